"""A rotor that makes less thrust than it is told."""

from __future__ import annotations

import math
from operator import mul
from typing import TYPE_CHECKING, Any

import numpy as np

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Follow, Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses

BANDWIDTH = 5.0
"""rad/s, of the torque that is observed beside the rotors'."""
USUAL_S = 5.0
"""s, lag of what counts as usual: errors of masses and gains."""
ALIKE = 0.85
"""Cosine between what is observed and what one rotor's loss would do."""
COMPARED_EVERY = 2
"""Looks between comparisons with the rotors."""


def cross(a: list[float], b: list[float]) -> list[float]:
    """Return a x b; NumPy's takes twenty times as long for three numbers."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class RotorWeak(Rule):
    """Share of a rotor's thrust whose loss explains the wrench that is observed.

    A momentum observer (De Luca and Mattone 2005, eq. 6-9, for the angular momentum I w) tells the
    torque beside that of the rotors, the estimator the force. Less what is usual they are compared,
    as (f_z, t / arm), with each rotor's column of the allocation.
    """

    watches = "external wrench as observed, compared with the loss of each rotor's thrust"
    unit = ""
    source = "a propeller that lost a blade tip keeps 70 %; gains differ by 2 % between rotors"
    every = 4

    class Table(Rule.Table):
        """Limit as a share of the thrust."""

        limit: NonNegative = 0.25
        hold_s: NonNegative = 0.4
        response: Response = "come_home"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._torque = [0.0, 0.0, 0.0]  # N m, about the axes of B
        self._predicted: list[float] | None = None  # angular momentum
        self._ticks, self._loss = 0, 0.0
        self._usual = Follow(USUAL_S)
        self._t = 0.0
        self.rotor = 0

    def begin(self, v: Senses) -> None:
        rotors = v.vehicle.rotors
        self._arm = float(np.max(np.linalg.norm(rotors.position[:, :2], axis=1)))
        columns = -np.vstack([rotors.B[2], rotors.B[3:] / self._arm]).T  # (n, 4)
        self._lengths = np.linalg.norm(columns, axis=1)
        self._columns = columns / self._lengths[:, None]

    def look(self, v: Senses) -> float:
        from skywright.vehicle.bus import Allocated, Body

        body, made = v.get(Body), v.get(Allocated)
        if v.reference["active"] < 0.5 or v.touching:
            self._predicted = None
            return float("nan")
        est = v.estimate
        R, w, weight = est["R_WB"].tolist(), est["w_WB_B"].tolist(), body.mass * body.gravity
        momentum = [sum(map(mul, row, w)) for row in body.I_B.tolist()]
        dt, self._t = v.t - self._t, v.t
        if self._predicted is None:
            self._predicted, self._torque, self._ticks = momentum, [0.0, 0.0, 0.0], 0
            return float("nan")
        hang = cross(R[2], body.p_BC.tolist())  # of the weight, -weight R[2] at p_BC
        turn = cross(w, momentum)
        for a, made_t in enumerate(made.t_B_alloc.tolist()):
            known = made_t + weight * hang[a] - turn[a]
            self._predicted[a] += dt * (known + self._torque[a])
            self._torque[a] = BANDWIDTH * (momentum[a] - self._predicted[a])
        self._ticks += 1
        if self._ticks % COMPARED_EVERY:
            return self._loss
        f_z = float((est["R_WB"].T @ est["f_ext_W"])[2])
        seen = np.array([f_z, *(t / self._arm for t in self._torque)])
        off = seen - self._usual.step(v.t, seen)
        along = self._columns @ off
        losses = np.where(along > ALIKE * math.hypot(*off.tolist()), along / self._lengths, 0.0)
        self._loss = max(float(np.max(losses)) / (weight / len(losses)), 0.0)
        self.rotor = int(np.argmax(losses)) + 1
        return self._loss

    def explain(self, value: float) -> str:
        """Say which rotor."""
        return f"rotor {self.rotor} lacks {100 * value:.0f} % of its thrust"
