"""Criteria of the oracle for two hands, from the true state of all things.

Two hands on a bench: the box is held above its stand by 60 % of the requested lift, with the
requested squeeze within a tenth, with less than 1 cm of slip. The plug comes out, which is detected
within 0.5 s of its passing the threshold, and stays in the hands. The bar comes within 25 mm and 4
deg of each pose. The drift that the arms measure is that of the base within 0.3 of its size.
Sensor: it sticks to the lowest line of the pipe, within 2 cm, at the requested position along it
within the map's error and 3 cm; 0.1 N in the mean, 0.15 N rms; the preceding checks are met. Tool:
it is on the pipe for the requested time, 10 mm and 3 deg from its seat, and returns to the bench
within 5 cm, upright. Peg: in the hole at the end, released by the hands; never pressed with more
than 8 N.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from oracle_truth import Array, list_spans, pick, rms, tell_touches, turn

from skywright.core.rotations import rot_z
from skywright.description.loader import Description
from skywright.description.world.things import list_movers, locate_thing
from skywright.models.deviation import build_socket_error
from skywright.models.things._build import find_offsets

LIFTED, SQUEEZED, SLIP_M, NOTICED_S = 0.6, 0.1, 0.010, 0.5
BAR_M, BAR_RAD, DRIFTED = 0.025, math.radians(4.0), 0.3
STUCK_M, ALONG_M, MEAN_N, RMS_N, HAND_M = 0.02, 0.03, 0.1, 0.15, 0.015
MOVED_M, SETTLED_S, REST_RAD = 0.03, 2.0, math.radians(1.0)
SEAT_M, SEAT_RAD, BACK_M, UPRIGHT_RAD = 0.010, math.radians(3.0), 0.05, math.radians(9.0)
PEG_N, IN_HOLE = 8.0, 0.95


def find_end(s: Any, told: dict[str, Any], name: str) -> int | None:
    """Return the last sample of the last phase with this name."""
    there = np.flatnonzero(pick(s, list_spans(told, name)[-1:]))
    return int(there[-1]) if len(there) else None


def get_thing(d: Description[Any], s: Any, name: str) -> tuple[Array, Array]:
    """Return the recorded position (n, 3) and attitude (n, 4) of a movable thing."""
    i = list_movers(d.world.things).index(name)
    return s[f"object{i}_p_WO"], s[f"object{i}_q_WO"]


def judge_bimanual(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the failed trials of two hands on a bench."""
    task = d.mission.task
    trials = {
        "squeeze": tell_squeeze, "unplug": tell_unplug, "bar": tell_bar,
        "position-sensor": tell_drift,
    }  # fmt: skip
    return [x for trial in task.trials for x in trials[trial](d, told, s)]


