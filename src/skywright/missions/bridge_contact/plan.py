"""Press a probe on a structure: docked under a deck, or flying at a deck, wall, pillar or tunnel.

Sanchez-Cuevas et al. 2020, section 5.4: fly to the deck with position and attitude commanded
independently, dock, press with a profile of forces, undock, land. While docked the rotors carry
weight, press and a light load of the feet (models/docked_balance.py), the integrals are frozen, and
the friction of the rubber feet compensates the remaining force.
"""

import math
import time
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import exp_so3
from skywright.description.loader import Description
from skywright.description.world.structure import Structure
from skywright.description.world.wind import compute_direction, compute_speed
from skywright.errors import InputError
from skywright.missions.bridge_contact.borne import check_borne, refuse
from skywright.missions.bridge_contact.motion import sum_moves
from skywright.missions.bridge_contact.sliding import (
    check_mobility,
    check_slide_ends,
    check_wobble,
    compute_sliding_press,
)
from skywright.missions.bridge_contact.stations import Station, build_station
from skywright.missions.bridge_contact.survey import SurveyWay, plan_survey
from skywright.missions.bridge_contact.task import BridgeContact
from skywright.missions.bridge_contact.ways import check_way
from skywright.missions.skills.operated import load_operator
from skywright.missions.skills.pressing import TIP_GAP, check_can_press
from skywright.missions.skills.surveyed import get_map_error, is_surveyed
from skywright.models.contact_stance import (
    ContactStance,
    check_lever,
    compute_flying_press,
    find_free_stance,
    find_tip_pose,
)
from skywright.models.docked import build_docked, compute_drag, find_stance
from skywright.models.docked_balance import MARGIN, DockedBalance, compute_docked_balance
from skywright.models.docked_map import DIRECTIONS, Condition, compute_worst_press
from skywright.models.rigid_body import compute_tip, posture
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

READY_GAP = 0.04  # m, of the tip below the feet while docking
FOOT_LOADS = (1.0, 0.75, 0.5)  # N, least load of each foot: the largest that the rotors allow


class ContactPlan(NamedTuple):
    """Poses, balances and forces of the mission."""

    stations: list[Station]
    q_ready: Array  # rad, tip below the feet
    q_touch: Array  # rad, tip TIP_GAP below the surface while docked
    dock_tip: Array  # (3,) m in B, contact point of the docked tip
    free: ContactStance | None
    rest: DockedBalance | None  # docked, not pressing
    pressed: DockedBalance | None  # docked, at the largest force
    largest: float  # N, largest force of the profile
    limit_n: float  # N, computed docked press here
    borne_n: float  # N, docked press withstood with the plant's errors; NaN: not computed
    free_limit_n: float  # N, computed press in flight
    free_forces: list[float]  # N, forces of the profile that are allowed in flight
    stand_off: float  # m, of feet or tip from the surface before the approach
    survey: SurveyWay | None = None


def plan(setup: Setup[BridgeContact]) -> MissionPlan[ContactPlan]:
    """Plan according to the map."""
    return _plan_on(setup, is_surveyed(setup), _is_level(setup))


def plan_found(setup: Setup[BridgeContact], structure: Structure) -> MissionPlan[ContactPlan]:
    """Plan again with the surveyed structure."""
    world = setup.world.model_copy(update={"structure": structure})
    found = Setup(setup.description._replace(world=world))
    return _plan_on(found, False, _is_level(setup))


def _is_level(setup: Setup[BridgeContact]) -> bool:
    """Return whether the structure is known to have no slope."""
    s = setup.world.structure
    return s is not None and s.slope_deg == 0.0 and get_map_error(setup).turn == 0.0


