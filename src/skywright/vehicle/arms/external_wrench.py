"""External wrench on a robot whose arms may hang on a joint without a servo.

Momentum observer (De Luca and Mattone 2005, ICRA, eq. 6-9, here for the linear momentum, whose
balance in W has no Coriolis terms): with P = R_WB (m v_B + m w x c + L_s q')

    dP/dt = R_WB f_rotors + m g + f_hands + f_rest,    f_rest = k (P - P_predicted).

P includes the momentum of the swinging link, so a swing alone gives no external force. The
estimators' simple `f_ext_W` (mass times the platform's acceleration, minus the rotors' force) does
include it. f_hands, the reaction to the forces of the hands, is measured at the joints. The
observer subtracts it, so the sum f_hands + f_rest counts no force twice, also for a wrong f_hands.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from skywright.core.record import Record, Vec3
from skywright.core.rotations import cross, mat_t_vec, mat_vec, norm
from skywright.core.scratch import local
from skywright.core.types import TASK_FORCE, TASK_FORCE_POSITION
from skywright.vehicle.arms.ports import (
    ArmModel,
    Floating,
    HandForce,
    Hands,
    HandsReference,
    Wrench,
)
from skywright.vehicle.bus import Body, Clock, Estimate, Reference
from skywright.vehicle.component import Component, Law, Out, helper
from skywright.vehicle.estimates import RotorForce

SWING_BANDWIDTH = 2.0
"""rad/s, of the torque about the swinging joint. It is below the joint's own frequency, so that at
the frequency of the arms on their springs `balance_rate` is a fraction (k^2 M_ss / (m l g), 0.4) of
the joint's rate."""
TRUSTED = 2.0
"""Largest accepted ratio of the measured force at a hand to the commanded force."""
HANGING = 0.1
"""m, lever below which the swing angle gives no estimate of a force at the hands."""


class WrenchObserver(Component):
    """Fills Wrench each tick, for a law that reads it."""

    slot = "control"

    class Me(Record):
        bandwidth: Vec3  # rad/s, of f_rest_W along the platform's axes forward, left, up
        momentum_W: Vec3  # N s, as predicted
        momentum_s: float  # N m s, of the joint, as predicted
        reference_rate: float  # rad/s, balance_rate due to the reference, with the lag of s_rest
        reference_slow: float  # rad/s, with the lag of s_slow

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one if law, estimator or a part has a port of Wrench."""
        if Wrench in context.asked:
            yield cls("external_wrench")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the bandwidth that the law requires."""
        for part in context.named:
            if isinstance(part, Law):
                me.bandwidth[:] = part.observe_wrench(context)

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        floating: Floating,
        ref: Reference,
        est: Estimate,
        body: Body,
        rotors: RotorForce,
        arm: ArmModel | None,
        hands: Hands | None,
        force: HandForce | None,
        tasks: HandsReference | None,
        out: Out[Wrench],
    ) -> None:
        v = View(me, clock.dt, floating, est, body, out)
        out.f_swing = 0.0
        if arm is not None and hands is not None and force is not None and tasks is not None:
            take_hands(v, arm, hands, force, tasks)
        P, f_W = local(3), local(3)
        rate = est.qd[floating.swing] if floating.swing >= 0 else 0.0
        find_momentum(v, rate, P)
        if ref.active < 0.5:
            start(v, P)
            return
        mat_vec(est.R_WB, rotors.f_B, f_W)
        observe_force(v, P, f_W)
        if floating.swing >= 0:
            observe_swing(v, rate, ref.q[floating.swing], ref.qd[floating.swing])


class View(NamedTuple):
    """Records that the functions below read and write."""

    me: Any
    dt: float
    floating: Any
    est: Any
    body: Any
    out: Any


