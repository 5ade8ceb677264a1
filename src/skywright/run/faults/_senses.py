"""Interface of rules to the vehicle: data that the robot itself has, updated every mission tick."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import find_place
from skywright.core.types import TASK_FORCE, TASK_FORCE_POSITION, TASK_JOINTS, TASK_SQUEEZE
from skywright.description.mission.safety import Fence
from skywright.errors import InputError
from skywright.vehicle.arms.ports import ArmModel, HandForce, Hands
from skywright.vehicle.bus import Estimate
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.interface import Backend

Array = NDArray[np.float64]
PRESSING = (TASK_FORCE, TASK_FORCE_POSITION, TASK_SQUEEZE)
FELT_N = 0.5
"""N, at a hand: above it, the hand is in contact."""


class Senses:
    """State of the vehicle. Records belong to the vehicle: copy the values that must be kept."""

    def __init__(
        self, vehicle: Backend, fence: Fence | None = None, noise_sigmas: float = 3.0
    ) -> None:
        self.vehicle, self.fence = vehicle, Fence() if fence is None else fence
        self.noise_sigmas = noise_sigmas
        self.reference: Any = vehicle.reference_now  # the REFERENCE row that is tracked
        self.t = vehicle.t  # s, mission time
        self._records: dict[Any, Any] = {}
        self._told: dict[str, Any] = {}
        self._heard = self.place(EstimatorState, "heard")
        self._forces: Any = None
        self._touching: bool | None = None
        self.failure = ""  # of the robot's computer
        self.restarts = False  # the failed step is restarted
        self.room: Callable[[], float] | None = None  # m, beyond the clearance of the mission
        self.reset()

    def reset(self) -> None:
        """Forget the responses of the last flight; a failure of the computer remains."""
        self.responding = False  # a rule has acted
        self.carrying = False  # whether a load was carried when a rule acted
        self.stuck: set[int] = set()  # joints, from 0, that do not follow
        self.posture: Array | None = None  # rad, joints commanded from the last valid estimate
        self.left: Array | None = None  # unit vector away from the object touched when a rule acted
        self.doubt = np.zeros(3)  # m in W, from the estimate to another possible position

    def refresh(self) -> None:
        """Called after each tick."""
        self._touching, self.t = None, self.vehicle.t

    def get(self, record: type[Any]) -> Any:
        """Return a record of the robot's side, or None if no component fills it."""
        if record not in self._records:
            try:
                self._records[record] = self.vehicle.look(record)
            except InputError:
                self._records[record] = None
        return self._records[record]

    def place(self, record: type[Any], name: str) -> Any:
        """Return a reference to one array of a record, to be stored; None if no component fills it.

        `place.tolist()` returns its present numbers, in a tenth of the time of `get` and NumPy.
        """
        found = self.get(record)
        return None if found is None else find_place(found, name)

    def told(self, name: str) -> Any:
        """Return the present value or values of a field of the reference."""
        read = self._told.get(name)
        if read is None:
            reference = self.reference  # not self: a cycle would keep the memory of a flight
            place = reference.place(name)
            read = (
                place.tolist if place is not None else lambda: np.asarray(reference[name]).tolist()
            )
            self._told[name] = read
        return read()

    def explain_noise(self) -> str:
        """Return a message if the gyroscope's noise drives the rotors to their limits, else "".

        It takes some 0.1 s: call it once.
        """
        from skywright.run.gyro_limit import explain_noise

        return explain_noise(self.vehicle, self.noise_sigmas)

    @property
    def order(self) -> str:
        """The order of an operator on the ground: "abort", "land", or "" (none)."""
        return str(getattr(self.vehicle, "order", ""))

    @property
    def fix_age(self) -> float:
        """Time (s) since the estimator received its last position fix."""
        if self._heard is None:
            return self.vehicle.fix_age
        return float(self.t - self._heard.tolist())

    @property
    def estimate(self) -> Any:
        """The present ESTIMATE."""
        return self.get(Estimate)

    @cached_property
    def hands(self) -> int:
        """Number of hands whose force is estimated."""
        arm = self.get(ArmModel)
        return 0 if arm is None or self.get(HandForce) is None else int(arm.n_hands)

    @property
    def touching(self) -> bool:
        """Whether the reference commands contact, or contact is measured."""
        if self._touching is None:
            self._touching = self._find_touching()
        return self._touching

    @property
    def means_to_touch(self) -> bool:
        """Whether the reference commands contact."""
        told = self.told
        if told("press") > 0.0 or told("dead_zone") > 0.0 or told("docked") > 0.0:
            return True
        if max(told("load")) > 0.0:
            return True
        return any(task in PRESSING for task in told("task")[: self.hands])

    def _find_touching(self) -> bool:
        if self.means_to_touch or self.vehicle.in_contact():
            return True
        return any(force > FELT_N for force in self.list_forces())

    def list_forces(self) -> list[float]:
        """Return the estimated force (N) of each hand."""
        return [math.hypot(*f_W) for f_W in self.list_vectors()]

    def list_vectors(self) -> list[list[float]]:
        """Return the estimated force (3,) N in W that each hand exerts."""
        if self._forces is None:
            self._forces = self.place(HandForce, "f_WH") if self.hands else []
        return list(self._forces.tolist()[: self.hands]) if self._forces else []

    @property
    def engaged(self) -> bool:
        """Whether the robot is in contact or its hands are commanded in task space."""
        return self.touching or self.leads_hands

    @property
    def leads_hands(self) -> bool:
        """Whether hands are commanded in task space (not as joint angles)."""
        return any(t != TASK_JOINTS for t in self.told("task")[: self.hands])

    def find_pressed(self) -> Array | None:
        """Return the unit vector (3,) in W in which hands press; None if they carry or do not.

        The commanded direction where a force is commanded, otherwise the estimated one. A hand
        below the platform may press up. An arm with a stuck joint measures its own swinging, so its
        estimate is not used.
        """
        if max(self.told("load")) > 0.0:
            return None
        ref, felt = self.reference, np.sum(self.list_vectors(), axis=0)
        asked = [ref["f_WH"][h] for h in range(self.hands) if ref["task"][h] in PRESSING]
        commanded = np.sum(asked, axis=0) if asked else np.zeros(3)
        for force in (commanded,) if self.stuck else (commanded, felt):
            size = float(np.linalg.norm(force))
            if size > FELT_N:
                return np.asarray(force / size)
        return None

    @property
    def away(self) -> Array:
        """Unit vector (3,) in W away from the touched object."""
        ref, est = self.reference, self.estimate
        if ref["dead_zone"] > 0.0:
            return np.array(ref["R_WS"][:, 2])
        if ref["press"] > 0.0 or ref["docked"] > 0.0 or self.vehicle.in_contact():
            return -np.array(est["R_WT"][:, 2])
        pressed = self.find_pressed() if self.hands else None
        if pressed is not None:
            return -pressed
        if self.hands:
            back = est["p_WB"] - np.mean(self.get(Hands).p_WH[: self.hands], axis=0)
            return np.asarray(back / max(float(np.linalg.norm(back)), 1e-6))
        return -np.array(est["R_WB"][:, 0])
