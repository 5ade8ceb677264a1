"""External wrench on a robot whose arms hang on a joint without a servo, or on no such joint.

Momentum observer (De Luca and Mattone 2005, ICRA, eq. 6-9, here for the linear momentum, whose
balance in W has no Coriolis terms): with P = R_WB (m v_B + m w x c + L_s q')

    dP/dt = R_WB f_rotors + m g + f_hands + f_rest,    f_rest = k (P - P_predicted).

The swinging link's momentum is in P, so a swing alone is no external force; the estimators' plain
`f_ext_W` (mass times the platform's acceleration, less the rotors' force) shows it as one.
f_hands, the reaction of what the hands press, is known from the joints; subtracting it here means
that the sum f_hands + f_rest counts no force twice, whatever f_hands says.
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
"""rad/s, of the torque about the swinging joint: below its own frequency, so that at that of the
arms on their springs `balance_rate` stays a fraction (k^2 M_ss / (m l g), 0.4) of the rate."""
TRUSTED = 2.0
"""Largest force at a hand that is believed, over the one asked for."""
HANGING = 0.1
"""m, lever below which the weight of a hanging link says nothing about a force."""


class WrenchObserver(Component):
    """Fills Wrench each tick, for a law that reads it."""

    slot = "control"

    class Me(Record):
        bandwidth: Vec3  # rad/s, of f_rest_W along the platform's axes forward, left, up
        momentum_W: Vec3  # N s, as predicted
        momentum_s: float  # N m s, of the joint, as predicted
        told_rate: float  # rad/s, of the balance as the reference turns the link, as late as s_rest
        told_slow: float  # rad/s, as late as s_slow

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one where the platform's law has such a port."""
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
    """What the functions below work on."""

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
    """The same for the link's joint: dp/dt = dT/dq + L_s . g + s_hands + s_rest.

    p = L_s . v_B + M_ws . w + M_ss q'. Of dT/dq only what makes the balance independent of a steady
    velocity is kept: w . (L_s x v_B) + q' (axis x L_s) . v_B; the rest is quadratic in slow rates.
    A changing torque moves the angle at which the link is in balance, at `balance_rate`. Where the
    reference turns the link (rad, rad/s), on the ground, a torque turns it that way too: what that
    moves the balance is no part of `balance_rate`, for the reference tells it already.
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
    told = (math.cos(angle) * turned[2] - math.sin(angle) * w.L_s[2]) / size * wanted_rate
    blend = find_gain(SWING_BANDWIDTH, dt) * dt  # twice, as late as s_slow
    me.told_rate += blend * (told - me.told_rate)
    me.told_slow += blend * (me.told_rate - me.told_slow)
    out.balance_rate = change / (size * v.body.gravity) - me.told_slow


@helper
def find_gain(bandwidth: float, dt: float) -> float:
    """Gain (1/s) of a first-order observer of a bandwidth (rad/s) at the period dt."""
    return -math.expm1(-bandwidth * dt) / dt


@helper
def start(v: View, P: Any) -> None:
    """Motors off: when they start, the ground still carries the end of a link that lies on it."""
    w, me, out = v.floating, v.me, v.out
    level = math.sqrt(w.L_s[0] ** 2 + w.L_s[1] ** 2)
    for a in range(3):
        out.f_rest_W[a] = 0.0
    if w.swing >= 0 and abs(w.L_s[2]) > level:  # it lies rather than hangs
        out.f_rest_W[2] = w.L_s[2] * w.L_s[2] / w.M_ss * v.body.gravity
    for a in range(3):
        me.momentum_W[a] = P[a]
    torque = 0.0  # what holds the link on the ground
    for a in range(3):
        torque += w.L_s[a] * v.est.R_WB[2, a] * v.body.gravity
    out.s_rest, out.s_slow, out.balance_rate = torque, torque, 0.0
    me.told_rate = me.told_slow = 0.0
    me.momentum_s = -torque / find_gain(SWING_BANDWIDTH, v.dt)
    me.momentum_W[2] -= out.f_rest_W[2] / find_gain(me.bandwidth[2], v.dt)


@helper
def take_hands(v: View, arm: Any, hands: Any, force: Any, tasks: Any) -> None:
    """Reaction of the forces that the hands exert; and the level force from the swing angle.

    A hand's force counts while the reference asks it to press, and up to twice what is asked: in
    free air the springs carry the arm's inertia, and near a stretched arm their reading means
    little. f_rest takes what this leaves out. A load that is said to hang on a hand counts in full.

    Slowed down to `bandwidth[0]`: while friction holds a hand, the link bounces on the springs of
    the arm (2.2 Hz under a wide pipe). The rotors answer a level force by leaning, at that
    frequency more than a quarter turn late: what cancels a steady reaction would drive the bounce.
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
