"""Stepping of a single component, a law or an estimator, with inputs that the caller sets."""

from __future__ import annotations

import math
import reprlib
from typing import Any

import numpy as np

from skywright.core.record import Record, View, fill
from skywright.core.rotations import log_so3
from skywright.errors import InputError, SimulationError
from skywright.models.rigid_body import compute_tip
from skywright.recordings.period import compute_period
from skywright.vehicle.bus import Allocated, Clock, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Component, Draws
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.failed_line import find_line
from skywright.vehicle.native import read_error
from skywright.vehicle.own_data import Innovations, check_record, check_units
from skywright.vehicle.ports import READ
from skywright.vehicle.readings import Fix, ImuBatch, MocapSample, Odometry
from skywright.vehicle.schedule import end_control, run_rows
from skywright.vehicle.simulated import SimulatedVehicle

Array = np.ndarray[Any, np.dtype[np.float64]]

ESTIMATES = np.dtype(
    [
        ("t", "<f8"), ("p_WB", "<f8", 3), ("v_WB", "<f8", 3), ("R_WB", "<f8", (3, 3)),
        ("w_WB_B", "<f8", 3), ("p_std", "<f8", 3), ("ready", "?"),
    ]
)  # fmt: skip
"""One row of the result of `run_estimator`."""
ESTIMATED = ("p_WB", "v_WB", "R_WB", "w_WB_B")


class Stepped:
    """Runs some rows of a vehicle's schedule without the rest of the vehicle."""

    def __init__(self, vehicle: SimulatedVehicle, components: list[Component]) -> None:
        self.vehicle, self.assembly = vehicle, vehicle.assembly
        a = self.assembly
        mine = [i for i, step in enumerate(a.steps) if step.component in components]
        model = [
            i for i, step in enumerate(a.steps)
            if step.slot == "body" and step.component.side == "robot" and i not in mine
            and not any(p.record is Estimate and p.use != READ for p in step.ports)
        ]  # fmt: skip
        self.rows = [*model, *mine]
        self.ports: dict[str, Any] = {}
        """The records that the steps read and fill, by the names of the steps' parameters."""
        for i in mine:
            for port in a.steps[i].ports:
                key = None if issubclass(port.record, Draws) else a.resolve(a.steps[i], port)
                if key is not None:
                    self.ports[port.name] = View(a.records[key][0])
        self._clock = a.get(Clock)

    def run(self) -> None:
        """Run the due rows and advance the clock; raises SimulationError if a step raises."""
        a, clock = self.assembly, self._clock
        at, clock_at = int(a.rows.ctypes.data), a.address(Clock)
        a.refill(1, self.vehicle.n_steps)
        for i in self.rows:
            if a.rows["function"][i] == 0:
                a.run_python(i)
            elif run_rows(at, i, i + 1, clock_at):
                error, place = read_error(int(clock["error"]))
                clock["error"] = 0
                place = place or find_line(a, i, error)
                where = f" ({place})" if place else ""
                raise SimulationError(f"component {a.steps[i].label} raised: {error!r}{where}")
        end_control(clock_at)

    def find(self, record: type[Record]) -> Any:
        """Return the record of a class that the steps read or fill, or None."""
        for view in self.ports.values():
            if view.dtype == record.dtype:
                return view
        return None


class InputView(View):
    """A record that a caller fills: a value of a wrong type or shape raises InputError."""

    __slots__ = ("_label",)

    def __init__(self, row: Any, label: str) -> None:
        super().__init__(row)
        object.__setattr__(self, "_label", label)

    def __setattr__(self, name: str, value: Any) -> None:
        try:
            super().__setattr__(name, value)
        except ValueError:
            shape = self.dtype[name].shape
            wanted = f"an array of numbers of the shape {shape}" if shape else "a number"
            raise InputError(
                f"{self._label}.{name}: got {reprlib.repr(value)}; valid: {wanted}"
            ) from None

    __setitem__ = __setattr__


