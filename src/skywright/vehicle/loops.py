"""Control loops that laws share: position, attitude and arm; a user's law may use any of them.

A law's `Me` inherits the records of the loops that it closes, its `Table` the tables, and its
`build` calls `fill_position`, `fill_attitude` and `fill_arm`. Every gain follows from a bandwidth:
stiffness m wn^2, damping 2 zeta m wn, integral wi times the stiffness; the same with the composite
inertia for the attitude. Bandwidths that the law's table does not set are those of [robot.control].
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import cross, mat_t_mat, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.core.spec import Bandwidth, NonNegative, Positive, Spec
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.spec import Control, Robot
from skywright.description.world.spec import World
from skywright.models.link_age import compute_mean_age
from skywright.models.nominal import Nominal
from skywright.models.rotor_reaction import compute_reaction_times, limit_bandwidth
from skywright.vehicle.component import Context, helper

DELAY_TICKS = 1.5
"""Control ticks from the gyroscope to the rotors: half a sample, hold, computation."""
SLOW = 1e-3
"""m/s, desired sliding speed below which the friction feed-forward fades."""


class AttitudeGains(NamedTuple):
    """A loop (k_p + k_d s + k_i / s) / (I s^2): k_p = w^2 I, k_d = 2 zeta w I, k_i = w_i k_p."""

    bandwidth: float  # rad/s, w
    damping: float  # zeta
    integral: float  # rad/s, w_i


class PositionTable(Spec):
    """Bandwidths of the position loop; None: those of [robot.control]."""

    position_bandwidth_rad_s: Bandwidth | None = None
    position_damping: Positive | None = None
    position_integral_rad_s: NonNegative | None = None
    friction_feed_forward: NonNegative | None = None


class AttitudeTable(Spec):
    """Bandwidths of the attitude loop; None: those of [robot.control]."""

    attitude_bandwidth_rad_s: Bandwidth | None = None
    attitude_damping: Positive | None = None
    attitude_integral_rad_s: NonNegative | None = None


class ArmTable(Spec):
    """Bandwidth of the arm's loop; None: that of [robot.control]."""

    arm_bandwidth_rad_s: NonNegative | None = None


class LoopsTable(PositionTable, AttitudeTable, ArmTable):
    """Bandwidths of all three loops."""


class PositionLoop(Record):
    """Gains and integral of `force_from_errors`."""

    dt: float  # s, control period
    wn_p: float  # rad/s, position bandwidth
    zeta_p: float
    wi_p: float  # rad/s, integral
    friction: float  # nominal coefficient of the surface, fed forward while sliding
    f_integral_max: float  # N
    sigma: Vec3  # N, the integral, in W


class AttitudeLoop(Record):
    """Gains and integral of `attitude_torque`."""

    dt: float  # s, control period
    wn_R: Vec3  # rad/s, attitude bandwidth about the axes of B
    zeta_R: float
    wi_R: float
    t_integral_max: float  # N m
    theta: Vec3  # N m, the integral, in B


class ArmLoop(Record):
    """Gains of `arm_velocity`."""

    k_arm: float  # 1/s, joint position loop around the velocity servos
    belt: Annotated[Array, MAX_JOINTS, MAX_JOINTS]  # J_AM
    belt_inv: Annotated[Array, MAX_JOINTS, MAX_JOINTS]
    motor_speed_max: Annotated[Array, MAX_JOINTS]  # rad/s


def choose_bandwidths(table: Spec, context: Context | Nominal) -> Control:
    """Return `merge_control` for the robot of a context."""
    return merge_control(table, context.robot)


def merge_control(table: Spec, robot: Robot) -> Control:
    """Return [robot.control] with the values that a law's own table overrides."""
    own = {k: v for k, v in table if k in Control.model_fields and v is not None}
    return robot.control.model_copy(update=own)


def get_attitude_gains(table: Spec, robot: Robot) -> AttitudeGains:
    """Return the attitude loop of a law's table and [robot.control]."""
    c = merge_control(table, robot)
    return AttitudeGains(c.attitude_bandwidth_rad_s, c.attitude_damping, c.attitude_integral_rad_s)


def compute_delay_margin(
    loop: AttitudeGains, rotor_tau: float, spare: float, reaction: float = 0.0
) -> float:
    """Return the dead time (s) with which an attitude loop keeps `spare` (rad) of phase.

    The loop is L(s) = (w^2 + 2 zeta w s + w_i w^2 / s) (1 + T s) / (s^2 (1 + tau s)), tau that of
    the rotors, T the time (s) of their reaction (models/rotor_reaction.py). A negative T reduces
    the phase.
    """
    w, zeta, w_i = loop
    grid = w * np.geomspace(0.3, 100.0, 4000)
    s = 1j * grid
    L = (w * w + 2.0 * zeta * w * s + w_i * w * w / s) / (s * s * (1.0 + rotor_tau * s))
    L *= 1.0 + reaction * s
    k = int(np.argmax(np.abs(L) < 1.0))  # the crossover: |L| falls
    angle = float(np.angle(L[k]))
    phase = math.pi + (angle if angle <= 0.0 else angle - 2.0 * math.pi)
    return float(max(phase - spare, 0.0) / grid[k])


