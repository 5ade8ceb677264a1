"""The kinematic back end: the robot has the pose of its reference, without mass or contact.

Sensors, estimator, law and plant are built as for a flight, so that records and recordings have the
same names. Only the steps that follow references, observe and record run. The estimate is the
truth. The ground limits the height of the platform; there are no other contacts.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.record import fill
from skywright.core.rotations import rot_to_quat
from skywright.description.world.thing import Fixture
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.models.rigid_body import compute_tip
from skywright.vehicle.bus import Body, Clock, Estimate, Reference, Truth
from skywright.vehicle.devices import Devices
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.interface import R, Ticked
from skywright.vehicle.ports import FILL
from skywright.vehicle.readings import ImuBatch, Telemetry
from skywright.vehicle.schedule import end_control, is_due, run_rows
from skywright.vehicle.setpoints import Actuators
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.ticker import list_stretches

Array = NDArray[np.float64]

OFFERS = frozenset({"uav", "arms", "whole_body"})
"""Offers of this back end: without contacts, forces of hands, and the signal of a probe."""
KEPT = (Body, Estimate, EstimatorState, Reference, ImuBatch, Telemetry)
"""Records that can be read. Those of sensors, laws and observers are not filled."""
SLOTS = ("observe", "derive", "record")
"""Slots of the plant's side that run, in addition to the slot `reference`."""


class KinematicVehicle(SimulatedVehicle):
    """A back end (vehicle.interface.Backend) that moves the robot along its references."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take the same arguments as SimulatedVehicle."""
        super().__init__(*args, **kwargs)
        self.offers = self.offers & OFFERS
        a = self.assembly
        told = [i for i, s in enumerate(a.steps) if s.slot == "reference"]
        seen = [i for i, s in enumerate(a.steps) if s.slot in SLOTS and s.component.side == "plant"]
        body = [
            i for i, s in enumerate(a.steps)
            if any(port.record is Body and port.use == FILL for port in s.ports)
        ]  # fmt: skip
        self._after_move = [*body, *seen]
        self._told, self._seen = _list_runs(told), _list_runs(sorted(self._after_move))
        self._python = set(a.list_python_rows())
        self._clock, self._ref, self._truth = a.get(Clock), a.get(Reference), a.get(Truth)
        self._est, self._state = a.get(Estimate), a.get(EstimatorState)
        self._imu = a.records.get((ImuBatch, ""))
        self._state["ready"], self._state["pose_std"] = 1.0, math.nan
        self._gauge: Any = None
        if (Telemetry, "") in a.records:
            self._gauge = a.get(Telemetry)
            self._gauge["charge"] = self._gauge["speed"] = math.nan  # no rotors, no power
        self._bench = find_first(self.world.things, Fixture)
        self._floor = self.robot.platform.gear_height_m
        self._posture, self._tip = b"", (np.zeros(3), np.eye(3))  # joints, and the tip in B at them

    def run_also(self, rows: list[int]) -> None:
        """Also run further rows of the schedule, such as those of a law."""
        self._seen = _list_runs(sorted({*self._after_move, *rows}))

    def look(self, record: type[R], name: str = "") -> R:
        """Return a record of KEPT itself; raise InputError for any other record."""
        if record not in KEPT:
            raise InputError(f"the back end fills no {record.__name__}")
        return super().look(record, name)

    @property
    def actuators(self) -> Actuators:
        """No actuators."""
        return Actuators({}, "none, the back end moves no actuators")

    @property
    def devices(self) -> Devices:
        """No devices."""
        return Devices(self, frozenset())

    def release(self) -> None:
        """Open the clamp, so that the platform follows its reference."""
        super().release()
        self._bench = None

    @property
    def saturated(self) -> bool:
        """Always False."""
        return False

    def tick(self, guards: int = 0) -> Ticked:
        """Move the robot along its reference for one mission tick; guards never fire."""
        a, clock = self.assembly, self._clock
        a.refill(self.n_ticks, self.n_steps)
        at, clock_at = int(a.rows.ctypes.data), a.address(Clock)
        for _ in range(self.n_ticks):
            self._run(self._told, at, clock_at)
            self._move()
            self._run(self._seen, at, clock_at)
            end_control(clock_at)
            clock["fast"] += self.n_steps
        if self._recorder.is_full or any(c.is_full for c in self._raw):
            self.flush()
        return Ticked(self.t, 0, self.t - self._table_start >= self._table_end - 1e-9)

    def _run(self, runs: list[tuple[int, int]], at: int, clock_at: int) -> None:
        for first, last in runs:
            for i, j in list_stretches(first, last, sorted(self._python)):
                row = self.assembly.rows[i]
                if j >= 0:
                    run_rows(at, i, j, clock_at)
                elif is_due(int(self._clock["tick"]), row["every"], row["calls"], row["phase"]):
                    self.assembly.run_python(i)

    def _move(self) -> None:
        """Move to the pose of the reference, on or above the ground."""
        ref, d = self._ref, self.sim.data
        if self._bench is not None:
            self._show(d.qpos[:3].copy(), d.qvel[:3].copy(), ref["R_WB"], d.qvel[3:6].copy(), False)
            return
        p, v = np.array(ref["p_WB"]), np.array(ref["v_WB"])
        if p[2] <= self._floor:
            p[2], v[2] = self._floor, max(v[2], 0.0)
        self._show(p, v, ref["R_WB"], ref["w_WB_B"])

    def _show(self, p: Array, v: Array, R: Array, w: Array, moves: bool = True) -> None:
        """Set the state of the robot: p (3,) m, v (3,) m/s, R (3, 3), w (3,) rad/s in B.

        The joints follow their reference; truth and estimate are updated. With `moves` False the
        bench holds the platform.
        """
        ref, truth, est, d = self._ref, self._truth, self._est, self.sim.data
        if moves:
            d.qpos[:3], d.qvel[:3], d.qvel[3:6] = p, v, w
            rot_to_quat(np.ascontiguousarray(R), d.qpos[3:7])
        places, n = self.scene.places, self.n_joints
        d.qpos[places.joint_qpos], d.qvel[places.joint_dof] = ref["q"][:n], ref["qd"][:n]
        d.actuator_force[:] = 0.0  # else the forces of the scene's start remain
        mujoco.mj_kinematics(self.scene.model, d)
        fill(est, truth)
        est["t"] = self._state["heard"] = self.t
        if self._imu is not None:
            self._imu["t"][0] = self.t  # the link counts as alive
        est["p_WB"], est["v_WB"], est["w_WB_B"] = p, v, w
        est["R_WB"] = R
        est["q"], est["qd"] = ref["q"], ref["qd"]
        if (q := est["q"].tobytes()) != self._posture:  # the arms are mostly at rest
            self._posture, self._tip = q, compute_tip(self.model, est["q"])
        p_BT, R_BT = self._tip
        est["p_WT"], est["R_WT"] = est["p_WB"] + est["R_WB"] @ p_BT, est["R_WB"] @ R_BT


def _list_runs(rows: list[int]) -> list[tuple[int, int]]:
    """Return consecutive row numbers as ranges (first, last + 1)."""
    out: list[tuple[int, int]] = []
    for i in rows:
        if out and out[-1][1] == i:
            out[-1] = (out[-1][0], i + 1)
        else:
            out.append((i, i + 1))
    return out
