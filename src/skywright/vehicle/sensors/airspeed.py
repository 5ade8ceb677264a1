"""A Pitot tube along the robot's x axis: `[robot.sensors.NAME] kind = "airspeed"`."""

from __future__ import annotations

import math
from typing import Any

from skywright.core.record import Record
from skywright.core.spec import NonNegative, Positive, Spec
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import Normal, Out, Output, Recorded, Sensor
from skywright.vehicle.plant import Wind


class Airspeed(Sensor):
    """Measures the airspeed along x of the robot, with the lag of a hose and white noise."""

    class Table(Spec):
        """The defaults are assumed for a small MEMS tube."""

        rate_hz: Positive = 50.0
        noise_mps: NonNegative = 0.2  # 1 sigma
        lag_s: Positive = 0.02  # of the hose

    class Me(Record):
        sigma: float  # m/s
        gain: float  # of the lag, per sample
        v: float  # m/s, after the lag of the hose

    class Noise(Normal):
        v: float

    class Reading(Output):
        fresh: float
        t: float  # s
        v: float  # m/s, along x of B

    columns = (Recorded("airspeed", Reading, "v", "m/s", "of the air against the robot, along x"),)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gain of the lag; it is exact for a speed that is constant over a sample.

        A rate above the control rate yields a sample a control tick.
        """
        me.sigma = table.noise_mps
        period = max(1.0 / table.rate_hz, context.dt)
        me.gain = 1.0 - math.exp(-period / table.lag_s)

    @staticmethod
    def step(
        me: Me, clock: Clock, truth: Truth, wind: Wind, noise: Noise, out: Out[Reading]
    ) -> None:
        along = 0.0
        for i in range(3):
            along += truth.R_WB[i, 0] * (truth.v_WB[i] - wind.body_W[i])
        me.v += me.gain * (along - me.v)
        out.fresh, out.t, out.v = 1.0, clock.t, me.v + me.sigma * noise.v
