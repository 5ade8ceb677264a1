"""Total station and tracking camera: a laser-tracked prism, and visual odometry.

As in Sanchez-Cuevas 2020, section 3.1, the camera is aligned with the station on a flight before
the mission: both sensors are recorded on a path through a box of 6 x 5 x 3 m, and the functions of
`skywright locate` find time, frame and scale. The result is `Aligned`, from which an estimator
starts. The line of sight to the prism follows from the scene's geometry, once a mission tick.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Array, Mat3, Record
from skywright.core.rotations import exp_so3, mat_mat, quat_to_rot
from skywright.core.scratch import local
from skywright.core.streams import build_stream
from skywright.description.world.localisation import TotalStation
from skywright.errors import InputError
from skywright.models.localisation.calibration import Calibration, calibrate
from skywright.models.localisation.drift_noise import LEAST_STATION
from skywright.models.localisation.time_alignment import estimate_offset
from skywright.models.sight import Sight
from skywright.models.total_station import (
    STATION_BLOCK,
    Station,
    StationPrecision,
    build_total_station,
    draw_total_station,
    step_total_station,
)
from skywright.models.tracking_camera import (
    CAMERA_BLOCK,
    CameraErrors,
    Tracker,
    build_tracking_camera,
    draw_tracking_camera,
    step_tracking_camera,
)
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import Component, Out, Output, Sensor, helper
from skywright.vehicle.plant import SETTLE
from skywright.vehicle.readings import Fix, Odometry
from skywright.vehicle.sensor_flight import (
    CALIBRATION_SPEED,
    build_inspection_path,
    record_flight,
)
from skywright.vehicle.sensor_tables import get_true_table


class StationCamera(Sensor):
    """Fills Fix and Odometry with the samples that arrive in a tick."""

    Table = TotalStation

    class Me(Record):
        station: Station
        camera: Tracker
        clock: float  # s, offset of the station's clock from the robot's
        attitude_noise: float  # rad, of the camera
        attitude_unit: Annotated[Array, CAMERA_BLOCK, 3]
        visible: int

    class Aligned(Output):
        """The calibration before the flight; constant."""

        R_WC: Mat3  # frame of the camera
        scale: float  # m of a unit of the camera
        clock: float  # s, offset of the station's clock from the robot's
        rotation_std: float  # rad
        scale_std: float
        offset_std: float  # s
        station_noise: float  # m
        per_sqrt_m: float  # m, random walk of the camera
        per_sqrt_s: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Fly the calibration; mission time starts.

        Raises InputError where the calibration finds too little, or where the station does not see
        the robot that stands at its start.
        """
        self._me, self._sim, self._true = me, context.sim, table
        self._rng = {name: context.stream(name) for name in ("station", "camera")}
        station, camera = self._build_instruments(context)
        me.clock = table.clock_s * self._rng["station"].standard_normal()
        self.calibration = self._calibrate(station, camera, me.clock, context.seed)
        found = self.calibration
        for (record, _), aligned in context.records.items():
            if record is self.Aligned:  # at both ends of a link
                fill_aligned(aligned[0], found)
        me.station, me.camera = station[0], camera[0]
        me.station.next_t = me.station.sent = me.camera.next_t = 0.0
        me.station.n, me.station.seen_since = 0, -math.inf
        me.camera.index = CAMERA_BLOCK  # attitude and position noise are drawn together
        self._sight = Sight(context.scene, context.sim.data)
        self._look(0.0)
        self._check_start()

    def _build_instruments(self, context: Any) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return (1,) arrays of Station and Tracker; the camera's frame is drawn."""
        prism, s = context.robot.prism, self._true
        camera = get_true_table(context.robot.tracking_camera, "tracking camera", context)
        rng = self._rng["camera"]
        heading, tilt, R_CW = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
        exp_so3(np.array([0.0, 0.0, rng.uniform(-math.pi, math.pi)]), heading)
        exp_so3(math.radians(1.0) * rng.standard_normal(3) * [1.0, 1.0, 0.0], tilt)
        mat_mat(heading, tilt, R_CW)
        precision = StationPrecision(
            s.rate_max_hz, s.rate_mean_hz, s.latency_min_s, s.latency_mean_s, s.range_noise_m,
            s.angle_noise_rad, s.pointing_noise_m, s.relock_s,
        )  # fmt: skip
        errors = CameraErrors(
            camera.rate_hz, camera.scale, camera.walk_m_per_sqrt_m, camera.walk_m_per_sqrt_s,
            camera.yaw_rate_deg_per_min, 0.0, 0.0, camera.noise_m, camera.jump_interval_s,
            camera.jump_m,
        )  # fmt: skip
        self._me.attitude_noise = camera.attitude_noise_rad
        place = np.array([s.x_m, s.y_m, s.z_m])
        p_BP = np.array([prism.x_m, prism.y_m, prism.z_m])
        return build_total_station(place, p_BP, precision), build_tracking_camera(R_CW, errors)

    def _calibrate(
        self, station: NDArray[Any], camera: NDArray[Any], clock: float, seed: int
    ) -> Calibration:
        lasts = self.table.calibration_s
        seen = record_flight(
            build_inspection_path(seed, lasts, CALIBRATION_SPEED), station, camera,
            self._rng["station"], self._rng["camera"], station_clock=float(clock),
        )  # fmt: skip
        try:
            offset = estimate_offset(seen.station, seen.camera).offset
            p_BP = np.array(station[0]["p_BP"])
            return calibrate(
                seen.station, seen.camera, offset, p_BP=p_BP,
                station_noise=compute_noise(self.table, seen.station.p),
            )  # fmt: skip
        except InputError as error:
            raise InputError(
                "world.total_station and robot.tracking_camera cannot be calibrated on a flight of "
                f"{lasts:g} s: {error}"
            ) from error

    def _check_start(self) -> None:
        s = self.table
        for start, stop in s.blocked_s:
            if start < SETTLE and stop > 0.0:
                raise InputError(
                    f"world.total_station.blocked_s contains [{start:g}, {stop:g}]: the "
                    f"station must see the robot for {SETTLE:g} s before take-off"
                )
        if not self._me.visible:
            raise InputError(
                f"world.total_station at ({s.x_m:g}, {s.y_m:g}, {s.z_m:g}) m does not see "
                "the robot's prism before take-off: move the station or the obstacle"
            )

    def _look(self, t: float) -> None:
        """Determine whether the prism is visible."""
        qpos, R = self._sim.qpos, np.empty((3, 3))
        quat_to_rot(qpos[3:7], R)
        station = self._me.station
        hidden = any(start <= t < stop for start, stop in self.table.blocked_s)
        prism = qpos[:3] + R @ station["p_BP"]
        self._me.visible = int(not hidden and self._sight.sees(station["p_WS"], prism))

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Determine whether the prism is visible; refill noise that would run out."""
        me, rng = self._me, self._rng
        if me.station.index + n_ticks > STATION_BLOCK:
            draw_total_station(me.station, rng["station"])
        if me.camera.index + n_ticks > CAMERA_BLOCK:
            draw_tracking_camera(me.camera, rng["camera"])
            me.attitude_unit[:] = rng["camera"].standard_normal((CAMERA_BLOCK, 3))
        self._look(t)

    def save(self) -> Any:
        """Return the state of its random streams."""
        return {name: rng.bit_generator.state for name, rng in self._rng.items()}

    def restore(self, saved: Any) -> None:
        """Restore what `save` returned."""
        for name, rng in self._rng.items():
            rng.bit_generator.state = saved[name]

    def reseed(self, seed: int) -> None:
        """Draw the noise of both sensors by another seed, from the next tick on."""
        self._rng = {name: build_stream(seed, name) for name in self._rng}
        self._me.station.index, self._me.camera.index = STATION_BLOCK, CAMERA_BLOCK

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        truth: Truth,
        aligned: Out[Aligned],
        fix: Out[Fix],
        odometry: Out[Odometry],
    ) -> None:
        step_total_station(me.station, clock.t, truth.p_WB, truth.R_WB, me.visible > 0)
        if me.station.fresh > 0.0:
            fix.fresh, fix.t = 1.0, me.station.stamp + me.clock
            for i in range(3):
                fix.p[i] = me.station.p_WP[i]
        step_tracking_camera(me.camera, clock.t, truth.p_WB, truth.R_WB)
        if me.camera.fresh > 0.0:
            take_odometry(me, odometry)

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds with a total station have one."""
        if context.world.localisation == "total-station":
            yield cls("total station", context.world.total_station)