@helper
def find_momentum(v: View, rate: float, P: Any) -> None:
    """Fill P (3,) N s, the momentum in W, with a swing of `rate` (rad/s)."""
    p_B, turned = local(3), local(3)
    mat_t_vec(v.est.R_WB, v.est.v_WB, p_B)
    cross(v.est.w_WB_B, v.body.p_BC, turned)
    for a in range(3):
        p_B[a] = v.body.mass * (p_B[a] + turned[a]) + v.floating.L_s[a] * rate
    mat_vec(v.est.R_WB, p_B, P)


@helper
def observe_force(v: View, P: Any, f_W: Any) -> None:
    """Fill f_rest_W from the momentum P and the rotors' force f_W, both in W."""
    me, est, out, dt = v.me, v.est, v.out, v.dt
    f_W[2] -= v.body.mass * v.body.gravity
    x, y = est.R_WB[0, 0], est.R_WB[1, 0]
    size = max(math.sqrt(x * x + y * y), 1e-3)
    x, y = x / size, y / size
    e_x, e_y = P[0] - me.momentum_W[0], P[1] - me.momentum_W[1]
    forward = find_gain(me.bandwidth[0], dt) * (x * e_x + y * e_y)
    left = find_gain(me.bandwidth[1], dt) * (x * e_y - y * e_x)
    out.f_rest_W[0] = forward * x - left * y
    out.f_rest_W[1] = forward * y + left * x
    out.f_rest_W[2] = find_gain(me.bandwidth[2], dt) * (P[2] - me.momentum_W[2])
    for a in range(3):
        me.momentum_W[a] += dt * (f_W[a] + out.f_hands_W[a] + out.f_rest_W[a])


@helper
def observe_swing(v: View, rate: float, wanted: float, wanted_rate: float) -> None:
    """Fill s_rest, s_slow and balance_rate: dp/dt = dT/dq + L_s . g + s_hands + s_rest.

    p = L_s . v_B + M_ws . w + M_ss q'. Of dT/dq only w . (L_s x v_B) + q' (axis x L_s) . v_B is
    kept, which makes the balance independent of a steady velocity; the other terms are quadratic in
    slow rates. A changing torque moves the equilibrium angle of the link at `balance_rate`. Where
    the reference turns the link (rad, rad/s), on the ground, a torque turns it in that direction
    too. `balance_rate` excludes this part of the motion, because the reference already contains it.
    """
    w, me, out, est, dt = v.floating, v.me, v.out, v.est, v.dt
    v_B, lever, turned = local(3), local(3), local(3)
    mat_t_vec(est.R_WB, est.v_WB, v_B)
    cross(w.L_s, v_B, lever)
    cross(w.axis, w.L_s, turned)
    p, force, size = w.M_ss * rate, 0.0, 0.0
    for a in range(3):
        p += w.L_s[a] * v_B[a] + w.M_ws[a] * est.w_WB_B[a]
        force += est.w_WB_B[a] * lever[a] + rate * turned[a] * v_B[a]
        force -= w.L_s[a] * est.R_WB[2, a] * v.body.gravity
        size += w.L_s[a] * w.L_s[a]
    out.s_rest = find_gain(SWING_BANDWIDTH, dt) * (p - me.momentum_s)
    me.momentum_s += dt * (force + out.s_hands + out.s_rest)
    change = SWING_BANDWIDTH * (out.s_hands + out.s_rest - out.s_slow)
    out.s_slow += dt * change
    size = math.sqrt(size)
    angle = wanted - est.q[w.swing]
    given = (math.cos(angle) * turned[2] - math.sin(angle) * w.L_s[2]) / size * wanted_rate
    blend = find_gain(SWING_BANDWIDTH, dt) * dt  # two stages, to match the lag of s_slow
    me.reference_rate += blend * (given - me.reference_rate)
    me.reference_slow += blend * (me.reference_rate - me.reference_slow)
    out.balance_rate = change / (size * v.body.gravity) - me.reference_slow


@helper
def find_gain(bandwidth: float, dt: float) -> float:
    """Return the gain (1/s) of a first-order observer of a bandwidth (rad/s) at the period dt."""
    return -math.expm1(-bandwidth * dt) / dt


