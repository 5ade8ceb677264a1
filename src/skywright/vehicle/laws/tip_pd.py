"""Feedback of tip position and tip velocity alone, across the elasticity of the arm.

Tognon et al. 2018, section V, after De Luca and Book (Springer Handbook of Robotics, 2008, ch. 13):
for a joint with an undamped elastic transmission this feedback is unstable for every gain, while
link position with motor velocity (`push_and_slide`) is stable for suitable gains. The law
demonstrates this instability.
"""

from __future__ import annotations

from typing import Any

from skywright.core.record import Vec3
from skywright.core.scratch import local
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out, helper
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.loops import (
    arm_velocity,
    force_from_errors,
    hold_attitude,
    position_force,
    rest,
    to_body,
)

DERIVATIVE = 0.004
"""s, time constant of the derivative of the measured tip position. The tip velocity of the estimate
is rigid kinematics and does not contain the bending of the arm, which this law feeds back."""


class TipPd(ThreeLoops):
    """Laws (2), (3); while the tip is tracked f_W = ... + K^D (v_E^d - v_E) + K^P e_E + sigma."""

    needs_full_actuation = True

    class Me(ThreeLoops.Me):
        started: float  # 1: p_WT is valid
        p_WT: Vec3  # m, tip at the last step
        v_WT: Vec3  # m/s

    @staticmethod
    def step(
        me: Me,
        ref: Reference,
        est: Estimate,
        body: Body,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:
        arm_velocity(me, ref, est, body, cmd.qd)
        e, v, f_W = local(3), local(3), local(3)
        tip_velocity(me, est, v)
        if ref.active < 0.5:
            rest(me, cmd)
            return
        if ref.track_tip > 0.5:
            for i in range(3):
                e[i] = ref.p_WT[i] - est.p_WT[i]
                v[i] = ref.v_WT[i] - v[i]
            force_from_errors(me, ref, body, e, v, allocated.saturated, f_W)
        else:
            position_force(me, ref, est, body, allocated.saturated, f_W)
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)


@helper
def tip_velocity(me: Any, est: Any, v: Any) -> None:
    """Fill v: filtered derivative of the tip's position, v += dt / (tau + dt) (dp / dt - v)."""
    for i in range(3):
        if me.started > 0.5:
            rate = (est.p_WT[i] - me.p_WT[i]) / me.dt
            me.v_WT[i] += me.dt / (DERIVATIVE + me.dt) * (rate - me.v_WT[i])
        me.p_WT[i] = est.p_WT[i]
        v[i] = me.v_WT[i]
    me.started = 1.0
