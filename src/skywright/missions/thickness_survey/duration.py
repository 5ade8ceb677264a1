"""Time that a thickness survey takes in addition to its moves: touches, readings, waits."""

from typing import Any, cast

from skywright.missions.bridge_contact.duration import compute_contacts_s
from skywright.missions.thickness_survey.plan import ThicknessWay
from skywright.missions.thickness_survey.task import ThicknessSurvey
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[ThicknessSurvey], plan: MissionPlan[ThicknessWay]) -> float:
    """Return the time (s) of touches and readings, if the first reading of each spot is accepted.

    A reading takes the least duration of steady values.
    """
    reading = setup.task.procedure.steady_s
    return compute_contacts_s(cast(Any, setup), plan.get_way().contact, setup.task, reading)