def fill_position(me: Any, table: Spec, context: Context) -> None:
    """Fill the PositionLoop of a law's `Me`."""
    c = choose_bandwidths(table, context)
    me.dt, me.friction = context.dt, c.friction_feed_forward
    me.wn_p, me.zeta_p = c.position_bandwidth_rad_s, c.position_damping
    me.wi_p = c.position_integral_rad_s
    me.f_integral_max = 0.4 * context.mass * context.world.gravity_mps2


def fill_attitude(me: Any, table: Spec, context: Context) -> None:
    """Fill the AttitudeLoop of a law's `Me`."""
    c = choose_bandwidths(table, context)
    me.dt = context.dt
    me.wn_R, me.zeta_R = limit_attitude(c, context), c.attitude_damping
    me.wi_R = c.attitude_integral_rad_s
    me.t_integral_max = 0.1 * context.mass * context.world.gravity_mps2


def limit_attitude(c: Control, context: Context) -> Array:
    """Return the bandwidths (3,) rad/s of the attitude about the axes of B.

    About z it is limited by the rotors' reaction; no other loop depends on it. Roll and pitch keep
    theirs, which must stay clear of the position loop's (ADR 0023).
    """
    weight, wanted = context.mass * context.world.gravity_mps2, c.attitude_bandwidth_rad_s
    reaction = float(compute_reaction_times(context.rotors, context.allocator, weight)[2])
    lag, delay = context.rotors.time_constant, compute_delay(c, context.world)
    return np.array([
        wanted, wanted, limit_bandwidth(wanted, c.attitude_damping, reaction, lag, delay)
    ])  # fmt: skip


def compute_delay(c: Control, world: World) -> float:
    """Return the time (s) from the gyroscope to the rotors."""
    tick = 1.0 / c.rate_hz
    return DELAY_TICKS * tick + 2.0 * compute_mean_age(world.link, tick)


def fill_arm(me: Any, table: Spec, context: Context) -> None:
    """Fill the ArmLoop of a law's `Me`."""
    me.k_arm = choose_bandwidths(table, context).arm_bandwidth_rad_s
    for name in ("belt", "belt_inv", "motor_speed_max"):
        me[name] = context.model[name]


@helper
def position_force(me: Any, ref: Any, est: Any, body: Any, saturated: float, f_W: Any) -> None:
    """Tognon 2018, law (4): f_W = -g_1 + M_11 a^n + K^D (v^n - v) + K^P e + sigma.

    e is the tip's position error if `ref.track_tip` is set, else the platform's; the velocity is
    always the platform's.
    """
    e, v = local(3), local(3)
    for i in range(3):
        if ref.track_tip > 0.5:
            e[i] = ref.p_WT[i] - est.p_WT[i]
        else:
            e[i] = ref.p_WB[i] - est.p_WB[i]
        v[i] = ref.v_WB[i] - est.v_WB[i]
    force_from_errors(me, ref, body, e, v, saturated, f_W)


@helper
def platform_force(me: Any, ref: Any, est: Any, body: Any, saturated: float, f_W: Any) -> None:
    """`position_force` that always tracks the platform's own position."""
    e, v = local(3), local(3)
    for i in range(3):
        e[i] = ref.p_WB[i] - est.p_WB[i]
        v[i] = ref.v_WB[i] - est.v_WB[i]
    force_from_errors(me, ref, body, e, v, saturated, f_W)


@helper
def force_from_errors(
    me: Any, ref: Any, body: Any, e: Any, v: Any, saturated: float, f_W: Any
) -> None:
    """Compute `position_force` for a position error e (3,) m and a velocity error v (3,) m/s, in W.

    sigma integrates e with a dead zone in the interaction frame: along the surface normal only
    while |e_n| exceeds `ref.dead_zone` (a dead zone of 0 integrates always), so in contact the
    intended penetration does not wind up. The integral is frozen while the rotors are saturated. In
    addition to the paper: in contact the nominal Coulomb friction of the desired sliding, mu K^P
    |e_n| along v_T^d, is fed forward (`friction`, 0 gives the paper's law). Without it each
    reversal of the friction causes a tip error of 2 mu F / K^P until the integral has compensated
    it.
    """
    kp = body.mass * me.wn_p * me.wn_p
    kd = 2.0 * me.zeta_p * body.mass * me.wn_p
    for i in range(3):
        f_W[i] = body.mass * ref.a_WB[i] + kd * v[i] + kp * e[i] + me.sigma[i]
    f_W[2] += body.mass * body.gravity
    normal = 0.0
    for i in range(3):
        normal += ref.R_WS[i, 2] * e[i]
    if ref.dead_zone > 0.0 and normal < 0.0:
        speed = math.sqrt(ref.v_WT[0] ** 2 + ref.v_WT[1] ** 2 + ref.v_WT[2] ** 2 + SLOW**2)
        for i in range(3):
            f_W[i] -= me.friction * kp * normal * ref.v_WT[i] / speed
    if saturated > 0.0:
        return
    keep = 1.0 if ref.dead_zone > 0.0 and abs(normal) < ref.dead_zone else 0.0
    total = 0.0
    for i in range(3):
        me.sigma[i] += me.dt * me.wi_p * kp * (e[i] - keep * normal * ref.R_WS[i, 2])
        total += me.sigma[i] * me.sigma[i]
    if total > me.f_integral_max * me.f_integral_max:
        scale = me.f_integral_max / math.sqrt(total)
        for i in range(3):
            me.sigma[i] *= scale


