"""A laser at the tip, along the probe: `[robot.sensors.NAME] kind = "tip_distance"`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.core.record import Record
from skywright.core.spec import NonNegative, Positive, Spec
from skywright.errors import InputError
from skywright.models.sight import Sight
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Normal, Out, Output, Recorded, Sensor, Streamed
from skywright.vehicle.schedule import count_calls


class TipDistance(Sensor):
    """Measures from the tip to the first thing that is not the robot; silent beyond its range.

    The ray is cast in the mission tick (20 ms) in which a sample is due, so that faster rates see
    one ray several times.
    """

    class Table(Spec):
        """The defaults are of the class of a ST VL53L4CD: data sheet, noise assumed."""

        rate_hz: Positive = 50.0
        range_min_m: NonNegative = 0.001
        range_max_m: Positive = 1.2
        noise_m: NonNegative = 0.002  # 1 sigma
        resolution_m: Positive = 0.001

    class Me(Record):
        distance: float  # m, true
        low: float
        high: float
        sigma: float  # m
        lsb: float  # m

    class Noise(Normal):
        d: float

    class Reading(Output):
        fresh: float
        t: float  # s
        distance: float  # m

    columns = (Recorded("tip_distance", Reading, "distance", "m", "along the probe, newest"),)
    streams = (Streamed((Recorded("distance", Reading, "distance", "m", "along the probe"),)),)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Find the tip.

        Raises InputError for a robot without an arm, or inconsistent limits.
        """
        self._site = context.scene.places.tip_site
        if self._site < 0:
            raise InputError(f"sensor {self.name!r}: robot {context.robot.name!r} has no tip")
        if table.range_min_m >= table.range_max_m:
            raise InputError(
                f"sensor {self.name!r}: range_min_m {table.range_min_m:g} must be below "
                f"range_max_m {table.range_max_m:g}"
            )
        me.low, me.high = table.range_min_m, table.range_max_m
        me.sigma, me.lsb, me.distance = table.noise_m, table.resolution_m, math.inf
        self._dt, self._due = context.dt, 0  # of the next sample: its number
        self._every, self._calls = count_calls(1.0 / table.rate_hz, context.dt)
        self._me, self._data = me, context.sim.data
        self._sight = Sight(context.scene, self._data)

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Cast the ray if a sample is due in this mission tick."""
        end = round(t / self._dt) + n_ticks
        if not self._is_before(end):
            return
        while self._is_before(end):
            self._due += 1
        axis = np.array(self._data.site_xmat[self._site].reshape(3, 3)[:, 2])
        self._me.distance = self._sight.measure(np.array(self._data.site_xpos[self._site]), axis)

    def _is_before(self, tick: int) -> bool:
        """Return whether the next sample is due in a control tick before `tick`."""
        return -(-self._due * self._every // self._calls) < tick  # rounded up, as `is_due`

    def save(self) -> Any:
        """Return the number of the next sample."""
        return self._due

    def restore(self, saved: Any) -> None:
        """Restore what `save` returned."""
        self._due = saved

    @staticmethod
    def step(me: Me, clock: Clock, noise: Noise, out: Out[Reading]) -> None:
        if me.low <= me.distance <= me.high:
            seen = max(me.distance + me.sigma * noise.d, 0.0)
            out.fresh, out.t = 1.0, clock.t
            out.distance = me.lsb * math.floor(seen / me.lsb + 0.5)
