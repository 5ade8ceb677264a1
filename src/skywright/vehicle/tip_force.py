"""The force of a probe's tip from the robot's force sensor: `Estimate.f_tip`.

A sensor behind the slider measures the contact force and the weight of the parts beyond it (0.03 kg
are 0.29 N upright). The weight is subtracted with the nominal mass and the estimated attitude. The
inertial force of these parts during motion is not subtracted.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from skywright.core.record import Record
from skywright.description.parts import Part, build_part, list_parts
from skywright.description.robot.spec import Robot
from skywright.vehicle.bus import Body, Estimate, Reference
from skywright.vehicle.component import Component, InOut, Recorded, helper
from skywright.vehicle.follower import Press
from skywright.vehicle.ports import FILL, list_steps
from skywright.vehicle.readings import TipForce, WrenchSample

TARE_S = 2.0
"""s, free flight whose mean is the first tare; also the time constant of later updates."""
TARE_GATE = 0.2
"""N, deviation from the tare above which the tip counts as touching and the tare is constant."""


class TipSensor(NamedTuple):
    """The sensor that measures the force of the tip."""

    name: str  # of its table in [robot.sensors]; "": [robot.force_sensor]
    mass: float  # kg, of the parts beyond it
    period: float  # s, between samples; 0: each control tick


def find_tip_sensor(robot: Robot) -> TipSensor | None:
    """Return the sensor of the tip's force, or None.

    [robot.force_sensor], else the first sensor at the probe or its wrist that fills WrenchSample.
    """
    if robot.probe is None:
        return None
    if robot.force_sensor is not None:
        return TipSensor("", robot.probe.slider_mass_kg, 0.0)
    beyond = {"probe": robot.probe.slider_mass_kg, "wrist": robot.probe.mass_kg}
    for name, part in list_parts(robot.sensors).items():
        at = getattr(part, "at", None)
        if at in beyond and _measures_wrench(name, part):
            return TipSensor(name, beyond[at], 1.0 / part.rate_hz)  # type: ignore[attr-defined]
    return None


def _measures_wrench(name: str, part: Part) -> bool:
    steps = list_steps(build_part("sensor", part, name))
    return any((p.record, p.use) == (WrenchSample, FILL) for step in steps for p in step.ports)


class TipForceEstimator(Component):
    """Fills `Estimate.f_tip` of a robot with [robot.force_sensor]."""

    slot = "reference"  # after the estimators

    columns = (
        Recorded(
            "force_meas",
            Estimate,
            "f_tip",
            "N",
            "measured by the probe's sensor, minus the slider's weight",
        ),
        Recorded("ref_force", Press, "force", "N", "requested force of the tip"),
        Recorded("pressing", Press, "press", "", "1: the arm controls the force"),
        Recorded("docked", Press, "docked", "", "1: docked to the structure"),
    )

    class Me(Record):
        mass: float  # kg, of the parts beyond the sensor

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for a robot whose probe has its own force sensor."""
        sensor = find_tip_sensor(context.robot)
        if sensor is not None and not sensor.name:
            yield cls("tip force")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the nominal mass of the slider."""
        sensor = find_tip_sensor(context.robot)
        assert sensor is not None
        me.mass = sensor.mass

    @staticmethod
    def step(me: Me, measured: TipForce, press: Press, body: Body, est: InOut[Estimate]) -> None:
        """`press` is recorded beside the force."""
        est.f_tip = measured.force - weigh(me.mass, body, est)


class WrenchTipForce(TipForceEstimator):
    """Fills `Estimate.f_tip` of a robot with a force-torque sensor, minus the sensor's bias.

    The bias is measured in free flight (`Reference.dead_zone` 0): first as a mean, then with a slow
    update. It is constant while the tip touches something.
    """

    class Me(Record):
        mass: float  # kg, of the parts beyond the sensor
        dt: float  # s, control period
        tare: float  # N
        learned: float  # s of free flight

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for a robot that measures the tip's force with a force-torque sensor."""
        sensor = find_tip_sensor(context.robot)
        if sensor is not None and sensor.name:
            found = cls("tip force")
            found.ports = {"measured": sensor.name}
            yield found

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the nominal mass of the parts beyond the sensor, and the control period."""
        super().build(me, table, context)
        me.dt = context.dt

    @staticmethod
    def step(  # type: ignore[override]
        me: Me,
        measured: WrenchSample,
        ref: Reference,
        press: Press,
        body: Body,
        est: InOut[Estimate],
    ) -> None:
        """`press` is recorded beside the force."""
        force = -measured.force[0] - weigh(me.mass, body, est) - me.tare
        near = abs(force) < TARE_GATE or me.learned < TARE_S
        if ref.active > 0.5 and ref.dead_zone == 0.0 and near:
            me.learned += me.dt
            me.tare += force * me.dt / min(me.learned, TARE_S)
        est.f_tip = force


@helper
def weigh(mass: float, body: Any, est: Any) -> float:
    """Return the weight (N) of `mass` along the probe, positive if it presses on the sensor."""
    up = 0.0
    for i in range(3):
        up += est.R_WB[2, i] * body.R_BT[i, 2]
    return mass * body.gravity * up
