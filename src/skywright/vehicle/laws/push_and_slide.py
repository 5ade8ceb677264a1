"""Tognon et al. 2018, section V: the dislocated PID of a fully actuated platform with an arm.

Attitude and arm follow their nominal trajectories, laws (3) and (2). The platform's force closes
the position loop at the tip, law (4), with the platform's velocity as damping: position of the
link's far end and velocity of its driven end, which is stable across the arm's elasticity.
"""

from __future__ import annotations

from skywright.core.scratch import local
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.loops import arm_velocity, hold_attitude, position_force, rest, to_body


class PushAndSlide(ThreeLoops):
    """Laws (2), (3), (4)."""

    needs_full_actuation = True

    @staticmethod
    def step(
        me: ThreeLoops.Me,
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
