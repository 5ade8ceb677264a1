"""Motion capture of a marker."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Record
from skywright.description.world.spec import Mocap
from skywright.description.world.things import find_first
from skywright.models.things.marker import Marker
from skywright.vehicle.arms.ports import MarkerCapture
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Out, Sensor
from skywright.vehicle.readings import MocapSample
from skywright.vehicle.sensors.camera import MarkerNoise, Target, fill_target, place_target
from skywright.vehicle.sensors.mocap import capture_body


class MarkerTracking(Sensor):
    """Fills MarkerCapture with each sample of the robot, where no camera sees the marker."""

    Table = Mocap

    class Me(Record):
        target: Target
        sigma_p: float
        sigma_R: float

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds with a marker have one, for robots without a camera."""
        world = context.world
        seen = context.robot.camera is None and world.localisation == "mocap"
        if seen and find_first(world.things, Marker):
            yield cls("tracked marker", world.mocap)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Take the marker's place."""
        fill_target(me.target, context)
        me.sigma_p, me.sigma_R = table.position_noise_m, table.attitude_noise_rad

    def get_period(self, step: str, context: Any) -> float:
        """It comes with the robot's samples."""
        return 0.0

    @staticmethod
    def step(
        me: Me, mj: MuJoCo, mocap: MocapSample, noise: MarkerNoise, out: Out[MarkerCapture]
    ) -> None:
        place_target(me.target, mj)
        if mocap.fresh > 0.0:
            out.fresh = 1.0
            capture_body(me, me.target.p_WM, me.target.R_WM, noise, out.p_WM, out.R_WM)
