"""Time that a contact inspection takes in addition to its moves: touches, presses, waits."""

import numpy as np

from skywright.missions.bridge_contact.fly import SEAT_S, SETTLE_S, UNSEAT_S
from skywright.missions.bridge_contact.plan import ContactPlan
from skywright.missions.bridge_contact.seat import compute_seat_s
from skywright.missions.bridge_contact.survey import SurveyWay
from skywright.missions.bridge_contact.task import BridgeContact, Contact
from skywright.missions.skills.datum import LOOK_S
from skywright.missions.skills.moves import compute_move_s
from skywright.missions.skills.pressing import GO_SPEED, compute_feet_lag, compute_press_s
from skywright.missions.skills.survey import compute_touch_s
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[BridgeContact], plan: MissionPlan[ContactPlan]) -> float:
    """Return the time (s) of touches, presses and waits."""
    return compute_contacts_s(setup, plan.get_way(), setup.task, setup.task.hold_s)


def compute_contacts_s(
    setup: Setup[BridgeContact], way: ContactPlan, task: Contact, hold: float
) -> float:
    """Return the duration (s) of all contacts, with measurements of `hold` (s) each."""
    each = 0.0
    if task.dock:
        press = compute_press_s(task, len(task.forces_n), hold, compute_feet_lag(setup.robot))
        reach = 2.0 * compute_move_s(0.0, 0.0, _find_bend(way), speed=GO_SPEED)
        each += SETTLE_S + SEAT_S + SETTLE_S + reach + press + UNSEAT_S
    if way.free_forces:
        each += SETTLE_S + compute_press_s(task, len(way.free_forces), hold)
        each += task.ramp_s + task.settle_s if task.slide_m else 0.0
    survey = 0.0 if way.survey is None else _sum_touches(way.survey, way)
    return len(way.stations) * each + survey


def _find_bend(way: ContactPlan) -> float:
    """Return the largest angle (rad) by which a joint moves to reach the surface when docked."""
    return float(np.max(np.abs(way.q_touch - way.q_ready)))


def _sum_touches(survey: SurveyWay, way: ContactPlan) -> float:
    if not survey.stations:
        return len(way.stations) * (SETTLE_S + compute_seat_s(way.stand_off))
    look = 0.0 if survey.mark is None else SETTLE_S + LOOK_S
    return look + len(survey.stations) * (SETTLE_S + compute_touch_s(survey.stand_off))
