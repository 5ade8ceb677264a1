"""The fingers of an imported model: their joints, and whether they form a gripper.

Two fingers at the end of the arm that slide or turn towards each other form a gripper. Fingers with
inner joints (linkages) and more than two fingers do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array

ALONG = 1.0 - 1e-4
"""Smallest cosine between parallel axes."""
ACROSS = 0.7
"""Largest cosine between the travel of sliding fingers and the direction to the tip; above it,
rotating fingers point along that direction."""
STROKES, LIGHTEST, NEAREST = (1e-3, 1.0), 1e-4, 1e-3
"""Limits of a gripper: opening (m), least mass of its fingers (kg), least distance (m) from the
last joint to their ends."""
ALIKE, STEEPEST, LONGEST = np.radians(3.0), np.radians(80.0), 0.3
"""Limits of rotating fingers: rad between mirrored limits, rad from the arm's direction, and m."""
SHORTEST = 1e-5
"""m of the last link."""


class Turn(NamedTuple):
    """Motion of two rotating fingers: mirrored, in one plane."""

    pivot: float  # m, from the middle to each pivot
    length: float  # m, of a finger: twice the distance to its centre of mass
    closed: float  # rad, of a finger from the hand's direction, outward
    open: float
    way: Array  # (3,) direction out of the hand


class Gripper(NamedTuple):
    """Two fingers, in the frame of the root body with all joints at zero."""

    joints: tuple[str, str]
    mass: float  # kg, of both
    axis: Array  # (3,) along which they move
    middle: Array  # (3,) m, of their frames; of their pivots
    stroke: float  # m, of both together
    turn: Turn | None = None


class Coupled(NamedTuple):
    """Joints that equalities or <mimic> couple."""

    joints: frozenset[int]
    fingers: bool  # they move fingers; otherwise links of an arm, a leg or a linkage


def find_held(model: mujoco.MjModel, root: int) -> dict[str, float]:
    """Return the named joints that an equality holds at a position (rad or m).

    MuJoCo's equality of one joint: its position is `ref` plus the first number of `polycoef`.
    """
    out = {}
    for e in range(model.neq):
        j = int(model.eq_obj1id[e])
        held = model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj2id[e] < 0
        mine = held and model.body_rootid[model.jnt_bodyid[j]] == root
        if mine and model.eq_active0[e] and model.joint(j).name:
            at = model.qpos0[model.jnt_qposadr[j]] + model.eq_data[e, 0]
            out[model.joint(j).name] = float(at)
    return out


def list_coupled(model: mujoco.MjModel, root: int) -> list[Coupled]:
    """Return the groups of coupled joints of the tree of `root`.

    Fingers are side by side: their joints do not all follow each other in one chain, and the same
    number of other joints moves beyond each of them. Fingers may have coupled joints of their own,
    as long as another finger with coupled joints is beside them.
    """
    groups: list[set[int]] = []
    for e in range(model.neq):
        if model.eq_type[e] != mujoco.mjtEq.mjEQ_JOINT:
            continue
        pair = {int(model.eq_obj1id[e]), int(model.eq_obj2id[e])}
        if all(j >= 0 and model.body_rootid[model.jnt_bodyid[j]] == root for j in pair):
            met = [group for group in groups if group & pair]
            groups = [group for group in groups if not group & pair] + [pair.union(*met)]
    above = {j: set(joints_to(model, int(model.jnt_bodyid[j]), {})) for g in groups for j in g}
    first = [sorted(j for j in group if above[j] & group == {j}) for group in groups]
    start = [frozenset(above[joints[0]] - {joints[0]}) for joints in first]
    out = []
    for group, joints, at in zip(groups, first, start, strict=True):
        beyond = {j: 0 for j in joints}
        for k in range(model.njnt):
            path = set(joints_to(model, int(model.jnt_bodyid[k]), {}))
            for j in joints:
                beyond[j] += k not in group and j in path
        beside = len(joints) > 1 or start.count(at) > 1
        out.append(Coupled(frozenset(group), beside and len(set(beyond.values())) == 1))
    return out


