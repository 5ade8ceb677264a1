"""Cascade of a coplanar multirotor: the position loop commands a force, the attitude follows it.

The force is that of law (4) of Tognon 2018 (loops.py). The thrust acts along z_B, so the direction
of the force and the nominal heading determine the attitude reference (Lee, Leok, McClamroch 2010,
CDC, eq. 12-16, with a tilt limit). Robots with tilted rotors can fly this law, too.
"""

from __future__ import annotations

from typing import Any

from skywright.core.scratch import local
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.laws._thrust import Thrust, ThrustTable, aim_thrust, fill_thrust
from skywright.vehicle.loops import (
    LoopsTable,
    arm_velocity,
    attitude_torque,
    position_force,
    rest,
)


class ThrustVectoring(ThreeLoops):
    """Fills f_B = (0, 0, T), t_B and qd."""

    class Table(LoopsTable, ThrustTable):
        """[mission.law]; keys that are not set have the value of [robot.control]."""

    class Me(ThreeLoops.Me, Thrust):
        """Gains and integrals of the loops, limits of the thrust."""

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gains from the bandwidths."""
        super().build(me, table, context)
        fill_thrust(me, table, context)

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
        f_W, R_des, w_des, wd_des = local(3), local(3, 3), local(3), local(3)
        position_force(me, ref, est, body, allocated.saturated, f_W)
        cmd.f_B[0] = 0.0
        cmd.f_B[1] = 0.0
        cmd.f_B[2] = aim_thrust(me, ref, est, body, f_W, R_des)
        w_des[0] = w_des[1] = wd_des[0] = wd_des[1] = 0.0
        w_des[2] = ref.w_WB_B[2]
        wd_des[2] = ref.wd_WB_B[2]
        attitude_torque(me, R_des, w_des, wd_des, est, body, cmd.f_B, allocated.saturated, cmd.t_B)
