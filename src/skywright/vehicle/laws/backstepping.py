"""Sanchez-Cuevas 2020, section 4: backstepping with integral action and contact feed-forward.

For each axis, with z_1 = x_d - x, its integral chi, alpha = x_d' + lambda chi + k_1 z_1 and
z_2 = alpha - x', equations (42) to (44) give

    x'' = x_d'' + (1 - k_1^2 + lambda) z_1 + (k_1 + k_2) z_2 - k_1 lambda chi

This is stable for all positive gains. After substitution of z_2 it equals the PID
x_d'' + (1 + lambda + k_1 k_2) z_1 + (k_1 + k_2) z_1' + k_2 lambda chi. Four misprints of the paper
are corrected (docs/papers/sanchez-cuevas-2020.md): e_p = p_d - p in (28), k and lambda exchanged
in K (E004-1, E004-2), the lever in (24) (E004-6), and (23) rotates the force only (E004-7). The
attitude error is e = 1/2 [R^T R_d - R_d^T R]_vee instead of a difference of Euler angles (E004-4).

Platform, (25) and (26): mass and inertia are those of the present posture of the arm. The contact
wrench is subtracted: the tip's from the measured force (24), the docking feet's as planned. Arm,
(27), (30) and (31): the law controls the force along the probe, and before contact the position of
the tip across it. The servos take speeds, and a speed of the tip against the probe's spring of
stiffness K is a rate of force. (31) therefore becomes v = k_f (F_d - F) / K with the bandwidth k_f
of the force loop, the servo map of section 4; the rate of F_d is not fed forward.

Since the law is a PID, k_1, k_2 and lambda follow from its stiffness, damping and integral gain:

    K_p = 1 + lambda + k_1 k_2,   K_d = k_1 + k_2,   K_i = k_2 lambda
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

from scipy.optimize import brentq

from skywright.core.record import Array, Mat3, Vec3
from skywright.core.rotations import cross, mat_t_mat, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Law, Out, helper
from skywright.vehicle.follower import Press
from skywright.vehicle.laws._standard_mode import (
    StandardLoop,
    fill_standard,
    follow_trim,
    stabilise,
)
from skywright.vehicle.laws._tip_motion import fill_tip_rows, invert_tip, slow_at_stops
from skywright.vehicle.loops import (
    SLOW,
    ArmLoop,
    AttitudeGains,
    LoopsTable,
    arm_velocity,
    choose_bandwidths,
    fill_arm,
    get_attitude_gains,
    limit_attitude,
    rest,
)

TIP_SPEED = 0.03
"""m/s, largest tip speed of the arm while it controls the force or approaches the surface."""
TOUCHING = 0.2  # N, tip force above which the tip is in contact
REACH = 0.03
"""m, largest distance by which the force loop moves the tip beyond its reference."""
FOLLOW = 0.5
"""rad/s, bandwidth of the platform's shift: a sixth of the force loop's and of its own."""
SHIFT_MAX = 0.05  # m


class Backstepping(Law):
    """Fills f_B, t_B and qd."""

    needs_full_actuation = presses_with_arm = knows_modes = True
    follows_bandwidths: ClassVar[bool] = True
    """Whether the position loop of the platform is a PID with the bandwidths of the table."""
    Table = LoopsTable

    class Me(ArmLoop, StandardLoop):
        dt: float  # s, control period
        k_p: Vec3  # k_1, k_2 (1/s) and lambda (1/s^2) of the position loop
        k_R: Mat3  # the same of the attitude loop, one row per axis of B
        k_force: float  # 1/s, bandwidth of the arm's force loop
        spring: float  # N/m, of a probe with a force sensor; 0: no sensor
        knee: float  # N, force above which the stiffness is `soft`
        soft: float  # N/m
        friction: float  # friction coefficient of the feed-forward
        q_min: Annotated[Array, MAX_JOINTS]  # rad
        q_max: Annotated[Array, MAX_JOINTS]
        f_integral_max: float  # N
        t_integral_max: float  # N m
        sigma: Vec3  # m s, chi of the position, in W
        theta: Vec3  # rad s, chi of the attitude, in B
        shift: float  # m, of the platform along the probe

    def get_attitude_loop(self, robot: Robot) -> AttitudeGains:
        """Return the PID that is equivalent to the gains of the attitude loop."""
        return get_attitude_gains(self.table, robot)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gains from the bandwidths; raise InputError if no gains exist.

        The force loop has the bandwidth of the arm. The probe's spring converts a speed of the tip
        to a rate of force, so the loop integrates. The servos respond to a speed command as a
        critically damped pair of poles at 1 / T_v: a lag of 2 T_v = 0.08 s, 14 deg at 3 rad/s.
        """
        c, robot = choose_bandwidths(table, context), context.robot
        me.k_p = compute_backstepping_gains(
            c.position_bandwidth_rad_s, c.position_damping, c.position_integral_rad_s
        )
        me.k_R = [
            compute_backstepping_gains(float(w), c.attitude_damping, c.attitude_integral_rad_s)
            for w in limit_attitude(c, context)
        ]
        fill_arm(me, table, context)
        me.q_min, me.q_max = context.model["q_min"], context.model["q_max"]
        me.dt, me.k_force, me.friction = context.dt, me.k_arm, c.friction_feed_forward
        if robot.force_sensor is not None and robot.probe is not None:
            factor = context.springs.sensor
            me.spring = factor * robot.probe.spring_n_per_m
            me.knee = factor * robot.force_sensor.knee_n
            me.soft = me.spring * robot.force_sensor.hard_share
        fill_standard(me, table, context)
        weight = context.mass * context.world.gravity_mps2
        me.f_integral_max, me.t_integral_max = 0.4 * weight, 0.1 * weight

    @staticmethod
    def step(
        me: Me,
        ref: Reference,
        press: Press,
        est: Estimate,
        body: Body,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:
        command_arm(me, ref, press, est, body, cmd)
        if ref.active < 0.5:
            rest(me, cmd)
            return
        command_platform(me, ref, press, est, body, allocated.saturated, cmd)


def compute_backstepping_gains(
    bandwidth: float, damping: float, integral: float
) -> tuple[float, float, float]:
    """Return k_1, k_2 (1/s) and lambda (1/s^2), all positive.

    K_p = w^2, K_d = 2 zeta w, K_i = w_i w^2 as in the other laws. k_2 is the largest root of
    1 + K_i / k_2 + (K_d - k_2) k_2 = K_p. Raises InputError if no positive gains give this PID:
    k_1 k_2 is at most (zeta w)^2, so a larger K_p - 1 requires more damping.
    """
    kp, kd, ki = bandwidth**2, 2.0 * damping * bandwidth, integral * bandwidth**2

    def excess(k2: float) -> float:
        return 1.0 + ki / k2 + (kd - k2) * k2 - kp

    low, high = 0.5 * kd, kd
    if not excess(low) >= 0.0 >= excess(high):
        raise InputError(
            f"no backstepping gains for a bandwidth of {bandwidth:g} rad/s with damping "
            f"{damping:g} and integral {integral:g} rad/s; valid: a bandwidth above 1 "
            "rad/s, a damping of at least 1, and an integral well below the bandwidth"
        )
    k2 = float(brentq(excess, low, high, xtol=1e-12))
    return kd - k2, k2, ki / k2


@helper
def backstep(z1: float, z1_dot: float, chi: float, k1: float, k2: float, lam: float) -> float:
    """Return x'' - x_d'' by (42) to (44)."""
    z2 = z1_dot + lam * chi + k1 * z1
    return (1.0 - k1 * k1 + lam) * z1 + (k1 + k2) * z2 - k1 * lam * chi


@helper
def add_friction(me: Any, ref: Any, est: Any, body: Any, f: Any) -> None:
    """Add the modelled Coulomb friction `me.friction` F of a desired sliding to f (3,) N in B.

    Without it the tip would move only after a position error of mu F over the stiffness of the
    platform, which is centimetres. The friction fades to zero below the speed SLOW.
    """
    v_B = local(3)
    mat_t_vec(est.R_WB, ref.v_WB, v_B)
    along = 0.0
    for i in range(3):
        along += v_B[i] * body.R_BT[i, 2]
    speed = SLOW * SLOW
    for i in range(3):
        v_B[i] -= along * body.R_BT[i, 2]
        speed += v_B[i] * v_B[i]
    for i in range(3):
        f[i] -= me.friction * max(est.f_tip, 0.0) * v_B[i] / math.sqrt(speed)


@helper
def find_contact_wrench(me: Any, ref: Any, press: Any, est: Any, body: Any, f: Any, t: Any) -> None:
    """Fill the contact force (3,) N and torque (3,) N m about B's origin on the robot, in B.

    At the tip (24) for any arm: -F along the probe. At the feet: the planned wrench.
    """
    for i in range(3):
        f[i] = 0.0
        t[i] = 0.0
    if press.press > 0.5:
        for i in range(3):
            f[i] = -est.f_tip * body.R_BT[i, 2]
        add_friction(me, ref, est, body, f)
        cross(body.p_BT, f, t)
    if press.docked > 0.5:
        for i in range(3):
            f[i] += press.f_feet_B[i]
            t[i] += press.t_feet_B[i]


@helper
def find_extension(ref: Any, body: Any) -> float:
    """Return how far (m) the tip is ahead of its reference along the probe, relative to B."""
    total = 0.0
    p_W, p_B = local(3), local(3)
    for i in range(3):
        p_W[i] = ref.p_WT[i] - ref.p_WB[i]
    mat_t_vec(ref.R_WB, p_W, p_B)
    for i in range(3):
        total += body.R_BT[i, 2] * (body.p_BT[i] - p_B[i])
    return total


@helper
def find_offset(ref: Any, body: Any) -> float:
    """Return how far (m) the reference of the tip is from the tip along x of T, relative to B."""
    p_W, p_B, across = local(3), local(3), 0.0
    for i in range(3):
        p_W[i] = ref.p_WT[i] - ref.p_WB[i]
    mat_t_vec(ref.R_WB, p_W, p_B)
    for i in range(3):
        across += body.R_BT[i, 0] * (p_B[i] - body.p_BT[i])
    return across


@helper
def follow_arm(me: Any, ref: Any, press: Any, est: Any, body: Any, shift_W: Any) -> None:
    """Fill the shift (3,) m of the platform's reference that brings the arm back to its pose.

    While the tip presses in flight, the platform follows the extension of the arm along the probe,
    slower than the force loop, so that static position errors do not use up the travel of the arm.
    Afterwards the shift returns to zero at the same rate. `me.shift` holds the shift (m).
    """
    axis = local(3)
    mat_vec(est.R_WB, body.R_BT[:, 2], axis)
    if press.press > 0.5 and press.docked < 0.5:
        rate = FOLLOW * find_extension(ref, body)
    else:
        rate = -FOLLOW * me.shift
    me.shift = min(max(me.shift + me.dt * rate, -SHIFT_MAX), SHIFT_MAX)
    for i in range(3):
        shift_W[i] = me.shift * axis[i]


@helper
def command_platform(
    me: Any, ref: Any, press: Any, est: Any, body: Any, saturated: float, cmd: Any
) -> None:
    """Fill `cmd.f_B` and `cmd.t_B` by (25) and (26), or by the standard stabilisation."""
    if ref.mode > 0.5:
        me.sigma[0] = me.sigma[1] = 0.0
        stabilise(me, ref, est, body, saturated, cmd)
        return
    k, lam = me.k_p, me.k_p[2]
    m = body.mass
    integrate = saturated == 0.0 and press.docked < 0.5
    f_W, f_free, f_C, t_C = local(3), local(3), local(3), local(3)
    shift, total = local(3), 0.0
    follow_arm(me, ref, press, est, body, shift)
    for i in range(3):
        f_W[i] = 0.0
        z1 = ref.p_WB[i] + shift[i] - est.p_WB[i]
        z1_dot = ref.v_WB[i] - est.v_WB[i]
        f_W[i] = m * (ref.a_WB[i] + backstep(z1, z1_dot, me.sigma[i], k[0], k[1], lam))
        if integrate:
            me.sigma[i] += me.dt * z1
        total += me.sigma[i] * me.sigma[i]
    f_W[2] += m * body.gravity
    largest = me.f_integral_max / max(m * k[1] * lam, 1e-9)
    if total > largest * largest:
        for i in range(3):
            me.sigma[i] *= largest / math.sqrt(total)
    mat_t_vec(est.R_WB, f_W, f_free)
    find_contact_wrench(me, ref, press, est, body, f_C, t_C)
    for i in range(3):
        cmd.f_B[i] = f_free[i] - f_C[i]
    command_torque(me, ref, est, body, cmd, f_free, t_C, integrate)
    follow_trim(me, body, cmd)


@helper
def command_torque(
    me: Any, ref: Any, est: Any, body: Any, cmd: Any, f_free: Any, t_C: Any, integrate: bool
) -> None:
    """Fill `cmd.t_B` by (26) about the centre of mass: I_C w_d' + w x I_C w + c x f - t_C.

    f is the total force on the robot without its weight: rotors and contact together.
    """
    k = me.k_R
    rel, e, w_des = local(3, 3), local(3), local(3)
    acc, spin, gyro, lever = local(3), local(3), local(3), local(3)
    mat_t_mat(est.R_WB, ref.R_WB, rel)
    e[0] = 0.5 * (rel[2, 1] - rel[1, 2])
    e[1] = 0.5 * (rel[0, 2] - rel[2, 0])
    e[2] = 0.5 * (rel[1, 0] - rel[0, 1])
    mat_vec(rel, ref.w_WB_B, w_des)
    for i in range(3):
        acc[i] = ref.wd_WB_B[i] + backstep(
            e[i], w_des[i] - est.w_WB_B[i], me.theta[i], k[i, 0], k[i, 1], k[i, 2]
        )
    c, m = body.p_BC, body.mass
    cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    for i in range(3):
        spin[i] = 0.0
        cmd.t_B[i] = 0.0
        own = 0.0
        for j in range(3):
            inertia = body.I_B[i, j] + m * c[i] * c[j] - (m * cc if i == j else 0.0)
            cmd.t_B[i] += inertia * acc[j]
            spin[i] += inertia * est.w_WB_B[j]
            if i == j:
                own = inertia
        if integrate:
            most = me.t_integral_max / max(own * k[i, 1] * k[i, 2], 1e-9)
            me.theta[i] = min(max(me.theta[i] + me.dt * e[i], -most), most)
    cross(est.w_WB_B, spin, gyro)
    cross(c, f_free, lever)
    for i in range(3):
        cmd.t_B[i] += gyro[i] + lever[i] - t_C[i]


@helper
def find_approach(ref: Any, est: Any, body: Any) -> float:
    """Return the tip speed (m/s) along the probe due to the platform, less that of its reference.

    The velocity of the reference is subtracted: with an inclined probe, a slide along the surface
    has a component along the probe without approaching the surface.
    """
    v_W, v_B, turn, total = local(3), local(3), local(3), 0.0
    for i in range(3):
        v_W[i] = est.v_WB[i] - ref.v_WB[i]
    mat_t_vec(est.R_WB, v_W, v_B)
    cross(est.w_WB_B, body.p_BT, turn)
    for i in range(3):
        total += (v_B[i] + turn[i]) * body.R_BT[i, 2]
    return total


@helper
def command_arm(me: Any, ref: Any, press: Any, est: Any, body: Any, cmd: Any) -> None:
    """Fill `cmd.qd` by (27), (30) and (31) through the servo map."""
    arm_velocity(me, ref, est, body, cmd.qd)
    if press.press < 0.5 or me.spring <= 0.0:
        return
    n = body.n_joints
    spring = me.spring if est.f_tip < me.knee else me.soft
    along = (press.force - est.f_tip) * me.k_force / spring
    along = min(max(along, -TIP_SPEED), TIP_SPEED)
    if press.docked < 0.5:  # in flight the arm compensates the motion of the platform
        along -= find_approach(ref, est, body)
    across = find_offset(ref, body)
    if find_extension(ref, body) > REACH:  # there is no surface
        along = min(along, 0.0)
    across = min(max(me.k_arm * across, -TIP_SPEED), TIP_SPEED)
    if est.f_tip > TOUCHING:  # friction holds the tip: a command across it only loads the arm
        across = 0.0
    J = local(2, MAX_JOINTS)
    fill_tip_rows(body, J)
    invert_tip(J, n, along, across, cmd.qd)
    slow_at_stops(me.q_min, me.q_max, est.q, n, cmd.qd)
    for j in range(n):
        cmd.qd[j] = min(max(cmd.qd[j], -me.motor_speed_max[j]), me.motor_speed_max[j])
