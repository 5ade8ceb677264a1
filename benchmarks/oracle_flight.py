"""Criteria of the oracle for flights without a tool.

Way-points: each is reached in order and held for the requested time, 5 cm and 3 deg in the mean; 10
cm rms off the path. Excitation: each posture's motion was flown for the requested time, 15 cm rms
off its path. Flight modes: it translates by the requested distance, level within 2 deg, and tilts
by the requested angle, to each of four sides, within 5 cm of its position. Impact: the requested
part touches the pad, and nothing else before it, at the requested speed within a tenth; the
platform's recoil is below three quarters of its tilt limit, the torque on it below half of the
rotors' capability. Carried bar: at most 8 cm off its path; it ends within 8 cm of its position with
the platform at the goal; no contact. Plan file: the platform stays within 15 cm of its rows and
ends within 8 cm of the last one; no contact.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from oracle_truth import (
    ON_GROUND,
    Array,
    find_heading,
    find_tilt,
    list_spans,
    pick,
    rms,
    tell_touches,
    turn,
)
from scipy.optimize import linprog

from skywright.description.loader import Description
from skywright.run.setup import Setup

HELD_M, HELD_RAD, PATH_M = 0.05, math.radians(3.0), 0.10
SHAKEN_M = 0.15
PLACE_M, LEVEL_RAD = 0.05, math.radians(2.0)
FOLLOWED_M, ROUNDED_S = 0.15, 1.0
CARRIED_M, SWING_RAD = 0.08, math.radians(10.0)
FELT_N = 0.5


def judge_waypoints(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the way-points that were not held, and further unmet criteria of the flight."""
    missing, begin = tell_touches(told, s), 0
    dt = float(np.median(np.diff(s["t"])))
    heading = find_heading(s["q_WB"])
    for i, point in enumerate(d.mission.task.points):
        far = np.linalg.norm(s["p_WB"] - [point.x_m, point.y_m, point.z_m], axis=1)
        off = np.abs((heading - math.radians(point.yaw_deg) + math.pi) % (2 * math.pi) - math.pi)
        n = max(round(point.hold_s / dt) - 1, 1)
        mean = [np.convolve(x[begin:], np.full(n, 1.0 / n), "valid") for x in (far, off)]
        good = np.flatnonzero((mean[0] <= HELD_M) & (mean[1] <= HELD_RAD))
        if not len(good):
            least = float(np.min(mean[0], initial=math.inf))
            missing.append(f"way-point {i + 1} not held: {100 * least:.1f} cm at best")
            continue
        begin += int(good[0]) + n - 1
    spans = list_spans(told, starts="waypoint ") + list_spans(told, starts="hold ")
    path = rms((s["p_WB"] - s["ref_p_WB"])[pick(s, spans)])
    if path > PATH_M:
        missing.append(f"{100 * path:.1f} cm rms off the path")
    return missing


