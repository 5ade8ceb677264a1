"""Time that the trials on a bench take in addition to the travel between their stations."""

from skywright.missions.bimanual_bench.fly import (
    APART_S,
    ARRIVED_S,
    BAR_POSES,
    DRIFT_PERIODS,
    GRASP_S,
    LIFT_S,
    NEAR_S,
    PART_S,
    PULL_SPEED,
    SETTLE_S,
    START_S,
    TARE_S,
)
from skywright.missions.bimanual_bench.plan import BenchPlan
from skywright.missions.bimanual_bench.task import BimanualBench
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[BimanualBench], plan: MissionPlan[BenchPlan]) -> float:
    """Return the time (s) of the trials; a plug is assumed to come free at once."""
    task = setup.task
    works = {
        "squeeze": 2.0 * LIFT_S + task.hold_s,
        "unplug": task.unplug_threshold_m / PULL_SPEED + SETTLE_S,
        "bar": BAR_POSES * LIFT_S,
        "position-sensor": DRIFT_PERIODS * task.drift_period_s,
    }
    approach, grasp, leave = APART_S + TARE_S + NEAR_S, GRASP_S + SETTLE_S, GRASP_S + PART_S
    each = ARRIVED_S + approach + grasp + leave
    return START_S + sum(each + works[trial] for trial in task.trials)
