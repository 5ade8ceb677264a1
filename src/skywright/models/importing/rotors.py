"""Rotors of an imported file: positions, axes and thrust constants.

Three sources, in this order: actuators of MJCF that act at a site, plug-in tags of Gazebo's motor
model in SDF and URDF (`motorConstant`, `momentConstant`, `maxRotVelocity`, `timeConstantUp`,
`rotorDragCoefficient`), and URDF links with names of rotors, which give positions only.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.importing.forces import find_thrust
from skywright.models.importing.opening import Opened
from skywright.models.importing.xml_input import read_numbers

SAME, NEARLY = 1e-6, 0.01
"""Relative differences of rotors' constants that are ignored, and that are averaged."""
CLOSE = 1e-3
"""m between two rotors that are suspected to be duplicates."""
NAMED = re.compile(
    r"(^|[_/: ])(rotor|prop|propeller|thrust|thruster)[_ ]?\d*($|[_/ ])", re.IGNORECASE
)

AROUND = re.compile(
    r"[_/ -](guard|mount|arm|boom|cage|duct|shroud|holder|bracket|protector)s?[_ ]?\d*"
    r"($|[_/ -])",
    re.IGNORECASE,
)
"""Parts named after the rotor that they hold or protect."""


class FoundRotor(NamedTuple):
    """A rotor in the frame of the root body, all joints at zero."""

    p: Array  # (3,) m
    axis: Array  # (3,) thrust direction
    spin: str  # ccw, cw, or "" if the file does not state it
    joint: str  # joint that turns it, "" if it is fixed to the body
    constants: dict[str, float]  # by key of [robot.rotors]
    body: int = -1  # that carries it; -1 if the file does not give the rotor


class FoundRotors(NamedTuple):
    """All rotors of a file."""

    rotors: list[FoundRotor]
    origin: str  # source within the file
    constants: dict[str, float]  # constants common to all rotors
    notes: list[str]


def find_rotors(
    opened: Opened, model: mujoco.MjModel, data: mujoco.MjData, root: int, given: list[FoundRotor]
) -> FoundRotors:
    """Return the rotors of a compiled file; `given` ones take precedence over those of the file.

    `data` is at zero, the root body at the origin of W. Raises InputError if there are fewer than
    three, or if they differ in a constant that a robot file states once for all.
    """
    notes: list[str] = []
    if given:
        rotors, origin = given, "--rotor"
    else:
        rotors, origin = _list_rotors(opened, model, data, root, notes)
    if len(rotors) < 3:
        raise InputError(
            f"{opened.path}: {len(rotors)} rotors found (actuators at sites, motor plug-ins, links "
            "named rotor or prop); give at least 3 as --rotor X,Y,Z,ccw|cw[,AX,AY,AZ] in m"
        )
    for i, rotor in enumerate(rotors):
        for k, other in enumerate(rotors[:i]):
            if np.linalg.norm(rotor.p - other.p) < CLOSE:
                notes.append(f"rotors {k + 1} and {i + 1} are at one place: is one there twice?")
    return FoundRotors(rotors, origin, _common(opened, rotors, notes), notes)


