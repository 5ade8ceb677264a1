"""Tip motion along and across the probe by the joints, within the stops of the joints."""

from __future__ import annotations

from typing import Any

from skywright.vehicle.component import helper

DAMPING = 1e-6
"""m^2/rad^2, damping of the inverse of the arm's Jacobian: a lever of 1 mm."""
STOP_RATE = 12.5
"""1/s, speed limit of a joint over its distance to the stop; servos lag by 2 T_v = 0.08 s."""


@helper
def fill_tip_rows(body: Any, J: Any) -> None:
    """Fill J (2, MAX_JOINTS) m/rad: the Jacobian of the tip along z and along x of T."""
    for j in range(body.n_joints):
        J[0, j] = J[1, j] = 0.0
        for i in range(3):
            J[0, j] += body.R_BT[i, 2] * body.J_BT[i, j]
            J[1, j] += body.R_BT[i, 0] * body.J_BT[i, j]


@helper
def invert_tip(J: Any, n: int, along: float, across: float, out: Any) -> None:
    """Fill the least-norm joint speeds for tip speeds along and across: J^T (J J^T + e I)^-1 v."""
    aa, cc, ac = DAMPING, DAMPING, 0.0
    for j in range(n):
        aa += J[0, j] * J[0, j]
        cc += J[1, j] * J[1, j]
        ac += J[0, j] * J[1, j]
    det = aa * cc - ac * ac
    x = (cc * along - ac * across) / det
    y = (aa * across - ac * along) / det
    for j in range(n):
        out[j] = J[0, j] * x + J[1, j] * y


@helper
def slow_at_stops(q_min: Any, q_max: Any, q: Any, n: int, qd: Any) -> None:
    """Scale the speeds qd (n,) rad/s in place so that no joint passes its stop.

    One factor scales all joints, so that the tip keeps its direction. If only one joint stopped,
    the others would move the tip sideways or, if friction holds the tip, push the platform away.
    """
    share = 1.0
    for j in range(n):
        room = q_max[j] - q[j] if qd[j] > 0.0 else q[j] - q_min[j]
        fastest = STOP_RATE * max(room, 0.0)
        if abs(qd[j]) * share > fastest:
            share = fastest / abs(qd[j])
    for j in range(n):
        qd[j] *= share
