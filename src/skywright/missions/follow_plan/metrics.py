"""Metrics of the kind "follow-plan": those of a transport, with or without a load."""

from skywright.missions.bar_transport.metrics import MEASURES, WHERE, compute_metrics

__all__ = ["MEASURES", "WHERE", "compute_metrics"]
