"""Statics of a force on a hand: wrench on the platform, and motion of passive link and springs.

The platform is level and held; its axes are those of W. A passive link turns until the torque about
its joint vanishes, so that it transmits no torque about that axis (Suarez 2020, section II-C).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from skywright.core.arrays import Array
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import (
    build_body_model,
    compute_body,
    compute_kinematics,
    fill_gravity_torque,
)
from skywright.models.springs import spring_deflection, spring_torque

SWING_MAX = math.radians(85.0)  # beyond this angle, the force exceeds the weight of link and arms


class Reaction(NamedTuple):
    """Change of the wrench on the platform, about its origin, due to a force on the left hand."""

    f: Array  # (3,) N
    t: Array  # (3,) N m
    swing: float  # rad, change of the passive link's angle; 0 without one


class Recoil(NamedTuple):
    """Motion of a robot's arms under a force on its left hand."""

    swing: float  # rad, of the passive link
    deflection: float  # rad, largest change of a spring
    moved: Array  # (3,) m, of the hand against the platform


class Loaded:
    """A robot's arms in one posture, under forces on the left hand."""

    def __init__(self, robot: Robot, q: Array, gravity: float = 9.81) -> None:
        """`q` (n_joints,) rad is the posture at rest without a force."""
        self.robot, self.q = robot, np.array(q, dtype=float)
        self.model: Any = build_body_model(robot, gravity)
        self.joints = list_joints(robot)
        self.swing = robot.pendulum is not None
        self._g = np.array([0.0, 0.0, -gravity])
        self._weight_t = self._weight_torque(self.q)

    def hand(self, q: Array) -> tuple[Array, Array, Array]:
        """Return hand (3,) m in B, its Jacobian (3, n) and the holding torques (n,) N m at q."""
        k, n, torque = compute_kinematics(self.model, q), len(q), np.zeros(MAX_JOINTS)
        fill_gravity_torque(self.model[0], k, self._g, torque)
        return k["p_BH"][0].copy(), k["J_BH"][0][:, :n].copy(), torque[:n]

    def _weight_torque(self, q: Array) -> Array:
        mass, p_BC, _ = compute_body(self.model, q)
        return np.cross(p_BC, mass * self._g)

    def compute_push_limit(self, way: Array) -> tuple[float, str]:
        """Return the largest force (N) of the left hand along the unit vector `way` (3,) in B, and
        the limiting joint.

        The limiting joint is the one whose servo stalls under the arm's weight and the force's
        torque J^T f. Returns (inf, "") if the force loads no servo.
        """
        _, J, hold = self.hand(self.q)
        servos = list_servos(self.robot)
        limit, first = math.inf, ""
        for j, limb in enumerate(self.joints):
            lever = float(J[:, j] @ way)
            if limb.servo < 0 or abs(lever) < 1e-9:
                continue
            spare = servos[limb.servo][1].stall_torque_nm - math.copysign(1.0, lever) * hold[j]
            if spare / abs(lever) < limit:
                limit, first = float(spare / abs(lever)), limb.name
        return limit, first

    def compute_reaction(self, f: Array) -> Reaction | None:
        """Return the wrench of a force f (3,) N on the hand on the platform; joints rigid.

        Returns None if the passive link has no rest angle.
        """
        q = self.q.copy()
        if self.swing:

            def unbalanced(angle: float) -> float:
                q[0] = angle
                _, J, hold = self.hand(q)
                return float(hold[0] - J[:, 0] @ f)

            low, high = -SWING_MAX, SWING_MAX
            if unbalanced(low) * unbalanced(high) > 0.0:
                return None
            q[0] = optimize.brentq(unbalanced, low, high, xtol=1e-10)
        p, _, _ = self.hand(q)
        t = np.cross(p, f) + self._weight_torque(q) - self._weight_t
        return Reaction(np.array(f, dtype=float), t, float(q[0] - self.q[0]) if self.swing else 0.0)

    def compute_recoil(self, f: Array) -> Recoil | None:
        """Return the motion of springs and passive link under f (3,) N; the servo shafts do not
        move.

        Returns None if there is no rest position.
        """
        p0, _, hold0 = self.hand(self.q)
        links = [limb.link for limb in self.joints]
        springs = [
            (x.flex_stiffness_nm_per_rad, math.radians(x.flex_linear_deg or 0.0), x.flex_hardening)
            for x in links
        ]
        wound = np.array([
            spring_deflection(k, end, hard, t) if k else 0.0
            for (k, end, hard), t in zip(springs, hold0, strict=True)
        ])  # fmt: skip
        free = [j for j, x in enumerate(links) if x.passive or x.flex_stiffness_nm_per_rad]
        q = self.q.copy()

        def unbalanced(x: Array) -> Array:
            q[free] = x
            _, J, hold = self.hand(q)
            need = hold - J.T @ f
            out = []
            for j in free:
                k, end, hard = springs[j]
                given = spring_torque(k, end, hard, self.q[j] + wound[j] - q[j]) if k else 0.0
                out.append(given - need[j])
            return np.array(out)

        if free:
            found = optimize.root(unbalanced, self.q[free], tol=1e-9)
            if not found.success or np.max(np.abs(unbalanced(found.x))) > 1e-4:
                return None
            q[free] = found.x
        p, _, _ = self.hand(q)
        moved = p - p0
        if self.swing and links[0].lateral_stiffness_nm_per_rad is not None:
            lever = p0[2] - self.joints[0].offset[2]
            moved[1] += f[1] * lever**2 / links[0].lateral_stiffness_nm_per_rad
        turned = np.abs(q - self.q)
        sprung = [j for j in free if not links[j].passive]
        return Recoil(
            float(q[0] - self.q[0]) if self.swing else 0.0,
            float(np.max(turned[sprung])) if sprung else 0.0,
            moved,
        )


def compute_reaction_map(
    loaded: Loaded, force: float, azimuth: Array, elevation: Array
) -> tuple[Array, Array]:
    """Return torque per newton (n_el, n_az, 3) in m, and the link's rotation (n_el, n_az) rad.

    `force` (N) acts on the hand toward azimuth (rad, from +x to the left) and elevation (up). NaN
    if the passive link has no rest angle.
    """
    torque = np.full((len(elevation), len(azimuth), 3), np.nan)
    swing = np.full((len(elevation), len(azimuth)), np.nan)
    for i, up in enumerate(elevation):
        for j, around in enumerate(azimuth):
            way = np.array([
                math.cos(up) * math.cos(around), math.cos(up) * math.sin(around), math.sin(up)
            ])  # fmt: skip
            found = loaded.compute_reaction(force * way)
            if found is not None:
                torque[i, j], swing[i, j] = found.t / force, found.swing
    return torque, swing
