"""Time that an excitation flight takes in addition to its planned motion."""

from skywright.missions.excitation.fly import REST_S
from skywright.missions.excitation.task import ExcitationTask
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[ExcitationTask], plan: MissionPlan[None]) -> float:
    """Return the time (s) of the rests."""
    return REST_S * len(plan.segments)
