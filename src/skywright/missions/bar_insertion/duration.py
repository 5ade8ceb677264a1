"""Time that an insertion takes in addition to its moves: survey, grasp, alignment, insertion."""

from skywright.missions.bar_insertion.fly import RELEASE_S
from skywright.missions.bar_insertion.insertion import SURVEY_S
from skywright.missions.bar_insertion.plan import InsertionPlan
from skywright.missions.bar_insertion.task import BarInsertion
from skywright.missions.skills.moves import compute_move_s
from skywright.missions.skills.tool_handling import DROP, LIFT, STEADY_S
from skywright.missions.skills.tool_motion import Speeds, compute_take_up_s
from skywright.models.things.peg import Peg
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

ALIGN_S = 8.0
"""s, for which the peg waits over the hole: it is lowered once the bar is calm, 12 s at most."""


def compute_added_s(setup: Setup[BarInsertion], plan: MissionPlan[InsertionPlan]) -> float:
    """Return the time (s) of survey, grasp, and an insertion that succeeds at once."""
    task, peg = setup.task, setup.world.find_thing(setup.task.bar, Peg)
    take = STEADY_S + compute_take_up_s(Speeds(task.hand_speed_mps, task.lift_speed_mps))
    lower = ALIGN_S + (LIFT + peg.length_m) / task.lower_speed_mps
    release = RELEASE_S + compute_move_s(DROP, speed=task.hand_speed_mps) + STEADY_S
    return SURVEY_S + take + lower + release
