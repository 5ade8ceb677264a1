"""Standard stabilisation of Sanchez-Cuevas 2020, section 5.3: a linear cascade, coplanar logic.

The mode commands thrust and three torques only, as for level rotors. The lateral force that tilted
rotors produce with them remains; on a symmetric robot it is zero. There is no position loop: the
attitude of the reference tilts the platform as a pilot would.

Height: f = m (g + z''_d + k_v (k_p e_z + z'_d - z')), without regard to the tilt. Attitude: t = J
(k_r (k_a e + w_d - w)) with the constant inertia about the axes of B in the folded posture. Each
pair follows from bandwidth and damping of [robot.control], k_r k_a = w^2 and k_r = 2 zeta w. A trim
compensates errors of weight and centre of mass: it follows the command of the other modes, and
integrates from there.

The mixer is the least-norm inverse of four rows of the true allocation. With the rows of level
rotors, drag torques alone would produce yaw; on this robot the tilt acts six times stronger and in
the opposite direction, so that the loop would diverge (test).
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import mat_t_mat
from skywright.core.scratch import local
from skywright.models.rigid_body import compute_body, posture
from skywright.vehicle.component import Context, helper
from skywright.vehicle.loops import choose_bandwidths, limit_attitude

TRIM = 1.0
"""rad/s, bandwidth with which the trim follows the command of the other modes."""


class StandardLoop(Record):
    """Gains and trim of `stabilise`."""

    k_climb: float  # 1/s, speed per height error
    k_lift: float  # 1/s, acceleration per speed error
    k_angle: Vec3  # 1/s, rate per attitude error about the axes of B
    k_rate: Vec3  # 1/s, angular acceleration per rate error
    k_trim: Annotated[Array, 4]  # 1/s^3, integral gains: height, about the axes of B
    inertia: Vec3  # kg m^2, about the axes of B
    mix: Annotated[Array, 6, 4]  # wrench of the rotors per commanded thrust and torque
    trim: Annotated[Array, 4]  # N in addition to the weight, N m
    trim_max: Annotated[Array, 4]


def fill_standard(me: Any, table: Any, context: Context) -> None:
    """Fill the StandardLoop of a law's `Me`, all but the trim."""
    c, weight = choose_bandwidths(table, context), context.mass * context.world.gravity_mps2
    w, zeta = c.position_bandwidth_rad_s, c.position_damping
    me.k_climb, me.k_lift = w / (2.0 * zeta), 2.0 * zeta * w
    turn, damping = limit_attitude(c, context), c.attitude_damping
    me.k_angle, me.k_rate = turn / (2.0 * damping), 2.0 * damping * turn
    me.k_trim = [c.position_integral_rad_s * w**2, *(c.attitude_integral_rad_s * turn**2)]
    me.trim_max = [0.4 * weight, *[0.1 * weight] * 3]
    mass, at, inertia = compute_body(context.model.reshape(1), posture(context.robot, "folded"))
    me.inertia = np.diag(inertia - mass * (at @ at * np.eye(3) - np.outer(at, at)))
    me.mix = compute_coplanar_mix(context.allocator.B)


def compute_coplanar_mix(B: Array) -> Array:
    """Return (6, 4): the wrench of the least-norm rotor thrusts for a total thrust and torque (3,).

    B (6, n) is the wrench per thrust of each rotor.
    """
    return np.asarray(B @ np.linalg.pinv(B[2:]))


@helper
def follow_trim(me: Any, body: Any, cmd: Any) -> None:
    """Let the trim follow the command of another mode."""
    me.trim[0] += TRIM * me.dt * (cmd.f_B[2] - body.mass * body.gravity - me.trim[0])
    for i in range(3):
        me.trim[i + 1] += TRIM * me.dt * (cmd.t_B[i] - me.trim[i + 1])


@helper
def stabilise(me: Any, ref: Any, est: Any, body: Any, saturated: float, cmd: Any) -> None:
    """Fill `cmd.f_B` and `cmd.t_B`; the trim is held while the rotors are saturated."""
    rel, asked, e = local(3, 3), local(4), local(4)
    e[0] = ref.p_WB[2] - est.p_WB[2]
    speed = me.k_climb * e[0] + ref.v_WB[2] - est.v_WB[2]
    asked[0] = body.mass * (body.gravity + ref.a_WB[2] + me.k_lift * speed)
    mat_t_mat(est.R_WB, ref.R_WB, rel)
    e[1] = 0.5 * (rel[2, 1] - rel[1, 2])
    e[2] = 0.5 * (rel[0, 2] - rel[2, 0])
    e[3] = 0.5 * (rel[1, 0] - rel[0, 1])
    for i in range(3):
        rate = me.k_angle[i] * e[i + 1] + ref.w_WB_B[i] - est.w_WB_B[i]
        asked[i + 1] = me.inertia[i] * me.k_rate[i] * rate
    for i in range(4):
        size = body.mass if i == 0 else me.inertia[i - 1]
        if saturated == 0.0:
            more = me.trim[i] + me.dt * me.k_trim[i] * size * e[i]
            me.trim[i] = min(max(more, -me.trim_max[i]), me.trim_max[i])
        asked[i] += me.trim[i]
    for r in range(3):
        cmd.f_B[r] = cmd.t_B[r] = 0.0
        for i in range(4):
            cmd.f_B[r] += me.mix[r, i] * asked[i]
            cmd.t_B[r] += me.mix[r + 3, i] * asked[i]
