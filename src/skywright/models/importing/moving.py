"""What moves in an imported model and no robot file can describe: tilting rotors, closed loops."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import mujoco
import numpy as np

from skywright.errors import InputError
from skywright.models.importing.fingers import joints_to
from skywright.models.importing.rotors import FoundRotor

SAME = 1e-6
"""Sine between axes, and m between a rotor and an axis: a joint there turns the propeller only."""
LOOPS = {mujoco.mjtEq.mjEQ_CONNECT: "connect", mujoco.mjtEq.mjEQ_WELD: "weld"}


def check_rotors(
    file: Path,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    rotors: Sequence[FoundRotor],
    frozen: Collection[str],
) -> None:
    """Raise InputError if a joint between the root and a rotor moves the rotor.

    `data` is at zero, the root body at the origin of W. The joint that turns the propeller does not
    count, and neither do `frozen` joints ("*": all).
    """
    for i, rotor in enumerate(rotors):
        if rotor.body < 0 or "*" in frozen:
            continue
        for j in joints_to(model, rotor.body, {}):
            name, axis = model.joint(j).name, data.xaxis[j]
            turns = name == rotor.joint or (
                model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
                and np.linalg.norm(np.cross(axis, rotor.axis)) < SAME
                and np.linalg.norm(np.cross(axis, rotor.p - data.xanchor[j])) < SAME
            )
            if not turns and name not in frozen:
                raise InputError(
                    f"{file}: joint {name!r} moves rotor {i + 1}, on link "
                    f"{model.body(rotor.body).name!r}: rotors that tilt or move in flight are not "
                    f"supported; --weld {name} freezes the joint"
                )


def check_loops(file: Path, model: mujoco.MjModel, root: int, joints: Collection[int]) -> list[str]:
    """Return notes on equalities that are left out; InputError if one closes a loop.

    `joints` are those of the arm: a loop of frozen joints, such as a linkage of fingers, is rigid
    in the robot file.
    """
    notes = []
    for e in range(model.neq):
        kind = LOOPS.get(mujoco.mjtEq(model.eq_type[e]))
        if kind is None or not model.eq_active0[e]:
            continue
        ends = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            ends = [int(model.site_bodyid[site]) for site in ends]
        mine = [body for body in ends if body > 0 and model.body_rootid[body] == root]
        if not mine:
            continue
        names = " and ".join(repr(model.body(body).name) for body in ends)
        what = f"equality {model.equality(e).name!r} ({kind}) of bodies {names}"
        if len(mine) == 1:
            notes.append(f"left out: {what}, of which one does not belong to the robot")
            continue
        above = [set(joints_to(model, body, {})) & set(joints) for body in ends]
        between = [model.joint(j).name for j in sorted(above[0] ^ above[1])]
        if between:
            raise InputError(
                f"{file}: {what} closes a loop over joint {', '.join(map(repr, between))}: "
                "kinematic loops are not supported; remove the equality, or freeze the joints: "
                + " ".join(f"--weld {name}" for name in between)
            )
        notes.append(f"left out: {what}, between which no joint of the arm moves")
    return notes
