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

from skywright.core.rotations import rot_to_quat
from skywright.description.world.thing import Fixture
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.models.rigid_body import compute_tip
from skywright.vehicle.bus import Body, Clock, Estimate, Reference
from skywright.vehicle.devices import Devices
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.interface import R, Ticked
from skywright.vehicle.ports import FILL
from skywright.vehicle.readings import ImuBatch, Telemetry
from skywright.vehicle.schedule import end_control, is_due, run_rows
from skywright.vehicle.setpoints import Actuators
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.ticker import Stretch, list_stretches

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
        self._told, self._seen = self._list_runs(told), self._list_runs(self._after_move)
        self._clock, self._state = a.get(Clock), a.get(EstimatorState)
        # views of the fields: reading one of a record by its name takes longer
        self._ref, self._est = _view_fields(a.get(Reference)), _view_fields(a.get(Estimate))
        d, places = self.sim.data, self.scene.places
        self._qpos, self._qvel, self._forces = d.qpos, d.qvel, d.actuator_force
        self._joint_qpos, self._joint_dof = places.joint_qpos, places.joint_dof
        self._imu = a.records.get((ImuBatch, ""))
        self._state["ready"], self._state["pose_std"] = 1.0, math.nan
        self._gauge: Any = None
        if (Telemetry, "") in a.records:
            self._gauge = a.get(Telemetry)
            self._gauge["charge"] = self._gauge["speed"] = math.nan  # no rotors, no power
        clamped = find_first(self.world.things, Fixture) is not None
        self._clamp = self.scene.model.equality(Fixture.CLAMP).id if clamped else None
        self._floor = self.robot.platform.gear_height_m
        self._posture, self._tip = b"", (np.zeros(3), np.eye(3))  # joints, and the tip in B at them

    def run_also(self, rows: list[int]) -> None:
        """Also run further rows of the schedule, such as those of a law."""
        self._seen = self._list_runs([*self._after_move, *rows])

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

    def _list_runs(self, rows: list[int]) -> list[Stretch]:
        """Return rows of the schedule as stretches, in their order."""
        slow = self.assembly.list_python_rows()
        runs = _join(sorted(set(rows)))
        return [s for first, last in runs for s in list_stretches(first, last, slow)]

    def _run(self, stretches: list[Stretch], at: int, clock_at: int) -> None:
        for i, j in stretches:
            if j >= 0:
                run_rows(at, i, j, clock_at)
                continue
            row = self.assembly.rows[i]
            if is_due(int(self._clock["tick"]), row["every"], row["calls"], row["phase"]):
                self.assembly.run_python(i)

    def _move(self) -> None:
        """Move to the pose of the reference, on or above the ground."""
        ref, q, qd = self._ref, self._qpos, self._qvel
        # read from the physics, whose state `restore` sets
        if self._clamp is not None and self.sim.data.eq_active[self._clamp]:
            self._show(q[:3].copy(), qd[:3].copy(), ref["R_WB"], qd[3:6].copy(), False)
            return
        p, v = ref["p_WB"].copy(), ref["v_WB"].copy()
        if p[2] <= self._floor:
            p[2], v[2] = self._floor, max(v[2], 0.0)
        self._show(p, v, ref["R_WB"], ref["w_WB_B"])

    def _show(self, p: Array, v: Array, R: Array, w: Array, moves: bool = True) -> None:
        """Set the state of the robot: p (3,) m, v (3,) m/s, R (3, 3), w (3,) rad/s in B.

        The joints follow their reference; the estimate is updated. With `moves` False the bench
        holds the platform.
        """
        ref, est, qpos, qvel, n = self._ref, self._est, self._qpos, self._qvel, self.n_joints
        if moves:
            qpos[:3], qvel[:3], qvel[3:6] = p, v, w
            rot_to_quat(np.ascontiguousarray(R), qpos[3:7])
        qpos[self._joint_qpos], qvel[self._joint_dof] = ref["q"][:n], ref["qd"][:n]
        self._forces[:] = 0.0  # else the forces of the scene's start remain
        mujoco.mj_kinematics(self.scene.model, self.sim.data)
        est["t"][...] = self._state["heard"] = self.t
        if self._imu is not None:
            self._imu["t"][0] = self.t  # the link counts as alive
        est["p_WB"][:], est["v_WB"][:], est["w_WB_B"][:], est["R_WB"][:] = p, v, w, R
        est["q"][:], est["qd"][:] = ref["q"], ref["qd"]
        if (q := est["q"].tobytes()) != self._posture:  # the arms are mostly at rest
            self._posture, self._tip = q, compute_tip(self.model, est["q"])
        p_BT, R_BT = self._tip
        est["p_WT"][:], est["R_WT"][:] = est["p_WB"] + est["R_WB"] @ p_BT, est["R_WB"] @ R_BT


def _view_fields(record: Any) -> dict[str, Any]:
    """Return arrays that are the memory of a record's fields, by their names."""
    row = np.asarray(record)
    return {name: row[name] for name in row.dtype.names or ()}


def _join(rows: list[int]) -> list[tuple[int, int]]:
    """Return consecutive row numbers as ranges (first, last + 1)."""
    out: list[tuple[int, int]] = []
    for i in rows:
        if out and out[-1][1] == i:
            out[-1] = (out[-1][0], i + 1)
        else:
            out.append((i, i + 1))
    return out
