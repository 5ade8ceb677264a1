"""Positions around a pipe that a robot's hand reaches while the rest of the robot keeps clear.

Postures of the left arm are sampled (the right arm mirrors the left). For each posture the platform
is placed so that the hand is at the point in question, and the distances are computed. This works
for any arm, and a passive link is at the rest angle of the posture's weight. The platform is level
and faces the pipe squarely.
"""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints, Mask
from skywright.core.rotations import rot_z
from skywright.core.user_code import njit
from skywright.description.robot.limbs import list_joints, list_limbs
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.surface import build_cylinder, level_axes
from skywright.models.bar_body import BAR
from skywright.models.compliant_arms import find_hands, find_swing
from skywright.models.geometry import (
    FAR,
    ClearanceCore,
    ClearanceQuery,
    build_clearance,
    compute_self_clearance,
    query_clearance,
)
from skywright.models.rigid_body import build_body_model, posture
from skywright.models.scene import build_scene

POSTURES = 320  # approximate number of sampled postures
PLATFORM_MARGIN = 0.1  # m, kept between platform and world
ARM_MARGIN = 0.02  # m, kept by the links that carry the hand
PLATFORM = ("platform", "gear", "docking")
"""Bodies of the platform."""


class ReachMap(NamedTuple):
    """Points around the pipe in its cross-section; x ahead, z up, from the pipe's axis."""

    x: Array  # (n,) m
    z: Array  # (m,) m
    reached: Mask  # (m, n) by a robot that faces +x
    inside: Mask  # (m, n) within the pipe
    angle: Array  # (k,) rad, points on the surface, from the side that faces the robot to the top
    touched: Mask  # (k,) from this side
    radius: float

    @property
    def surface_share(self) -> float:
        """Share of the circumference that can be touched, from either side of the pipe."""
        return float(np.mean(self.touched | self.touched[_mirror(self.angle)]))

    @property
    def below_share(self) -> float:
        """Share of the lower half of the surface, likewise."""
        both = self.touched | self.touched[_mirror(self.angle)]
        return float(np.mean(both[np.sin(self.angle) < -1e-9]))

    @property
    def area_below(self) -> float:
        """Area (m^2) below the pipe's axis that the hand reaches."""
        cell = (self.x[1] - self.x[0]) * (self.z[1] - self.z[0])
        return float(np.count_nonzero(self.reached[self.z < 0.0]) * cell)


def _mirror(angle: Array) -> Ints:
    """Return the index (k,) of the point on the other side of the pipe."""
    other = (math.pi - angle) % (2.0 * math.pi)
    return np.array([int(np.argmin(np.abs(angle - a))) for a in other], dtype=np.int64)


def compute_reach(
    robot: Robot, world: World, *, span: float = 0.8, step: float = 0.05, places: int = 72
) -> ReachMap:
    """Map the reach of the left hand around the world's pipe (which it must have)."""
    assert world.pipe is not None
    cylinder = build_cylinder(world.pipe)
    ahead, _, up = level_axes(cylinder.R_WP).T
    R = rot_z(math.atan2(ahead[1], ahead[0]))
    query = build_clearance(build_scene(robot, world))
    q = sample_postures(robot, query)
    model = build_body_model(robot, world.gravity_mps2)
    hands = np.array([find_hands(model, row)[0] for row in q])
    groups = split_query(robot, query)
    margins = np.array([PLATFORM_MARGIN, ARM_MARGIN, 0.0])
    ball = robot.probe.tip_radius_m if robot.probe is not None else _ball(robot)
    axis = np.arange(-span, span + 0.5 * step, step)
    inside = np.hypot(axis[None], axis[:, None]) < cylinder.radius + ball

    def ask(x: Array, z: Array) -> Mask:
        goals = cylinder.p_WP + x[:, None] * ahead + z[:, None] * up
        out = np.zeros(len(goals), dtype=np.bool_)
        _try_goals(groups[0], groups[1], groups[2], margins, goals, R, q, hands, out)
        return out

    xx, zz = np.meshgrid(axis, axis)
    reached = np.zeros(xx.shape, dtype=np.bool_)
    reached[~inside] = ask(xx[~inside], zz[~inside])
    angle = np.arange(places) * 2.0 * math.pi / places
    r = cylinder.radius + ball
    touched = ask(-r * np.cos(angle), r * np.sin(angle))
    return ReachMap(axis, axis, reached, inside, angle, touched, cylinder.radius)


