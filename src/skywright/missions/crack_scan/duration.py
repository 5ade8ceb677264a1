"""Time that a crack search takes in addition to its planned motion."""

from skywright.missions.crack_scan.plan import CrackWay
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.duration import compute_rests_s
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[CrackScan], plan: MissionPlan[CrackWay]) -> float:
    """Return the time (s) of touches and rests; a second scan of missed parts is not included."""
    return compute_rests_s(setup, plan.segments, plan.get_way().scan.survey)
