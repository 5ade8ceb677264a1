"""The kinematic chain of an imported model: moving joints, and one body per rigid group.

Joints that do not lead to the tip (fingers, gimbals, legs, rotors) are frozen at zero, or at the
end of their range nearest to zero; their child bodies become part of the preceding link. Two
fingers that move towards each other at the tip are a gripper.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.types import MAX_JOINTS
from skywright.errors import InputError, neighbours
from skywright.models.importing.fingers import (
    SHORTEST,
    Gripper,
    find_ends,
    find_fingers,
    find_gripper,
    find_held,
    joints_to,
    list_coupled,
)

TINY = 1e-9
TIP_NAMES = ("tcp", "tip", "tool", "ee", "end_effector", "end_link", "pinch", "grasp", "gripper")


class Part(NamedTuple):
    """A rigid group of bodies, in the frame of the root body with all joints at zero."""

    name: str
    mass: float  # kg
    com: Array  # (3,) m
    inertia: Array  # (3, 3) kg m^2 about it
    joint: str  # joint that moves it; "" for the platform
    slide: bool
    p: Array  # (3,) m, of the joint
    axis: Array  # (3,)
    span: tuple[float, float] | None  # rad or m


class Chain(NamedTuple):
    """The platform, then the moving links, in a chain."""

    parts: list[Part]
    tip: Array  # (3,) m
    tip_name: str
    carrier: int  # body that contains the tip
    qpos: Array  # of the model with the chain's joints at zero
    joints: list[int]  # of the model, in the order of the parts from the second on
    gripper: Gripper | None
    members: dict[int, int]  # body -> index of its part; excludes rotors and the gripper's fingers
    frozen: list[str]  # names of joints, with the reason


def freeze(model: mujoco.MjModel, root: int, locked: Mapping[str, float]) -> mujoco.MjData:
    """Return data with the root body at the origin of W and every joint at or next to zero.

    `locked` joints are at their locked positions (rad or m).
    """
    data = mujoco.MjData(model)
    for j in range(model.njnt):
        at, kind = int(model.jnt_qposadr[j]), model.jnt_type[j]
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            data.qpos[at : at + 7] = [0, 0, 0, 1, 0, 0, 0]
        elif model.body_rootid[model.jnt_bodyid[j]] != root:
            continue
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            raise InputError(f"joint {model.joint(j).name!r} is a ball joint; valid: hinge, slide")
        else:
            low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf)
            data.qpos[at] = locked.get(model.joint(j).name, min(max(0.0, low), high))
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    if np.linalg.norm(data.xpos[root]) > TINY:
        raise InputError(f"body {model.body(root).name!r} is not the free root of its tree")
    return data


def find_chain(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    root: int,
    rotor_joints: set[str],
    locked: Mapping[str, float],
    weld: set[str],
    tip: str | None,
) -> Chain:
    """Return platform and arm. `weld` names joints to freeze, "*" all; raises InputError.

    `locked` joints, whose limits are equal or which an equality holds, are frozen too.
    """
    held = find_held(model, root)
    movable = model.jnt_type != mujoco.mjtJoint.mjJNT_FREE
    known = {model.joint(int(j)).name for j in np.flatnonzero(movable)}
    unknown = sorted(weld - known - {"*"})
    if unknown:
        raise InputError(f"--weld {unknown[0]!r} is no joint; valid: {', '.join(sorted(known))}")
    frozen: dict[int, str] = {}
    for j in range(model.njnt):
        body, name = int(model.jnt_bodyid[j]), model.joint(j).name
        if model.body_rootid[body] != root or body == root:
            continue
        if name in rotor_joints:
            frozen[j] = ""
        elif name in locked:
            why = "an equality holds it at" if name in held else "both its limits are"
            frozen[j] = f"{why} {locked[name]:g}"
        elif name in weld or "*" in weld:
            frozen[j] = "as asked"
        elif model.body_jntnum[body] > 1:
            raise InputError(
                f"body {model.body(body).name!r} has {model.body_jntnum[body]} joints; valid: one "
                "hinge or slide a body"
            )
    fingers = find_fingers(model, data, root)
    for j in fingers:
        frozen.setdefault(j, "a finger of the gripper")
    coupled = _list_partners(model, root)
    carrier, place, tip_name = _find_tip(model, data, root, frozen, fingers, tip)
    joints = joints_to(model, carrier, frozen)
    for j in joints:
        partners = [model.joint(k).name for k in joints if k in coupled.get(j, ())]
        if partners:
            names = " and ".join([model.joint(j).name, *partners])
            raise InputError(
                f"joints {names} of the arm are coupled (<mimic>, or an equality): coupled joints "
                f"that follow each other in an arm are not supported; freeze one of them with "
                f"--weld {partners[-1]}, or remove the coupling to move each by a servo of its own"
            )
    for j in range(model.njnt):
        body = int(model.jnt_bodyid[j])
        if model.body_rootid[body] == root and body != root and j not in (*joints, *frozen):
            with_it = [model.joint(k).name for k in joints if k in coupled.get(j, ())]
            which = f" (in the file it moves with {with_it[0]})" if with_it else ""
            frozen[j] = f"does not lead to the tip {tip_name}{which}"
    if len(joints) > MAX_JOINTS:
        raise InputError(
            f"{len(joints)} joints lead to the tip; at most {MAX_JOINTS} are supported (--weld)"
        )
    qpos = data.qpos.copy()
    for j in joints:
        qpos[model.jnt_qposadr[j]] = 0.0
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    R, p = data.xmat[carrier].reshape(3, 3), data.xpos[carrier]
    if joints and np.linalg.norm(p + R @ place - data.xanchor[joints[-1]]) < SHORTEST:
        last = model.joint(joints[-1]).name
        raise InputError(
            f"the tip ({tip_name}) is at joint {last!r}, the last: choose a link or site beyond it "
            f"with --tip, or freeze the joint with --weld {last}"
        )
    tip_at = p + R @ place
    hands = [j for j in fingers if model.joint(j).name not in weld]
    gripper = find_gripper(model, data, hands, joints, tip_at)
    fingers_of = () if gripper is None else gripper.joints
    notes = [
        f"joint {name} is frozen: {why}"
        for name, why in ((model.joint(j).name, why) for j, why in frozen.items())
        if why and name not in fingers_of
    ]
    if gripper is not None:
        turn = gripper.turn
        what = f"of {1e3 * gripper.stroke:.3g} mm" if turn is None else (
            f"whose fingers turn by {np.degrees(turn.open - turn.closed):.3g} deg"
        )  # fmt: skip
        notes.append(f"joints {' and '.join(gripper.joints)}: a gripper {what}")
    parts = _collect(model, data, root, joints)
    apart = rotor_joints | set(fingers_of)
    members = {
        b: part for b, part in _assign(model, root, joints).items()
        if not apart & {model.joint(j).name for j in joints_to(model, b, {})}
    }  # fmt: skip
    return Chain(parts, tip_at, tip_name, carrier, qpos, joints, gripper, members, notes)


def _list_partners(model: mujoco.MjModel, root: int) -> dict[int, frozenset[int]]:
    """Return joint -> the other joints that are coupled to it, of all joints but fingers'."""
    return {
        j: group.joints - {j}
        for group in list_coupled(model, root)
        if not group.fingers
        for j in group.joints
    }


