"""The force that a compliant arm exerts with its hand, from the deflection of its springs.

Two estimators (robot.control.force_estimator). "cartesian" is Suarez 2020, (25)-(28), as published:
the displacement of the hand between the arm with rigid joints and the real one, times a Cartesian
stiffness. It includes the arm's own weight in the force, is linearised in angles that are not
small, and diverges as the arm stretches. "torque" is the static equilibrium of the links: spring
torque = gravity torque + J^T f, with f the force on the touched object.

Only joints with a measured deflection contribute; with two of them f lies in the arm's plane.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, ClassVar

from skywright.core.record import Record
from skywright.core.rotations import mat_t_vec, mat_vec, solve3
from skywright.core.scratch import local
from skywright.description.robot.limbs import SIDES
from skywright.models.compliant_arms import count_command_ticks, is_compliant
from skywright.models.springs import joint_torque
from skywright.vehicle.arms.ports import (
    ArmModel,
    HandForce,
    HandPoints,
    Hands,
    HandsReference,
    Joints,
)
from skywright.vehicle.bus import Estimate
from skywright.vehicle.component import Component, Out, Recorded, helper

SINGULAR = 1e-3
"""m, lever below which a direction of force is taken as unobservable."""
TARE_TIME = 0.5
"""s, time constant of the average of the forces that a tare subtracts."""


class Tare(Record):
    """State of a force estimator."""

    tare: HandPoints  # N, subtracted from the estimated force, in W


class _ForceEstimator(Component):
    slot = "control"
    kind: ClassVar[str] = ""  # of robot.control.force_estimator
    across: ClassVar[float] = 0.0

    Me = Tare
    columns = tuple(
        Recorded(
            f"{side}_est_f_W", HandForce, "f_WH", "N",
            f"estimated force of the {side} hand", item=h, per="hand",
        )
        for h, side in enumerate(SIDES)
    )  # fmt: skip

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield the estimator that the robot's `force_estimator` selects."""
        if is_compliant(context.robot) and context.robot.control.force_estimator == cls.kind:
            yield cls("contact_force")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Set whether the transverse component of the estimated force is valid."""
        context.records[HandForce, ""]["across"] = self.across

    def get_period(self, step: str, context: Any) -> float:
        """Return the servos' period (s)."""
        return count_command_ticks(context.robot) * float(context.dt)


class CartesianForce(_ForceEstimator):
    """Suarez 2020, (25)-(28); the transverse component is not valid: it is the arm's own weight."""

    kind = "cartesian"

    @staticmethod
    def step(
        me: Tare, arm: ArmModel, joints: Joints, hands: Hands, ref: HandsReference, est: Estimate,
        force: Out[HandForce],
    ) -> None:  # fmt: skip
        f_B = local(3)
        for h in range(arm.n_hands):
            force_from_displacement(arm, hands, h, f_B)
            report_force(me, arm, ref, est, force, h, f_B)


class TorqueForce(_ForceEstimator):
    """Static equilibrium of the links."""

    kind, across = "torque", 1.0

    @staticmethod
    def step(
        me: Tare, arm: ArmModel, joints: Joints, hands: Hands, ref: HandsReference, est: Estimate,
        force: Out[HandForce],
    ) -> None:  # fmt: skip
        f_B = local(3)
        for h in range(arm.n_hands):
            force_from_torques(arm, joints, hands, h, f_B)
            report_force(me, arm, ref, est, force, h, f_B)


@helper
def report_force(me: Any, arm: Any, ref: Any, est: Any, force: Any, h: int, f_B: Any) -> None:
    """Fill the force of a hand in W minus the tare; average the tare while `ref.tare` is set."""
    mat_vec(est.R_WB, f_B, force.f_WH[h])
    gain = 1.0 - math.exp(-arm.dt / TARE_TIME)
    for a in range(3):
        if ref.tare > 0.5:
            me.tare[h, a] += gain * (force.f_WH[h, a] - me.tare[h, a])
        force.f_WH[h, a] -= me.tare[h, a]


@helper
def force_from_displacement(arm: Any, hands: Any, h: int, f_B: Any) -> None:
    """Fill f_B (N) with (25)-(28): F = K_C dl, K_C = J^-T K_p J^-1, in x and z of the arms' base.

    J is 2 x 2, of the shoulder's pitch and the elbow (the arm's own is 3 x 4, which has no
    inverse). For a stretched arm J is singular too, and the force is zero.
    """
    shoulder, elbow = arm.first[h], arm.first[h] + arm.n - 1
    dl, dl_B, f_A = local(3), local(3), local(3)
    J, column, column_B = local(2, 2), local(3), local(3)
    for a in range(3):
        dl_B[a] = hands.p_BH_stiff[h, a] - hands.p_BH[h, a]  # (25)
        f_A[a] = 0.0
    mat_t_vec(hands.R_BA, dl_B, dl)
    for i in range(2):
        for a in range(3):
            column_B[a] = hands.J_BH[h, a, shoulder if i == 0 else elbow]
        mat_t_vec(hands.R_BA, column_B, column)
        J[0, i], J[1, i] = column[0], column[2]
    det = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
    if abs(det) > 1e-9:
        # J^-1 dl, times K_p (28), then J^-T: (26), (27)
        t0 = arm.k[shoulder] * (J[1, 1] * dl[0] - J[0, 1] * dl[2]) / det
        t1 = arm.k[elbow] * (J[0, 0] * dl[2] - J[1, 0] * dl[0]) / det
        f_A[0] = (J[1, 1] * t0 - J[1, 0] * t1) / det
        f_A[2] = (J[0, 0] * t1 - J[0, 1] * t0) / det
    mat_vec(hands.R_BA, f_A, f_B)


@helper
def force_from_torques(arm: Any, joints: Any, hands: Any, h: int, f_B: Any) -> None:
    """Fill f_B (N): least squares of J^T f = spring torque - gravity torque, measured joints.

    J is the Jacobian of the centre of the hand's ball, because a force on the ball passes through
    it (at the hand's end a transverse force would have 6 % more lever). The damping,
    (J J^T + l^2 1) f = J dt, gives zero force in directions in which the arm has no lever.
    """
    first = arm.first[h]
    M, y = local(3, 3), local(3)
    M[:] = 0.0
    y[:] = 0.0
    for j in range(first, first + arm.n):
        if arm.sensed[j] == 0.0 or arm.k[j] == 0.0:
            continue
        t = joint_torque(arm, j, joints.deflection[j]) - joints.t_gravity[j]
        for a in range(3):
            y[a] += hands.J_BP[h, a, j] * t
            for c in range(3):
                M[a, c] += hands.J_BP[h, a, j] * hands.J_BP[h, c, j]
    for a in range(3):
        M[a, a] += SINGULAR * SINGULAR
    solve3(M, y, f_B)
