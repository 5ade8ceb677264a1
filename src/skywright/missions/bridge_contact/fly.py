"""Press a probe on a structure: docked under a deck, or flying at a deck, wall, pillar or tunnel.

Sanchez-Cuevas et al. 2020, section 5.4: fly to the deck with position and attitude commanded
independently, dock, press with a profile of forces, undock, land. While docked the rotors carry
weight, press and a light load of the feet (models/docked_balance.py), the integrals are frozen, and
the friction of the rubber feet compensates the remaining force.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from skywright.core.arrays import Array
from skywright.missions.bridge_contact.motion import LEAVE_SPEED, NEAR_SPEED
from skywright.missions.bridge_contact.operated_press import HandPress
from skywright.missions.bridge_contact.plan import ContactPlan, plan_found
from skywright.missions.bridge_contact.seat import DEEP, touch_with_feet
from skywright.missions.bridge_contact.sliding import find_way
from skywright.missions.bridge_contact.stations import Station
from skywright.missions.bridge_contact.survey import SurveyWay, get_ball
from skywright.missions.bridge_contact.task import BridgeContact, Contact
from skywright.missions.bridge_contact.visits import APPROACH, DOCK, FREE_APPROACH, FREE_NEAR
from skywright.missions.skills.datum import SeenMark, look_at_datum
from skywright.missions.skills.operated import Lead
from skywright.missions.skills.pressing import TIP_GAP, Presser
from skywright.missions.skills.survey import TRIES, PressingTip, Touch, survey_surface
from skywright.missions.skills.surveyed_structure import fit_structure
from skywright.models.contact_stance import ContactStance
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

SEAT_S, UNSEAT_S = 2.0, 1.5  # s, in which the feet are loaded and unloaded
SETTLE_S = 1.0  # s, before and after a contact begins
TIP_FELT_N = 0.5
"""N, contact threshold of a tip on a spring; its sensor resolves hundredths of a newton."""
SEATED_M = 0.03  # m, estimated distance of the feet from the deck
SLIDE_NEAR, SLIDE_SHARE = 2e-3, 0.02
"""m, of the estimated tip from the end of a slide, and the same relative to a short slide."""
SLIDE_STEPS, SLIDE_STEP = 4, 0.03
"""Moves with which a tip that friction holds back is moved to the end, and the largest (m): at
friction 0.6 it stays 1 to 2 cm behind."""


# --- flight ---------------------------------------------------------------------------------------


def fly(s: Supervisor[BridgeContact], way: ContactPlan) -> Flight:
    """Survey the structure, inspect every station docked, then once more in flight."""
    pilot = Pilot(s, way, s.task)
    home = np.array(s.vehicle.reference)
    reason = beside = ""
    if way.survey is not None and way.survey.stations:
        reason = pilot.find_with_tip(way.survey)
    for i in range(len(way.stations)) if not reason else ():
        if way.survey is not None and not way.survey.stations:
            reason = pilot.find_with_feet(way.survey, i)
        if pilot.contact.dock and not reason:
            reason = pilot.inspect_docked(pilot.way.stations[i]) or ""
        free = pilot.way.free
        if not reason and free is not None and pilot.way.free_forces:
            told = pilot.inspect_flying(pilot.way.stations[i], free) or ""
            beside = beside or told
            reason = "" if pilot.contact.dock else told  # then it has no requirements
        if reason:
            break
    pilot.go("return", p=home["p_WB"], R=home["R_WB"], q=home["q"][: s.vehicle.n_joints])
    return Flight(not reason, reason or beside)


class Pilot(Presser):
    """The moves of this mission; each starts at the present reference."""

    def __init__(self, supervisor: Supervisor, way: ContactPlan, task: Contact) -> None:
        super().__init__(supervisor, task)
        self.way, self.contact = way, task
        operator = supervisor.operator
        self.lead = None if operator is None else Lead(supervisor, operator)

    def find_with_feet(self, survey: SurveyWay, i: int) -> str:
        """Touch the deck at station i with the feet and plan again; returns why it failed, or "".

        Touches at other stations are not used: the localisation's error has changed in the minutes
        since.
        """
        at = self.way.stations[i]
        stand = at.p_dock + self.way.stand_off * at.normal
        for _ in range(TRIES):
            self.go("survey_move", p=stand, R=at.R_level, q=self.way.q_ready)
            self.go(None, R=at.R_approach)
            self.s.wait(SETTLE_S)
            travel = self.way.stand_off + survey.reach
            touches = touch_with_feet(self.s, at.R_WS, survey.feet, travel, survey.stiffness)
            if not touches[0].reason or not touches[0].met:
                break
        self.go("survey_leave", R=at.R_level)
        return self._plan_found(survey, touches)

    def find_with_tip(self, survey: SurveyWay) -> str:
        """Touch the structure around the spots with the tip and plan again; returns like
        `find_with_feet`."""
        stance, first = self.way.free, survey.stops[0]
        assert stance is not None
        back = first.p_press + self.way.stand_off * first.normal
        self.go("survey_approach", p=back, R=first.R_level, q=stance.q)

        def stand_off(at: Station) -> None:
            self.go("survey_move", p=at.p_press + survey.stand_off * at.normal, R=at.R_approach,
                    speed=LEAVE_SPEED)  # fmt: skip

        mark = None
        if survey.mark is not None:
            stand_off(survey.mark)
            self.s.wait(SETTLE_S)
            seen = look_at_datum(self.s, survey.setup)
            if isinstance(seen, str):
                self.go("survey_leave", p=back, R=first.R_level, speed=LEAVE_SPEED)
                return seen
            mark = seen
        tip = PressingTip(self.s, True, TIP_FELT_N)
        travel = survey.stand_off + survey.reach + DEEP * TIP_FELT_N / survey.stiffness
        touches = survey_surface(
            self.s, tip, [at.R_WS for at in survey.stations], [travel] * len(survey.stations),
            lambda i, _: stand_off(survey.stations[i]), lambda: self.s.wait(SETTLE_S),
        )  # fmt: skip
        self.go("survey_leave", p=back, R=first.R_level, speed=LEAVE_SPEED)
        return self._plan_found(survey, touches, mark)

    def _plan_found(
        self, survey: SurveyWay, touches: list[Touch], mark: SeenMark | None = None
    ) -> str:
        """Fit the structure to the touches and plan again; returns why it failed, or ""."""
        ball = get_ball(survey.setup, len(survey.feet) > 0, self.s.vehicle.pose_std)
        found = fit_structure(survey.setup, touches, ball, mark)
        if found.reason:
            return found.reason
        plan = plan_found(survey.setup, found.structure)
        if not plan.feasible:
            return f"survey: no plan on the surveyed structure: {plan.blocked_by}"
        self.structure, self.way = found.structure, plan.get_way()
        return ""

    def inspect_docked(self, at: Station) -> str | None:
        """Dock, press, undock; returns the reason of a failure, or "".

        Returns None if an order left the contact out.
        """
        s, way = self.s, self.way
        rest, pressed = way.rest, way.pressed
        assert rest is not None and pressed is not None

        def load_feet(force: float) -> dict[str, Any]:
            u = force / way.largest
            return {
                "f_feet_B": (1.0 - u) * rest.f_feet + u * pressed.f_feet,
                "t_feet_B": (1.0 - u) * rest.t_feet + u * pressed.t_feet,
            }

        stand = at.p_dock + way.stand_off * at.normal
        self.go(APPROACH, p=stand, R=at.R_level, q=way.q_ready)
        self.go("align", R=at.R_approach)
        s.wait(SETTLE_S)
        reason = s.orders.attempt(at.name, lambda: self._press_docked(at, load_feet), None)
        self.go(None, R=at.R_level)
        return reason

    def _press_docked(self, at: Station, load_feet: Callable[[float], dict[str, Any]]) -> str:
        """Dock from below a station, press, undock; returns the reason of a failure, or ""."""
        s, way, task = self.s, self.way, self.contact
        stand = at.p_dock + way.stand_off * at.normal
        self.go(DOCK, p=at.p_dock, R=at.R_approach, speed=task.dock_speed_mps)
        self.go("seat", R=at.R_dock, least=SEAT_S, docked=1.0, **load_feet(0.0))
        s.wait(SETTLE_S)
        gap = float((at.p_dock - s.vehicle.estimate["p_WB"]) @ -at.normal)
        reason = ""
        if abs(gap) > SEATED_M:
            reason = f"{at.name}: the feet remained {100 * gap:.1f} cm off the deck"
        if not reason:
            self.go("reach", q=way.q_touch)
            reason = self.press(at.name, "docked", task.forces_n, "", load_feet)
            self.go("retract", q=way.q_ready)
        self.go("undock", least=UNSEAT_S, f_feet_B=np.zeros(3), t_feet_B=np.zeros(3))
        self.go(None, p=stand, R=at.R_approach, docked=0.0, speed=task.dock_speed_mps)
        return reason

    def inspect_flying(self, at: Station, stance: ContactStance) -> str | None:
        """Press in flight, slide if the task requires it; returns like `inspect_docked`."""
        task = self.contact
        back = at.p_press + self.way.stand_off * at.normal
        self.go(FREE_APPROACH, p=back, R=at.R_level, q=stance.q)
        self.go(None, R=at.R_approach)

        what = f"{at.name} in flight" if task.dock else at.name
        return self.s.orders.attempt(what, lambda: self._press_flying(at, back), None)

    def _press_flying(self, at: Station, back: Array) -> str:
        """Press, slide and leave, starting with the platform at `back` (3,) m in front of a
        station."""
        task = self.contact
        if self.lead is not None and isinstance(task, BridgeContact):
            return self._press_by_hand(at, back, self.lead, task)
        self.go(FREE_NEAR, p=at.p_press + TIP_GAP * at.normal, R=at.R_approach, speed=NEAR_SPEED)
        self.s.wait(SETTLE_S)
        slide = self._slide if task.slide_m else None
        reason = self.press(at.name, "flying", self.way.free_forces, "free ", then=slide)
        self.go("free leave", p=back, R=at.R_level, speed=LEAVE_SPEED)
        return reason

    def _press_by_hand(self, at: Station, back: Array, lead: Lead, task: BridgeContact) -> str:
        """Press with an operator at the stick, who applies one force and does not slide."""
        s = self.s
        self.go(FREE_NEAR, p=HandPress.place_before(at), R=at.R_approach, speed=NEAR_SPEED)
        s.wait(SETTLE_S)
        hand = HandPress(s, lead, at, task)
        reason = hand.fly()
        if not reason:
            s.begin(f"free hold {hand.exerts:.1f} N")
            self.measure_force(at.name, hand.exerts, "flying")
        self.set_force("free release", 0.0, task.ramp_s)
        self.go(None, press=0.0)
        self.go("free leave", p=back, R=at.R_level, speed=LEAVE_SPEED)
        return reason

    def _slide(self) -> None:
        """Move along the structure and back with the tip in contact.

        Friction displaces the robot: the tip stays behind the platform. At each end the platform
        continues by the remaining distance of the estimated tip, so that the tip covers the
        required length.
        """
        task = self.contact
        self.set_force("press to slide", task.slide_force_n, task.ramp_s)
        self.s.wait(task.settle_s)
        begin, length = self._locate_tip(), find_way(task, self.structure)
        stood = np.array(self.s.vehicle.reference["p_WB"])
        self._slide_to("slide", begin + length)
        self._slide_to("slide back", begin)
        if np.linalg.norm(self.s.vehicle.reference["p_WB"] - stood) > 2.0 * SLIDE_STEP:
            self.go(None, p=stood, speed=task.slide_speed_mps)  # the tip stuck: return the platform

    def _slide_to(self, phase: str, end: Array) -> None:
        """Slide until the estimated tip is at `end` (3,) along the path, or moves no farther."""
        task = self.contact
        name: str | None = phase
        way, along = end - self._locate_tip(), find_way(task, self.structure)
        near = min(SLIDE_NEAR, SLIDE_SHARE * abs(task.slide_m))
        along = along * math.copysign(1.0, along @ way) / np.linalg.norm(along)
        for speed in (task.slide_speed_mps, *[0.5 * task.slide_speed_mps] * SLIDE_STEPS):
            lacks = float(along @ (end - self._locate_tip()))
            if lacks < near and name is None:  # a tip that jumped past the end is not drawn back
                return
            step = lacks if name else min(lacks, SLIDE_STEP)
            at = np.array(self.s.vehicle.reference["p_WB"]) + step * along
            self.go(name, p=at, speed=speed)
            name = None

    def _locate_tip(self) -> Array:
        return np.array(self.s.vehicle.estimate["p_WT"])