def _find_tip(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    root: int,
    frozen: dict[int, str],
    fingers: list[int],
    tip: str | None,
) -> tuple[int, Array, str]:
    """Return the body of the tip, the tip's position (3,) m in it, and its name."""
    mine = [b for b in range(1, model.nbody) if model.body_rootid[b] == root]
    if tip is not None:
        bodies = {model.body(b).name: b for b in mine}
        sites = {model.site(k).name: k for k in range(model.nsite) if model.site_bodyid[k] in mine}
        if tip in bodies:
            return bodies[tip], np.zeros(3), tip
        if tip not in sites:
            raise InputError(
                f"--tip {tip!r} is neither a body (link) nor a site of the robot; valid: "
                + neighbours(tip, filter(None, {*bodies, *sites}), 10)
            )
        site = sites[tip]
        return int(model.site_bodyid[site]), model.site_pos[site].copy(), tip
    length = {b: len(joints_to(model, b, frozen)) for b in mine}
    deepest = max(length.values())
    ends = [b for b in mine if length[b] == deepest]
    if deepest == 0:
        return root, np.zeros(3), "none"
    last = {tuple(joints_to(model, b, frozen)) for b in ends}
    if len(last) > 1:
        joints = [joints[-1] for joints in sorted(last)]
        names = [model.joint(j).name for j in joints]
        turning = all(
            model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE and not model.jnt_limited[j]
            for j in joints
        )
        advice = "; if they turn propellers, freeze them: " if turning else ", or freeze joints: "
        raise InputError(
            f"several arms end after {deepest} joints ({', '.join(names)}); choose with --tip"
            + advice
            + (" ".join(f"--weld {name}" for name in names) if turning else "--weld NAME")
        )
    at = data.xanchor[next(iter(last))[-1]]
    away = {b: float(np.linalg.norm(data.xpos[b] - at)) for b in ends}
    for word in TIP_NAMES:
        for b in ends:
            if word in model.body(b).name.lower().split("/")[-1] and away[b] > 1e-3:
                return b, np.zeros(3), model.body(b).name
    grip = [j for j in fingers if int(model.jnt_bodyid[j]) in ends]
    if grip:
        palm = int(model.body_parentid[model.jnt_bodyid[grip[0]]])
        ends_at = find_ends(model, data, grip, at) - data.xpos[palm]
        return palm, data.xmat[palm].reshape(3, 3).T @ ends_at, "middle of the fingers' ends"
    far = max(ends, key=away.__getitem__)
    if away[far] > 1e-3:
        return far, np.zeros(3), model.body(far).name
    return far, 2.0 * model.body_ipos[far], f"twice the centre of mass of {model.body(far).name}"


