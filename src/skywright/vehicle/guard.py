"""Guards: conditions that end a mission tick early."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from skywright.core.types import MAX_JOINTS, MODE_STANDARD
from skywright.vehicle.bus import Clock, Estimate, Reference, ShaftCommand, Truth, WrenchCommand
from skywright.vehicle.component import Component

NOT_FINITE, CONTACT_MADE, CONTACT_LOST, COLLISION, LOST_CONTROL = 1, 2, 4, 8, 16

ERROR_MAX = 0.8  # m between estimate and nominal pose: the robot no longer follows
UP_MIN = 0.3  # cosine of the tilt below which it has tipped over


class CommandGuard(Component):
    """Stops the tick where a command is not finite, so that NaN never reaches an actuator; ends the
    mission tick where the robot no longer follows.
    """

    slot = "guard"

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has one."""
        yield cls("command guard")

    @staticmethod
    def step(
        clock: Clock,
        ref: Reference,
        est: Estimate,
        cmd: WrenchCommand,
        shaft: ShaftCommand | None,
    ) -> None:
        total = 0.0
        for i in range(3):
            total += cmd.f_B[i] + cmd.t_B[i]
        for j in range(MAX_JOINTS):
            total += cmd.qd[j] + cmd.torque[j]
        if shaft is not None:
            for j in range(MAX_JOINTS):
                total += shaft.theta[j]
        if not math.isfinite(total):
            clock.fired |= NOT_FINITE
            clock.stop = 1
            return
        if ref.active > 0.5:
            error = 0.0
            # standard stabilisation lets go of the place: it drifts, at the height of the reference
            for i in range(2 if ref.mode == MODE_STANDARD else 0, 3):
                error += (ref.p_WB[i] - est.p_WB[i]) ** 2
            if error > ERROR_MAX * ERROR_MAX or est.R_WB[2, 2] < UP_MIN:
                clock.fired |= LOST_CONTROL


class StateGuard(Component):
    """Stops the tick where the simulated state is not finite."""

    slot, side = "guard", "plant"

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has one."""
        yield cls("state guard")

    @staticmethod
    def step(clock: Clock, truth: Truth) -> None:
        total = 0.0
        for i in range(3):
            total += truth.p_WB[i] + truth.v_WB[i] + truth.w_WB_B[i]
        if not math.isfinite(total):
            clock.fired |= NOT_FINITE
            clock.stop = 1
