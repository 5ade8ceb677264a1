"""The recording back end: plays a run through a vehicle's interface; commands are refused."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import View
from skywright.core.rotations import quat_to_rot
from skywright.core.types import REFERENCE
from skywright.errors import InputError
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_tip, joint_names
from skywright.vehicle.bus import Estimate
from skywright.vehicle.commands import State
from skywright.vehicle.devices import Devices
from skywright.vehicle.interface import R, Ticked, build_limits
from skywright.vehicle.link_arc import compute_link_arc
from skywright.vehicle.pilot_switch import NoPilotSwitch
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.setpoints import Actuators

Array = NDArray[np.float64]

STATES = {"start": State.LANDED_DISARMED, "take_off": State.TAKING_OFF, "land": State.LANDING}
"""State by name of the phase; in all other phases the vehicle flies."""


class Phase(NamedTuple):
    """A phase of the run that is played."""

    name: str
    start_s: float
    end_s: float


class RecordedVehicle(NoPilotSwitch):
    """A back end (vehicle.interface.Backend) that plays samples of a run."""

    offers: frozenset[str] = frozenset()
    refuses = "the back end plays a recording"

    def __init__(self, nominal: Nominal, samples: NDArray[Any], phases: list[Phase]) -> None:
        """`samples` (n,) are those of a run; raises InputError if there are none."""
        if not len(samples):
            raise InputError("the recording has no samples")
        self.robot, self.world = nominal.robot, nominal.world
        self.model, self.rotors = nominal.model, nominal.rotors
        self.n_joints = len(joint_names(nominal.robot))
        self.limits = build_limits(nominal.robot)
        self.arc = compute_link_arc(self.robot, self.model)
        self._samples, self._phases, self._i = samples, phases, 0
        self._estimate = np.zeros(1, Estimate.dtype)

    @property
    def actuators(self) -> Actuators:
        """Empty: a recording has no actuators."""
        return Actuators({}, f"none, {self.refuses}")

    @property
    def devices(self) -> Devices:
        """Empty: a recording has no devices."""
        return Devices(self, frozenset(), self.refuses)

    @property
    def t(self) -> float:
        """Mission time (s) of the present sample."""
        return float(self._samples["t"][self._i])

    @property
    def has_ended(self) -> bool:
        """Whether the present sample is the last."""
        return self._i == len(self._samples) - 1

    @property
    def phase(self) -> str:
        """Name of the present phase, "" between phases."""
        names = [p.name for p in self._phases if p.start_s <= self.t < p.end_s]
        return names[-1] if names else ""

    @property
    def state(self) -> State:
        """State of the vehicle in the phase of the present sample."""
        if not self.phase:
            return State.LANDED_DISARMED
        return STATES.get(self.phase, State.FLYING_AUTO)

    def tick(self, guards: int = 0) -> Ticked:
        """Advance by a mission tick (20 ms), up to the last sample."""
        t = self._samples["t"]
        after = int(np.searchsorted(t, self.t + MISSION_TICK - 1e-6))
        self._i = min(after, len(t) - 1)
        return Ticked(self.t, 0, self.has_ended)

    @property
    def reference(self) -> Any:
        """The REFERENCE row of the sample; fields that were not recorded are zero."""
        s, row = self._samples[self._i], np.zeros(1, REFERENCE)[0]
        row["p_WB"], row["R_WB"] = s["ref_p_WB"], _rotate(s["ref_q_WB"])
        row["p_WT"], row["R_WT"] = s["ref_p_WT"], _rotate(s["ref_q_WT"])
        row["q"][: self.n_joints] = s["ref_q"][: self.n_joints]
        row["R_WS"] = np.eye(3)
        row["active"] = float(self.state not in (State.LANDED_DISARMED, State.UNINITIALIZED))
        return row

    @property
    def tracking(self) -> tuple[NDArray[Any], float]:
        """The row of the sample and time 0, because a recording has no table."""
        return self.reference[None], 0.0

    @property
    def reference_now(self) -> Any:
        """As `reference`."""
        return self.reference

    @property
    def estimate(self) -> Any:
        """The Estimate of the sample; fields that were not recorded are zero."""
        s, est = self._samples[self._i], self._estimate[0]
        est["t"], est["p_WB"], est["v_WB"] = s["t"], s["est_p_WB"], s["est_v_WB"]
        est["R_WB"], est["w_WB_B"] = _rotate(s["est_q_WB"]), s["est_w_WB_B"]
        est["p_WT"], est["f_ext_W"] = s["est_p_WT"], s["est_f_ext_W"]
        if self.n_joints:
            est["q"][: self.n_joints] = s["q"][: self.n_joints]
            est["qd"][: self.n_joints] = s["qd"][: self.n_joints]
            est["R_WT"] = est["R_WB"] @ compute_tip(self.model, est["q"])[1]
        return View(est)

    def look(self, record: type[R]) -> R:
        """Return the Estimate; raises InputError for every other record."""
        if record is not Estimate:
            raise InputError(f"a recording has no {record.__name__}")
        return cast(R, self.estimate)

    def read(self, record: type[R], name: str = "") -> R:
        """Return the Estimate; raises InputError for every other record."""
        return cast(R, View(cast(View, self.look(record)).copy()))

    localised, saturated, fix_age, force, pose_std = True, False, 0.0, 0.0, math.nan

    def in_contact(self) -> bool:
        """Always False: not recorded."""
        return False

    def tip_of(self, row: Any) -> tuple[Array, Array]:
        """Nominal (p_WT, R_WT) of a row's platform pose and joints."""
        p_BT, R_BT = compute_tip(self.model, row["q"])
        return row["p_WB"] + row["R_WB"] @ p_BT, row["R_WB"] @ R_BT

    def _refuse(self, *_: Any, **__: Any) -> Any:
        """Raise InputError: a recording cannot be commanded."""
        raise InputError(self.refuses)

    track: Any = _refuse
    give_up_rotor = stop_computer = release = set_stick = calibrate_probe = track


def _rotate(q: Array) -> Array:
    R = np.empty((3, 3))
    quat_to_rot(np.ascontiguousarray(q, dtype=float), R)
    return R
