"""Motion capture of a pipe with targets on it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Mat3, Record, Vec3
from skywright.description.world.spec import Mocap
from skywright.description.world.surface import build_cylinder
from skywright.vehicle.arms.ports import PipeCapture
from skywright.vehicle.component import Component, Normal, Out, Sensor
from skywright.vehicle.readings import MocapSample
from skywright.vehicle.sensors.mocap import capture_body


class PipeTracking(Sensor):
    """Fills PipeCapture with each sample of the robot."""

    Table = Mocap

    class Me(Record):
        p_WP: Vec3  # m, with the error of its targets' calibration
        R_WP: Mat3
        sigma_p: float
        sigma_R: float

    class Noise(Normal):
        stream = "pipe"
        p: Vec3
        R: Vec3

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Take the pipe's pose and its error."""
        cylinder = build_cylinder(context.world.pipe)
        me.p_WP[:] = cylinder.p_WP + context.deviation.pipe_error
        me.R_WP[:] = cylinder.R_WP
        me.sigma_p, me.sigma_R = table.position_noise_m, table.attitude_noise_rad

    def get_period(self, step: str, context: Any) -> float:
        """It comes with the robot's samples."""
        return 0.0

    @staticmethod
    def step(me: Me, mocap: MocapSample, noise: Noise, out: Out[PipeCapture]) -> None:
        if mocap.fresh > 0.0:
            out.fresh = 1.0
            capture_body(me, me.p_WP, me.R_WP, noise, out.p_WP, out.R_WP)

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds with a tracked pipe have one, where motion capture tells the place."""
        world = context.world
        if world.pipe is not None and world.pipe.tracked and world.localisation == "mocap":
            yield cls("tracked pipe", world.mocap)