def has_rotors(opened: Opened, model: mujoco.MjModel, root: int) -> bool:
    """Whether the tree of a body has rotors; raises InputError if one of them is malformed."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return bool(_list_rotors(opened, model, data, root, [])[0])


def _list_rotors(
    opened: Opened, model: mujoco.MjModel, data: mujoco.MjData, root: int, notes: list[str]
) -> tuple[list[FoundRotor], str]:
    """Return the rotors of the tree of `root`, by the first source that has some, and its name."""
    found = _of_actuators(opened, model, data, root, notes)
    if found:
        return found, "actuators at sites"
    found = [
        r for r in _of_plugins(opened, model, data, notes) if model.body_rootid[r.body] == root
    ]
    if found:
        return found, "plug-in tags"
    if opened.kind != "MJCF":
        found = _of_names(model, data, root)
    if found:
        names = ", ".join(model.body(rotor.body).name for rotor in found)
        notes.append(f"links taken as rotors by their names: {names}")
    return found, "names of links"


def is_rotor(name: str) -> bool:
    """Whether a link with this name is a rotor, and not a part around or below one."""
    found = NAMED.search(name)
    return found is not None and not AROUND.search(name[found.start() :])


def parse_rotor(text: str) -> FoundRotor:
    """Return the rotor of an option `X,Y,Z,ccw|cw[,AX,AY,AZ]`; raises InputError."""
    parts = [part.strip() for part in text.split(",")]
    where = f"--rotor {text}"
    if len(parts) not in (4, 7) or parts[3] not in ("ccw", "cw"):
        raise InputError(f"{where}: valid: X,Y,Z,ccw|cw or X,Y,Z,ccw|cw,AX,AY,AZ")
    p = np.array(read_numbers(" ".join(parts[:3]), 3, where, []))
    axis = np.array(read_numbers(" ".join(parts[4:]), 3, where, [0.0, 0.0, 1.0]))
    if np.linalg.norm(axis) < 1e-9:
        raise InputError(f"{where}: the axis has no direction")
    return FoundRotor(p, axis / np.linalg.norm(axis), parts[3], "", {})


def _of_actuators(
    opened: Opened, model: mujoco.MjModel, data: mujoco.MjData, root: int, notes: list[str]
) -> list[FoundRotor]:
    out, left_out = [], set[str]()
    for a in range(model.nactuator):
        if model.actuator_trntype[a] != mujoco.mjtTrn.mjTRN_SITE:
            continue
        site = int(model.actuator_trnid[a, 0])
        body = int(model.site_bodyid[site])
        if model.body_rootid[body] != root:
            continue
        thrust = find_thrust(model, a, str(opened.path), left_out)
        if thrust is None:
            continue
        constants = {"torque_per_thrust_m": abs(thrust.torque), "time_constant_s": thrust.lag}
        constants = {key: value for key, value in constants.items() if value > 0.0}
        if all(map(math.isfinite, thrust.span)):
            low, high = thrust.span
            constants |= {"thrust_min_n": max(low, 0.0), "thrust_max_n": high}
        R = data.site_xmat[site].reshape(3, 3)
        spin = "" if thrust.torque == 0.0 else "cw" if thrust.torque > 0.0 else "ccw"
        out.append(
            FoundRotor(data.site_xpos[site].copy(), R @ thrust.axis, spin, "", constants, body)
        )
    notes += [f"left out: {what}" for what in sorted(left_out)]
    return out


def _of_plugins(
    opened: Opened, model: mujoco.MjModel, data: mujoco.MjData, notes: list[str]
) -> list[FoundRotor]:
    out, left_out, reversed_ = [], set(), []
    for plugin in opened.root.iter("plugin"):
        link, joint = (_text(plugin, tag) for tag in ("linkName", "jointName"))
        if plugin.find("motorConstant") is None or not link:
            continue
        where = f"{opened.path}: motor plug-in of {link!r}"
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link)
        turns = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
        if body < 0 or turns < 0:
            raise InputError(f"{where}: no such link or joint {joint!r} in the model")
        spin = _text(plugin, "turningDirection")
        if spin not in ("ccw", "cw"):
            raise InputError(f"{where}: turningDirection is {spin!r}; valid: ccw, cw")
        number = {
            tag: read_numbers(plugin.findtext(tag), 1, f"{where}: {tag}", [0.0])[0]
            for tag in ("motorConstant", "momentConstant", "maxRotVelocity", "timeConstantUp",
                        "timeConstantDown", "rotorDragCoefficient", "rollingMomentCoefficient")
        }  # fmt: skip
        for tag, value in number.items():
            if value < 0.0 and tag != "momentConstant":
                raise InputError(f"{where}: {tag} is {value:g}; valid: 0 or more")
        if number["momentConstant"] < 0.0:  # Gazebo: torque = -direction * thrust * momentConstant
            spin = {"ccw": "cw", "cw": "ccw"}[spin]
            reversed_.append(link)
        k, fastest = number["motorConstant"], number["maxRotVelocity"]
        constants = {
            "thrust_coefficient_n_per_rad2s2": k, "thrust_max_n": k * fastest**2,
            "torque_per_thrust_m": abs(number["momentConstant"]),
            "time_constant_s": number["timeConstantUp"],
            "drag_coefficient_n_per_rads_mps": number["rotorDragCoefficient"],
        }  # fmt: skip
        axis = data.xaxis[turns].copy()
        about = data.xmat[body].reshape(3, 3) @ _rotation(model, body)
        constants["rotor_inertia_kgm2"] = float(
            axis @ about @ np.diag(model.body_inertia[body]) @ about.T @ axis
        )
        constants = {key: value for key, value in constants.items() if value > 0.0}
        if number["timeConstantDown"] != number["timeConstantUp"]:
            left_out.add("timeConstantDown (one lag for both directions: timeConstantUp)")
        if number["rollingMomentCoefficient"]:
            left_out.add("rollingMomentCoefficient")
        # Gazebo's motor model pushes along z of the rotor's link
        up = data.xmat[body].reshape(3, 3)[:, 2]
        out.append(FoundRotor(data.xpos[body].copy(), up.copy(), spin, joint, constants, body))
    notes += [f"left out: {what}" for what in sorted(left_out)]
    if reversed_:
        notes.append(
            f"momentConstant is negative: {', '.join(reversed_)} turn against turningDirection, so "
            "that the drag torque is that of the file"
        )
    return out


def _rotation(model: mujoco.MjModel, body: int) -> Array:
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, model.body_iquat[body])
    return out.reshape(3, 3)


def _of_names(model: mujoco.MjModel, data: mujoco.MjData, root: int) -> list[FoundRotor]:
    """Return leaf links with names of rotors, on a rotating joint or fixed.

    If all their frames coincide, the centres of mass give the positions.
    """
    parents = set(model.body_parentid[1:].tolist())
    out, centres = [], []
    for body in range(1, model.nbody):
        leaf = body not in parents and body != root and model.body_rootid[body] == root
        if not leaf or not is_rotor(model.body(body).name):
            continue
        joint, axis = "", data.xmat[body].reshape(3, 3)[:, 2].copy()
        if model.body_jntnum[body]:
            j = int(model.body_jntadr[body])
            joint, axis = model.joint(j).name, data.xaxis[j].copy()
            if axis @ data.xmat[body].reshape(3, 3)[:, 2] < 0.0:
                axis = -axis  # the sign of the joint's axis gives at most the sense of rotation
        out.append(FoundRotor(data.xpos[body].copy(), axis, "", joint, {}, body))
        centres.append(data.xipos[body].copy())
    if out and np.max(np.ptp([rotor.p for rotor in out], axis=0)) < CLOSE:
        out = [rotor._replace(p=p) for rotor, p in zip(out, centres, strict=True)]
    return out


def _common(opened: Opened, rotors: list[FoundRotor], notes: list[str]) -> dict[str, float]:
    out: dict[str, float] = {}
    for key in {key for rotor in rotors for key in rotor.constants}:
        values = [rotor.constants.get(key, 0.0) for rotor in rotors]
        apart, most = max(values) - min(values), max(abs(v) for v in values)
        if apart > NEARLY * most:
            raise InputError(
                f"{opened.path}: rotors differ in {key}: {min(values):g} to {max(values):g}; a "
                "robot file has one value for all: give the rotors with --rotor"
            )
        out[key] = values[0]
        if apart > SAME * most:
            out[key] = sum(values) / len(values)
            notes.append(f"rotors differ in {key} by {100 * apart / most:.2g} %: their mean")
    return out


def _text(element: ET.Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()