def _assign(model: mujoco.MjModel, root: int, joints: list[int]) -> dict[int, int]:
    """Return body -> index of its part: 0 the platform, then the joints' in order."""
    movers = {int(model.jnt_bodyid[j]): i + 1 for i, j in enumerate(joints)}
    member: dict[int, int] = {root: 0}
    for b in range(root + 1, model.nbody):
        if model.body_rootid[b] == root:
            member[b] = movers.get(b, member[int(model.body_parentid[b])])
    return member


def _collect(
    model: mujoco.MjModel, data: mujoco.MjData, root: int, joints: list[int]
) -> list[Part]:
    member = _assign(model, root, joints)
    out = []
    for i in range(len(joints) + 1):
        bodies = [b for b, m in member.items() if m == i]
        mass, com, inertia = combine(model, data, bodies)
        j = joints[i - 1] if i else -1
        name = model.body(int(model.jnt_bodyid[j]) if i else root).name
        if mass <= 0.0:
            raise InputError(f"body {name!r} moves but has no mass; add one, or --weld its joint")
        span = (float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1]))
        out.append(
            Part(
                name, mass, com, inertia, model.joint(j).name if i else "",
                bool(i and model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE),
                data.xanchor[j].copy() if i else np.zeros(3),
                data.xaxis[j].copy() if i else np.zeros(3),
                span if i and model.jnt_limited[j] else None,
            )
        )  # fmt: skip
    return out


def combine(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: list[int]
) -> tuple[float, Array, Array]:
    """Return mass (kg), centre (3,) m in W and inertia (3, 3) kg m^2 about it, of bodies."""
    mass = float(sum(model.body_mass[b] for b in bodies))
    if mass <= 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    com = sum((model.body_mass[b] * data.xipos[b] for b in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for b in bodies:
        R, d = data.ximat[b].reshape(3, 3), data.xipos[b] - com
        inertia += R @ np.diag(model.body_inertia[b]) @ R.T
        inertia += model.body_mass[b] * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, com, inertia
