"""Conversion of the command of a law to commands of rotors and servos."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import table, words
from skywright.core.record import Array, Record
from skywright.core.rotations import mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_JOINTS, MAX_ROTORS
from skywright.description.robot.limbs import takes_torque
from skywright.models.allocation import allocate, thrust_to_speed
from skywright.models.compliant_arms import is_compliant
from skywright.models.rotor_loss import RotorsLeft, compute_rotors_left
from skywright.models.rotor_reaction import compute_reaction_times
from skywright.vehicle.arms.ports import Floating
from skywright.vehicle.bus import (
    Allocated,
    Body,
    Estimate,
    Reference,
    RotorDrive,
    ServoDrive,
    ThrustCommand,
    WrenchCommand,
)
from skywright.vehicle.component import Component, Out, Recorded, helper

MISSED = 1e-6
"""Tolerance of the wrench (N, N m) of thrusts that a law commands itself, over the weight."""


class RotorAllocation(Component):
    """Fills RotorDrive and Allocated from the commanded wrench (models/allocation.py).

    At a limit the force is reduced at the point where this does not turn the platform: the centre
    of mass, or, with a link on a joint without a servo, the point p with p x f = A f
    (models/floating.py), f along z_B.

    Thrusts that a law commands itself (port ThrustCommand) are used within the limits of the rotors
    in use. `saturated` is then 1 if they do not produce the commanded wrench and a rotor is at a
    limit; a wrench that the law reduces for another reason does not count.
    """

    slot = "allocate"

    class Me(Record):
        B: int  # addresses of the allocator's arrays
        P: int
        t_min: int
        t_max: int
        full: int
        n: int  # rotors
        k_f: float  # N/(rad/s)^2
        missed: float  # N, N m: error of the wrench above which the rotors count as saturated
        share: float  # per tick, low-pass of the torque about z, for the spin-up reaction
        t_z: float  # N m, low-passed torque about z
        thrust: Annotated[Array, MAX_ROTORS]  # N
        preload: Annotated[Array, MAX_ROTORS]  # N
        R_AB: Annotated[Array, 3, 3]  # to the frame A with z along the lift of the rotors in use

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has it."""
        yield cls("allocation")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Copy the nominal rotors, because the allocation changes when a rotor is given up.

        About z the rotors produce (1 + T s) times their command (models/rotor_reaction.py). The
        allocation therefore low-passes the torque about z by 1 / (1 + T s).
        """
        a, weight = context.allocator, context.mass * context.world.gravity_mps2
        me.share, me.missed = compute_yaw_share(context), MISSED * weight
        self._own = a._replace(
            P=a.P.copy(), t_min=a.t_min.copy(), t_max=a.t_max.copy(), preload=a.preload.copy()
        )
        me.B, me.P = context.keep(a.B), context.keep(self._own.P)
        me.t_min, me.t_max = context.keep(self._own.t_min), context.keep(self._own.t_max)
        me.full, me.n, me.k_f = a.full, len(a.t_min), a.k_f
        me.preload[: len(a.preload)], me.R_AB[:] = a.preload, np.eye(3)

    def give_up(
        self, me: Any, i: int, weight: float, p_BC: NDArray[Any], tilt_max: float
    ) -> RotorsLeft | None:
        """Stop using rotor `i`; return None if the others cannot hold `weight` (N) at p_BC (3,) m.

        `allocate` then works in a frame with z along the lift of the remaining rotors, and reduces
        the command at a limit about this axis.
        """
        own, left = self._own, compute_rotors_left(self._own, i, weight, p_BC, tilt_max)
        if left is None:
            return None
        own.t_min[:], own.t_max[:] = left.t_min, left.t_max
        own.preload[:] = me.preload[: len(left.preload)] = left.preload
        # Without a rotor none is omnidirectional: a lift along the vertical is feasible only at the
        # lean, and asked for on the way there it would leave no thrust for the torque that leans.
        me.full = min(me.full, 1)
        me.R_AB[:] = left.R_WB
        own.P[:, :3], own.P[:, 3:] = left.P[:, :3] @ left.R_WB.T, left.P[:, 3:] @ left.R_WB.T
        return left

    def save(self) -> Any:
        """Return the present allocation."""
        own = self._own
        return [x.copy() for x in (own.P, own.t_min, own.t_max, own.preload)]

    def restore(self, saved: Any) -> None:
        """Restore a saved allocation."""
        own = self._own
        for x, was in zip((own.P, own.t_min, own.t_max, own.preload), saved, strict=True):
            x[:] = was

    @staticmethod
    def step(
        me: Me,
        ref: Reference,
        est: Estimate,
        body: Body,
        cmd: WrenchCommand,
        floating: Floating | None,
        told: ThrustCommand | None,
        out: Out[Allocated],
        drive: Out[RotorDrive],
    ) -> None:
        n = me.n
        B, P, thrust = table(me.B, 6, n), table(me.P, n, 6), me.thrust[:n]
        t_B = local(3)
        if ref.active < 0.5:
            for i in range(n):
                thrust[i] = 0.0
            out.saturated = me.t_z = 0.0
        else:
            me.t_z += (cmd.t_B[2] - me.t_z) * me.share
            t_B[0], t_B[1], t_B[2] = cmd.t_B[0], cmd.t_B[1], me.t_z
            f, t, up, c, p = local(3), local(3), local(3), local(3), local(3)
            mat_vec(me.R_AB, cmd.f_B, f)
            mat_vec(me.R_AB, t_B, t)
            mat_vec(me.R_AB, est.R_WB[2], up)
            for i in range(3):
                p[i] = body.p_BC[i]
            if floating is not None:  # a swinging link does not turn with the platform
                p[0], p[1], p[2] = -floating.A[1, 2], floating.A[0, 2], -floating.A[0, 1]
            mat_vec(me.R_AB, p, c)
            flag = allocate(
                B, P, words(me.t_min, n), words(me.t_max, n), me.full, f, t, up, c, thrust
            )
            out.saturated = float(flag)
            for i in range(n):
                thrust[i] += me.preload[i]
            if told is not None:
                low, high = words(me.t_min, n), words(me.t_max, n)
                out.saturated = follow_told(
                    told, low, high, me.preload, B, cmd.f_B, t_B, me.missed, out.saturated, thrust
                )
        for r in range(3):
            force = torque = 0.0
            for i in range(n):
                force += B[r, i] * thrust[i]
                torque += B[r + 3, i] * thrust[i]
            out.f_B_alloc[r], out.t_B_alloc[r] = force, torque
        thrust_to_speed(thrust, n, me.k_f, drive.speed)


@helper
def follow_told(
    told: Any, t_min: Any, t_max: Any, preload: Any, B: Any, f_B: Any, t_B: Any, missed: float,
    saturated: float, thrust: Any,
) -> float:  # fmt: skip
    """Replace `thrust` (n,) N by the thrusts that the law commands, if any, within the limits.

    Returns 1 if their wrench differs from the command by more than `missed` (N, N m) and a rotor is
    at a limit, else 0; without commanded thrusts it returns `saturated`.
    """
    n, total = t_min.shape[0], 0.0
    for i in range(n):
        total += told.thrust[i]
    if told.given < 0.5 or not math.isfinite(total):
        return saturated
    at_limit = False
    for i in range(n):
        low, high = t_min[i] + preload[i], t_max[i] + preload[i]
        thrust[i] = min(max(told.thrust[i], low), high)
        at_limit = at_limit or thrust[i] - low < missed or high - thrust[i] < missed
    worst = 0.0
    for r in range(3):
        f, t = f_B[r], t_B[r]
        for i in range(n):
            f -= B[r, i] * thrust[i]
            t -= B[r + 3, i] * thrust[i]
        worst = max(worst, abs(f), abs(t))
    return 1.0 if at_limit and worst > missed else 0.0


def compute_yaw_share(context: Any) -> float:
    """Return the share per tick of the low-pass 1 / (1 + T s) of the torque about z.

    About z the rotors produce (1 + T s) times their command (models/rotor_reaction.py).
    """
    weight = context.mass * context.world.gravity_mps2
    reaction = float(compute_reaction_times(context.rotors, context.allocator, weight)[2])
    return 1.0 - math.exp(-context.dt / reaction) if reaction > 0.0 else 1.0


class SpeedServos(Component):
    """Fills ServoDrive with motor speeds from the commanded joint speeds, through the belt."""

    slot = "allocate"

    class Me(Record):
        belt_inv: Annotated[Array, MAX_JOINTS, MAX_JOINTS]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Arms with velocity servos have it: neither springs nor torque servos."""
        if not is_compliant(context.robot) and not takes_torque(context.robot):
            yield cls("servos")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Copy the nominal belt matrix."""
        me.belt_inv = context.model["belt_inv"]

    @staticmethod
    def step(me: Me, body: Body, cmd: WrenchCommand, drive: Out[ServoDrive]) -> None:
        for j in range(body.n_joints):
            v = 0.0
            for i in range(body.n_joints):
                v += me.belt_inv[j, i] * cmd.qd[i]
            drive.motor[j] = v


class TorqueServos(Component):
    """Fills ServoDrive with motor torques from the commanded joint torques, through the belt."""

    slot = "allocate"

    class Me(Record):
        belt: Annotated[Array, MAX_JOINTS, MAX_JOINTS]

    columns = (
        Recorded(
            "cmd_torque",
            WrenchCommand,
            "torque",
            "N m",
            "commanded joint torque",
            per="joint",
        ),
    )

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Arms with torque servos have it."""
        if takes_torque(context.robot):
            yield cls("servos")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Copy the nominal belt matrix."""
        me.belt = context.model["belt"]

    @staticmethod
    def step(me: Me, body: Body, cmd: WrenchCommand, drive: Out[ServoDrive]) -> None:
        for j in range(body.n_joints):
            torque = 0.0
            for i in range(body.n_joints):  # the same power at joints and motors
                torque += me.belt[i, j] * cmd.torque[i]
            drive.motor[j] = torque
