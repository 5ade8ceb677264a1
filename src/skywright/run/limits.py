"""The wind that a mission may require a robot to withstand, from the computed capability.

The planner checks rotor loads under contact force and wind along the plan, for the mean wind. This
module checks the margin that a mission requires in addition (`mission.wind_fraction`), including
gusts, and computes the number for a refusal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.description.world.surface import level_axes
from skywright.description.world.wind import (
    compute_direction,
    compute_gust_scales,
    compute_gust_sigma,
    compute_mean_wind,
    compute_speed,
)
from skywright.models.capability import build_drag_body
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_tip, posture
from skywright.models.statics import build_layout
from skywright.models.wind import compute_hold, compute_largest, compute_wind_limits, is_held
from skywright.run.parts import build_law

if TYPE_CHECKING:
    from skywright.run.setup import Setup

Array = NDArray[np.float64]

HEADING_STEP_DEG = 10.0  # headings of a plan are grouped to this
TOWARD_STEP_DEG = 5.0  # and directions of gusts
PLACE_STEP = 0.2  # m, positions of a plan in a fan's jet are grouped to this
GUST_FREQUENCIES = np.geomspace(1e-3, 300.0, 3000)  # rad/s
PUSH_ROWS = 12  # rows of a plan for which the rotors' push in gusts is computed
SWEEP_STEPS = 9  # sampled directions of an oscillating fan
GUST_DIRECTIONS = 12


def find_exceeded_wind(setup: Setup[Any], segments: Mapping[str, NDArray[Any]]) -> str | None:
    """Return a message if the wind exceeds what the robot may be required to withstand, or None.

    Checked at every heading of `segments`, and in a fan's jet also at every position; without a
    plan, at the heading of the start and at the one that faces the pipe. Turbulence counts as the
    mean plus `mission.gust_sigmas` standard deviations of its part below the position bandwidth, in
    its worst direction. The arm is in its working posture.
    """
    world, robot, mission = setup.world, setup.robot, setup.description.mission
    wind = world.wind
    if compute_speed(wind) == 0.0:
        return None
    layout = build_layout(setup.rotors, robot.rotors.thrust_fraction)
    q = posture(robot, "working")
    body = build_drag_body(robot, setup.model, q, world.gravity_mps2, world.air_density_kg_m3)
    cases = [
        (heading, gust)
        for heading, mean in _find_winds(setup, segments)
        for gust in find_gusts(setup, mean)
    ]
    gusts = np.array([gust for _, gust in cases])
    speeds = np.linalg.norm(gusts, axis=1)
    toward = np.degrees(np.arctan2(gusts[:, 1], gusts[:, 0])) - [heading for heading, _ in cases]
    step = TOWARD_STEP_DEG if wind.gusty else 1e-3
    toward = (step * np.round(toward / step) + 180.0) % 360.0 - 180.0
    different, which = np.unique(toward, return_inverse=True)
    tilt_max = math.radians(robot.control.tilt_max_deg)
    limits = compute_wind_limits(layout, body, np.radians(different), tilt_max)
    limits = np.where(np.isfinite(limits), limits, 0.0)[which]  # NaN: not even still air
    loads = speeds / np.maximum(limits, 1e-9)
    k = int(np.argmax(loads))
    fraction = mission.wind_fraction
    if loads[k] <= fraction * (1.0 + 1e-9):
        return None
    speed, limit = float(speeds[k]), float(limits[k])
    what = "wind" if not wind.gusty else f"wind with gusts (mean + {_tell_sigmas(setup)})"
    return (
        f"{what} of {speed:.2f} m/s exceeds {fraction * limit:.2f} m/s, {fraction:.0%} "
        f"(mission.wind_fraction) of the {limit:.2f} m/s that {robot.name} can hold when it blows "
        f"toward {toward[k]:.0f} deg "
        "(0 is ahead, 90 to the left)"
    )


def find_exceeded_push(
    setup: Setup[Any], push_force: float, contact: Sequence[Any] | NDArray[Any] = ()
) -> str | None:
    """Return a message if gusts could lift a probe that presses with `push_force` (N), or None.

    `contact` are the rows of the plan with contact. A gust of `mission.gust_sigmas`, with the drag
    of the nominal model, may reduce the push by `mission.wind_fraction`; the rest is a margin for
    drag above the nominal one.

    Under a law that presses by position stiffness, slow gusts act on the contact force in full. The
    integral compensates the wind at touch-down, including a gust, and is frozen along the normal
    afterwards. The force error is then due to the difference of two independent gusts, with sqrt(2)
    of the deviation of one. Under a law that closes a force loop, the error is the loop's response
    to the gust spectrum, plus the part of the push that the rotors cannot produce while they
    compensate the gust.
    """
    wind = setup.world.wind
    speed = compute_speed(wind)
    if not wind.gusty or speed == 0.0:
        return None
    if wind.kind == "fan":
        speed = float(np.linalg.norm(compute_wind_allowance(setup)))
    body, hubs = _compute_drag_factors(setup)
    d = setup.description
    fraction = d.mission.wind_fraction
    law = build_law(d, setup)
    push_force *= law.compute_push_share(setup)
    response = law.compute_gust_response(
        d.robot, d.world, GUST_FREQUENCIES, 1e-3 * d.mission.timestep_ms
    )
    if response is None:
        sigma = compute_gust_sigma(wind, speed, d.robot.control.position_bandwidth_rad_s)
        rms, when = math.sqrt(2.0) * float(sigma[0]), "between touch-down and scan"
    else:
        scale, time = compute_gust_scales(wind, speed)
        rms, when = (
            compute_response_rms(response, float(scale[0]), float(time[0])),
            "above the bandwidth of the force loop",
        )
    gust = d.mission.gust_sigmas * rms * (2.0 * body * speed + hubs)
    if gust > fraction * push_force * (1.0 + 1e-9):
        return (
            f"gusts ({_tell_sigmas(setup)} {when}) cause a drag of {gust:.2f} N, more than "
            f"{fraction:.0%} (mission.wind_fraction) of the contact force of "
            f"{push_force:.2f} N, and could lift the probe off the surface"
        )
    return None if response is None else _find_weak_rotors(setup, push_force, contact)


def _tell_sigmas(setup: Setup[Any]) -> str:
    return f"{setup.description.mission.gust_sigmas:g} sigma, mission.gust_sigmas"


def compute_response_rms(response: Array, sigma: float, time: float) -> float:
    """Return the rms of a quantity with the gust response `response` (n,) at GUST_FREQUENCIES.

    First-order gusts of `sigma` (m/s) and the time scale `time` (s), as Dryden's along the wind: 2
    sigma^2 T / pi / (1 + (T w)^2), one-sided.
    """
    w = GUST_FREQUENCIES
    power = 2.0 * sigma**2 * time / math.pi / (1.0 + (time * w) ** 2)
    return float(np.sqrt(np.trapezoid(response**2 * power, w)))


def _find_weak_rotors(setup: Setup[Any], push_force: float, contact: Any) -> str | None:
    """Return a message if gusts leave the rotors less of the push than is required, or None."""
    world, robot, model = setup.world, setup.robot, setup.model
    layout = build_layout(setup.rotors, robot.rotors.thrust_fraction)
    fraction = setup.description.mission.wind_fraction
    n = len(robot.arm.links) if robot.arm is not None else 0
    least, worst, gust = (1.0 - fraction) * push_force, math.inf, np.zeros(3)
    for row in contact[:: max(len(contact) // PUSH_ROWS, 1)]:
        q = row["q"][:n]
        body = build_drag_body(robot, model, q, world.gravity_mps2, world.air_density_kg_m3)
        mean = compute_mean_wind(world.wind, row["p_WB"][None])[0]
        if world.wind.kind == "fan":
            yaw = math.atan2(row["R_WB"][1, 0], row["R_WB"][0, 0])
            mean = compute_equivalent_wind(setup, row["p_WB"], yaw)
        winds, inward = find_gusts(setup, mean), -row["R_WB"].T @ row["R_WS"][:, 2]
        p_BT = compute_tip(model, row["q"])[0]

        def holds(push: Array, args: Any = (body, winds @ row["R_WB"], inward, p_BT)) -> Any:
            drag, air, way, tip = args
            thrust, tilt = compute_hold(layout, drag, air, push[:, None] * way, tip)
            return is_held(layout, thrust, tilt, math.radians(robot.control.tilt_max_deg))

        left = np.nan_to_num(compute_largest(holds, len(winds), push_force), nan=-1.0)
        k = int(np.argmin(left))
        if left[k] < worst:
            worst, gust = float(left[k]), winds[k]
    if worst >= least * (1.0 - 1e-6):
        return None
    return (
        f"in gusts of {np.linalg.norm(gust):.1f} m/s (mean + {_tell_sigmas(setup)}) the "
        f"rotors can produce {max(worst, 0.0):.2f} N of the contact force of "
        f"{push_force:.2f} N; at least {least:.2f} N are required (mission.wind_fraction)"
    )


def compute_wind_allowance(nominal: Nominal) -> Array:
    """Return the steady wind (3,) m/s in W that a plan allows for: the mean.

    In a fan's jet, it is the uniform wind with the same drag on a robot in the middle of the jet,
    at the distance of the pipe, or else at the outlet.
    """
    wind = nominal.world.wind
    direction, speed = compute_direction(wind), compute_speed(wind)
    if wind.kind != "fan":
        return np.asarray(speed * direction)
    place, along = np.array([wind.fan.x_m, wind.fan.y_m, wind.fan.z_m]), 0.0
    if nominal.cylinder is not None:
        along = max(float((nominal.cylinder.p_WP - place) @ direction), 0.0)
    v = compute_equivalent_wind(nominal, place + along * direction, 0.0)
    return np.asarray(float(np.linalg.norm(v)) * direction)


def compute_wind_drag(nominal: Nominal) -> float:
    """Return the drag (N) of a level robot in the steady wind that a plan allows for."""
    a, b = _compute_drag_factors(nominal)
    speed = float(np.linalg.norm(compute_wind_allowance(nominal)))
    return a * speed**2 + b * speed


def compute_gust_drag(nominal: Nominal, speed: float) -> Array:
    """Return the drag (3,) N of a gust of 1 m/s along a mean wind of `speed`, across it and above.

    The hubs' drag lies in the rotors' plane, so a vertical gust acts on the body only.
    """
    a, b = _compute_drag_factors(nominal)
    p = nominal.robot.platform
    above = 0.5 * nominal.world.air_density_kg_m3 * p.drag_area_z_m2
    return np.array([2.0 * a * speed + b, a * speed + b, above * speed])


def compute_equivalent_wind(nominal: Nominal, p_WB: Array, yaw: float, turn: float = 0.0) -> Array:
    """Return the uniform wind (3,) m/s with the drag of the mean wind on a level robot at p_WB.

    A jet is narrower than a robot, so the drag of body and hubs (hovering rotors, each in its local
    wind) is summed and a v^2 + b v = F is solved for the speed. The torque of the uneven drag is
    neglected.
    """
    wind = nominal.world.wind
    points = np.vstack([np.zeros(3), nominal.rotors.position @ rot_z(yaw).T]) + p_WB
    air = compute_mean_wind(wind, points, turn)
    if wind.kind != "fan":
        return np.asarray(air[0])
    a, b = _compute_drag_factors(nominal)
    force = a * float(np.linalg.norm(air[0])) * air[0] + b * air[1:].mean(axis=0)
    size = float(np.linalg.norm(force))
    if size < 1e-9:
        return np.zeros(3)
    return np.asarray(2.0 * force / (b + math.sqrt(b * b + 4.0 * a * size)))


def _compute_drag_factors(nominal: Nominal) -> tuple[float, float]:
    """Return a (kg/m) and b (kg/s) of the horizontal drag a v^2 + b v: body, and hovering hubs."""
    robot, world, rotors = nominal.robot, nominal.world, nominal.rotors
    p = robot.platform
    mass = p.mass_kg
    if robot.arm is not None:
        mass += sum(link.mass_kg for link in robot.arm.links.values())
    if robot.probe is not None:
        mass += robot.probe.mass_kg
    n = len(rotors.position)
    omega = math.sqrt(mass * world.gravity_mps2 / n / rotors.k_f)
    a = 0.5 * world.air_density_kg_m3 * max(p.drag_area_x_m2, p.drag_area_y_m2)
    return a, n * rotors.drag_coefficient * omega


def find_gusts(setup: Setup[Any], mean: Array) -> Array:
    """Return the mean wind (3,) and the gusts around it, (n, 3) m/s."""
    wind = setup.world.wind
    speed = float(np.linalg.norm(mean))
    if not wind.gusty or speed == 0.0:
        return mean[None]
    sigma = compute_gust_sigma(wind, speed, setup.robot.control.position_bandwidth_rad_s)
    along = mean / speed
    across = np.array([-along[1], along[0], 0.0])
    around = np.linspace(0.0, 2.0 * math.pi, GUST_DIRECTIONS, endpoint=False)[:, None]
    gusts = sigma[0] * np.cos(around) * along + sigma[1] * np.sin(around) * across
    return np.vstack([mean, mean + setup.description.mission.gust_sigmas * gusts])


def _find_winds(
    setup: Setup[Any], segments: Mapping[str, NDArray[Any]]
) -> list[tuple[float, Array]]:
    """Return each distinct (heading in deg, mean wind (3,) m/s) of a plan."""
    wind = setup.world.wind
    poses = _find_poses(setup, segments)
    if wind.kind != "fan":
        mean = compute_mean_wind(wind, np.zeros((1, 3)))[0]
        return [(heading, mean) for heading in sorted({h for h, _ in poses})]
    sweep = math.radians(wind.fan.sweep_deg)
    turns = np.linspace(-sweep, sweep, SWEEP_STEPS) if sweep > 0.0 else np.zeros(1)
    found = {}
    for heading, p in poses:
        for turn in turns:
            v = compute_equivalent_wind(setup, p, math.radians(heading), turn)
            key = (heading, *np.round(v, 1).tolist())
            found[key] = (heading, v)
    return list(found.values())


def _find_poses(
    setup: Setup[Any], segments: Mapping[str, NDArray[Any]]
) -> list[tuple[float, Array]]:
    """Return distinct (heading in deg, position (3,) m) of a plan, or of the start of a mission.

    Positions are distinguished only in a fan's jet.
    """
    jet = setup.world.wind.kind == "fan"
    if segments:
        found = {}
        for table in segments.values():
            r = table["R_WB"]
            yaw = np.degrees(np.arctan2(r[:, 1, 0], r[:, 0, 0]))
            headings = np.round(yaw / HEADING_STEP_DEG).astype(int)
            places = np.round(table["p_WB"] / PLACE_STEP).astype(int) if jet else headings[:, None]
            rows = np.unique(np.column_stack([headings, places]), axis=0, return_index=True)[1]
            for i in rows:
                key = (int(headings[i]), *places[i].tolist())
                found[key] = (headings[i] * HEADING_STEP_DEG, np.array(table["p_WB"][i]))
        return [found[k] for k in sorted(found)]
    m = setup.description.mission
    start = np.array([m.start_x_m, m.start_y_m, m.hover_height_m])
    out = [(m.start_yaw_deg, start)]
    if setup.cylinder is not None:
        ahead = level_axes(setup.cylinder.R_WP)[:, 0]
        out.append((math.degrees(math.atan2(ahead[1], ahead[0])), start))
    return out
