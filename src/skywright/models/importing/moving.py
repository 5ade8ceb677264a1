"""What moves in an imported model and no robot file can describe: tilting rotors, closed loops."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import mujoco
import numpy as np

from skywright.errors import InputError
from skywright.models.importing.fingers import has_joint, joints_to
from skywright.models.importing.rotors import FoundRotor

SAME = 1e-6
"""Sine between axes, and m between a rotor and an axis: a joint there turns the propeller only."""
TIES = (mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtEq.mjEQ_TENDON)
LOOPS = {mujoco.mjtEq.mjEQ_CONNECT: "connect", mujoco.mjtEq.mjEQ_WELD: "weld"}


def check_rotors(
    file: Path,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    rotors: Sequence[FoundRotor],
    frozen: Collection[str],
) -> set[str]:
    """Return the joints that turn nothing but the propeller of a rotor.

    Raises InputError if another joint between the root and a rotor moves the rotor. `data` is at
    zero, the root body at the origin of W. `frozen` joints ("*": all) do not count.
    """
    out = set()
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
            if turns and not has_joint(model, int(model.jnt_bodyid[j]), 1):
                out.add(name)
            if not turns and name not in frozen:
                raise InputError(
                    f"{file}: joint {name!r} moves rotor {i + 1}, on link "
                    f"{model.body(rotor.body).name!r}: rotors that tilt or move in flight are not "
                    f"supported; --weld {name} freezes the joint"
                )
    return out - set(frozen)


def check_loops(file: Path, model: mujoco.MjModel, root: int, joints: Collection[int]) -> list[str]:
    """Return notes on constraints that are left out; InputError if one constrains the arm.

    `joints` are those of the arm: a loop of frozen joints, such as a linkage of fingers, is rigid
    in the robot file. Equalities of two joints are found with the chain.
    """
    notes, tied = [], set[int]()
    for e in range(model.neq):
        kind = mujoco.mjtEq(model.eq_type[e])
        if not model.eq_active0[e] or kind not in (*LOOPS, *TIES):
            continue
        if kind in LOOPS:
            notes += _check_loop(file, model, root, joints, e)
            continue
        name = f"equality {model.equality(e).name!r}"
        ends = [int(x) for x in (model.eq_obj1id[e], model.eq_obj2id[e]) if x >= 0]
        moved = set(ends)
        if kind == mujoco.mjtEq.mjEQ_TENDON:
            tied |= moved
            moved = set().union(*(_list_moved(model, tendon) for tendon in ends))
            name += f" of tendon {' and '.join(repr(model.tendon(t).name) for t in ends)}"
        mine = {j for j in moved if model.body_rootid[model.jnt_bodyid[j]] == root}
        arm = [model.joint(j).name for j in joints if j in mine]
        if mine and mine != moved:
            notes.append(f"left out: {name}, of which a part does not belong to the robot")
        elif arm and (kind == mujoco.mjtEq.mjEQ_TENDON or len(ends) == 1):
            raise InputError(
                f"{file}: {name} constrains joint {', '.join(map(repr, arm))} of the arm, which is "
                "not supported: remove the equality, or freeze the joints: "
                + " ".join(f"--weld {joint}" for joint in arm)
            )
        elif mine and kind == mujoco.mjtEq.mjEQ_TENDON:
            notes.append(f"left out: {name}, which constrains no joint of the arm")
    for tendon in sorted(set(range(model.ntendon)) - tied):
        arm = [model.joint(j).name for j in joints if j in _list_moved(model, tendon)]
        if arm:
            notes.append(
                f"left out: tendon {model.tendon(tendon).name!r} of joint "
                f"{', '.join(map(repr, arm))}, with its limits, springs and actuators"
            )
    return notes


def _check_loop(
    file: Path, model: mujoco.MjModel, root: int, joints: Collection[int], e: int
) -> list[str]:
    """Return the note on an equality of bodies; InputError if it closes a loop of the arm."""
    ends = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
    if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
        ends = [int(model.site_bodyid[site]) for site in ends]
    mine = [body for body in ends if body > 0 and model.body_rootid[body] == root]
    if not mine:
        return []
    names = " and ".join(repr(model.body(body).name) for body in ends)
    kind = LOOPS[mujoco.mjtEq(model.eq_type[e])]
    what = f"equality {model.equality(e).name!r} ({kind}) of bodies {names}"
    if len(mine) == 1:
        return [f"left out: {what}, of which one does not belong to the robot"]
    above = [set(joints_to(model, body, {})) & set(joints) for body in ends]
    between = [model.joint(j).name for j in sorted(above[0] ^ above[1])]
    if between:
        raise InputError(
            f"{file}: {what} closes a loop over joint {', '.join(map(repr, between))}: "
            "kinematic loops are not supported; remove the equality, or freeze the joints: "
            + " ".join(f"--weld {name}" for name in between)
        )
    return [f"left out: {what}, between which no joint of the arm moves"]


def _list_moved(model: mujoco.MjModel, tendon: int) -> set[int]:
    """Return the joints that change the length of a tendon."""
    out: set[int] = set()
    paths: list[set[int]] = []
    first, n = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    for kind, i in zip(
        model.wrap_type[first : first + n], model.wrap_objid[first : first + n], strict=True
    ):
        if kind == mujoco.mjtWrap.mjWRAP_JOINT:
            out.add(int(i))
        elif kind == mujoco.mjtWrap.mjWRAP_SITE:
            paths.append(set(joints_to(model, int(model.site_bodyid[i]), {})))
        elif kind in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER):
            paths.append(set(joints_to(model, int(model.geom_bodyid[i]), {})))
    return out.union(*paths) - (paths[0].intersection(*paths) if paths else set())
