"""Motion capture of objects with targets: a pipe, a marker, another thing of the world."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from skywright.core.record import Mat3, Record, Vec3
from skywright.core.rotations import exp_so3, mat_mat, mat_vec
from skywright.core.scratch import local
from skywright.description.world.spec import Mocap
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Normal, Out, Recorded, Sensor, Streamed
from skywright.vehicle.readings import MocapSample, TargetCapture
from skywright.vehicle.sensors._target_place import TargetPlace, fill_place, move_place
from skywright.vehicle.sensors.mocap import capture_body
from skywright.vehicle.targets import list_tracked
from skywright.vehicle.topics import MAP


class TrackedTarget(Sensor):
    """Fills TargetCapture with each sample of the robot; one for each tracked thing."""

    Table = Mocap

    class Me(Record):
        place: TargetPlace
        error_p_W: Vec3  # m, calibration error of the targets, in W
        error_p_O: Vec3  # m, likewise, on the thing
        error_R: Mat3
        sigma_p: float  # m
        sigma_R: float  # rad

    streams = (
        Streamed(
            (
                Recorded("p_WO", TargetCapture, "p_WO", "m", "tracked thing"),
                Recorded("q_WO", TargetCapture, "R_WO", "", "tracked thing", rotation=True),
            ),
            "geometry_msgs/PoseStamped", MAP,
            {"pose.position": "p_WO", "pose.orientation": "q_WO"},
        ),
    )  # fmt: skip

    class Noise(Normal):
        stream = "pipe"
        p: Vec3
        R: Vec3

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for each thing that motion capture measures and the camera does not."""
        for name in list_tracked(context.robot, context.world):
            yield cls(f"tracked {name}", context.world.mocap)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the target's position and calibration error; a marker is its own target."""
        name = self.name.removeprefix("tracked ")
        fill_place(me.place, context, name)
        me.sigma_p, me.sigma_R = table.position_noise_m, table.attitude_noise_rad
        error = context.deviation.survey_error
        exp_so3(np.zeros(3), me.error_R)
        if name not in context.world.things:
            me.error_p_W[:] = context.deviation.pipe_error
        elif not context.world.things[name].is_marker:
            me.error_p_O[:] = error[:3]
            exp_so3(error[3:], me.error_R)

    def get_period(self, step: str, context: Any) -> float:
        """It is sampled with the robot."""
        return 0.0

    @staticmethod
    def step(me: Me, mj: MuJoCo, mocap: MocapSample, noise: Noise, out: Out[TargetCapture]) -> None:
        if mocap.fresh == 0.0:
            return
        move_place(me.place, mj)
        p, R = local(3), local(3, 3)
        mat_vec(me.place.R_WO, me.error_p_O, p)
        for a in range(3):
            p[a] += me.place.p_WO[a] + me.error_p_W[a]
        mat_mat(me.place.R_WO, me.error_R, R)
        out.fresh = 1.0
        capture_body(me, p, R, noise, out.p_WO, out.R_WO)