class LawStep(Stepped):
    """A control law that runs alone: set `reference` and `estimate`, then call `step()`.

    Both are initially at rest at the mission's start, so the first command supports the robot's
    weight. docs/reference/python.md lists the fields; units are SI and radians. `ports` has the
    other records that the law reads.
    """

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        super().__init__(vehicle, [vehicle.law])
        get = vehicle.assembly.get
        self.reference: Any = InputView(get(Reference), "reference")
        self.estimate: Any = InputView(get(Estimate), "estimate")
        self.command: Any = View(get(WrenchCommand))
        self.dt = vehicle.dt
        """Period (s) between steps."""
        self.reference.active = 1.0
        fill(get(Estimate), get(Reference))

    def step(self) -> Any:
        """Run the law once; returns a copy of its command.

        The command has the wrench of the rotors at B's origin, `f_B` (3,) N and `t_B` (3,) N m, and
        `qd` rad/s (or `torque` N m) of the joints. The law keeps its integrals between steps.
        Raises InputError, which names the field, for a number that is not finite and for an
        attitude that is not a rotation.
        """
        check_record("reference", self.reference)
        check_record("estimate", self.estimate)
        self.run()
        return View(self.command.copy())


class EstimatorRun(Stepped):
    """An estimator that runs on arrays of inertial samples and position fixes."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        parts = [c for c in vehicle.assembly.components if c.group == "estimator"]
        super().__init__(vehicle, parts)
        if self.find(Odometry) is not None:
            raise InputError(
                "run_estimator has no input for odometry of a tracking camera: use a world with "
                "world.localisation = 'mocap' or 'gnss'"
            )
        if vehicle.estimator.is_truth or self.find(ImuBatch) is None:
            raise InputError(
                f"estimator {vehicle.estimator.name!r} reads no inertial samples; use one that "
                "does, such as mission.estimator = 'filter'"
            )

    def feed(
        self, t: Array, gyro: Array, accel: Array, t_fix: Array, p_fix: Array,
        R_fix: Array | None, heading: Array | None,
    ) -> Any:  # fmt: skip
        """Return the estimates, one a control tick; for the arguments see run_estimator."""
        h = compute_period(t)
        imu, room = self.find(ImuBatch), len(self.find(ImuBatch).gyro)
        k = int(np.clip(round(self.vehicle.dt / h), 1, room))
        self._set_period(h, k * h)
        mocap, fix = self.find(MocapSample), self.find(Fix)
        target = mocap if mocap is not None else fix
        self._check_inputs(mocap, fix, R_fix, heading)
        ticks = len(t) // k
        self._check_span(t[: ticks * k], t_fix, h, k)
        check_units(t, gyro, accel, t_fix, p_fix, R_fix, self.vehicle.world.gravity_mps2)
        out = np.zeros(ticks, ESTIMATES)
        for name in (*ESTIMATED, "p_std"):
            out[name] = np.nan  # until ready
        innovations = Innovations()
        est, state = View(self.assembly.get(Estimate)), self.find(EstimatorState)
        self.assembly.get(Allocated)["f_B_alloc"] = 0.0
        nxt = int(np.searchsorted(t_fix, t[0] - 0.5 * h))
        # the first sample has no predecessor: its period is that of the others
        last_fix = t_fix[nxt] - (compute_period(t_fix) or k * h)
        for i in range(len(out)):
            last = (i + 1) * k
            now = float(t[last - 1])
            self._clock["t"] = imu.t = now
            imu.n = k
            imu.gyro[:k], imu.accel[:k] = gyro[last - k : last], accel[last - k : last]
            target.fresh = 0.0
            before = View(est.copy())
            due = int(np.searchsorted(t_fix, now + 0.5 * h, "right"))
            if due > nxt:
                nxt = due - 1  # the newest fix, if several came since the last control tick
                target.fresh, target.t = 1.0, float(t_fix[nxt])
                if mocap is not None:
                    assert R_fix is not None
                    mocap.period, last_fix = t_fix[nxt] - last_fix, t_fix[nxt]
                    self._set_pose(mocap, p_fix[nxt], R_fix[nxt])
                else:
                    assert heading is not None
                    fix.p, fix.heading = p_fix[nxt], float(heading[nxt])
                nxt += 1
            self.run()
            row = out[i]
            row["t"] = now
            row["ready"] = state is None or state.ready > 0.0
            if target.fresh:
                innovations.add(*self._compare(target, before), state)
            if row["ready"]:
                for name in ESTIMATED:
                    row[name] = est[name]
                if state is not None:
                    row["p_std"] = state.p_std
        innovations.judge(self._list_noise(mocap is not None), bool(out["ready"].any()))
        return out

    @staticmethod
    def _check_inputs(mocap: Any, fix: Any, R_fix: Array | None, heading: Array | None) -> None:
        """Raise InputError for a missing input, or for one that the estimator does not read."""
        inputs = {"R_fix": R_fix, "heading": heading}
        if mocap is None and fix is None:
            raise InputError(
                "mission.estimator: reads no position fixes; valid: an estimator that reads them"
            )
        poses = mocap is not None
        source = "poses of motion capture" if poses else "positions with a heading"
        needed, other = ("R_fix", "heading") if poses else ("heading", "R_fix")
        if inputs[needed] is None:
            raise InputError(f"{needed}: missing; the mission's estimator requires {source}")
        if inputs[other] is not None:
            raise InputError(
                f"{other}: not read; the mission's estimator requires {source}: give {needed} only"
            )

    @staticmethod
    def _check_span(t: Array, t_fix: Array, h: float, k: int) -> None:
        """Raise InputError unless `t` holds a control period (k samples) and a fix is within it."""
        if not len(t):
            raise InputError(f"t: valid: at least {k} times, one control period ({k * h:g} s)")
        start, end = t[0] - 0.5 * h, t[-1] + 0.5 * h
        if not np.any((t_fix >= start) & (t_fix <= end)):
            given = f"{t_fix[0]:.12g} to {t_fix[-1]:.12g} s" if len(t_fix) else "no fixes"
            raise InputError(
                f"t_fix: {given}; valid: at least one fix within the times t, "
                f"{t[0]:.12g} to {t[-1]:.12g} s, on the same clock"
            )

    def _compare(self, fix: Any, before: Any) -> tuple[Array, Array]:
        """Return fix minus estimate `before` it: position (m), and rotation (rad) or heading (deg).

        The lever from B's origin to an antenna remains in the position.
        """
        dt, poses = float(fix.t) - float(before.t), "R_WB" in fix.dtype.names
        away = (fix.p_WB if poses else fix.p) - before.p_WB - dt * before.v_WB
        if poses:
            turn = np.empty(3)
            log_so3(fix.R_WB @ before.R_WB.T, turn)
            return away, turn - dt * before.R_WB @ before.w_WB_B
        off = float(fix.heading) - math.atan2(before.R_WB[1, 0], before.R_WB[0, 0])
        return away, np.degrees([math.remainder(off, 2.0 * math.pi)])

    def _list_noise(self, poses: bool) -> dict[str, float]:
        """Return the noises (1 sigma) of fixes that the estimator assumes, by their keys."""
        w = self.vehicle.world
        if poses:
            keys, table = ("position_noise_m", "attitude_noise_rad"), w.mocap
            return {f"world.mocap.{key}": getattr(table, key) for key in keys}
        return {
            f"world.gnss.{key}": getattr(w.gnss.errors, key)
            for key in ("noise_level_m", "heading_noise_deg")
        }

    def _set_pose(self, mocap: Any, p_WB: Array, R_WB: Array) -> None:
        """Fill a sample of motion capture; the probe's pose follows from the nominal arm."""
        v = self.vehicle
        mocap.p_WB, mocap.R_WB = p_WB, R_WB
        if v.n_joints:
            p_BT, R_BT = compute_tip(v.model, np.asarray(self.assembly.get(Estimate)["q"]))
            mocap.p_WT, mocap.axis_W = p_WB + R_WB @ p_BT, (R_WB @ R_BT)[:, 2]

    def _set_period(self, h: float, dt: float) -> None:
        """Set the estimator's periods (s): `h` of inertial samples, `dt` of its steps."""
        for view in self.ports.values():
            names = view.dtype.names
            if "h" in names and "dt" in names and view.dtype != Clock.dtype:
                view.h, view.dt = h, dt
