"""Metrics of the kind "follow-plan": those of a transport, of whatever is carried."""

from skywright.missions.bar_transport.metrics import MEASURES, WHERE, compute_metrics

__all__ = ["MEASURES", "WHERE", "compute_metrics"]