@helper
def start(v: View, P: Any) -> None:
    """Initialise the observer with motors off: the ground carries the end of a link on it."""
    w, me, out = v.floating, v.me, v.out
    level = math.sqrt(w.L_s[0] ** 2 + w.L_s[1] ** 2)
    for a in range(3):
        out.f_rest_W[a] = 0.0
    if w.swing >= 0 and abs(w.L_s[2]) > level:  # the link lies rather than hangs
        out.f_rest_W[2] = w.L_s[2] * w.L_s[2] / w.M_ss * v.body.gravity
    for a in range(3):
        me.momentum_W[a] = P[a]
    torque = 0.0  # that supports the link on the ground
    for a in range(3):
        torque += w.L_s[a] * v.est.R_WB[2, a] * v.body.gravity
    out.s_rest, out.s_slow, out.balance_rate = torque, torque, 0.0
    me.reference_rate = me.reference_slow = 0.0
    me.momentum_s = -torque / find_gain(SWING_BANDWIDTH, v.dt)
    me.momentum_W[2] -= out.f_rest_W[2] / find_gain(me.bandwidth[2], v.dt)


@helper
def take_hands(v: View, arm: Any, hands: Any, force: Any, tasks: Any) -> None:
    """Fill the reaction to the forces of the hands, and the horizontal force from the swing angle.

    A hand's force counts only while the reference commands a force, and up to twice that force: in
    free air the springs carry the arm's inertia, and near a stretched arm their readings are
    inaccurate. f_rest includes the remainder. A load in the reference counts in full.

    The reaction is low-passed at `bandwidth[0]`. While friction holds a hand, the link oscillates
    on the springs of the arm (2.2 Hz under a wide pipe). The robot counters a horizontal force by
    tilting, with a phase lag of more than 90 deg at that frequency: compensation that cancels a
    steady reaction would excite the oscillation.
    """
    w, est, out = v.floating, v.est, v.out
    f_W, f_B, t_B = local(3), local(3), local(3)
    total, moment, column = local(3), local(3), local(3)
    total[:] = 0.0
    moment[:] = 0.0
    about_swing, lever = 0.0, 0.0
    for h in range(arm.n_hands):
        share = 0.0
        if tasks.task[h] == TASK_FORCE or tasks.task[h] == TASK_FORCE_POSITION:
            asked, felt = norm(tasks.f_WH[h]), norm(force.f_WH[h])
            share = min(1.0, TRUSTED * asked / max(felt, 1e-9))
        for a in range(3):
            f_W[a] = share * force.f_WH[h, a]
        f_W[2] += tasks.load[h]
        mat_t_vec(est.R_WB, f_W, f_B)
        cross(hands.p_BH[h], f_B, t_B)
        for a in range(3):
            total[a] -= f_W[a]
            moment[a] -= t_B[a]
            if w.swing >= 0:
                about_swing -= hands.J_BH[h, a, w.swing] * f_B[a]
        if w.swing >= 0:
            for a in range(3):
                column[a] = hands.J_BH[h, a, w.swing]
            mat_vec(est.R_WB, column, t_B)
            lever += t_B[0] * est.R_WB[0, 0] + t_B[1] * est.R_WB[1, 0]
    blend = -math.expm1(-v.me.bandwidth[0] * v.dt)
    for a in range(3):
        out.f_hands_W[a] += blend * (total[a] - out.f_hands_W[a])
        out.t_hands_B[a] += blend * (moment[a] - out.t_hands_B[a])
    out.s_hands += blend * (about_swing - out.s_hands)
    lever /= max(arm.n_hands, 1)
    if w.swing >= 0 and abs(lever) > HANGING:
        up = 0.0  # moment of the weight: -L_s . g
        for a in range(3):
            up += w.L_s[a] * est.R_WB[2, a]
        out.f_swing = -up * v.body.gravity / lever