def _plan_on(setup: Setup[BridgeContact], surveyed: bool, level: bool) -> MissionPlan[ContactPlan]:
    """Place the robot, compute the allowed press, check the path; `level`: the deck is known to be
    level."""
    d, robot, task = setup.description, setup.robot, setup.task
    structure = _check(d, task)
    began = time.perf_counter()
    model = setup.model
    working = posture(robot, "working")
    free = None
    if not task.dock or task.without_gear:
        free = find_free_stance(robot, structure.facing)
        check_lever(robot, free)
    dock_tip, q_ready, q_touch = np.full(3, math.nan), working, working
    if robot.docking is not None and structure.facing == "down":
        tip = compute_tip(model, working)[0]
        dock_tip = np.array([tip[0], tip[1], robot.docking.height_m])
        q_ready = find_tip_pose(model, working, dock_tip - [0.0, 0.0, READY_GAP])
        q_touch = find_tip_pose(model, working, dock_tip - [0.0, 0.0, TIP_GAP])
    q_hover = q_ready if task.dock else free.q if free else working

    def stand(place: Array, name: str) -> Station:
        return build_station(d, place, name, dock_tip, free, q_hover, bool(task.slide_m))

    stations = [
        stand(np.array([spot.x_m, spot.y_m]), spot.name or f"spot {i + 1}")
        for i, spot in enumerate(task.spots)
    ]
    survey, stand_off, unsure = None, task.stand_off_m, 0.0
    if surveyed:
        survey = plan_survey(setup, stations, stand, q_ready)
        stand_off = max(stand_off, survey.stand_off)
        # heading and slope each have an error up to the bound
        unsure = math.sqrt(2.0) * get_map_error(setup).turn if structure.facing == "down" else 0.0
    blocked, largest = _check_hover(d, stations), max(task.forces_n)
    limit = borne = free_limit = math.nan
    rest = pressed = None
    if task.dock and not blocked:
        limit, borne, rest, pressed, blocked = _plan_docked(d, task, stations[0], unsure, level)
    free_forces: list[float] = []
    if free is not None:
        held = [R for s in stations for R in _tilt(s.R_dock, unsure)]
        free_limit, free_forces, refused = _plan_flying(d, task, structure, free, held)
        blocked = blocked or refused
    if free is not None and not task.dock and not blocked:
        blocked = _check_tilt(stations, unsure, task.tilt_fraction)
    if not blocked:
        blocked = check_way(setup, stations, free, q_ready, stand_off, survey)
    found = ContactPlan(
        stations, q_ready, q_touch, dock_tip, free, rest, pressed, largest, limit, borne,
        free_limit, free_forces, stand_off, survey,
    )  # fmt: skip
    total = sum_moves(setup, stations, free, q_ready, stand_off, survey, bool(free_forces))
    return MissionPlan(
        not blocked, blocked or None, time.perf_counter() - began, total, math.nan, math.nan, {},
        found, operator=load_operator(task) if isinstance(task, BridgeContact) else None,
    )  # fmt: skip


def _check(d: Description, task: BridgeContact) -> Structure:
    """Raise InputError if robot, world or law lack what the mission requires."""
    robot, structure = d.robot, d.world.structure
    if structure is None:
        raise InputError(
            f"world {d.world.name!r} has no structure to inspect: add [world.structure], "
            "see worlds bridge, tunnel and test-bench"
        )
    check_can_press(robot, d.mission)
    if task.dock and structure.facing != "down":
        raise InputError(
            "docking requires a structure that faces down; this one faces sideways: set "
            "mission.task.dock=false"
        )
    if task.dock and robot.docking is None:
        raise InputError(
            f"robot {robot.name!r} has no docking gear: set mission.task.dock=false, or "
            "add a [robot.docking] table"
        )
    for i, spot in enumerate(task.spots):
        half = structure.half_extents
        if any(abs(getattr(spot, key)) > most for key, most in half.items()):
            reaches = " and ".join(f"{most:g} m along {key[0]}" for key, most in half.items())
            raise InputError(
                f"mission.task.spots[{i}] = ({spot.x_m:g}, {spot.y_m:g}) m lies beside the "
                f"structure, which reaches {reaches}"
            )
    check_slide_ends(task, structure)
    return structure


