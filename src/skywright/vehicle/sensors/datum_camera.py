"""The camera on the probe's holder: measures the position of the datum mark in its field of view.

Frame C: parallel to T, z along the optical axis, out of the robot. As for the marker camera
(sensors/camera.py), the output of a detector is modelled: two bearings and the distance, each with
noise. The true pose of the camera differs by `plant.probe_camera_error_*` from the nominal one,
constant during a flight.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from skywright.core.record import Mat3, Record, Vec3
from skywright.core.rotations import exp_so3, mat_mat, mat_t_mat, mat_t_vec
from skywright.core.scratch import local
from skywright.description.robot.camera import ProbeCamera
from skywright.description.world.datum import find_datum, find_seen_datum, locate_datum
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import Component, Normal, Out, Recorded, Sensor, Streamed
from skywright.vehicle.readings import DatumImage
from skywright.vehicle.sensors.camera import is_seen, spoil_place
from skywright.vehicle.topics import BODY


class DatumCamera(Sensor):
    """Fills DatumImage at its own rate, while the mark is in view."""

    Table = ProbeCamera

    class Me(Record):
        p_WM: Vec3  # m, of the mark, in truth
        R_WM: Mat3  # z: its normal
        p_TC: Vec3  # m, as the robot knows it
        true_p_TC: Vec3  # m
        R_TC: Mat3  # in truth; the robot knows it as the unit matrix
        edge: float  # tangent of half the field of view
        range_max: float  # m
        side_min: float  # cosine of the slant beyond which the mark is not read
        sigma_bearing: float  # rad
        sigma_range: float  # of the distance
        period: float  # s
        next: float  # s, next image

    class Noise(Normal):
        stream = "datum camera"
        image: Vec3  # two bearings and the distance

    streams = (
        Streamed(
            (Recorded("p_TM", DatumImage, "p_TM", "m", "datum mark, from the tip"),),
            "geometry_msgs/PointStamped", BODY, {"point": "p_TM"},
        ),
    )  # fmt: skip

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for a robot with a camera at its probe, where there is a datum."""
        if find_seen_datum(context.robot, context.world):
            yield cls("datum camera", context.robot.probe.camera)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the camera's data and the mark's true position."""
        datum, error = find_datum(context.world), context.deviation.camera_error
        assert datum is not None
        me.p_WM[:], me.R_WM[:] = locate_datum(context.world, datum)
        me.p_TC[:] = [table.aside_m, 0.0, -table.back_m]
        me.true_p_TC[:] = me.p_TC + error[:3]
        R = np.empty((3, 3))
        exp_so3(np.ascontiguousarray(error[3:]), R)
        me.R_TC[:] = R
        me.edge = math.tan(0.5 * math.radians(table.field_of_view_deg))
        me.range_max = table.range_max_m
        me.side_min = math.cos(math.radians(table.slant_max_deg))
        me.sigma_bearing, me.sigma_range = table.bearing_noise_rad, table.range_noise_fraction
        me.period = 1.0 / table.rate_hz

    def get_period(self, step: str, context: Any) -> float:
        """Called every tick: the step checks whether an image is due."""
        return 0.0

    @staticmethod
    def step(me: Me, clock: Clock, truth: Truth, noise: Noise, out: Out[DatumImage]) -> None:
        if clock.t < me.next - 1e-9:
            return
        me.next += me.period
        d, p_T, p_C, R_WC, R_CM = local(3), local(3), local(3), local(3, 3), local(3, 3)
        for a in range(3):
            d[a] = me.p_WM[a] - truth.p_WT[a]
        mat_t_vec(truth.R_WT, d, p_T)
        for a in range(3):
            p_T[a] -= me.true_p_TC[a]
        mat_t_vec(me.R_TC, p_T, p_C)
        mat_mat(truth.R_WT, me.R_TC, R_WC)
        mat_t_mat(R_WC, me.R_WM, R_CM)
        if not is_seen(me, p_C, R_CM):
            return
        spoil_place(me, p_C, noise.image)
        for a in range(3):
            out.p_TM[a] = me.p_TC[a] + p_C[a]
        out.fresh = 1.0
