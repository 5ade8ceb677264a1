"""Metrics of the kind "arm-test-bench": metrics of a press for a clamped platform."""

from skywright.missions.bridge_contact.metrics import HOLD
from skywright.missions.bridge_contact.metrics import compute_bench_metrics as compute_metrics
from skywright.run.kind import Measures

__all__ = ["MEASURES", "WHERE", "compute_metrics"]

MEASURES: Measures = {}
WHERE = {"force.": HOLD}
