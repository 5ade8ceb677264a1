"""An imported model as the tables of a robot file, each number with its source.

Links have new frames: the joint at the origin, its axis along a coordinate axis, and the vector to
the next joint along x (or -z) as far as the axis allows. Shapes are capsules along that vector;
collision meshes are not imported.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.arm import TAKEN, Arm
from skywright.models.importing.chain import Chain, Part
from skywright.models.importing.rotors import FoundRotors
from skywright.models.importing.tool import (
    FINGER_RADIUS,
    LINK_RADIUS,
    TOOL_INERTIA,
    TOOL_MASS,
    build_gripper,
    build_tool,
    take,
    turn_tool,
)
from skywright.models.importing.values import PLACEHOLDER, Question, Value, imported
from skywright.models.urdf import roll_pitch_yaw

SHORT = 1e-6
PARALLEL = 0.9
"""Least cosine between axes of propellers that may be above each other."""
COAXIAL, SAME_PLACE, ALONE = 0.5, 1e-3, 0.22
"""Distance of axes over that of hubs below which propellers are above each other; m between hubs of
one place; m assumed between propellers if no two of them are side by side."""


class Tables(NamedTuple):
    """Dotted key -> value, in the order of the file, and the missing keys."""

    values: dict[str, Value]
    questions: list[Question]
    links: list[str]  # names of the links of the chain's joints
    frames: list[tuple[Array, Array]]  # (R, p) of platform and links in the root body's frame


def build_tables(
    name: str,
    origin: str,
    chain: Chain,
    rotors: FoundRotors,
    limits: Mapping[str, tuple[float | None, float | None]],
) -> Tables:
    """Return the tables of a robot; `limits` are effort and speed of joints by name."""
    values: dict[str, Value] = {
        "robot.name": Value(name),
        "robot.description": Value(f"Imported from {origin}"),
    }
    questions: list[Question] = []
    frames = [(np.eye(3), np.zeros(3))]
    links, lowest, names = _build_arm(chain, limits, questions, frames)
    weight = 9.81 * sum(part.mass for part in chain.parts)
    values |= _build_platform(chain.parts[0], rotors, lowest)
    values |= _build_rotors(rotors, weight, questions)
    questions.append(
        Question("robot.battery.energy_wh", "energy of the battery, Wh", round(weight * 5.0, 1),
                 (round(weight, 1), round(weight * 20.0, 1)))
    )  # fmt: skip
    return Tables(values | links, questions, names, frames)


def _build_platform(part: Part, rotors: FoundRotors, lowest: float) -> dict[str, Value]:
    out, note = {}, f"{part.name} with all that is rigid with it"
    out["mass_kg"] = imported(part.mass, note)
    for a, b in ("xx", "yy", "zz", "xy", "xz", "yz"):
        term = float(part.inertia["xyz".index(a), "xyz".index(b)])
        if a == b or abs(term) > 1e-12 * float(np.trace(part.inertia)):
            out[f"inertia_{a}{b}_kgm2"] = imported(term, "about the centre of mass, axes of B")
    for axis, x in zip("xyz", part.com, strict=True):
        out[f"com_{axis}_m"] = imported(float(x), note)
    places = np.array([rotor.p for rotor in rotors.rotors])
    reach = float(np.max(np.hypot(places[:, 0], places[:, 1])))
    out["diameter_m"] = Value(
        round(2.8 * reach, 4), "assumed", "1.4 times the hubs' circle", (2.0 * reach, 4.0 * reach)
    )
    hub = round(0.4 * reach, 4)
    out["body_radius_m"] = Value(hub, "assumed", "0.4 of the hubs' circle", (0.2 * reach, reach))
    out["height_m"] = Value(
        round(0.3 * reach, 4), "assumed", "0.3 of the hubs' circle", (0.1 * reach, reach)
    )
    gear = round(max(0.3 * reach, 0.05 - float(np.min(places[:, 2])), 0.03 - lowest), 4)
    out["gear_height_m"] = Value(
        gear, "assumed", "feet below rotors and the folded arm", (0.5 * gear, 2.0 * gear)
    )
    out["gear_radius_m"] = Value(
        round(0.6 * reach, 4), "assumed", "0.6 of the hubs' circle", (0.3 * reach, reach)
    )
    for axis, share in (("x", 0.35), ("y", 0.35), ("z", 0.6)):
        area = round(max(share * reach**2, 1e-4), 5)
        out[f"drag_area_{axis}_m2"] = Value(
            area, "assumed", "C_D A, scaled with the hubs' circle", (0.5 * area, 2.0 * area)
        )
    return {f"robot.platform.{key}": value for key, value in out.items()}


def _build_rotors(found: FoundRotors, weight: float, questions: list[Question]) -> dict[str, Value]:
    rotors, known = found.rotors, dict(found.constants)
    note, n = f"from {found.origin}", len(rotors)
    p = np.array([rotor.p for rotor in rotors])
    azimuth = np.arctan2(p[:, 1], p[:, 0])
    radial = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(n)], axis=1)
    tangential = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(n)], axis=1)
    axis = np.array([rotor.axis for rotor in rotors])
    # axis = (sin b, -sin a cos b, cos a cos b) in (radial, tangential, up)
    beta = np.arcsin(np.clip(np.sum(axis * radial, axis=1), -1.0, 1.0))
    alpha = np.arctan2(-np.sum(axis * tangential, axis=1), axis[:, 2])
    out = {
        "azimuth_deg": imported(np.degrees(azimuth).tolist(), note),
        "radius_m": imported(np.hypot(p[:, 0], p[:, 1]).tolist(), note),
        "height_m": imported(p[:, 2].tolist(), note),
        "alpha_deg": imported(np.degrees(alpha).tolist(), note),
        "beta_deg": imported(np.degrees(beta).tolist(), note),
    }
    spins = [rotor.spin for rotor in rotors]
    if all(spins):
        out["spin"] = imported(spins, note)
    else:
        senses = ["ccw"] * n  # neighbours around the platform turn in opposite senses
        for i, rotor in enumerate(np.lexsort((p[:, 2], np.round(azimuth, 3)))):
            senses[rotor] = ("ccw", "cw")[i % 2]
        text = "sense of each propeller seen from above, a list"
        questions.append(Question("robot.rotors.spin", text, senses, None))
    R = round(0.45 * _find_gap(p, axis), 4)
    most = known.get("thrust_max_n", round(2.0 * weight / n, 3))
    guesses = {
        "propeller_radius_m": ("radius of the propellers, m", R, 2.0),
        # C_T = T / (rho n^2 D^4) of about 0.1 for small propellers
        "thrust_coefficient_n_per_rad2s2": (
            "thrust over squared speed, N/(rad/s)^2", float(f"{0.1 * 1.2 * 16 * R**4 / 39.5:.3g}"),
            3.0,
        ),
        "torque_per_thrust_m": ("drag torque over thrust, m", round(0.12 * R, 5), 2.0),
        "thrust_min_n": ("least thrust of a rotor in flight, N", round(0.02 * most, 4), 4.0),
        "thrust_max_n": ("largest thrust of a rotor, N", most, 2.0),
        "time_constant_s": ("lag of the rotor speed, s", 0.03, 2.0),
    }  # fmt: skip
    for key, (text, guess, factor) in guesses.items():
        if key in known:
            out[key] = imported(known.pop(key), note)
        else:
            span = (guess / factor, guess * factor)
            questions.append(Question(f"robot.rotors.{key}", text, guess, span))
    inertia = 2e-3 * R**3.5
    known.setdefault("rotor_inertia_kgm2", 0.0)
    if known["rotor_inertia_kgm2"]:
        out["rotor_inertia_kgm2"] = imported(known["rotor_inertia_kgm2"], "about its axis")
    else:
        out["rotor_inertia_kgm2"] = Value(
            float(f"{max(inertia, 2e-10):.3g}"), "assumed", "scaled with the propeller's radius",
            (1e-10, 1e-2),
        )  # fmt: skip
    drag = known.get("drag_coefficient_n_per_rads_mps")
    key = "drag_coefficient_n_per_rads_mps"
    if drag is not None:
        out[key] = imported(drag, note)
    else:
        guess = float(f"{1e-4 * (R / 0.13):.3g}")
        out[key] = Value(guess, "assumed", "scaled with the radius", (0.3 * guess, 5.0 * guess))
    return {f"robot.rotors.{key}": value for key, value in out.items()}


def _find_gap(p: Array, axis: Array) -> float:
    """Return the least distance (m) between propellers at `p` (n, 3) with `axis` (n, 3).

    Of parallel rotors it is the distance between their axes, and coaxial pairs do not count.
    """
    gaps = []
    for i in range(len(p)):
        for j in range(i):
            d = p[i] - p[j]
            far = beside = float(np.linalg.norm(d))
            if abs(axis[i] @ axis[j]) > PARALLEL:
                beside = float(np.linalg.norm(d - (d @ axis[i]) * axis[i]))
            if far > SAME_PLACE and beside > COAXIAL * far:
                gaps.append(beside)
    return min(gaps, default=ALONE)


def _build_arm(
    chain: Chain,
    limits: Mapping[str, tuple[float | None, float | None]],
    questions: list[Question],
    frames: list[tuple[Array, Array]],
) -> tuple[dict[str, Value], float, list[str]]:
    """Return tables of links and servos, the lowest point (m) at zero, and the links' names."""
    out: dict[str, Value] = {}
    lowest = 0.0
    names: list[str] = []
    hand: dict[str, Value] = {}
    R_parent, p_parent = np.eye(3), np.zeros(3)
    moving = chain.parts[1:]
    for i, part in enumerate(moving):
        last = i == len(moving) - 1
        end = chain.tip if last else moving[i + 1].p
        R, axis, along, length = choose_frame(part.axis, end - part.p)
        name = _name(part.name, names)
        names.append(name)
        table: dict[str, Value] = {"joint": Value("slide" if part.slide else "hinge")}
        if i:
            table["parent"] = Value(names[i - 1])
        table |= _place(R_parent.T @ (part.p - p_parent), R_parent.T @ R, f"joint {part.joint}")
        table |= {"axis": Value(axis), "along": Value(along)}
        table["length_m"] = Value(length, "derived", "to the next joint, or to the tip")
        table["radius_m"] = Value(
            LINK_RADIUS, "assumed", "capsule in place of the shapes of the file", (0.005, 0.1)
        )
        gripper = chain.gripper if last else None
        tool = gripper is not None or (last and not _is_reached(R, along, length, part.p, end))
        body = part
        if tool:
            R_tool, at, start = turn_tool(end - part.p, gripper), end, part.p
            if gripper is not None:
                hand, at, body = build_gripper(gripper, part, R_tool, end, limits, questions)
                # its capsule leaves space for the fingers
                short = max(length - float(np.linalg.norm(end - at)), SHORT)
                table["length_m"] = Value(short, "derived", "to the fingers")
                if gripper.turn is not None:  # along the fingers, independent of the joint
                    way = R_tool[:, 0]
                    start = at - max(float((at - part.p) @ way), FINGER_RADIUS) * way
            body = take(body, TOOL_MASS, at, TOOL_INERTIA * np.eye(3))
        table |= _body(body, R, part.p, f"link {part.name}")
        table |= _span(part)
        out |= {f"robot.arm.{name}.{key}": value for key, value in table.items()}
        lowest = min(lowest, part.p[2] - LINK_RADIUS, end[2] - LINK_RADIUS)
        R_parent, p_parent = R, part.p
        frames.append((R, part.p))
        if tool:
            length = float(np.linalg.norm(at - start))
            out |= build_tool(name, R.T @ R_tool, R.T @ (start - part.p), length) | hand
    for name, part in zip(names, moving, strict=True):
        out |= _servo(name, part, limits.get(part.joint, (None, None)), questions)
    return out, lowest, names