def _ball(robot: Robot) -> float:
    return robot.arm.hand.radius_m if robot.arm is not None else 0.0


def sample_postures(robot: Robot, query: ClearanceQuery) -> Array:
    """Return postures (n, n_joints) rad that keep clear of propellers and gear, link at rest.

    Arm joints that turn about y are sampled on a grid; the others keep their working angles.
    """
    joints = list_joints(robot)
    model = build_body_model(robot)
    base = posture(robot, "working")
    mine = [j for j, x in enumerate(joints) if x.side == 0 and x.link.axis == "y"]
    count = max(3, int(POSTURES ** (1.0 / max(len(mine), 1))))
    grids = [np.linspace(*joints[j].link.reach, count) for j in mine]
    partner = {j: _find_partner(robot, j) for j in mine}
    out = []
    tries: list[Any] = [base[mine], *itertools.product(*grids)]
    for angles in tries:
        q = base.copy()
        for j, a in zip(mine, angles, strict=True):
            q[j] = a
            if partner[j] >= 0:
                q[partner[j]] = a
        q = find_swing(model, q)
        if compute_self_clearance(query, q).distance >= ARM_MARGIN:
            out.append(q)
    return np.array(out).reshape(-1, len(base))


def _find_partner(robot: Robot, j: int) -> int:
    """Return the right arm's joint that mirrors joint `j` of the left; -1: none."""
    names = [x.name for x in list_joints(robot)]
    other = names[j].replace("left_", "right_", 1)
    return names.index(other) if other != names[j] and other in names else -1


def split_query(robot: Robot, query: ClearanceQuery) -> tuple[Any, Any, Any]:
    """Return the queries of the platform, of the links that carry the hands, and of the last links
    alone.

    Hands may touch and are in no query.
    """
    last = {
        [x.name for x in list_joints(robot) if x.side == side][-1]
        for side in range(robot.arm.sides if robot.arm is not None else 0)
    }
    kinds = dict.fromkeys(PLATFORM, 0) | {x.name: 1 for x in list_limbs(robot)}
    kinds |= {BAR: 1} | dict.fromkeys(last, 2)
    bodies = query.model.geom_bodyid[query.core.pairs[:, 0]]
    kind = np.array([kinds.get(query.model.body(b).name, 3) for b in bodies])
    used = np.arange(len(kind)) < query.core.n_world
    return tuple(_pick(query.core, used & (kind == k)) for k in range(3))  # type: ignore[return-value]


def _pick(core: ClearanceCore, keep: Mask) -> ClearanceCore:
    pairs = np.ascontiguousarray(core.pairs[keep])
    return core._replace(pairs=pairs, n_world=len(pairs), probe=np.zeros(len(pairs)))


@njit(cache=True, error_model="numpy")
def _try_goals(
    platform: ClearanceCore, carrier: ClearanceCore, last: ClearanceCore, margins: Array,
    goals: Array, R: Array, q: Array, hands: Array, out: Any,
) -> None:  # fmt: skip
    """Mark the goals (n, 3) m that a posture reaches with all margins kept."""
    p = np.empty(3)
    for g in range(goals.shape[0]):
        for k in range(q.shape[0]):
            for a in range(3):
                p[a] = goals[g, a]
                for b in range(3):
                    p[a] -= R[a, b] * hands[k, b]
            if query_clearance(platform, p, R, q[k], 0.0, FAR)[0] < margins[0]:
                continue
            if query_clearance(carrier, p, R, q[k], 0.0, FAR)[0] < margins[1]:
                continue
            if query_clearance(last, p, R, q[k], 0.0, FAR)[0] < margins[2]:
                continue
            out[g] = True
            break
