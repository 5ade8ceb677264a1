"""What rules may ask of a vehicle: what the robot itself knows, once a mission tick."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.types import TASK_FORCE, TASK_FORCE_POSITION, TASK_JOINTS, TASK_SQUEEZE
from skywright.errors import InputError
from skywright.vehicle.arms.ports import ArmModel, HandForce, Hands
from skywright.vehicle.bus import Estimate
from skywright.vehicle.interface import Backend

Array = NDArray[np.float64]
PRESSING = (TASK_FORCE, TASK_FORCE_POSITION, TASK_SQUEEZE)
FELT_N = 0.5
"""N, at a hand: it touches something."""


class Senses:
    """The vehicle now. Records are those of the vehicle: copy what shall be kept."""

    def __init__(self, vehicle: Backend) -> None:
        self.vehicle = vehicle
        self.reference: Any = vehicle.reference_now  # the REFERENCE row that is tracked
        self._records: dict[Any, Any] = {}
        self._touching: bool | None = None
        self.responding = False  # a rule has acted
        self.failure = ""  # of the robot's computer

    def refresh(self) -> None:
        """A tick has passed."""
        self._touching = None

    @property
    def t(self) -> float:
        """Mission time (s)."""
        return self.vehicle.t

    def get(self, record: type[Any]) -> Any:
        """Return a record of the robot's side, or None where nothing fills it."""
        if record not in self._records:
            try:
                self._records[record] = self.vehicle.look(record)
            except InputError:
                self._records[record] = None
        return self._records[record]

    @property
    def estimate(self) -> Any:
        """The ESTIMATE now."""
        return self.get(Estimate)

    @property
    def hands(self) -> int:
        """Number of hands whose force is felt."""
        arm = self.get(ArmModel)
        return 0 if arm is None or self.get(HandForce) is None else int(arm.n_hands)

    @property
    def touching(self) -> bool:
        """Whether the mission means to touch, or the robot feels that it does."""
        if self._touching is None:
            self._touching = self._find_touching()
        return self._touching

    @property
    def means_to_touch(self) -> bool:
        """Whether the mission means to touch."""
        ref = self.reference
        if ref["press"] > 0.0 or ref["dead_zone"] > 0.0 or ref["docked"] > 0.0:
            return True
        if max(ref["load"].tolist()) > 0.0:
            return True
        return any(task in PRESSING for task in ref["task"].tolist()[: self.hands])

    def _find_touching(self) -> bool:
        if self.means_to_touch or self.vehicle.in_contact():
            return True
        n = self.hands
        return n > 0 and any(
            math.hypot(*f_W) > FELT_N for f_W in self.get(HandForce).f_WH[:n].tolist()
        )

    @property
    def engaged(self) -> bool:
        """Whether hands are led to something, or the robot touches: it is near a structure."""
        n = self.hands
        return self.touching or bool(n and np.any(self.reference["task"][:n] != TASK_JOINTS))

    @property
    def away(self) -> Array:
        """Unit vector (3,) in W that leads away from what is touched."""
        ref, est = self.reference, self.estimate
        if ref["dead_zone"] > 0.0:
            return np.array(ref["R_WS"][:, 2])
        if ref["press"] > 0.0 or ref["docked"] > 0.0 or self.vehicle.in_contact():
            return -np.array(est["R_WT"][:, 2])
        if self.hands:
            back = est["p_WB"] - np.mean(self.get(Hands).p_WH[: self.hands], axis=0)
            return np.asarray(back / max(float(np.linalg.norm(back)), 1e-6))
        return -np.array(est["R_WB"][:, 0])