def _plan_docked(
    d: Description, task: BridgeContact, station: Station, unsure: float, level: bool
) -> tuple[float, float, DockedBalance | None, DockedBalance | None, str]:
    """Return the computed and the withstood press (N), balances at zero and full force, a refusal.

    `unsure` (rad) is the largest difference of the slope from the map's. The margin is smaller for
    a deck that is known to be `level`.
    """
    largest = max(task.forces_n)
    robot, world, structure = d.robot, d.world, d.world.structure
    assert structure is not None
    docked = build_docked(robot, gravity=world.gravity_mps2, air_density=world.air_density_kg_m3)
    stance = find_stance(docked)
    slope, speed = math.radians(structure.slope_deg) + unsure, compute_speed(world.wind)
    rises = math.radians(structure.slope_toward_deg) - station.yaw if unsure == 0.0 else None
    blows = compute_direction(world.wind)
    condition = Condition(
        slope, rises, speed, math.atan2(blows[1], blows[0]) - station.yaw if speed else None
    )
    limit = compute_worst_press(docked, stance, condition).force
    calm = level and speed == 0.0
    fraction = task.calm_fraction if calm else task.force_fraction
    if not largest <= fraction * limit * (1.0 + 1e-9):  # true for NaN: the robot cannot stay docked
        where = f"docked at {math.degrees(slope):.3g} deg and {speed:.1f} m/s of wind"
        return limit, math.nan, None, None, refuse(
            largest, limit, fraction, where, robot.name,
            "calm_fraction" if calm else "force_fraction",
        )  # fmt: skip
    share = np.full(len(docked.layout.t_max), stance.mass * world.gravity_mps2)
    drag = compute_drag(docked, station.R_dock.T @ (speed * blows), share / len(share))
    best: tuple[DockedBalance, DockedBalance] | None = None
    for load in FOOT_LOADS:
        rest, pressed = (
            compute_docked_balance(
                docked, stance, force, R_WB=station.R_dock, foot_load=load, drag_B=drag
            )
            for force in (0.0, largest)
        )
        if rest and pressed and (best is None or pressed.margin > best[1].margin + 1e-6):
            best = rest, pressed
        if best is not None and best[1].margin >= MARGIN:
            break
    if best is not None:
        borne, refusal = math.nan, ""
        if unsure == 0.0 and not calm:
            borne, refusal = check_borne(d, largest, station, drag)
        return limit, borne, *best, refusal
    refusal = (
        f"no balance of rotors and feet at {largest:g} N keeps {FOOT_LOADS[-1]:g} N on each foot "
        f"and the rotors below {robot.rotors.thrust_fraction:.0%} of their thrust "
        "(robot.rotors.thrust_fraction): lower mission.task.forces_n"
    )
    return limit, math.nan, None, None, refusal


def _plan_flying(
    d: Description, task: BridgeContact, structure: Structure, free: ContactStance,
    held: list[Array],
) -> tuple[float, list[float], str]:  # fmt: skip
    """Return the computed press (N), the forces of the profile within it, and any refusal.

    `held` are the attitudes at which the press may take place.
    """
    robot, g, rho = d.robot, d.world.gravity_mps2, d.world.air_density_kg_m3
    speed, fraction = compute_speed(d.world.wind), task.force_fraction
    wind, air = speed * compute_direction(d.world.wind), f" in {speed:.1f} m/s of wind"
    limit = float(np.min([
        compute_flying_press(robot, free, R, g, wind=wind, air_density=rho) for R in held
    ]))  # fmt: skip
    forces, blocked = [f for f in task.forces_n if f <= fraction * limit], ""
    if not task.dock and len(forces) < len(task.forces_n):
        where = "in flight" + (air if speed else "")
        blocked = refuse(max(task.forces_n), limit, fraction, where, robot.name)
    elif task.slide_m:
        most = float(np.min([
            compute_sliding_press(robot, free, R, g, structure, wind=wind, air_density=rho)
            for R in held
        ]))  # fmt: skip
        if not task.slide_force_n <= fraction * most:
            where = f"sliding at friction {structure.friction:g}" + (air if speed else "")
            blocked = refuse(task.slide_force_n, most, fraction, where, robot.name)
        else:
            blocked = check_wobble(robot, d.world.localisation, task, fraction * most)
            for R in held:
                least = task.mobility_fraction
                blocked = blocked or check_mobility(robot, free, R, g, structure, least)
    return limit, forces, blocked


def _check_hover(d: Description, stations: list[Station]) -> str:
    if any(math.isnan(s.tilt_limit) for s in stations):
        speed = compute_speed(d.world.wind)
        return f"{d.robot.name} cannot hover level in {speed:.1f} m/s of wind (capability)"
    return ""


def _tilt(R: Array, angle: float) -> list[Array]:
    """Return an attitude, and for an `angle` (rad) > 0 also the attitude tilted by it in eight
    directions."""
    out, turn = [R], np.empty((3, 3))
    for side in DIRECTIONS if angle > 0.0 else ():
        exp_so3(angle * np.array([math.cos(side), math.sin(side), 0.0]), turn)
        out.append(R @ turn)
    return out


def _check_tilt(stations: list[Station], unsure: float, fraction: float) -> str:
    for s in stations:
        angle = math.acos(min(max(float(s.R_dock[2, 2]), -1.0), 1.0)) + unsure
        if angle > fraction * s.tilt_limit * (1.0 + 1e-9):
            return (
                f"{s.name}: the surface requires a tilt of {math.degrees(angle):.1f} deg "
                f"in flight; {fraction:.0%} (mission.task.tilt_fraction) of the computed "
                f"hover limit is {math.degrees(fraction * s.tilt_limit):.1f} deg"
            )
    return ""
