"""The force of a probe's tip from its force sensor.

The sensor sits behind the slider: its spring carries the contact force and, upright, the slider's
own weight (0.03 kg are 0.29 N), which is taken off with the nominal mass and the estimated
attitude. What the slider's inertia adds while it moves stays in.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Record
from skywright.vehicle.bus import Body, Estimate
from skywright.vehicle.component import Component, InOut, Recorded
from skywright.vehicle.follower import Press
from skywright.vehicle.readings import TipForce


class TipForceEstimator(Component):
    """Fills `Estimate.f_tip`."""

    slot = "reference"  # after the estimators

    columns = (
        Recorded("force_meas", Estimate, "f_tip", "N", "by the probe's sensor, less its slider"),
        Recorded("ref_force", Press, "force", "N", "that the tip shall exert"),
        Recorded("pressing", Press, "press", "", "1: the arm controls the force"),
        Recorded("docked", Press, "docked", "", "1: the feet shall rest on the structure"),
    )

    class Me(Record):
        slider: float  # kg, of the bar between the probe's spring and its tip

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots whose probe has a force sensor have one."""
        robot = context.robot
        if robot.force_sensor is not None and robot.probe is not None:
            yield cls("tip force")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Take the nominal slider."""
        me.slider = context.robot.probe.slider_mass_kg

    @staticmethod
    def step(me: Me, measured: TipForce, press: Press, body: Body, est: InOut[Estimate]) -> None:
        """`press` is recorded beside the force."""
        up = 0.0
        for i in range(3):
            up += est.R_WB[2, i] * body.R_BT[i, 2]
        est.f_tip = measured.force - me.slider * body.gravity * up
