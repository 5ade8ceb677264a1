"""Cascade of an autopilot: P on position, velocity and attitude; PI with a lead on the rates.

The structure is that of PX4. The position loop commands the velocity v_des + k e. The velocity loop
commands an acceleration: k times the velocity error, minus the damping of a swinging link. The
thrust points along the force for this acceleration, with the known external forces cancelled. The
attitude loop commands rates, k times the attitude error. The rate loop commands an angular
acceleration, k times the rate error. The torque for this acceleration follows from the model in
models/floating.py, which includes a link on a joint without a servo, the posture of the arms, and
forces at the hands; only errors of this model disturb the platform. The velocity loop has no
integral of its own, because the estimated force f_rest_W acts as one. All gains follow from
bandwidths.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from skywright.core.record import Array, Vec2, Vec3
from skywright.core.rotations import cross, log_so3, mat_t_mat, mat_t_vec, mat_vec, norm
from skywright.core.scratch import local
from skywright.core.spec import Positive
from skywright.errors import InputError
from skywright.models.nominal import Nominal
from skywright.vehicle.arms.ports import Floating, Hands, Wrench
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Context, Law, Out, helper
from skywright.vehicle.gusts import GustModel
from skywright.vehicle.laws._cascade_checks import compute_borne_delay, find_imbalance
from skywright.vehicle.laws._cascade_gains import (
    CascadeGains,
    build_gust_model,
    compute_bodies,
    compute_cascade_gains,
)
from skywright.vehicle.laws._thrust import Thrust, ThrustTable, aim_thrust, fill_thrust
from skywright.vehicle.loops import (
    ArmLoop,
    ArmTable,
    AttitudeTable,
    arm_velocity,
    choose_bandwidths,
    fill_arm,
)

JERK_MAX = 3.0
"""m/s^3, jerk limit of a reference; a larger step is a change of the reference table."""
SHIFT_BANDWIDTH = 3.0
"""rad/s, of the shift for the tip. The estimates that it uses have 2 to 3 rad/s themselves."""


class Cascade(Law):
    """Fills f_B = (0, 0, T), t_B and qd."""

    inverted: ClassVar[bool] = False

    class Table(AttitudeTable, ArmTable, ThrustTable):
        """[mission.law]; keys that are not set have the value of [robot.control]."""

        position_bandwidth_rad_s: Positive | None = None
        loop_separation: float | None = Field(default=None, ge=1.5)
        phase_margin_deg: float | None = Field(default=None, ge=30.0, lt=90.0)
        swing_damping: float | None = Field(default=None, gt=0.0, lt=1.0)
        position_damping: Positive | None = None
        motion_sensitivity: float | None = Field(default=None, ge=0.0, le=3.0)
        speed_max_mps: Positive | None = None

    class Me(ArmLoop, Thrust):
        dt: float  # s, control period
        k_position: Vec3  # 1/s, velocity per position error; forward, left, up
        k_velocity: Vec3  # 1/s, acceleration per velocity error
        k_swing: float  # m/s, acceleration against the swing rate of a passive joint
        k_attitude: Vec3  # 1/s, rate per attitude error about the axes of B
        k_rate: Vec3  # 1/s, angular acceleration per rate error
        k_integral: Vec3  # 1/s, integral gain of the torque about the axes of B
        lead: float  # s, rotor lag that remains after the lead
        rotor_tau: float  # s, nominal rotor lag
        speed_max: float  # m/s, limit of the velocity command of the position loop
        f_external_max: float  # N, largest external force that is cancelled
        t_integral_max: float  # N m
        theta: Vec3  # N m, integral of the torque
        t_lag: Vec3  # N m, low-passed torque, state of the lead
        shift: Vec3  # m, of the platform for its tip (`shift_for_tip`)
        shift_rate: Vec3  # m/s
        a_last: Vec2  # m/s^2, of the reference at the last step
        pose_bandwidth: float  # rad/s, of `pose`; 0: `pose` is not used
        pose: float  # rad, from the link to the line joint - hanging mass, low-passed

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gains from the bandwidths.

        Raises InputError if the loops would be unstable or too slow to take off along a link's arc.
        """
        gains = self._compute_gains(context, context.model)
        if me.lead == 0.0:  # first build, on the ground; not a change in flight
            imbalance = find_imbalance(gains, context)
            if imbalance is not None:
                raise InputError(imbalance)
        for name in gains._fields:
            if name not in ("wrench", "pose"):
                me[name] = getattr(gains, name)
        fill_arm(me, table, context)
        fill_thrust(me, table, context)
        me.dt, me.speed_max = context.dt, choose_bandwidths(table, context).speed_max_mps
        weight = context.mass * context.world.gravity_mps2
        me.f_external_max, me.t_integral_max = 0.4 * weight, 0.1 * weight
        me.pose_bandwidth, me.pose = gains.pose, math.nan

    def find_unflyable(self, nominal: Nominal) -> str | None:
        """Return a message if the loops are too slow to take off along a link's arc."""
        return find_imbalance(self._compute_gains(nominal, nominal.model[0]), nominal)

    def observe_wrench(self, context: Context) -> Array:
        """Return the bandwidths (3,) rad/s of the external force that is cancelled."""
        return self._compute_gains(context, context.model).wrench

    def build_gust_model(self, nominal: Nominal, yaw: float) -> GustModel | None:
        """Return a model of the motion in gusts, None if hands hold the link."""
        c = choose_bandwidths(self.table, nominal)
        return build_gust_model(c, self._compute_gains(nominal, nominal.model[0]), nominal, yaw)

    def compute_rate_torque(self, nominal: Nominal, I_C: Array) -> Array:
        """Return the torque gain of the rate loop with its lead; a passive link swings freely."""
        gains = self._compute_gains(nominal, nominal.model[0])
        I_eff = compute_bodies(nominal.robot, nominal.model[0])[1]["I_eff"]
        return np.asarray(I_eff[:, :2] * gains.k_rate[:2] * (gains.rotor_tau / gains.lead))

    def compute_borne_delay(self, nominal: Nominal, spare: float) -> float:
        """Return the delay that attitude and rate loop tolerate together."""
        c = choose_bandwidths(self.table, nominal)
        return compute_borne_delay(
            self._compute_gains(nominal, nominal.model[0]), c, nominal, spare
        )

    def _compute_gains(self, context: Context | Nominal, model: Any) -> CascadeGains:
        c = choose_bandwidths(self.table, context)
        return compute_cascade_gains(c, context.robot, context.world, model, self.inverted)

    @staticmethod
    def step(
        me: Me,
        ref: Reference,
        est: Estimate,
        body: Body,
        floating: Floating,
        wrench: Wrench,
        hands: Hands | None,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:
        if begin(me, ref, est, body, cmd):
            f_W = local(3)
            acceleration_for_motion(me, ref, est, body, floating, wrench, hands, f_W)
            force_for_motion(me, body, wrench, f_W)
            apply_force(me, ref, est, body, floating, wrench, allocated.saturated, cmd, f_W)


@helper
def begin(me: Any, ref: Any, est: Any, body: Any, cmd: Any) -> bool:
    """Fill `cmd.qd`; return whether the motors are on. If not, reset the states and the wrench."""
    arm_velocity(me, ref, est, body, cmd.qd)
    if ref.active >= 0.5:
        return True
    for i in range(3):
        me.theta[i] = me.t_lag[i] = me.shift[i] = me.shift_rate[i] = 0.0
        cmd.f_B[i] = 0.0
        cmd.t_B[i] = 0.0
    return False


@helper
def apply_force(
    me: Any, ref: Any, est: Any, body: Any, floating: Any, wrench: Any, saturated: float, cmd: Any,
    f_W: Any,
) -> None:  # fmt: skip
    """Realise a force f_W (3,) N by thrust and attitude."""
    R_des, acc = local(3, 3), local(3)
    thrust = aim_thrust(me, ref, est, body, f_W, R_des)
    cmd.f_B[0], cmd.f_B[1], cmd.f_B[2] = 0.0, 0.0, thrust
    angular_acceleration(me, ref, est, R_des, acc)
    torque_for_turn(me, est, body, floating, wrench, saturated, cmd, acc)


@helper
def force_for_motion(me: Any, body: Any, wrench: Any, f_W: Any) -> None:
    """Convert the acceleration f_W (3,) m/s^2 into the rotors' force (N), in place.

    Known external forces are cancelled up to `f_external_max`.
    """
    f_W[2] += body.gravity
    rest_W = local(3)
    size = 0.0
    for i in range(3):
        rest_W[i] = wrench.f_hands_W[i] + wrench.f_rest_W[i]
        size += rest_W[i] * rest_W[i]
    size = min(1.0, me.f_external_max / max(math.sqrt(size), 1e-9))
    for i in range(3):
        f_W[i] = body.mass * f_W[i] - size * rest_W[i]


@helper
def acceleration_for_motion(
    me: Any, ref: Any, est: Any, body: Any, floating: Any, wrench: Any, hands: Any, a_W: Any
) -> None:
    """Fill a_W (3,) m/s^2: the commanded acceleration, feed-forward of the reference included."""
    # axes of the platform, level: forward, left, up
    forward, left = local(2), local(2)
    x, y = est.R_WB[0, 0], est.R_WB[1, 0]
    size = max(math.sqrt(x * x + y * y), 1e-3)
    forward[0], forward[1] = x / size, y / size
    left[0], left[1] = -forward[1], forward[0]
    e, v, a = local(3), local(3), local(3)
    shift, rate = local(3), local(3)
    shift_for_tip(me, ref, est, body, floating, wrench, hands, shift, rate)
    for i in range(3):
        shift[i] += ref.p_WB[i]
        rate[i] += ref.v_WB[i]
    into_axes(forward, left, shift, est.p_WB, e)
    into_axes(forward, left, rate, est.v_WB, v)
    speed = 0.0
    for i in range(3):
        e[i] *= me.k_position[i]
        speed += e[i] * e[i]
    scale = min(1.0, me.speed_max / max(math.sqrt(speed), 1e-9))
    for i in range(3):
        a[i] = me.k_velocity[i] * (scale * e[i] + v[i])
    if floating.swing >= 0:
        damp_swing(me, ref, est, body, floating, wrench, forward, left, a)
    a_W[0] = forward[0] * a[0] + left[0] * a[1] + ref.a_WB[0]
    a_W[1] = forward[1] * a[0] + left[1] * a[1] + ref.a_WB[1]
    a_W[2] = a[2] + ref.a_WB[2]


@helper
def shift_for_tip(
    me: Any, ref: Any, est: Any, body: Any, floating: Any, wrench: Any, hands: Any, shift: Any,
    rate: Any,
) -> None:  # fmt: skip
    """Fill shift (3,) m and rate (3,) m/s of the platform that keep the tip in place.

    The goal is zero unless the reference tracks the tip. The estimated torque s about a link's
    joint turns the link by s / (m l g); the estimated force f leans the platform by f / (m g). Both
    are estimates of external forces, so no loop closes over the reaction of the link to the
    platform's own motion. The second low-pass removes the errors of the model (with the torque
    low-passed once the platform rings at 22 rad/s). The rate of the shift is continuous, because
    the goal steps when a reference begins to track the tip, and a step of the rate jolts the
    rotors.
    """
    goal, axis, vec = local(3), local(3), local(3)
    for i in range(3):
        goal[i] = axis[i] = 0.0
    if ref.track_tip > 0.5:
        along, joint = 0.0, body.p_BT[2]
        if floating.swing >= 0:
            mat_vec(est.R_WB, floating.axis, axis)
            turn = wrench.s_slow / (max(norm(floating.L_s), 1e-6) * body.gravity)
            mat_vec(est.R_WB, body.J_BT[:, floating.swing], vec)
            for i in range(2):
                goal[i] = -turn * vec[i]
                along += axis[i] * (wrench.f_hands_W[i] + wrench.f_rest_W[i])
            if hands is not None:
                joint = hands.p_BA[2]
        for i in range(2):  # only a force along the joint axis also tilts the hanging part
            across = wrench.f_hands_W[i] + wrench.f_rest_W[i] - along * axis[i]
            goal[i] += (along * axis[i] * body.p_BT[2] + across * joint) / (
                body.mass * body.gravity
            )
    w = 2.0 * SHIFT_BANDWIDTH  # two equal poles with the lag of one pole at SHIFT_BANDWIDTH
    for i in range(3):
        me.shift_rate[i] += me.dt * w * (w * (goal[i] - me.shift[i]) - 2.0 * me.shift_rate[i])
        me.shift[i] += me.dt * me.shift_rate[i]
        rate[i], shift[i] = me.shift_rate[i], me.shift[i]


@helper
def into_axes(forward: Any, left: Any, a: Any, b: Any, out: Any) -> None:
    """Write a - b in the level axes (forward, left, up)."""
    x, y = a[0] - b[0], a[1] - b[1]
    out[0] = forward[0] * x + forward[1] * y
    out[1] = left[0] * x + left[1] * y
    out[2] = a[2] - b[2]


@helper
def damp_swing(
    me: Any, ref: Any, est: Any, body: Any, floating: Any, wrench: Any, forward: Any, left: Any,
    a: Any,
) -> None:  # fmt: skip
    """Damp the passive link of Suarez 2020 by moving the platform with its swing, a = -k psi'.

    psi' is the link's rate in W less the desired rates: that of the reference (take-off and landing
    along the link's arc), that of the lag a / g behind an accelerating reference, and that of the
    equilibrium under a changing force. Only the rate is fed back, so that a link which wind or
    contact holds at an angle does not displace the platform.
    """
    axis, jerk = local(3), local(2)
    mat_vec(est.R_WB, floating.axis, axis)
    rate = est.qd[floating.swing] - ref.qd[floating.swing] - wrench.balance_rate
    for i in range(2):
        jerk[i] = min(max((ref.a_WB[i] - me.a_last[i]) / me.dt, -JERK_MAX), JERK_MAX)
        me.a_last[i] = ref.a_WB[i]
    rate -= (jerk[0] * axis[1] - jerk[1] * axis[0]) / body.gravity
    for i in range(3):
        rate += floating.axis[i] * est.w_WB_B[i]
    if me.pose_bandwidth > 0.0:
        rate += turn_of_pose(me, est, floating)
    # a positive rate about the axis moves the end of the link backward, along z x axis
    a[0] -= me.k_swing * rate * (forward[0] * axis[1] - forward[1] * axis[0])
    a[1] -= me.k_swing * rate * (left[0] * axis[1] - left[1] * axis[0])
    a[0] += (forward[0] * jerk[0] + forward[1] * jerk[1]) / me.k_attitude[1]
    a[1] += (left[0] * jerk[0] + left[1] * jerk[1]) / me.k_attitude[0]


@helper
def turn_of_pose(me: Any, est: Any, floating: Any) -> float:
    """Return the rate (rad/s) at which moving arms turn the line from joint to hanging mass.

    This line is the pendulum. While friction holds a hand, a motion of the platform moves the
    arms, and the link turns to keep their mass below the joint. This turn is not a swing: damping
    it would feed the motion of the platform back to itself.
    """
    sine, cosine = 0.0, 0.0  # of the line's angle; L_s is horizontal with the mass straight below
    side, up = local(3), local(3)
    up[0], up[1], up[2] = 0.0, 0.0, 1.0
    cross(floating.axis, up, side)
    for i in range(3):
        cosine -= side[i] * floating.L_s[i]
        sine += up[i] * floating.L_s[i]
    pose = math.atan2(sine, cosine) - est.q[floating.swing]
    if math.isnan(me.pose):
        me.pose = pose
    change = me.pose_bandwidth * (pose - me.pose)
    me.pose += me.dt * change
    return change


@helper
def angular_acceleration(me: Any, ref: Any, est: Any, R_des: Any, acc: Any) -> None:
    """Fill acc (3,) rad/s^2, in B: the angular acceleration that attitude and rate loop command."""
    rel, turn, w_des, spin = local(3, 3), local(3), local(3), local(3)
    mat_t_mat(est.R_WB, R_des, rel)
    log_so3(rel, turn)
    spin[0], spin[1], spin[2] = 0.0, 0.0, ref.w_WB_B[2]
    mat_vec(rel, spin, w_des)
    for i in range(3):
        acc[i] = me.k_rate[i] * (me.k_attitude[i] * turn[i] + w_des[i] - est.w_WB_B[i])


@helper
def torque_for_turn(
    me: Any, est: Any, body: Any, floating: Any, wrench: Any, saturated: float, cmd: Any, acc: Any
) -> None:
    """Fill cmd.t_B: the torque for the angular acceleration `acc`, with a lead for the rotor lag.

    The lead (1 + tau s) / (1 + lead s) acts on the feedback only; the feed-forward terms are slow.
    """
    t_fb, spin, gyro = local(3), local(3), local(3)
    g_B, u_v, u_w = local(3), local(3), local(3)
    for i in range(3):
        t_fb[i], spin[i] = 0.0, 0.0
        for j in range(3):
            t_fb[i] += floating.I_eff[i, j] * acc[j]
            spin[i] += floating.I_eff[i, j] * est.w_WB_B[j]
        g_B[i] = -body.gravity * est.R_WB[2, i]
    cross(est.w_WB_B, spin, gyro)
    cross(body.p_BC, g_B, u_w)  # gravity moment about B
    for i in range(3):
        u_w[i] = body.mass * u_w[i] + wrench.t_hands_B[i]
        spin[i] = wrench.f_hands_W[i] + wrench.f_rest_W[i]
    mat_t_vec(est.R_WB, spin, u_v)
    u_s = wrench.s_hands
    for i in range(3):
        u_v[i] += cmd.f_B[i] + body.mass * g_B[i]
        u_s += floating.L_s[i] * g_B[i]
    ahead = me.rotor_tau / me.lead
    blend = -math.expm1(-me.dt / me.lead)
    for i in range(3):
        lead = t_fb[i]
        if i < 2:  # yaw is slow enough without a lead, and its torque costs much thrust
            lead = ahead * t_fb[i] + (1.0 - ahead) * me.t_lag[i]
            me.t_lag[i] += blend * (t_fb[i] - me.t_lag[i])
        t = lead + gyro[i] - u_w[i] + floating.A[i, 3] * u_s + me.theta[i]
        for j in range(3):
            t += floating.A[i, j] * u_v[j]
        cmd.t_B[i] = t
        if saturated == 0.0:
            me.theta[i] += me.dt * me.k_integral[i] * t_fb[i]
            me.theta[i] = min(max(me.theta[i], -me.t_integral_max), me.t_integral_max)
