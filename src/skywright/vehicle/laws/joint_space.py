"""Pure joint-space control: every degree of freedom tracks its own nominal trajectory.

Tognon et al. 2018, section V, name it as the simplest solution and reject it: the tip is not fed
back, so errors of the kinematic model, the servos and the structure appear at the tip in full. Laws
(2) and (3) are those of `push_and_slide`. The force is law (4) with the position error of the
platform in place of the tip's.
"""

from __future__ import annotations

from skywright.core.scratch import local
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.loops import arm_velocity, hold_attitude, platform_force, rest, to_body


class JointSpace(ThreeLoops):
    """Laws (2), (3) and f_W = -g_1 + M_11 a^n + K^D (v^n - v) + K^P (p_R^n - p_R) + sigma."""

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
        platform_force(me, ref, est, body, allocated.saturated, f_W)
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)
