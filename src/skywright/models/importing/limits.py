"""Effort and speed limits of the joints of an imported file."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.importing.chain import Chain
from skywright.models.importing.forces import find_force
from skywright.models.importing.opening import Opened
from skywright.models.importing.sdf import TURN, read_limit

SMALL = 1e-6
"""Relative difference of limits, and rad beyond a turn, that are ignored."""
AT_JOINT = {int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)}

Limits = dict[str, tuple[float | None, float | None]]


def read_limits(opened: Opened, prefix: str, model: mujoco.MjModel) -> Limits:
    """Return effort (N m; N) and speed (rad/s; m/s) of a file's joints; None if it has none.

    `model` is the compiled model, in which names of the file have the `prefix`.
    """
    if opened.kind == "MJCF":
        return {name: (most, None) for name, most in _list_efforts(model, prefix).items()}
    out: Limits = {}
    for joint in opened.root.findall("joint"):
        limit = joint.find("limit")
        name, where = joint.get("name", ""), f"{opened.path}: joint {joint.get('name')!r}"
        if limit is not None:
            texts = (limit.get("effort"), limit.get("velocity"))
        else:
            texts = (joint.findtext("axis/limit/effort"), joint.findtext("axis/limit/velocity"))
        effort, speed = (
            _read_most(text, f"{where}: {key} of <limit>")
            for key, text in zip(("effort", "velocity"), texts, strict=True)
        )
        out[prefix + name] = (
            effort if 0.0 != effort < math.inf else None,
            speed if 0.0 != speed < math.inf else None,
        )
    return out


def note_limits(files: Sequence[tuple[Opened, str]], chain: Chain, limits: Limits) -> list[str]:
    """Return notes on limits of the arm and its gripper that the robot file does not keep.

    `files` are the files with the prefixes of their names in `chain`.
    """
    open_ended = {
        prefix + joint.get("name", "")
        for opened, prefix in files
        if opened.kind == "URDF"
        for joint in opened.root.findall("joint")
        if joint.get("type") in ("revolute", "prismatic")
    }
    out = []
    for part in chain.parts[1:]:
        most = "0.1 m" if part.slide else "180 deg"
        if part.span is None and part.joint in open_ended:
            out.append(
                f"joint {part.joint} has no lower and upper limit, which URDF reads as 0 and 0 "
                f"(locked): -{most} to {most} are assumed; --weld {part.joint} locks it"
            )
        elif part.span is not None and not part.slide and max(map(abs, part.span)) > TURN + SMALL:
            low, high = part.span
            out.append(
                f"joint {part.joint} has limits of {low:.4g} and {high:.4g} rad, cut to a turn: "
                "are they in degrees?"
            )
    if chain.gripper is not None:
        for what, k in (("efforts", 0), ("speeds", 1)):
            both = [limits.get(name, (None, None))[k] for name in chain.gripper.joints]
            found = sorted(value for value in both if value is not None)
            if len(found) == 2 and found[1] - found[0] > SMALL * found[1]:
                out.append(
                    f"joints {' and '.join(chain.gripper.joints)} of the gripper have {what} of "
                    f"{found[0]:g} and {found[1]:g}: the smaller one counts"
                )
    return out


def _read_most(text: str | None, what: str) -> float:
    """Return a limit, 0 without one; InputError names `what`."""
    value = read_limit(text, what, 0.0)
    if value == -math.inf:
        raise InputError(f"{what} is -inf; valid: a number, or inf for no limit")
    return value


def _list_efforts(model: mujoco.MjModel, prefix: str) -> dict[str, float]:
    """Return the largest effort of the joints of an MJCF file that have one.

    It is the smaller one of the limit of the joint (`actuatorfrcrange`) and that of its actuator
    (`forcerange`, or `ctrlrange` times gain, each times `gear`). Of several actuators on a joint,
    the strongest counts.
    """
    out: dict[str, float] = {}
    for a in range(model.nactuator):
        if int(model.actuator_trntype[a]) in AT_JOINT:
            name, most = (
                model.joint(int(model.actuator_trnid[a, 0])).name,
                _reach(find_force(model, a)),
            )
            if most < math.inf:
                out[name] = max(out.get(name, 0.0), most * abs(float(model.actuator_gear[a, 0])))
    for j in range(model.njnt):
        if model.jnt_actfrclimited[j]:
            name, most = model.joint(j).name, _reach(model.jnt_actfrcrange[j])
            out[name] = min(out.get(name, math.inf), most)
    return {name: most for name, most in out.items() if name.startswith(prefix) and most > 0.0}


def _reach(span: Sequence[float] | Array) -> float:
    """Return what a range (2,) gives in both directions; in its one direction if it has one."""
    low, high = float(span[0]), float(span[1])
    return min(-low, high) if low < 0.0 < high else max(abs(low), abs(high))
