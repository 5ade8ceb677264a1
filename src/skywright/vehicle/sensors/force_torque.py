"""A six-axis force-torque sensor in the arm: `[robot.sensors.NAME] kind = "force_torque"`."""

from __future__ import annotations

from typing import Annotated, Any

import mujoco

from skywright.core.record import Array, Record
from skywright.core.spec import NonNegative, Positive, Spec
from skywright.errors import InputError
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Draws, Normal, Out, Recorded, Sensor, words
from skywright.vehicle.readings import WrenchSample

PLACES = {"wrist": "holder", "probe": "slider"}
"""Bodies of a probe: its holder on the last link, and the part behind its spring."""


class ForceTorque(Sensor):
    """Fills WrenchSample, about the joint of its body.

    Axes are those of the body (x along a link, or along the probe). Values are one physics step
    old, as all forces. Beyond its range it stays at the end.
    """

    class Table(Spec):
        """The defaults are of the class of an ATI Nano17 (SI-12-0.12): data sheet."""

        at: str = "wrist"  # "wrist", "probe", or the name of a body of the robot
        rate_hz: Positive = 500.0
        force_max_n: Positive = 17.0
        torque_max_nm: Positive = 0.12
        force_noise_n: NonNegative = 0.003  # 1 sigma
        torque_noise_nm: NonNegative = 0.000016
        force_bias_n: NonNegative = 0.05  # 1 sigma an axis, drawn once a run; assumed
        torque_bias_nm: NonNegative = 0.0005

    class Me(Record):
        force: int  # address in sensordata
        torque: int
        high: Annotated[Array, 2]  # N, N m
        sigma: Annotated[Array, 2]
        drawn: int
        bias: Annotated[Array, 6]

    class Noise(Normal):
        n: Annotated[Array, 6]

    columns = (
        Recorded("wrench_force", WrenchSample, "force", "N", "on the arm, in axes of the sensor"),
        Recorded("wrench_torque", WrenchSample, "torque", "N m", "likewise"),
    )

    def extend_scene(self, spec: Any) -> None:
        """Add MuJoCo's sensors at the body; raises InputError if the robot has no such body."""
        at = self.table.at
        body = spec.body(PLACES.get(at, at))
        inner = [b.name for b in spec.body("platform").find_all("body")]
        if body is None or body.name not in inner:
            named = [name for name, part in PLACES.items() if part in inner]
            raise InputError(
                f"sensor {self.name!r}: at = {at!r} is not a part of the arm; valid: "
                f"{', '.join([*named, *inner]) or 'none, the robot has no arm'}"
            )
        body.add_site(name=self.name)
        for kind in ("force", "torque"):
            spec.add_sensor(
                name=f"{self.name} {kind}",
                type=getattr(mujoco.mjtSensor, f"mjSENS_{kind.upper()}"),
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=self.name,
            )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the sensors' addresses."""
        model = context.scene.model
        me.force = model.sensor(f"{self.name} force").adr[0]
        me.torque = model.sensor(f"{self.name} torque").adr[0]
        me.high[:] = table.force_max_n, table.torque_max_nm
        me.sigma[:] = table.force_noise_n, table.torque_noise_nm
        self._me = me

    def draw(self, what: type[Draws], rng: Any, n: int) -> Array:
        """Draw the biases of this run first."""
        me, table = self._me, self.table
        if not me.drawn:
            me.drawn = 1
            me.bias[:3] = table.force_bias_n * rng.standard_normal(3)
            me.bias[3:] = table.torque_bias_nm * rng.standard_normal(3)
        return super().draw(what, rng, n)

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo, noise: Noise, out: Out[WrenchSample]) -> None:
        data = words(mj.sensordata, mj.nsensor)
        out.fresh, out.t = 1.0, clock.t
        for i in range(3):  # MuJoCo: of the inner parts on the outer ones
            f = -data[me.force + i] + me.bias[i] + me.sigma[0] * noise.n[i]
            t = -data[me.torque + i] + me.bias[3 + i] + me.sigma[1] * noise.n[3 + i]
            out.force[i] = min(max(f, -me.high[0]), me.high[0])
            out.torque[i] = min(max(t, -me.high[1]), me.high[1])