def choose_frame(axis: Array, d: Array) -> tuple[Array, str, str, float]:
    """Return R (3, 3), the joint's axis and the link's direction in it, and its length (m).

    `axis` (3,) is the joint's, `d` (3,) m the vector to the next joint, both in one frame.
    """
    along = float(axis @ d)
    across = d - along * axis
    size = float(np.linalg.norm(across))
    if abs(along) > size:
        other = np.eye(3)[int(np.argmin(np.abs(axis)))]
        y = np.cross(axis, other) / np.linalg.norm(np.cross(axis, other))
        if along > 0.0:
            return np.column_stack([axis, y, np.cross(axis, y)]), "x", "x", abs(along)
        return np.column_stack([np.cross(y, axis), y, axis]), "z", "-z", abs(along)
    if size < SHORT:
        other = np.eye(3)[int(np.argmin(np.abs(axis)))]
        across = np.cross(axis, other)
    x = across / np.linalg.norm(across)
    return np.column_stack([x, axis, np.cross(x, axis)]), "y", "x", max(size, SHORT)


def _is_reached(R: Array, along: str, length: float, p: Array, end: Array) -> bool:
    way = R[:, 0] if along == "x" else -R[:, 2]
    return float(np.linalg.norm(p + length * way - end)) < 1e-9 + SHORT * length


