"""A satellite receiver: delayed fixes of its antenna, with white and correlated errors.

The correlated error is a first-order Gauss-Markov process an axis, e' = -e / T + w, of the stated
standard deviation (Rankin, An error model for sensor simulation: GPS and differential GPS, IEEE
PLANS 1994, has the same form). A fix includes the heading from two antennas or a magnetometer, with
white noise and an error that is constant during the flight.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import mat_vec
from skywright.core.scratch import local
from skywright.description.world.gnss import Gnss
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import Component, Draws, Normal, Out, Sensor, Uniform
from skywright.vehicle.readings import Fix

QUEUE = 16
"""Largest number of fixes in transit."""


class SatelliteReceiver(Sensor):
    """Fills Fix with the fixes that arrive in a tick; their rate is `rate_hz`."""

    Table = Gnss

    class Me(Record):
        period: float  # s
        latency: float  # s
        dropout: float  # fraction
        next: float  # s, next epoch
        p_BG: Vec3  # m, antenna
        noise: Vec3  # m, 1 sigma
        drift: Vec3
        decay: float  # of the correlated error in one period
        error: Vec3  # m, present value
        heading_noise: float  # rad
        heading_error: float
        started: int  # 1: the errors of this flight are drawn
        head: int
        tail: int
        t: Annotated[Array, QUEUE]
        p: Annotated[Array, QUEUE, 3]
        heading: Annotated[Array, QUEUE]

    class Noise(Normal):
        stream = "gnss"
        white: Vec3
        drift: Vec3
        heading: float

    class Chance(Uniform):
        stream = "dropout"
        drop: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read errors from the kind of fix, the antenna's position from the robot."""
        e, s = table.errors, context.robot.sensors
        me.period, me.latency = 1.0 / table.rate_hz, table.latency_s
        me.dropout = table.dropout_fraction
        me.p_BG[:] = [s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]
        me.noise[:] = [e.noise_level_m, e.noise_level_m, e.noise_up_m]
        me.drift[:] = [e.drift_level_m, e.drift_level_m, e.drift_up_m]
        me.decay = math.exp(-1.0 / (table.rate_hz * e.drift_time_s))
        me.heading_noise = math.radians(e.heading_noise_deg)
        self._me = me

    def get_period(self, step: str, context: Any) -> float:
        """Called every tick: the step checks whether an epoch is due."""
        return 0.0

    def draw(self, what: type[Draws], rng: np.random.Generator, n: int) -> Array:
        """Draw the initial errors of the flight first."""
        me = self._me
        if what is self.Noise and not me.started:
            me.started = 1
            me.error[:] = me.drift * rng.standard_normal(3)
            size = math.radians(self.table.errors.heading_error_deg)
            me.heading_error = size * rng.standard_normal()
        return super().draw(what, rng, n)

    @staticmethod
    def step(
        me: Me, clock: Clock, truth: Truth, noise: Noise, chance: Chance, out: Out[Fix]
    ) -> None:
        t = clock.t
        if t >= me.next - 1e-9:
            me.next += me.period
            spread = math.sqrt(1.0 - me.decay * me.decay)
            lever = local(3)
            mat_vec(truth.R_WB, me.p_BG, lever)
            for i in range(3):
                me.error[i] = me.decay * me.error[i] + spread * me.drift[i] * noise.drift[i]
            if chance.drop >= me.dropout:
                k = me.head
                me.head = (k + 1) % QUEUE
                if me.head == me.tail:  # full: the oldest is lost
                    me.tail = (me.tail + 1) % QUEUE
                me.t[k] = t
                for i in range(3):
                    me.p[k, i] = (
                        truth.p_WB[i] + lever[i] + me.error[i] + me.noise[i] * noise.white[i]
                    )
                heading = math.atan2(truth.R_WB[1, 0], truth.R_WB[0, 0])
                me.heading[k] = heading + me.heading_error + me.heading_noise * noise.heading
        while me.tail != me.head and t - me.t[me.tail] >= me.latency - 1e-9:
            k = me.tail
            me.tail = (k + 1) % QUEUE
            out.fresh, out.t, out.heading = 1.0, me.t[k], me.heading[k]
            for i in range(3):
                out.p[i] = me.p[k, i]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds that are localised by satellites have one."""
        if context.world.localisation == "gnss":
            yield cls("gnss", context.world.gnss.fill())
