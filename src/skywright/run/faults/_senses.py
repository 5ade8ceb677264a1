"""What rules may ask of a vehicle: what the robot itself knows, once a mission tick."""

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
"""N, at a hand: it touches something."""


class Senses:
    """The vehicle now. Records are those of the vehicle: copy what shall be kept."""

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
        self.responding = False  # a rule has acted
        self.failure = ""  # of the robot's computer
        self.restarts = False  # what failed is started again
        self.carrying = False  # when a rule acted
        self.stuck: set[int] = set()  # joints, from 0, that do not follow
        self.posture: Array | None = None  # rad, where a sound estimate led the joints last
        self.left: Array | None = None  # unit vector from what was touched when a rule acted
        self.room: Callable[[], float] | None = None  # m, beyond what a mission keeps clear now
        self.doubt = np.zeros(3)  # m in W, from the estimate to where the robot may be as well

    def refresh(self) -> None:
        """A tick has passed."""
        self._touching, self.t = None, self.vehicle.t

    def get(self, record: type[Any]) -> Any:
        """Return a record of the robot's side, or None where nothing fills it."""
        if record not in self._records:
            try:
                self._records[record] = self.vehicle.look(record)
            except InputError:
                self._records[record] = None
        return self._records[record]

    def place(self, record: type[Any], name: str) -> Any:
        """Return where an array of a record stands, to be kept; None where nothing fills it.

        `place.tolist()` gives its numbers now, in a tenth of the time that `get` and NumPy take.
        """
        found = self.get(record)
        return None if found is None else find_place(found, name)

    def told(self, name: str) -> Any:
        """Return the number or numbers that the reference has in a field now."""
        read = self._told.get(name)
        if read is None:
            reference = self.reference  # not self: a cycle would keep a flight's memory for long
            place = reference.place(name)
            read = place.tolist if place else lambda: np.asarray(reference[name]).tolist()
            self._told[name] = read
        return read()

    def explain_noise(self) -> str:
        """Say that the gyroscope's noise drives the rotors to their limits; "" where it does not.

        It takes some 0.1 s: for what is told once.
        """
        from skywright.run.gyro_limit import explain_noise

        return explain_noise(self.vehicle, self.noise_sigmas)

    @property
    def order(self) -> str:
        """What an operator on the ground has ordered: "abort", "land", or "" (nothing)."""
        return str(getattr(self.vehicle, "order", ""))

    @property
    def fix_age(self) -> float:
        """Time (s) since the robot was last told where it is."""
        if self._heard is None:
            return self.vehicle.fix_age
        return float(self.t - self._heard.tolist())

    @property
    def estimate(self) -> Any:
        """The ESTIMATE now."""
        return self.get(Estimate)

    @cached_property
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
        """Return the force (N) that each hand feels."""
        return [math.hypot(*f_W) for f_W in self.list_vectors()]

    def list_vectors(self) -> list[list[float]]:
        """Return the force (3,) N in W that each hand is felt to exert."""
        if self._forces is None:
            self._forces = self.place(HandForce, "f_WH") if self.hands else []
        return list(self._forces.tolist()[: self.hands]) if self._forces else []

    @property
    def engaged(self) -> bool:
        """Whether hands are led to something, or the robot touches: it is near a structure."""
        return self.touching or self.leads_hands

    @property
    def leads_hands(self) -> bool:
        """Whether hands are led to something."""
        return any(t != TASK_JOINTS for t in self.told("task")[: self.hands])

    def find_pressed(self) -> Array | None:
        """Return where hands press, unit (3,) in W; None where they press nothing or carry.

        As commanded where a force is, otherwise as felt. A hand below the platform may press up.
        An arm with a joint that does not follow feels its own swinging.
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
        """Unit vector (3,) in W that leads away from what is touched."""
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
