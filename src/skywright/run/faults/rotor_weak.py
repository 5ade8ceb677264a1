"""A rotor that makes less thrust than it is told."""

from __future__ import annotations

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


class RotorWeak(Rule):
    """Share of a rotor's thrust whose loss explains the wrench that is observed.

    A momentum observer (De Luca and Mattone 2005, eq. 6-9, for the angular momentum I w) tells the
    torque beside that of the rotors, the estimator the force. Less what is usual they are compared,
    as (f_z, t / arm), with each rotor's column of the allocation.
    """

    watches = "external wrench as observed, compared with the loss of each rotor's thrust"
    unit = ""
    source = "a propeller that lost a blade tip keeps 70 %; gains differ by 2 % between rotors"

    class Table(Rule.Table):
        """Limit as a share of the thrust."""

        limit: float = 0.25
        hold_s: NonNegative = 0.4
        response: Response = "come_home"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._torque: Any = np.zeros(3)
        self._predicted: Any = None
        self._usual = Follow(USUAL_S)
        self._t = 0.0
        self.rotor = 0

    def look(self, v: Senses) -> float:
        from skywright.vehicle.bus import Allocated, Body

        body, made, rotors = v.get(Body), v.get(Allocated), v.vehicle.rotors
        if v.reference["active"] < 0.5 or v.touching:
            self._predicted = None
            return float("nan")
        est = v.estimate
        R, w = est["R_WB"], est["w_WB_B"]
        weight_B = -body.mass * body.gravity * R[2]
        momentum = body.I_B @ w
        dt, self._t = v.t - self._t, v.t
        if self._predicted is None:
            self._predicted, self._torque = momentum, np.zeros(3)
            return float("nan")
        known = made.t_B_alloc + np.cross(body.p_BC, weight_B) - np.cross(w, momentum)
        self._predicted = self._predicted + dt * (known + self._torque)
        self._torque = BANDWIDTH * (momentum - self._predicted)
        f_z = float((R.T @ est["f_ext_W"])[2])
        arm = float(np.max(np.linalg.norm(rotors.position[:, :2], axis=1)))
        seen = np.array([f_z, *(self._torque / arm)])
        off = seen - self._usual.step(v.t, seen)
        loss, size = 0.0, float(np.linalg.norm(off))
        thrust = body.mass * body.gravity / len(rotors.axis)
        for i in range(len(rotors.axis)):
            column = -np.array([rotors.B[2, i], *(rotors.B[3:, i] / arm)])
            length = float(np.linalg.norm(column))
            along = float(off @ column) / length
            if along > ALIKE * size and along / (length * thrust) > loss:
                loss, self.rotor = along / (length * thrust), i + 1
        return loss

    def explain(self, value: float) -> str:
        """Say which rotor."""
        return f"rotor {self.rotor} lacks {100 * value:.0f} % of its thrust"
