"""Duration of the straight moves of a contact inspection, as planned on the map."""

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.bridge_contact.stations import Station
from skywright.missions.bridge_contact.survey import SurveyWay
from skywright.missions.bridge_contact.task import BridgeContact
from skywright.missions.skills.moves import MoveSum, compute_move_s
from skywright.missions.skills.pressing import GO_SPEED, TIP_GAP
from skywright.models.contact_stance import ContactStance
from skywright.models.rigid_body import posture
from skywright.run.setup import Setup

NEAR_SPEED, LEAVE_SPEED = 0.1, 0.2  # m/s, to and from the surface in flight


def sum_moves(
    setup: Setup[BridgeContact], stations: list[Station], free: ContactStance | None,
    q_ready: Array, stand_off: float, survey: SurveyWay | None, presses: bool,
) -> float:  # fmt: skip
    """Return the duration (s) of the moves; `presses`: whether the robot presses in flight."""
    task, hover = setup.task, setup.hover
    home = hover[:3], rot_z(float(hover[3])), posture(setup.robot, "folded")
    pilot = MoveSum(*home, speed=GO_SPEED)
    if survey is not None and survey.stations:
        assert free is not None
        first = survey.stops[0]
        back = first.p_press + stand_off * first.normal
        pilot.go(back, first.R_level, free.q)
        for stop in survey.stops:
            before = stop.p_press + survey.stand_off * stop.normal
            pilot.go(before, stop.R_approach, speed=LEAVE_SPEED)
        pilot.go(back, first.R_level, speed=LEAVE_SPEED)
    for at in stations:
        stand = at.p_dock + stand_off * at.normal
        if survey is not None and not survey.stations:
            pilot.go(stand, at.R_level, q_ready)
            pilot.go(stand, at.R_approach)
            pilot.go(stand, at.R_level)
        if task.dock:
            pilot.go(stand, at.R_level, q_ready)
            pilot.go(stand, at.R_approach)
            pilot.go(at.p_dock, at.R_approach, speed=task.dock_speed_mps)
            pilot.go(stand, at.R_approach, speed=task.dock_speed_mps)
            pilot.go(stand, at.R_level)
        if free is not None and presses:
            back = at.p_press + stand_off * at.normal
            pilot.go(back, at.R_level, free.q)
            pilot.go(back, at.R_approach)
            pilot.go(at.p_press + TIP_GAP * at.normal, at.R_approach, speed=NEAR_SPEED)
            if task.slide_m:
                slide = compute_move_s(abs(task.slide_m), speed=task.slide_speed_mps)
                pilot.seconds += 2.0 * slide
            pilot.go(back, at.R_level, speed=LEAVE_SPEED)
    pilot.go(*home)
    return pilot.seconds
