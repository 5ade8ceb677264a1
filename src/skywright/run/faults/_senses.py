"""What rules may ask of a vehicle: what the robot itself knows, once a mission tick."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.types import TASK_FORCE, TASK_FORCE_POSITION, TASK_JOINTS, TASK_SQUEEZE
from skywright.errors import InputError
from skywright.vehicle.arms.ports import ArmModel, HandForce, Hands
from skywright.vehicle.interface import Backend

Array = NDArray[np.float64]
PRESSING = (TASK_FORCE, TASK_FORCE_POSITION, TASK_SQUEEZE)
FELT_N = 0.5
"""N, at a hand: it touches something."""


class Senses:
    """The vehicle now. Records are copied at most once a tick."""

    def __init__(self, vehicle: Backend) -> None:
        self.vehicle = vehicle
        self._seen: dict[Any, Any] = {}
        self._absent: set[Any] = set()
        self.responding = False  # a rule has acted
        self.failure = ""  # of the robot's computer

    def refresh(self) -> None:
        """A tick has passed."""
        self._seen.clear()

    @property
    def t(self) -> float:
        """Mission time (s)."""
        return self.vehicle.t

    def get(self, record: type[Any]) -> Any:
        """Return a record of the robot's side, or None where nothing fills it."""
        if record in self._absent:
            return None
        if record not in self._seen:
            try:
                self._seen[record] = self.vehicle.read(record)
            except InputError:
                self._absent.add(record)
                return None
        return self._seen[record]

    @property
    def reference(self) -> Any:
        """The REFERENCE row that is tracked now."""
        return self._once("reference")

    @property
    def estimate(self) -> Any:
        """The ESTIMATE now."""
        return self._once("estimate")

    def _once(self, name: str) -> Any:
        if name not in self._seen:
            self._seen[name] = getattr(self.vehicle, name)
        return self._seen[name]

    @property
    def hands(self) -> int:
        """Number of hands whose force is felt."""
        arm = self.get(ArmModel)
        return 0 if arm is None or self.get(HandForce) is None else int(arm.n_hands)

    @property
    def touching(self) -> bool:
        """Whether the mission means to touch, or the robot feels that it does."""
        ref = self.reference
        if ref["press"] > 0.0 or ref["dead_zone"] > 0.0 or ref["docked"] > 0.0:
            return True
        if np.any(ref["load"] > 0.0):
            return True
        n = self.hands
        if n and bool(np.any(np.isin(ref["task"][:n], PRESSING))):
            return True
        felt = n and np.max(np.linalg.norm(self.get(HandForce).f_WH[:n], axis=1)) > FELT_N
        return bool(felt) or self.vehicle.in_contact()

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
