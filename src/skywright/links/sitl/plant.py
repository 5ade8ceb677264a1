"""The plant with an autopilot's interface: motor commands as input, sensor readings as output."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import quat_to_rot
from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.links.sitl.pickup import AutopilotNotes, RotorPickup, SensorPickup
from skywright.models.capability import check_can_fly
from skywright.run.backends import build_vehicle
from skywright.run.setup import Setup
from skywright.vehicle.component import Component
from skywright.vehicle.simulated import SimulatedVehicle

Array = NDArray[np.float64]

IMU_PERIOD_S = 0.004
"""s between inertial samples, if the control period divides it."""
IMU_RATES = (200.0, 250.0)
"""Hz, range of sample rates that autopilots accept."""


class Placed(NamedTuple):
    """A pose of motion capture, or a satellite fix (R_WB None)."""

    t: float  # s, time of measurement
    p: Array  # (3,) m, of B's origin, or of the antenna
    R_WB: Array | None


class Reading(NamedTuple):
    """Sensor readings over a period, and the truth for displays."""

    t: float  # s
    gyro: Array  # (3,) rad/s, mean over the period, in B
    accel: Array  # (3,) m/s^2, specific force, likewise
    pose: Placed | None
    fix: Placed | None
    p_WB: Array  # truth
    R_WB: Array
    v_WB: Array
    w_WB_B: Array


class Sockets:
    """Connects an autopilot to a vehicle: motor commands in, sensor readings out."""

    def __init__(self) -> None:
        self._rotors, self._sensors = RotorPickup("rotor pickup"), SensorPickup("sensor pickup")
        self._notes = AutopilotNotes("autopilot")
        self.parts: tuple[Component, ...] = (self._rotors, self._sensors, self._notes)
        """Components to add to the vehicle."""

    def attach(
        self, vehicle: SimulatedVehicle, period: float = IMU_PERIOD_S,
        rates: tuple[float, float] = IMU_RATES,
    ) -> None:  # fmt: skip
        """Attach to a vehicle that was built with `parts`, and set its tick to a period (s).

        The autopilot accepts sample rates in the range `rates` (Hz). Raises InputError if the
        robot's control rate has no such period.
        """
        v = self.vehicle = vehicle
        v.n_ticks = max(round(period / v.dt), 1)
        self.period = v.n_ticks * v.dt
        """Time (s) between readings."""
        if not rates[0] - 1e-6 <= 1.0 / self.period <= rates[1] + 1e-6:
            raise InputError(
                f"robot.control.rate_hz = {1.0 / v.dt:g}: inertial samples would come at "
                f"{1.0 / self.period:g} Hz; an autopilot takes {rates[0]:g} to "
                f"{rates[1]:g} Hz: set it to 250, 500 or 1000"
            )
        rotors = v.rotors
        self.n_rotors = len(rotors.spin)
        self.speed_max = np.sqrt(rotors.thrust_max / rotors.k_f)
        """Speed (n,) rad/s of each rotor at the full command."""
        self._drive, self._me = v.get_memory(self._rotors.name), v.get_memory(self._sensors.name)
        self.notes: Any = v.get_memory(self._notes.name)
        """Recorded data of the autopilot: fields of pickup.AutopilotNotes.Me."""

    def command(self, command: Array) -> None:
        """Set commands (n,) from 0 to 1, shares of the rotors' full speeds."""
        self._drive.speed[: self.n_rotors] = command * self.speed_max
        self.notes.command[: self.n_rotors] = command

    def read(self) -> Reading:
        """Return the sensor readings since the last call."""
        me, sim = self._me, self.vehicle.sim
        n = max(int(me.n), 1)
        gyro, accel = np.array(me.gyro) / n, np.array(me.accel) / n
        me.n, me.gyro[:], me.accel[:] = 0, 0.0, 0.0
        pose = fix = None
        if me.pose > 0.0:
            pose = Placed(float(me.pose_t), np.array(me.pose_p), np.array(me.pose_R))
        if me.fix > 0.0:
            fix = Placed(float(me.fix_t), np.array(me.fix_p), None)
        me.pose = me.fix = 0.0
        R = np.empty((3, 3))
        quat_to_rot(sim.qpos[3:7], R)
        p, v, w = sim.qpos[:3].copy(), sim.qvel[:3].copy(), sim.qvel[3:6].copy()
        return Reading(self.vehicle.t, gyro, accel, pose, fix, p, R, v, w)


class SitlPlant(Sockets):
    """A vehicle whose rotors an external program commands."""

    def __init__(
        self, description: Description[Any], period: float = IMU_PERIOD_S,
        rates: tuple[float, float] = IMU_RATES,
    ) -> None:  # fmt: skip
        """`period` (s) is that of inertial samples, if the control period divides it.

        The autopilot accepts sample rates in the range `rates` (Hz). Raises InputError if robot,
        world and autopilot do not match.
        """
        super().__init__()
        robot, world = description.robot, description.world
        if world.localisation == "total-station":
            raise InputError(
                f"world {world.name!r} is localised by a total station, which no autopilot takes; "
                "set world.localisation = 'mocap' or 'gnss'"
            )
        check_can_fly(robot, world.gravity_mps2)
        self.description, self.setup = description, Setup(description)
        self.attach(build_vehicle(description, setup=self.setup, parts=self.parts), period, rates)

    @property
    def t(self) -> float:
        """Time (s) since the start."""
        return self.vehicle.t

    def step(self, command: Array) -> Reading:
        """Run one period with commands (n,) from 0 to 1, shares of the rotors' full speeds.

        Raises SimulationError if the physics diverges.
        """
        self.command(command)
        self.vehicle.tick()
        return self.read()


def build_plant(
    description: Description[Any], on_samples: Callable[[NDArray[Any]], None] | None = None
) -> SitlPlant:
    """Build the plant; `on_samples` receives the samples of the recording."""
    plant = SitlPlant(description)
    plant.vehicle.on_samples = on_samples
    return plant