@helper
def attitude_torque(
    me: Any, R_des: Any, w_des_B: Any, wd_des_B: Any, est: Any, body: Any, f_B: Any,
    saturated: float, t_B: Any,
) -> None:  # fmt: skip
    """Tognon 2018, law (3), about the whole robot's centre of mass.

    t_B = p_BC x f_B + I_C (wd^n + wn^2 e_R + 2 zeta wn e_w) + theta + w x I_C w. The paper's g_2 is
    the first term at hover; its other part compensates the moment of the commanded lateral force
    about the centre of mass. e_R = 1/2 [R^T R^n - R^nT R]_vee; the rate error is expressed in the
    same frame, e_w = R^T R^n w^n - w (E001-4).
    """
    rel, e_R, e_w, acc, lever = local(3, 3), local(3), local(3), local(3), local(3)
    mat_t_mat(est.R_WB, R_des, rel)
    e_R[0] = 0.5 * (rel[2, 1] - rel[1, 2])
    e_R[1] = 0.5 * (rel[0, 2] - rel[2, 0])
    e_R[2] = 0.5 * (rel[1, 0] - rel[0, 1])
    mat_vec(rel, w_des_B, e_w)
    for i in range(3):
        kp, kd = me.wn_R[i] * me.wn_R[i], 2.0 * me.zeta_R * me.wn_R[i]
        e_w[i] -= est.w_WB_B[i]
        acc[i] = wd_des_B[i] + kp * e_R[i] + kd * e_w[i]
    # I_C = I_B - m (c.c 1 - c c^T)
    c, m = body.p_BC, body.mass
    cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    spin, gyro, push = local(3), local(3), local(3)
    for i in range(3):
        spin[i] = 0.0
        t_B[i] = 0.0
        push[i] = 0.0
        for j in range(3):
            inertia = body.I_B[i, j] + m * c[i] * c[j] - (m * cc if i == j else 0.0)
            t_B[i] += inertia * acc[j]
            spin[i] += inertia * est.w_WB_B[j]
            push[i] += inertia * e_R[j]
    cross(est.w_WB_B, spin, gyro)
    cross(c, f_B, lever)
    for i in range(3):
        t_B[i] += lever[i] + gyro[i] + me.theta[i]
        if saturated == 0.0:
            me.theta[i] += me.dt * me.wi_R * (me.wn_R[i] * me.wn_R[i]) * push[i]
            me.theta[i] = min(max(me.theta[i], -me.t_integral_max), me.t_integral_max)


@helper
def hold_attitude(me: Any, ref: Any, est: Any, body: Any, saturated: float, cmd: Any) -> None:
    """Fill `cmd.t_B` by `attitude_torque` with the attitude of the reference."""
    attitude_torque(me, ref.R_WB, ref.w_WB_B, ref.wd_WB_B, est, body, cmd.f_B, saturated, cmd.t_B)


@helper
def arm_velocity(me: Any, ref: Any, est: Any, body: Any, qd: Any) -> None:
    """Tognon 2018, law (2): v_M* = v_M^n + K_M (q_M^n - q_M), returned at the joints."""
    n = body.n_joints
    for i in range(n):
        qd[i] = 0.0
    for j in range(n):  # motor j
        v = 0.0
        for i in range(n):
            v += me.belt_inv[j, i] * (ref.qd[i] + me.k_arm * (ref.q[i] - est.q[i]))
        v = min(max(v, -me.motor_speed_max[j]), me.motor_speed_max[j])
        for i in range(n):
            qd[i] += me.belt[i, j] * v


@helper
def to_body(est: Any, f_W: Any, f_B: Any) -> None:
    """f_B = R_WB^T f_W."""
    mat_t_vec(est.R_WB, f_W, f_B)


@helper
def rest(me: Any, cmd: Any) -> None:
    """Motors off: no wrench, integrals cleared."""
    for i in range(3):
        me.sigma[i] = 0.0
        me.theta[i] = 0.0
        cmd.f_B[i] = 0.0
        cmd.t_B[i] = 0.0