def find_fingers(model: mujoco.MjModel, data: mujoco.MjData, root: int) -> list[int]:
    """Return coupled joints of fingers, and adjacent slides or mirrored hinges at the ends.

    `data` has the model's kinematics.
    """
    out = {j for group in list_coupled(model, root) if group.fingers for j in group.joints}
    parents = set(model.body_parentid[1:].tolist())
    slides: dict[int, list[int]] = {}
    hinges: dict[int, list[int]] = {}
    for j in range(model.njnt):
        body = int(model.jnt_bodyid[j])
        parent = int(model.body_parentid[body])
        if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE and body not in parents:
            slides.setdefault(parent, []).append(j)
        elif model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE and joints_to(model, parent, {}):
            hinges.setdefault(parent, []).append(j)
    for joints in slides.values():
        out |= set(joints) if len(joints) > 1 else set()
    for joints in hinges.values():
        out |= set(joints) if len(joints) == 2 and _find_turn(model, data, joints) else set()
    return sorted(j for j in out if model.body_rootid[model.jnt_bodyid[j]] == root)


def find_gripper(
    model: mujoco.MjModel, data: mujoco.MjData, fingers: list[int], joints: list[int], tip: Array
) -> Gripper | None:
    """Return the gripper of two slides or hinges with limits that are both children of the chain's
    last joint.

    Slides move along one line across the direction from that joint to the `tip` (3,) m; hinges are
    mirrored and point along it.
    """
    if len(fingers) != 2 or not joints:
        return None
    moving = dict.fromkeys(range(model.njnt), "")
    for j in joints:
        del moving[j]
    bodies = [int(model.jnt_bodyid[j]) for j in fingers]
    mass, way = float(np.sum(model.body_subtreemass[bodies])), tip - data.xanchor[joints[-1]]
    far = float(np.linalg.norm(way))
    if (
        any(joints_to(model, b, moving) != joints for b in bodies)
        or mass < LIGHTEST
        or far < NEAREST
    ):
        return None
    names = model.joint(fingers[0]).name, model.joint(fingers[1]).name
    turn = _find_turn(model, data, fingers)
    if turn is not None and turn.way @ way > ACROSS * far:
        anchors, axis = data.xanchor[fingers], np.cross(turn.way, data.xaxis[fingers[0]])
        return Gripper(names, mass, axis, np.mean(anchors, axis=0), 0.0, turn)
    axes, stroke = data.xaxis[fingers], float(np.sum(np.ptp(model.jnt_range[fingers], axis=1)))
    if (
        not all(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE for j in fingers)
        or not all(model.jnt_limited[fingers])
        or abs(axes[0] @ axes[1]) < ALONG
        or abs(axes[0] @ way) > ACROSS * far
        or not STROKES[0] <= stroke <= STROKES[1]
    ):
        return None
    return Gripper(names, mass, axes[0].copy(), np.mean(data.xpos[bodies], axis=0), stroke)


def _find_turn(model: mujoco.MjModel, data: mujoco.MjData, pair: list[int]) -> Turn | None:
    """Return the motion of two hinges with mirrored fingers, or None.

    A finger points from its joint to its centre of mass; the hand's direction is between both.
    """
    bodies, spans = [int(model.jnt_bodyid[j]) for j in pair], _list_spans(model, pair)
    below = [b for b in range(model.nbody) if int(model.body_parentid[b]) in bodies]
    if (
        any(model.jnt_type[j] != mujoco.mjtJoint.mjJNT_HINGE for j in pair)
        or any(has_joint(model, b) for b in below)
        or spans is None
        or abs(data.xaxis[pair[0]] @ data.xaxis[pair[1]]) < ALONG
    ):
        return None
    x, pivots = data.xaxis[pair[0]], data.xanchor[pair]
    arms = data.subtree_com[bodies] - pivots
    arms = arms - np.outer(arms @ x, x)
    sizes = np.linalg.norm(arms, axis=1)
    if min(sizes) < NEAREST:
        return None
    arms = arms / sizes[:, None]
    z = arms[0] + arms[1]
    if np.linalg.norm(z) < 2.0 * np.cos(STEEPEST):
        return None
    z = z / np.linalg.norm(z)
    y = np.cross(z, x)
    gap = pivots[0] - pivots[1]
    y = y if gap @ y > 0.0 else -y  # the first finger is on the positive side of y
    found = np.zeros((2, 2))
    for k, sign in enumerate((1.0, -1.0)):
        angle = float(np.arctan2(sign * arms[k] @ y, arms[k] @ z))
        outward = np.cos(angle) * sign * y - np.sin(angle) * z
        rate = np.sign(np.cross(data.xaxis[pair[k]], arms[k]) @ outward)
        here = data.qpos[model.jnt_qposadr[pair[k]]]
        found[k] = np.sort(angle + rate * (spans[k] - here))
    closed, most = np.clip(np.mean(found, axis=0), -STEEPEST, STEEPEST).tolist()
    pivot, length = float(0.5 * gap @ y), float(np.sum(sizes))  # twice the mean
    if (
        np.max(np.abs(found[0] - found[1])) > ALIKE
        or abs(gap @ z) > 0.1 * length
        or not NEAREST <= length <= LONGEST
        or pivot < STROKES[0]
        or pivot + length * np.sin(most) < 2.0 * STROKES[0]
        or most - closed < ALIKE
    ):
        return None
    return Turn(pivot, length, closed, most, z)