def _place(p: Array, R: Array, note: str) -> dict[str, Value]:
    p = np.where(np.abs(p) < 1e-14, 0.0, p)
    out = {f"{axis}_m": imported(float(x), note) for axis, x in zip("xyz", p, strict=True)}
    angles = np.degrees(roll_pitch_yaw(R))
    for key, angle in zip(("roll_deg", "pitch_deg", "yaw_deg"), angles, strict=True):
        if abs(angle) > 1e-12:
            out[key] = imported(float(angle), f"{note}, axes chosen by the importer")
    return out


def _body(part: Part, R: Array, p: Array, note: str) -> dict[str, Value]:
    out = {"mass_kg": imported(part.mass, note)}
    com, inertia = R.T @ (part.com - p), R.T @ part.inertia @ R
    for axis, x in zip("xyz", com, strict=True):
        out[f"com_{axis}_m"] = imported(float(x), note)
    for a, b in ("xx", "yy", "zz", "xy", "xz", "yz"):
        term = float(inertia["xyz".index(a), "xyz".index(b)])
        if a == b or abs(term) > 1e-12 * float(np.trace(inertia)):
            out[f"inertia_{a}{b}_kgm2"] = imported(term, note)
    return out


def _span(part: Part) -> dict[str, Value]:
    note = f"limits of joint {part.joint}"
    if part.slide:
        low, high = part.span or (-0.1, 0.1)
        rest = min(max(0.0, low), high)
        span = (low, high)
        out = {
            "joint_min_m": imported(low, note), "joint_max_m": imported(high, note),
            "folded_m": Value(rest, "assumed", "nearest to zero", span),
            "working_m": Value(rest, "assumed", "nearest to zero", span),
        }  # fmt: skip
        if part.span is None:
            wide = Value(-0.1, "assumed", "the file has no limits", (-1.0, 0.0))
            out |= {"joint_min_m": wide, "joint_max_m": wide._replace(value=0.1, range=(0.0, 1.0))}
        return out
    low, high = (math.degrees(x) for x in part.span or (-math.pi, math.pi))
    if low < -360.0 or high > 360.0:
        low, high, note = max(low, -360.0), min(high, 360.0), f"{note}, cut to a turn"
    rest = min(max(0.0, low), high)
    out = {
        key: Value(rest, "assumed", "nearest to zero", (low, high))
        for key in ("folded_deg", "working_deg")
    }
    if part.span is None:
        full = Value(-180.0, "assumed", "the file has no limits", (-360.0, 0.0))
        ends = {"joint_min_deg": full, "joint_max_deg": full._replace(value=180.0, range=(0, 360))}
        return ends | out
    return {"joint_min_deg": imported(low, note), "joint_max_deg": imported(high, note)} | out


