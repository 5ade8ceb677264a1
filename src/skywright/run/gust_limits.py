"""Tilt and motion of a platform in wind and gusts, and whether a mission permits them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import exp_so3, rot_z
from skywright.description.world.wind import compute_mean_wind, compute_speed
from skywright.models.capability import build_drag_body
from skywright.models.statics import build_layout
from skywright.models.wind import compute_hold
from skywright.run.limits import find_gusts
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.gusts import GustMotion

STEPS = 12  # of the bisection for the largest wind


def find_stances(
    setup: Setup[Any], yaw: float, q: Array, braking: float
) -> list[tuple[Array, Array]]:
    """Return the poses of a platform with heading `yaw` (rad): (R_WB (3, 3), shift (3,) m).

    The platform tilts against the mean wind or a gust of `mission.gust_sigmas`; gusts shift it as
    predicted by the law. Each pose is returned for hovering and for braking from forward flight
    with `braking` (m/s^2). A robot with lateral force stays level. `q` (rad) are the joints.
    """
    world, robot, wind = setup.world, setup.robot, setup.world.wind
    level, mean = rot_z(yaw), compute_mean_wind(wind, np.zeros((1, 3)))[0]
    winds, apart = find_gusts(setup, mean), 0.0
    law = build_law(setup.description, setup)
    if len(winds) > 1 and (model := law.build_gust_model(setup, yaw)) is not None:
        apart = setup.description.mission.gust_sigmas * model(wind).place
    body = build_drag_body(robot, setup.model, q, world.gravity_mps2, world.air_density_kg_m3)
    layout = build_layout(setup.rotors, robot.rotors.thrust_fraction, setup.allocator)
    _, tilts = compute_hold(layout, body, winds @ level)
    sizes = np.maximum(np.linalg.norm(winds, axis=1), 1e-9)
    leans = (tilts / sizes)[:, None] * np.cross(winds, [0.0, 0.0, 1.0])
    gusts = winds[1:] - mean
    shifts = apart * gusts / np.maximum(np.linalg.norm(gusts, axis=1, keepdims=True), 1e-9)
    poses = [(lean, np.zeros(3)) for lean in leans] + [(leans[0], shift) for shift in shifts]
    brake = np.zeros(3) if layout.full else braking / world.gravity_mps2 * level[:, 1]
    stances, turn = [], np.empty((3, 3))
    for lean, shift in poses:
        for rotation in (lean, lean - brake):
            exp_so3(rotation, turn)
            stances.append((turn @ level, shift))
    return stances


def find_exceeded_motion(
    setup: Setup[Any], yaw: float, place: float, swing: float, rest: float, within: float,
    swing_sigmas: float,
) -> str | None:  # fmt: skip
    """Return a message if gusts move the platform or its link too far, or None.

    The platform has the heading `yaw` (rad). `place` (m) is the permitted displacement from an
    earlier position: the difference of two gusts has sqrt(2) of the deviation of one, and
    `mission.gust_sigmas` of it must be less. A link released at `swing` (rad; 0: not released) must
    stay within `rest` (rad) less `swing_sigmas` of its own motion after `within` (s). Laws without
    a gust model are not checked.
    """
    wind = setup.world.wind
    if not wind.gusty or compute_speed(wind) == 0.0:
        return None
    model = build_law(setup.description, setup).build_gust_model(setup, yaw)
    if model is None:
        return None

    sigmas = setup.description.mission.gust_sigmas
    apart = math.sqrt(2.0) * sigmas

    def judge(share: float) -> tuple[str, GustMotion]:
        air = wind.model_copy(update={
            "mean_mps": share * wind.mean_mps, "vertical_mps": share * wind.vertical_mps
        })  # fmt: skip
        m = model(air)
        if apart * m.place > place:
            return "place", m
        left = rest - swing_sigmas * m.swing
        if swing > 0.0 and (left <= 0.0 or m.settle(left / swing) > within):
            return "swing", m
        return "", m

    what, motion = judge(1.0)
    if not what:
        return None
    low, high = 0.0, 1.0
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if judge(middle)[0] else (middle, high)
    speed = compute_speed(wind)
    gusts = f"gusts around a mean of {speed:.3g} m/s"
    most = (
        f"the largest permitted mean is {low * speed:.2f} m/s (world.wind.mean_mps)"
        if low > 0.0
        else "no gusts are permitted"
    )
    if what == "place":
        return (
            f"{gusts} displace the platform by {1000.0 * apart * motion.place:.1f} mm ({sigmas:g} "
            "sigma, mission.gust_sigmas, of the difference of two gusts); "
            f"{1000.0 * place:.0f} mm are allowed; {most}"
        )
    return (
        f"{gusts} move the link by {math.degrees(swing_sigmas * motion.swing):.1f} deg "
        f"({swing_sigmas:g} "
        f"sigma, mission.task.swing_sigmas): released at {math.degrees(swing):.0f} deg it "
        f"does not settle within {math.degrees(rest):.0f} deg in {within:g} s; {most}, or "
        "reduce mission.task.swing_deg"
    )