def tell_squeeze(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of holding the box."""
    task, held = d.mission.task, pick(s, list_spans(told, "hold box"))
    if not np.any(held):
        return ["no box was held"]
    p, missing = get_thing(d, s, task.box)[0], list[str]()
    lift = float(np.min(p[held, 2])) - float(np.median(p[: len(p) // 100 + 1, 2]))
    if lift < LIFTED * task.lift_m:
        missing.append(f"box lifted by {1e3 * lift:.0f} mm")
    force = 0.5 * (s["right_f_W"] - s["left_f_W"])[held, 1]
    if rms(force - task.squeeze_n) > SQUEEZED * task.squeeze_n:
        missing.append(f"squeezed {rms(force - task.squeeze_n):.2f} N off")
    away = (p - 0.5 * (s["left_p_WH"] + s["right_p_WH"]))[held]
    if float(np.max(np.linalg.norm(away - away[0], axis=1))) > SLIP_M:
        missing.append("box slipped")
    return missing


def tell_unplug(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of pulling the plug."""
    task, noticed = d.mission.task, list_spans(told, "unplugged")
    if not noticed:
        return ["the plug was not noticed to be out"]
    p = get_thing(d, s, task.plug)[0]
    pulled = list_spans(told, "pull")[0]
    out = np.linalg.norm(p - p[pick(s, [pulled])][0], axis=1) > task.unplug_threshold_m
    gone = np.flatnonzero(out & (s["t"] >= pulled[0]))
    if not len(gone) or s["t"][gone[0]] > noticed[0][1]:
        return ["told of a plug that had not come out"]
    missing = list[str]()
    if abs(noticed[0][0] - float(s["t"][gone[0]])) > NOTICED_S:
        missing.append(f"plug noticed {noticed[0][0] - float(s['t'][gone[0]]):.2f} s late")
    held = pick(s, noticed)
    away = (p - 0.5 * (s["left_p_WH"] + s["right_p_WH"]))[held]
    if float(np.max(np.linalg.norm(away - away[0], axis=1))) > SLIP_M:
        missing.append("plug slipped")
    return missing


def tell_bar(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the poses that the bar did not reach."""
    task, missing = d.mission.task, list[str]()
    p, q = get_thing(d, s, task.bar)
    lay, axis = p[0], turn(q, [0.0, 1.0, 0.0])
    poses = {"lift bar": (0.0, 0.0), "turn bar": (0.0, task.bar_turn_deg), "bar forward": (0.03, 0)}
    for name, (ahead, angle) in poses.items():
        late = pick(s, [(b - 1.0, b) for _, b in list_spans(told, name)])
        if not np.any(late):
            missing.append(f"{name}: not done")
            continue
        far = float(np.max(np.linalg.norm(p[late] - lay - [ahead, 0.0, 0.06], axis=1)))
        a = math.radians(angle)
        along = np.abs(axis[late] @ [-math.sin(a), math.cos(a), 0.0])
        off = float(np.max(np.arccos(np.clip(along, 0.0, 1.0))))
        if far > BAR_M or off > BAR_RAD:
            missing.append(f"{name}: {1e3 * far:.0f} mm, {math.degrees(off):.1f} deg off")
    return missing


def tell_drift(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return a failure if the drift was not measured."""
    moving = pick(s, list_spans(told, "drift"))
    if not np.any(moving):
        return ["no drift was felt"]
    hands = 0.5 * (s["left_est_p_WH"] + s["right_est_p_WH"])[moving] - s["est_p_WB"][moving]
    true = s["p_WB"][moving]
    error = rms((hands[0] - hands) - (true - true[0]))
    asked = d.mission.task.drift_m
    return (
        [f"drift felt {1e3 * error:.1f} mm off"] if asked > 0.0 and error > DRIFTED * asked else []
    )


def judge_install(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of an installed sensor."""
    task, pipe, missing = d.mission.task, d.true_world.pipe, tell_touches(told, s)
    a, b = math.radians(pipe.yaw_deg), math.radians(pipe.inclination_deg)
    along = rot_z(a) @ [0.0, math.cos(b), math.sin(b)]
    up = np.array([0.0, 0.0, 1.0]) - along[2] * along
    up /= np.linalg.norm(up)
    force = s["left_f_W"] @ up
    held = pick(s, list_spans(told, "force"))
    dt = float(np.median(np.diff(s["t"])))
    if np.count_nonzero(held) * dt < task.hold_s - 0.1:
        return [*missing, "the force was not held"]
    mean, spread = float(np.mean(force[held])) - task.force_n, rms(force[held] - task.force_n)
    if abs(mean) > MEAN_N or spread > RMS_N:
        missing.append(f"force {mean:+.3f} N in the mean, {spread:.3f} N rms off")
    at = s["left_p_WH"][held] - [pipe.x_m, pipe.y_m, pipe.z_m]
    off = at - np.outer(at @ along, along)
    around = np.arctan2(off @ np.cross(along, up), -(off @ up)) * 0.5 * pipe.diameter_m
    if float(np.max(np.abs(around))) > STUCK_M:
        missing.append(
            f"sensor {1e3 * float(np.max(np.abs(around))):.0f} mm beside the lowest line"
        )
    if float(np.max(np.abs(at @ along))) > ALONG_M + d.plant.map_error_m:
        missing.append(f"sensor {1e3 * float(np.max(np.abs(at @ along))):.0f} mm along the pipe")
    gap = np.linalg.norm(off, axis=1) - 0.5 * pipe.diameter_m
    if float(np.max(np.abs(gap))) > STUCK_M + 0.02:
        missing.append("sensor off the pipe's surface")
    tape: Any = next((x for x in d.world.things.values() if x.kind == "tape"), None)
    flown = ~pick(s, list_spans(told, "start", "take_off", "land"))
    if tape is not None:
        t, pressed = s["t"][flown], np.where(force[flown] > 0.02, force[flown], 0.0)
        bond = tape.strength_n * (1.0 - math.exp(-float(np.trapezoid(pressed, t)) / tape.press_n_s))
        if bond < tape.release_n:
            missing.append(f"tape holds {bond:.1f} N only")
    after = s["t"] > s["t"][np.flatnonzero(held)[-1]]
    if float(np.min((s["left_p_WH"] @ up)[after])) > float((s["left_p_WH"] @ up)[held][-1]) - 0.05:
        missing.append("the hand never left")
    hover = pick(s, list_spans(told, "hover check"))
    if np.any(hover) and rms((s["left_p_WH"] - s["left_ref_p_WH"])[hover]) > HAND_M:
        missing.append("hand left its point")
    swing = pick(s, list_spans(told, "swing check"))
    if np.any(swing):
        t, q = s["t"][swing], s["q"][swing, 0]
        out = np.flatnonzero(np.abs(q - np.mean(q[t > t[-1] - 1.0])) > REST_RAD)
        if len(out) and t[out[-1]] - t[0] > SETTLED_S:
            missing.append(f"swung for {t[out[-1]] - t[0]:.2f} s")
    pressing = pick(s, list_spans(told, "press", "leave singularity", "force"))
    way = s["p_WB"] - s["ref_p_WB"]
    t0 = s["t"][np.argmax(pressing)]
    stood = np.mean(way[(s["t"] > t0 - 2.0) & (s["t"] < t0)], axis=0)
    moved = float(np.max(np.linalg.norm(way[pressing] - stood, axis=1)))
    if moved > MOVED_M:
        missing.append(f"platform moved by {1e3 * moved:.0f} mm")
    return missing


def judge_tool(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of installing a tool."""
    task, pipe, missing = d.mission.task, d.true_world.pipe, tell_touches(told, s)
    p, q = get_thing(d, s, task.tool)
    a, b = math.radians(pipe.yaw_deg), math.radians(pipe.inclination_deg)
    along, across = rot_z(a) @ [0.0, math.cos(b), math.sin(b)], rot_z(a) @ [1.0, 0.0, 0.0]
    up, end = np.cross(across, along), find_end(s, told, "wait")
    if end is None or sum(y - x for x, y in list_spans(told, "wait")) < task.wait_s - 0.1:
        missing.append("the tool did not stay on the pipe")
    else:
        at = p[end] - [pipe.x_m, pipe.y_m, pipe.z_m]
        off = math.hypot(float(at @ across), float(at @ along) - task.along_pipe_m)
        axes = [turn(q[end : end + 1], e)[0] for e in np.eye(3)]
        lean = [float(x @ y) for x, y in zip(axes, (across, along, up), strict=True)]
        angle = math.acos(min(max(0.5 * (sum(lean) - 1.0), -1.0), 1.0))
        if off > SEAT_M or angle > SEAT_RAD or not 0.5 * pipe.diameter_m < at @ up < 0.5:
            missing.append(f"tool {1e3 * off:.1f} mm, {math.degrees(angle):.1f} deg off its seat")
    back = find_end(s, told, "return")
    if back is None:
        return [*missing, "never came back"]
    tilt = math.acos(min(float(turn(q[back : back + 1], [0, 0, 1.0])[0, 2]), 1.0))
    far = float(np.linalg.norm(p[back] - p[0]))
    if far > BACK_M or tilt > UPRIGHT_RAD:
        missing.append(f"tool {100 * far:.1f} cm from where it stood, {math.degrees(tilt):.0f} deg")
    hover = pick(s, list_spans(told, "hover check"))
    if np.any(hover):  # the tracked points are at the tool
        hands = [s[f"{x}_p_WH"][hover] for x in ("left", "right")]
        spread = max(rms(x - np.mean(x, axis=0)) for x in hands)
        if spread > HAND_M:
            missing.append(f"hands {1e3 * spread:.1f} mm rms about the grasp points")
    return missing


def judge_insertion(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of an inserted peg."""
    task, things, missing = d.mission.task, d.world.things, tell_touches(told, s)
    peg: Any = things[task.bar]
    hole = locate_thing(
        things, task.socket, offsets=find_offsets(things, build_socket_error(d.plant))
    )
    p, q = get_thing(d, s, task.bar)
    end = find_end(s, told, "return")
    if end is None:
        return [*missing, "never came back"]
    tip = hole.R.T @ (p[end] - peg.length_m * turn(q[end : end + 1], [0, 0, 1.0])[0] - hole.p)
    if -tip[2] < IN_HOLE * peg.length_m or float(np.max(np.abs(tip[:2]))) > 0.5 * peg.flange_m:
        missing.append(
            f"peg {1e3 * -tip[2]:.0f} mm deep, {1e3 * math.hypot(*tip[:2]):.0f} mm aside"
        )
    carried = np.linalg.norm(s["left_f_W"] + s["right_f_W"], axis=1)
    if carried[end] > 0.1:
        missing.append("hands still on the bar")
    trying = pick(s, list_spans(told, "lower", "insert", "draw out", "set free"))
    weight = np.array([0.0, 0.0, peg.mass_kg * d.world.gravity_mps2])
    pressed = np.linalg.norm((s["left_f_W"] + s["right_f_W"])[trying] - weight, axis=1)
    if float(np.max(pressed, initial=0.0)) > PEG_N:
        missing.append(f"pressed with {float(np.max(pressed)):.1f} N")
    return missing
