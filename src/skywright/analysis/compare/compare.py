"""Compare two robots: first quasi-static values, then flights."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from skywright.analysis.campaign.jobs import Job, check_places, fly_jobs
from skywright.analysis.compare import geometry as shapes
from skywright.analysis.compare.comparison import Comparison, Install, Side, TorqueMap
from skywright.analysis.compare.flown import (
    WINDS,
    build_hover,
    fly_collision,
    fly_install,
    hover_once,
    list_collisions,
)
from skywright.analysis.compare.table import build_rows, judge_statements
from skywright.core.arrays import Array
from skywright.core.keys import parse_assignment
from skywright.description.loader import Description, load_description
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.errors import InputError, SkywrightError
from skywright.missions.sensor_install.plan import build_pose
from skywright.models.capability import check_can_fly, compute_capability
from skywright.models.compliant_arms import find_hands, find_swing
from skywright.models.reach import compute_reach
from skywright.models.rigid_body import build_body_model, posture
from skywright.models.tip_force import Loaded, compute_reaction_map

Step = Callable[[str], None]

MISSION = "sensor-install"
FORCE = 2.0  # N, at the hand (Suarez 2020, section VI-B)
AZIMUTH, ELEVATION = np.radians(np.arange(0, 361, 10)), np.radians(np.arange(-90, 91, 10))
INSTALL = {
    "install.force_error_n": "force.rms_error_n",
    "install.tip_mm": "tip.hover_rms_mm",
    "install.excursion_m": "platform.excursion_m",
    "install.swing_decay_s": "swing.decay_s",
}
"""Row -> metric of sensor-install."""
COLLISIONS = {
    "hand": {f"impact.{k}": f"impact.{k}"
             for k in ("peak_torque_nm", "peak_force_n", "contact_force_n", "recoil_deg")},
    "hand, stiff joints": {"impact.stiff_torque_nm": "impact.peak_torque_nm"},
    "passive link": {"impact.link_torque_nm": "impact.peak_torque_nm",
                     "impact.link_force_n": "impact.peak_force_n"},
}  # fmt: skip
"""Impacting part -> row -> metric of impact."""


def compare_robots(
    first: str, second: str, *, sets: Sequence[str] = (), fly: bool = True, seeds: int = 2,
    step: Step | None = None, workers: int | None = None, ray: str | None = None,
) -> Comparison:  # fmt: skip
    """Compare two robots with arms, given by name or file.

    `sets` change the world of the mission sensor-install (`world.*`); `seeds` is the number of
    flights per wind speed. The flights run one after the other, on `workers` processes, or on a Ray
    cluster (`ray`, as for a campaign), with the same result. Raises InputError for unknown robots,
    robots without an arm, and if both robots are the same.
    """
    for text in sets:
        key, _ = parse_assignment(text)
        if not key.startswith("world."):
            raise InputError(f"--set {text}: compare changes the world only; valid: world.*")
    if seeds < 1:
        raise InputError(f"--seeds {seeds}: at least 1 is needed")
    check_places(1, workers, ray)
    loaded = [load_description(MISSION, name, sets=list(sets)) for name in (first, second)]
    for d in loaded:
        if d.robot.arm is None:
            raise InputError(
                f"robot {d.robot.name!r} has no arm; compare requires robots with arms"
            )
        check_can_fly(d.robot, d.world.gravity_mps2)
    if loaded[0].robot == loaded[1].robot:
        raise InputError(f"{first!r} and {second!r} are the same robot: give two different ones")
    if loaded[0].world.pipe is None:
        raise InputError("the comparison requires world.pipe")
    tell: Step = step or (lambda text: None)
    a, b = [measure(d, tell) for d in loaded]
    if a.name == b.name:  # files that describe variants of one robot
        a, b = a._replace(name=first), b._replace(name=second)
    if fly:
        named = list(zip((a, b), loaded, (first, second), strict=True))
        asked = [job for side, d, name in named for job in list_flights(side, d, name, seeds)]
        jobs = [job._replace(number=i) for i, job in enumerate(asked)]
        found = fly_jobs(jobs, workers=workers, ray=ray, step=tell)
        half = len(list_flights(*named[0], seeds))
        a, b = [
            add_flights(side, answers)
            for (side, *_), answers in zip(named, (found[:half], found[half:]), strict=True)
        ]
    rows = build_rows(a, b)
    world = loaded[0].world
    return Comparison(
        (a, b), rows, judge_statements((a, b), rows), world.name, tuple(sets), seeds if fly else 0
    )


def measure(d: Description, step: Step) -> Side:
    """Compute the values that need no flight."""
    robot, values, notes = d.robot, {}, {}
    q = work_pose(d)
    step(f"{robot.name}: clearance")
    way = None
    try:
        way = shapes.measure_way(d)
        values["clearance.propellers_m"] = float(np.min(way.propellers))
        values["clearance.gear_m"] = float(np.min(way.gear))
        if way.blocked_by:
            notes["clearance.propellers_m"] = f"no plan: {way.blocked_by}" + (
                "; below zero they would overlap"
                if min(values["clearance.propellers_m"], values["clearance.gear_m"]) < 0.0
                else ""
            )
    except SkywrightError as error:
        notes["clearance.propellers_m"] = notes["clearance.gear_m"] = f"does not apply: {error}"
    step(f"{robot.name}: reach")
    reach = compute_reach(robot, d.world)
    values |= {
        "reach.surface_share": reach.surface_share, "reach.below_share": reach.below_share,
        "reach.area_below_m2": reach.area_below,
    }  # fmt: skip
    hanging = shapes.hang(robot)
    hand = find_hands(build_body_model(robot), q)[0]
    diameter = 2.0 * robot.rotors.propeller_radius_m
    height = float(np.mean(robot.rotors.heights))
    values["access.rotor_diameters"] = (height - float(hand[2])) / diameter
    values["access.depth_m"] = shapes.measure_access(robot, hanging)
    step(f"{robot.name}: force on a hand")
    reaction = measure_force(robot, q, values, notes)
    c = compute_capability(robot, posture=q, gravity=d.world.gravity_mps2)
    values |= shapes.measure_agility(robot, q, c.torque_polytope)
    values |= {
        "mass_kg": c.body.mass, "power.hover_w": c.hover_power,
        "power.endurance_min": c.endurance / 60.0, "power.payload_kg": c.payload,
        "ground.height_m": shapes.measure_height(robot, q),
    }  # fmt: skip
    offset, share = shapes.measure_take_off(robot)
    values |= {"ground.offset_m": offset, "ground.thrust_share": share}
    if robot.pendulum is None:
        notes["control.swing_period_s"] = notes["recoil.swing_deg"] = "has no passive link"
    return Side(robot.name, robot, values, notes, way, reach, reaction, [], None)


def work_pose(d: Description) -> Array:
    """Return q (n_joints,) rad: forearms level as in sensor-install if the robot can fly it."""
    assert d.world.pipe is not None
    try:
        q = build_pose(d.robot, "L", 0.5 * d.world.pipe.diameter_m)
    except InputError:
        q = posture(d.robot, "working")
    return np.array(find_swing(build_body_model(d.robot, d.world.gravity_mps2), q))


def measure_force(robot: Robot, q: Array, values: dict[str, float], notes: Any) -> TorqueMap:
    """Add the effects of a force on the hand to `values` and return the torque map."""
    arms = Loaded(robot, q)
    torque, swing = compute_reaction_map(arms, FORCE, AZIMUTH, ELEVATION)
    for axis, name in enumerate(("roll", "pitch", "yaw")):
        values[f"reaction.{name}_m"] = float(np.nanmax(np.abs(torque[..., axis])))
    found = [arms.compute_recoil(FORCE * s * way) for way in np.eye(3) for s in (1.0, -1.0)]
    known = [r for r in found if r is not None]
    if known:
        values["recoil.tip_mm"] = 1e3 * max(float(np.linalg.norm(r.moved)) for r in known)
        values["recoil.deflection_deg"] = math.degrees(max(r.deflection for r in known))
        if robot.pendulum is not None:
            values["recoil.swing_deg"] = math.degrees(max(abs(r.swing) for r in known))
    if not any(x.link.flex_stiffness_nm_per_rad for x in list_joints(robot)):
        notes["recoil.deflection_deg"] = notes["recoil.tip_mm"] = "no springs in its joints"
    return TorqueMap(AZIMUTH, ELEVATION, torque, swing, FORCE)


def list_flights(side: Side, d: Description, name: str, seeds: int) -> list[Job]:
    """Return the flights of a robot: sensor-install if it has a plan, collisions, hovers."""
    jobs = []
    if _has_way(side):
        jobs.append(Job(0, f"{d.robot.name}: sensor-install", fly_install, (d,)))
    jobs += [
        Job(0, f"{name}: collision, {what}", fly_collision, (name, what))
        for what in list_collisions(*_find_parts(side.robot))
    ]
    pose = side.way.q if side.way is not None else posture(side.robot, "working")
    jobs += [
        Job(
            0, f"{name}: hover in {wind:g} m/s, seed {k + 1}", hover_once, (name, pose, wind, k + 1)
        )
        for wind in WINDS
        for k in range(seeds)
    ]
    return jobs


def _has_way(side: Side) -> bool:
    return side.way is not None and not side.way.blocked_by


def _find_parts(robot: Robot) -> tuple[bool, bool]:
    """Return whether the joints have springs and whether the robot has a passive link."""
    springs = any(x.link.flex_stiffness_nm_per_rad for x in list_joints(robot))
    return springs, robot.pendulum is not None


def add_flights(side: Side, found: Sequence[Any]) -> Side:
    """Add the results of the flights of `list_flights`."""
    values, notes, rest = dict(side.values), dict(side.notes), list(found)
    not_flown = Install({}, math.nan, math.nan, "not flown, no feasible path")
    install = rest.pop(0) if _has_way(side) else not_flown
    add_install(install, values, notes)
    springs, link = _find_parts(side.robot)
    names = list_collisions(springs, link)
    collisions, rest = rest[: len(names)], rest[len(names) :]
    for c in collisions:
        for row, metric in COLLISIONS[c.what].items():
            values[row] = c.metrics.get(metric, math.nan)
            if c.reason:
                notes[row] = c.reason
    if not springs:
        notes["impact.stiff_torque_nm"] = "its joints have no springs"
    if not link:
        notes["impact.link_torque_nm"] = notes["impact.link_force_n"] = "has no passive link"
    hover = build_hover(rest)
    for key, table, i in (("tip_calm", hover.tip, 0), ("tip_wind", hover.tip, -1),
                          ("platform_wind", hover.platform, -1)):  # fmt: skip
        row = table[i]
        values[f"accuracy.{key}_mm"] = 1e3 * float(np.sqrt(np.mean(row**2)))
        lost = int(np.count_nonzero(np.isnan(row)))
        if lost:
            notes[f"accuracy.{key}_mm"] = f"control was lost in {lost} of {len(row)} flights"
    return side._replace(
        values=values, notes=notes, collisions=collisions, hover=hover, install=install
    )


def add_install(found: Install, values: dict[str, float], notes: dict[str, str]) -> None:
    """Add the results of sensor-install; note why a value is missing."""
    values["install.propellers_m"], values["install.gear_m"] = found.propellers, found.gear
    for key, metric in INSTALL.items():
        values[key] = found.metrics.get(metric, math.nan)
    for key in ("install.propellers_m", "install.gear_m", *INSTALL):
        if found.reason and not math.isfinite(values[key]):
            notes[key] = found.reason
    if found.reason and found.metrics:
        notes["install.propellers_m"] = found.reason