def compute_noise(table: Any, p_WP: NDArray[Any]) -> float:
    """Return the noise (m, rms of an axis) of a total station by its data sheet, at prisms p_WP (n,
    3) m."""
    away = np.mean(np.linalg.norm(p_WP - [table.x_m, table.y_m, table.z_m], axis=1))
    across = table.pointing_noise_m**2 + (table.angle_noise_rad * away) ** 2
    return max(math.sqrt((table.range_noise_m**2 + 2.0 * across) / 3.0), LEAST_STATION)


def fill_aligned(aligned: Any, found: Calibration) -> None:
    """Write the result of a calibration into an Aligned record."""
    middle = found.span[0] + 0.5 * (found.span[1] - found.span[0])
    aligned["R_WC"], aligned["scale"] = found.frame.rotation, found.frame.scale
    aligned["clock"] = -(found.time_offset + found.skew * (middle - found.epoch))
    aligned["rotation_std"], aligned["scale_std"] = found.rotation_std, found.scale_std
    aligned["offset_std"], aligned["station_noise"] = found.offset_std, found.noise.station
    aligned["per_sqrt_m"], aligned["per_sqrt_s"] = found.noise.per_sqrt_m, found.noise.per_sqrt_s


@helper
def take_odometry(me: Any, odometry: Any) -> None:
    """Copy the camera's sample, with the noise of its attitude."""
    turn, noise = local(3), local(3, 3)
    k = me.camera.index % CAMERA_BLOCK
    odometry.fresh, odometry.t = 1.0, me.camera.stamp
    for i in range(3):
        odometry.p[i] = me.camera.p_CB[i]
        turn[i] = me.attitude_noise * me.attitude_unit[k, i]
    exp_so3(turn, noise)
    mat_mat(me.camera.R_CB, noise, odometry.R)