def judge_excitation(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of an excitation flight."""
    missing, task = tell_touches(told, s), d.mission.task
    for pose in task.poses:
        flown = sum(b - a for a, b in list_spans(told, f"excite {pose}"))
        if flown < task.duration_s - 0.1:
            missing.append(f"{pose}: moved for {flown:.1f} s")
    moving = ~pick(s, list_spans(told, *ON_GROUND))
    path = rms((s["p_WB"] - s["ref_p_WB"])[moving])
    if path > SHAKEN_M:
        missing.append(f"{100 * path:.1f} cm rms off the path")
    return missing


def judge_modes(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of each flight mode."""
    missing, task = tell_touches(told, s), d.mission.task
    tilt, up = find_tilt(s["q_WB"]), turn(s["q_WB"], [0.0, 0.0, 1.0])
    yaw = math.radians(d.mission.start_yaw_deg)
    ahead = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    moving = pick(s, list_spans(told, "command position"))
    if not np.any(moving):
        return [*missing, "did not translate"]
    way = (s["p_WB"][moving, :2] - s["p_WB"][moving][0, :2]) @ ahead.T
    for axis, name in enumerate(("ahead", "aside")):
        if float(np.max(way[:, axis])) < task.distance_m - PLACE_M:
            missing.append(f"came {float(np.max(way[:, axis])):.2f} m {name}")
    if float(np.max(tilt[moving])) > LEVEL_RAD:
        missing.append(f"tilted {math.degrees(float(np.max(tilt[moving]))):.1f} deg on its way")
    turning = pick(s, list_spans(told, "command angle", "hold angle"))
    off = np.linalg.norm(s["p_WB"] - s["ref_p_WB"], axis=1)[turning]
    if not len(off) or float(np.max(off)) > PLACE_M:
        missing.append(f"{100 * float(np.max(off, initial=0.0)):.1f} cm off its place")
    sides, asked = [], task.tilt_deg
    for a, b in list_spans(told, "hold angle"):
        if b - a < task.hold_s - 0.1:
            continue
        held = pick(s, [(a, b)])
        lean = np.mean(up[held, :2], axis=0) @ ahead.T
        sides.append((int(np.argmax(np.abs(lean))), bool(np.max(lean) > -np.min(lean))))
        mean = math.degrees(float(np.mean(tilt[held])))
        if asked is not None and mean < asked:
            missing.append(f"held {mean:.2f} deg")
    if len(set(sides)) < 4:
        missing.append(f"tilted to {len(set(sides))} of 4 sides")
    return missing


def compute_pitch_torque(d: Description[Any]) -> float:
    """Return the largest pitch torque (N m) at hover, level, without roll and yaw torque."""
    setup = Setup(d)
    r, model = setup.rotors, setup.scene.model
    weight = float(model.body_subtreemass[setup.scene.places.platform_body]) * d.world.gravity_mps2
    most = [min(float(x), setup.robot.rotors.thrust_fraction * float(x)) for x in r.thrust_max]
    bounds = list(zip(r.thrust_min, most, strict=True))
    found = linprog(-r.B[4], A_eq=r.B[[2, 3, 5]], b_eq=[weight, 0.0, 0.0], bounds=bounds)
    return float(-found.fun)


def judge_impact(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of an impact."""
    task = d.mission.task
    near = pick(s, list_spans(told, "impact", "retreat"))
    hit = np.flatnonzero(near & (s["pad_f_peak"] > FELT_N))
    if not len(hit):
        return ["the pad was not touched"]
    k, missing = int(hit[0]), list[str]()
    before = (s["t"] < s["t"][k]) & (s["t"] >= s["t"][k] - 0.05)
    ahead = turn(s["q_WB"][k : k + 1], [1.0, 0.0, 0.0])[0] * [1.0, 1.0, 0.0]
    ahead /= np.linalg.norm(ahead)
    soon = (s["t"] >= s["t"][k]) & (s["t"] <= s["t"][k] + 0.02)
    arm, names = task.part == "arm", s.dtype.names
    hand = np.linalg.norm(s["left_f_W"], axis=1) if "left_f_W" in names else s["f_contact"][:, 0]
    if arm != bool(np.any(np.abs(hand[soon]) > 0.1)):
        missing.append(f"not the {task.part} touched first")
    p = s["left_p_WH"] if arm and "left_p_WH" in names else s["p_WT"] if arm else s["p_WB"]
    speed = float(np.polyfit(s["t"][before], p[before] @ ahead, 1)[0])
    if not arm and d.robot.pendulum is not None:
        q, lever = s["q"][before, 0], 0.5 * d.robot.pendulum.length_m
        down = turn_each(s["q_WB"][before], -np.column_stack([np.sin(q), 0.0 * q, np.cos(q)]))
        speed += float(np.polyfit(s["t"][before], lever * down @ ahead, 1)[0])
    if abs(speed - task.speed_mps) > 0.1 * task.speed_mps:
        missing.append(f"hit at {speed:.3f} m/s")
    first = max(k - 1, 0)
    up = turn(s["q_WB"], [0.0, 0.0, 1.0])
    after = (s["t"] >= s["t"][k]) & (s["t"] <= s["t"][k] + 1.0)
    recoil = math.degrees(float(np.max(np.arccos(np.clip(up[after] @ up[first], -1.0, 1.0)))))
    if recoil > 0.75 * d.robot.control.tilt_max_deg:
        missing.append(f"recoil {recoil:.1f} deg")
    torque = float(np.max(s["load_t_peak"][near & (s["t"] >= s["t"][k])]))
    if torque > 0.5 * compute_pitch_torque(d):
        missing.append(f"torque {torque:.1f} N m")
    return missing


def judge_transport(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of carrying a bar."""
    task, missing = d.mission.task, tell_touches(told, s)
    carried = pick(s, list_spans(told, "transport", "settle"))
    if not np.any(carried):
        return [*missing, "nothing was carried"]
    bar: Array = 0.5 * (s["left_p_WH"] + s["right_p_WH"])
    wanted = 0.5 * (s["left_ref_p_WH"] + s["right_ref_p_WH"])
    goal = np.array([task.goal_x_m, 0.0, task.goal_z_m])
    end = np.flatnonzero(carried)[-1]
    # in wind the platform moves so that the bar stays: the bar has to arrive
    belongs = goal + wanted[end] - s["ref_p_WB"][end]
    for name, error in (
        ("path", (bar - wanted)[carried]),
        ("goal", bar[end : end + 1] - belongs),
    ):
        far = float(np.max(np.linalg.norm(error, axis=1)))
        if far > CARRIED_M:
            missing.append(f"{100 * far:.1f} cm off its {name}")
    if d.robot.pendulum is not None:
        q = s["q"][:, 0]
        down = turn_each(s["q_WB"], -np.column_stack([np.sin(q), 0.0 * q, np.cos(q)]))
        ahead = turn(s["q_WB"], [1.0, 0.0, 0.0])[:, :2]
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        swing = np.arctan2(-np.sum(down[:, :2] * ahead, axis=1), -down[:, 2]) - s["ref_q"][:, 0]
        if float(np.max(np.abs(swing[carried]))) > SWING_RAD:
            missing.append(f"swing {math.degrees(float(np.max(np.abs(swing[carried])))):.1f} deg")
    return missing


def judge_plan(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of a plan file's flight; the file gives positions and times."""
    missing, spans = tell_touches(told, s), list_spans(told, "plan")
    flown = s[pick(s, spans)]
    if not len(flown):
        return [*missing, "the plan was not flown"]
    file = Path(d.mission.task.plan_file).with_suffix(".csv")
    rows = np.genfromtxt(file, delimiter=",", names=True)
    t, names = flown["t"] - spans[0][0], ("x_m", "y_m", "z_m")
    # The platform runs ahead of a hanging load, and the plan begins and ends at rest.
    late = np.arange(-ROUNDED_S, ROUNDED_S, 0.02) if d.robot.pendulum is not None else [0.0]
    far = np.full(len(t), math.inf)
    for shift in late:
        at = np.column_stack([np.interp(t - shift, rows["t_s"], rows[n]) for n in names])
        far = np.minimum(far, np.linalg.norm(flown["p_WB"] - at, axis=1))
    if float(np.max(far)) > FOLLOWED_M:
        missing.append(f"{100 * float(np.max(far)):.1f} cm off the plan")
    last = s[pick(s, list_spans(told, "settle"))][-1:]
    end = np.array([rows[n][-1] for n in names])
    off = float(np.linalg.norm(last["p_WB"] - end)) if len(last) else math.inf
    if off > CARRIED_M:
        missing.append(f"{100 * off:.1f} cm off the plan's end")
    return missing


def turn_each(q: Array, v: Array) -> Array:
    """Return vectors (n, 3) rotated by quaternions (n, 4)."""
    return np.concatenate([turn(a[None], b) for a, b in zip(q, v, strict=True)])
