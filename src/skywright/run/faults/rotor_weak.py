"""A rotor that produces less thrust than commanded."""

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
"""rad/s, bandwidth of the observer of the external torque."""
USUAL_S = 5.0
"""s, lag of the baseline: errors of masses and gains."""
ALIKE = 0.85
"""Smallest cosine between the observed wrench and that of one rotor's loss."""
COMPARED_EVERY = 2
"""Evaluations between comparisons with the rotors."""


def cross(a: list[float], b: list[float]) -> list[float]:
    """Return a x b; NumPy takes twenty times as long for three numbers."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class RotorWeak(Rule):
    """Share of a rotor's thrust whose loss explains the observed wrench.

    A momentum observer (De Luca and Mattone 2005, eq. 6-9, for the angular momentum I w) estimates
    the torque in addition to that of the rotors, and the estimator provides the force. Less their
    baseline they are compared, as (f_z, t / arm), with each rotor's column of the allocation.
    """

    watches = "share of a rotor's thrust whose loss explains the observed external wrench"
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
        from skywright.vehicle.bus import Allocated, Body, Estimate

        rotors = v.vehicle.rotors
        self._arm = float(np.max(np.linalg.norm(rotors.position[:, :2], axis=1)))
        columns = -np.vstack([rotors.B[2], rotors.B[3:] / self._arm]).T  # (n, 4)
        lengths = np.linalg.norm(columns, axis=1).tolist()
        self._columns = list(
            zip((columns / np.array(lengths)[:, None]).tolist(), lengths, strict=True)
        )
        self._body = v.get(Body)
        self._places = [
            v.place(*field) for field in (
                (Estimate, "R_WB"), (Estimate, "w_WB_B"), (Estimate, "f_ext_W"), (Body, "I_B"),
                (Body, "p_BC"), (Allocated, "t_B_alloc"),
            )
        ]  # fmt: skip

    def look(self, v: Senses) -> float:
        if v.touching or v.told("active") < 0.5 or None in self._places:
            self._predicted = None
            return math.nan
        R, w, f_ext_W, I_B, p_BC, made = (place.tolist() for place in self._places)
        weight = float(self._body.mass * self._body.gravity)
        momentum = [sum(map(mul, row, w)) for row in I_B]
        dt, self._t = v.t - self._t, v.t
        if self._predicted is None:
            self._predicted, self._torque, self._ticks = momentum, [0.0, 0.0, 0.0], 0
            return math.nan
        hang = cross(R[2], p_BC)  # of the weight, -weight R[2] at p_BC
        turn = cross(w, momentum)
        for a in range(3):
            known = made[a] + weight * hang[a] - turn[a]
            self._predicted[a] += dt * (known + self._torque[a])
            self._torque[a] = BANDWIDTH * (momentum[a] - self._predicted[a])
        self._ticks += 1
        if self._ticks % COMPARED_EVERY == 0:
            f_z = sum(R[i][2] * f_ext_W[i] for i in range(3))
            self._compare([f_z, *(t / self._arm for t in self._torque)], v.t, weight)
        return self._loss

    def _compare(self, seen: list[float], t: float, weight: float) -> None:
        """Compare the observed values, less their baseline, with the loss of each rotor."""
        off = [s - u for s, u in zip(seen, self._usual.step(t, seen), strict=True)]
        least, self._loss = ALIKE * math.hypot(*off), 0.0
        for i, (column, length) in enumerate(self._columns):
            along = sum(map(mul, column, off))
            loss = along / length * len(self._columns) / weight
            if along > least and loss > self._loss:
                self._loss, self.rotor = loss, i + 1

    def explain(self, value: float) -> str:
        """State which rotor."""
        return f"rotor {self.rotor} lacks {100 * value:.0f} % of its thrust"
