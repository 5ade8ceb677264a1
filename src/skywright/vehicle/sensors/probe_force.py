"""The force sensor of a probe: the potentiometer reads the spring's travel."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Record
from skywright.description.robot.force_sensor import ForceSensor
from skywright.models.force_sensor import Converter, build_force_sensor, measure_travel
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Normal, Out, Sensor, words
from skywright.vehicle.readings import TipForce


class ProbeForce(Sensor):
    """Fills TipForce every control tick."""

    Table = ForceSensor

    class Me(Record):
        converter: Converter
        slider: int  # address in qpos

    class Noise(Normal):
        stream = "force"
        count: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the data sheet's curve, scaled by the calibration with known weights."""
        preload = context.robot.probe.spring_preload_n
        me.converter = build_force_sensor(table, preload, context.springs.sensor)[0]
        me.slider = context.scene.places.slider_qpos

    @staticmethod
    def step(me: Me, mj: MuJoCo, noise: Noise, out: Out[TipForce]) -> None:
        travel = -words(mj.qpos, mj.nq)[me.slider]
        out.force = measure_travel(me.converter, travel, noise.count)

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots whose probe has one."""
        robot = context.robot
        if robot.probe is not None and robot.force_sensor is not None:
            yield cls("probe force", robot.force_sensor)
