"""Tognon et al. 2018, section V: dislocated PID of a fully actuated platform with an arm.

Attitude and arm follow their nominal trajectories, laws (3) and (2). The force of the platform
closes the position loop at the tip, law (4), and the velocity of the platform provides the damping.
The loop thus combines the position of the link's far end with the velocity of its driven end, which
is stable across the elasticity of the arm.

    (2)  v_M = v_M^n + K_M (q_M^n - q_M)
    (3)  t = c x f + I_C (w'^n + w_R^2 e_R + 2 zeta_R w_R e_w) + theta + w x I_C w
    (4)  f = m (a^n + g e_z) + K^D (v_R^n - v_R) + K^P (p_E^d - p_E) + sigma

with q_M, v_M of the motors, R the platform, E the tip, c the centre of mass, theta and sigma the
integrals; K^P = m w^2, K^D = 2 zeta m w (loops.py describes each term and the additions to the
paper).

The option `moment_feed_forward` is an addition to the paper. While the reference slides inside a
surface, law (4) presses with N = K^P |e_n| and feeds the friction mu N forward as a force. Both
forces act at the tip, so they have the moment (p_T - c) x f about the centre of mass. The paper
leaves this moment to the integral of law (3), which then has to follow each reversal of the
friction. The value `friction` feeds the moment of the friction forward, `contact` also that of the
push.
"""

from __future__ import annotations

from typing import Any, Literal

from skywright.core.scratch import local
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out
from skywright.vehicle.laws._contact_moment import subtract_moment
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.loops import (
    LoopsTable,
    arm_velocity,
    hold_attitude,
    position_force,
    rest,
    to_body,
)


class PushAndSlide(ThreeLoops):
    """Laws (2), (3), (4)."""

    needs_full_actuation = True

    class Table(LoopsTable):
        """Bandwidths of the loops, and feed-forward of the contact moment in law (3)."""

        # part of the contact force whose moment about the centre of mass law (3) feeds forward
        moment_feed_forward: Literal["none", "friction", "contact"] = "none"

    class Me(ThreeLoops.Me):
        feed_friction: float  # 1: law (3) feeds the moment of the friction forward
        feed_push: float  # 1: it also feeds the moment of the push forward

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gains from the bandwidths."""
        super().build(me, table, context)
        me.feed_friction = float(table.moment_feed_forward != "none")
        me.feed_push = float(table.moment_feed_forward == "contact")

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
        if ref.active < 0.5:
            rest(me, cmd)
            return
        f_W = local(3)
        position_force(me, ref, est, body, allocated.saturated, f_W)
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)
        if me.feed_friction > 0.5:
            subtract_moment(me, ref, est, body, me.feed_push, cmd.t_B)
