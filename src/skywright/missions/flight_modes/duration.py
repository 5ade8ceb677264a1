"""Time that the flight modes take in addition to their planned motion."""

from skywright.missions.flight_modes.fly import STEADY_S, TAKE_OVER_S
from skywright.missions.flight_modes.plan import ModesPlan
from skywright.missions.flight_modes.task import ModesTask
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[ModesTask], plan: MissionPlan[ModesPlan]) -> float:
    """Return the time (s) of the holds, and of the return after standard stabilisation."""
    task = setup.task
    holds = 2.0 * (4.0 * task.hold_s + STEADY_S)
    calm = STEADY_S + 3.0 * task.standard_s + TAKE_OVER_S + task.hold_s
    return holds + (calm if plan.get_way().calm else 0.0)