def has_joint(model: mujoco.MjModel, body: int, own: int = 0) -> bool:
    """Whether a body or one of its descendants has a joint, besides `own` ones of the body."""
    return bool(model.body_jntnum[body] > own) or any(
        has_joint(model, b) for b in range(body + 1, model.nbody) if model.body_parentid[b] == body
    )


def _list_spans(model: mujoco.MjModel, pair: list[int]) -> list[Array] | None:
    """Return the limits (2,) of two joints; coupled joints share the limits of either.

    None without limits.
    """
    spans = [np.array(model.jnt_range[j]) if model.jnt_limited[j] else None for j in pair]
    for e in range(model.neq):
        ends = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
        if model.eq_type[e] != mujoco.mjtEq.mjEQ_JOINT or sorted(ends) != sorted(pair):
            continue
        follower, leader = pair.index(ends[0]), pair.index(ends[1])
        offset, rate = (float(c) for c in model.eq_data[e, :2])
        led, follows = spans[leader], spans[follower]
        if led is not None:
            spans[follower] = offset + rate * led
        elif follows is not None and rate:
            spans[leader] = (follows - offset) / rate
    first, second = spans
    return None if first is None or second is None else [first, second]


def joints_to(model: mujoco.MjModel, body: int, frozen: Mapping[int, str]) -> list[int]:
    """Return the moving joints from the root to a body, in this order."""
    out: list[int] = []
    while body > 0:
        for j in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
            if j not in frozen and model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE:
                out.insert(0, j)
        body = int(model.body_parentid[body])
    return out


def find_ends(model: mujoco.MjModel, data: mujoco.MjData, joints: list[int], start: Array) -> Array:
    """Return the middle (3,) m of the fingers' ends, relative to the last joint at `start`.

    Fingers end at their shapes, or at twice the distance of their centres of mass if that is
    farther. Two rotating fingers are taken as parallel.
    """
    turn = _find_turn(model, data, joints) if len(joints) == 2 else None
    if turn is not None:
        return np.asarray(np.mean(data.xanchor[joints], axis=0) + turn.length * turn.way)
    fingers = [int(model.jnt_bodyid[j]) for j in joints]
    middle = np.mean([data.xpos[b] for b in fingers], axis=0)
    axis = data.xaxis[model.body_jntadr[fingers[0]]]
    way = middle - start - ((middle - start) @ axis) * axis
    size = float(np.linalg.norm(way))
    if size < SHORTEST:
        return middle
    way /= size
    reach = 2.0 * max(float((data.xipos[b] - middle) @ way) for b in fingers)
    for g in range(model.ngeom):
        if int(model.geom_bodyid[g]) in fingers:
            R = data.geom_xmat[g].reshape(3, 3)
            centre, half = model.geom_aabb[g, :3], model.geom_aabb[g, 3:]
            far = (data.geom_xpos[g] + R @ centre - middle) @ way + np.abs(R.T @ way) @ half
            reach = max(reach, float(far))
    return np.asarray(middle + max(reach, 0.0) * way)
