"""The laser range finder that looks down: a ray through the scene once a mission tick."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from skywright.core.record import Record
from skywright.core.rotations import quat_to_rot
from skywright.core.streams import build_stream
from skywright.description.robot.localisation import RangeFinder as RangeTable
from skywright.models.range_finder import (
    RANGE_BLOCK,
    Finder,
    RangePrecision,
    build_range_finder,
    draw_range_finder,
    step_range_finder,
)
from skywright.models.sight import Sight
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Component, Out, Sensor
from skywright.vehicle.readings import Range


class RangeFinder(Sensor):
    """Fills Range at `rate_hz`."""

    Table = RangeTable

    class Me(Record):
        distance: float  # m, below the robot, true
        finder: Finder

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Draw its bias."""
        precision = RangePrecision(
            table.rate_hz, table.range_min_m, table.range_max_m, table.resolution_m, table.bias_m,
            table.noise_m,
        )  # fmt: skip
        self._me, self._sim = me, context.sim
        self._sight = Sight(context.scene, context.sim.data)
        self._rng = context.stream("range_finder")
        me.finder, me.distance = build_range_finder(self._rng, precision)[0], math.inf

    def get_period(self, step: str, context: Any) -> float:
        """Called every tick: the step checks whether a sample is due."""
        return 0.0

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Cast the ray."""
        finder, qpos, R = self._me.finder, self._sim.qpos, np.empty((3, 3))
        if finder["index"] + n_ticks > RANGE_BLOCK:
            draw_range_finder(finder, self._rng)
        quat_to_rot(qpos[3:7], R)
        self._me.distance = self._sight.measure(np.array(qpos[:3]), -R[:, 2])

    def save(self) -> Any:
        """Return the state of its random stream."""
        return self._rng.bit_generator.state

    def restore(self, saved: Any) -> None:
        """Restore what `save` returned."""
        self._rng.bit_generator.state = saved

    def reseed(self, seed: int) -> None:
        """Draw the noise by another seed, from the next tick on."""
        self._rng, self._me.finder["index"] = build_stream(seed, "range_finder"), RANGE_BLOCK

    @staticmethod
    def step(me: Me, clock: Clock, out: Out[Range]) -> None:
        step_range_finder(me.finder, clock.t, me.distance)
        if me.finder.fresh > 0.0 and me.finder.valid > 0.0:
            out.fresh, out.t, out.distance = 1.0, me.finder.stamp, me.finder.distance

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with a range finder have one if a total station localises them."""
        finder = context.robot.range_finder
        if finder is not None and context.world.localisation == "total-station":
            yield cls("range finder", finder)