def _servo(
    name: str, part: Part, limit: tuple[float | None, float | None], questions: list[Question]
) -> dict[str, Value]:
    table = f"robot.arm.{name}_servo"
    out = {}
    torque, speed = limit
    unit, rate = ("N", "m/s") if part.slide else ("N m", "rad/s")
    for key, value, text, guess, usual in (
        ("stall_torque_nm", torque, f"stall torque of the servo of {part.joint}, {unit}", 3.0,
         PLACEHOLDER),
        ("no_load_speed_rad_s", speed, f"speed of the servo of {part.joint} without load, {rate}",
         4.0, 50.0),
    ):  # fmt: skip
        if value is not None and 0.0 < value < usual:
            out[f"{table}.{key}"] = imported(value, f"limit of joint {part.joint}")
        else:
            said = f" (the file says {value:g})" if value else ""
            questions.append(
                Question(f"{table}.{key}", text + said, guess, (guess / 5.0, guess * 5.0))
            )
    return out


def _name(text: str, taken: list[str]) -> str:
    """Return a name for a link that no part of a robot and no key of [robot.arm] has."""
    name = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_") or "link"
    if TAKEN.fullmatch(name) or name == "tool_link" or name in Arm.model_fields:
        name = f"link_{name}"
    while name in taken:
        name += "_2"
    return name
