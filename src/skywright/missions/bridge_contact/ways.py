"""Straight paths of a contact inspection: from the start to the survey, the spots, and back."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.bridge_contact.sliding import find_way
from skywright.missions.bridge_contact.stations import Station
from skywright.missions.bridge_contact.survey import SurveyWay
from skywright.missions.bridge_contact.task import BridgeContact
from skywright.models.contact_stance import ContactStance
from skywright.models.geometry import ClearanceQuery, compute_clearance
from skywright.models.rigid_body import posture
from skywright.run.setup import Setup

BEFORE = 0.05  # m, off the surface, where clearance is checked: only the tip may touch
WAY, TURN, NEAR, SLIDE = (
    "mission.task.way_clearance_m", "mission.task.turn_clearance_m",
    "mission.task.near_clearance_m", "half of mission.task.near_clearance_m",
)  # fmt: skip
STEPS = 25
"""Number of poses that are checked on one path: each differs by a few degrees."""


def check_way(
    setup: Setup[BridgeContact], stations: list[Station], free: ContactStance | None,
    q_ready: Array, stand_off: float, survey: SurveyWay | None,
) -> str:  # fmt: skip
    """Return what blocks the path from the hover point to the stations, or ""."""
    d, task, query = setup.description, setup.task, setup.clearance_aloft
    wide, near = task.way_clearance_m, task.near_clearance_m
    lowest = d.robot.platform.gear_height_m + wide
    last, folded = setup.hover[:3], posture(d.robot, "folded")
    for s in stations:
        q, p = (q_ready, s.p_dock) if task.dock else (free.q if free else folded, s.p_press)
        stand = p + stand_off * s.normal
        if stand[2] < lowest:
            return _tell_low(f"{s.name}: the stand-off position", stand[2], lowest)
        for u in np.linspace(0.0, 1.0, 12):
            at = last + u * (stand - last)
            blocked = _find_near(query, at, s.R_level, q, wide, WAY, s.name)
            if blocked:
                return blocked
        q = q if task.dock else folded
        blocked = _find_near(query, p + BEFORE * s.normal, s.R_approach, q, near, NEAR, s.name)
        if blocked:
            return blocked
        if free and task.slide_m:
            assert d.world.structure is not None
            far = s.p_press + BEFORE * s.normal + find_way(task, d.world.structure)
            if far[2] < lowest:
                return _tell_low(f"{s.name}: the end of the slide", far[2], lowest)
            for u in np.linspace(0.0, 1.0, 12):
                at = far - u * find_way(task, d.world.structure)
                blocked = _find_near(query, at, s.R_approach, free.q, 0.5 * near, SLIDE, s.name)
                if blocked:
                    return f"on the slide, {blocked}"
        last = stand
    for s in () if survey is None else survey.stops:
        assert free is not None and survey is not None
        at = s.p_press + survey.stand_off * s.normal
        blocked = _find_near(query, at, s.R_approach, free.q, near, NEAR, s.name)
        if blocked:
            return blocked
    if free is not None and d.world.structure is not None and d.world.structure.facing == "side":
        return _check_turns(setup, stations, free, stand_off, survey)
    return ""


def _check_turns(
    setup: Setup[BridgeContact], stations: list[Station], free: ContactStance, stand_off: float,
    survey: SurveyWay | None,
) -> str:  # fmt: skip
    """Return what the robot would hit while it turns on its straight paths around a structure, or
    ""."""
    folded, keeps = posture(setup.robot, "folded"), setup.task.turn_clearance_m
    home = ("the way home", setup.hover[:3], float(setup.hover[3]), folded)
    stops = [home]
    if survey is not None and survey.stations:
        first = survey.stops[0]
        back = ("the way to the survey", first.p_press + stand_off * first.normal, first.yaw,
                free.q)  # fmt: skip
        stops.append(back)
    stops += [(s.name, s.p_press + stand_off * s.normal, s.yaw, free.q) for s in stations]
    for (_, p0, yaw0, q0), (name, p1, yaw1, q1) in pairwise([*stops, home]):
        turn = math.remainder(yaw1 - yaw0, 2 * math.pi)
        for u in np.linspace(0.0, 1.0, STEPS):
            R = np.ascontiguousarray(rot_z(yaw0 + u * turn))
            q = np.ascontiguousarray(q0 + u * (q1 - q0))
            at = p0 + u * (p1 - p0)
            blocked = _find_near(setup.clearance_aloft, at, R, q, keeps, TURN, name)
            if blocked:
                return f"{blocked}; set mission.start_x_m, start_y_m and start_yaw_deg before it"
    return ""


def _tell_low(what: str, z: float, lowest: float) -> str:
    return f"{what} would be {z:.2f} m above the ground; lowest: {lowest:.2f} m ({WAY})"


def _find_near(
    query: ClearanceQuery, p: Array, R: Array, q: Array, least: float, key: str, name: str
) -> str:
    found = compute_clearance(query, p, R, q)
    if found.distance >= least:
        return ""
    pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
    return (
        f"{name}: {pair} come within {max(found.distance, 0.0):.3f} m at ({p[0]:.2f}, "
        f"{p[1]:.2f}, {p[2]:.2f}) m; required clearance: {least:g} m ({key})"
    )
