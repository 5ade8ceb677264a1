"""A sensor whose zero jumps: a gyroscope, an accelerometer, or the frame of the localisation."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from skywright.core.record import Record, Vec3
from skywright.errors import InputError
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Fault, InOut
from skywright.vehicle.readings import Fix, ImuBatch, MocapSample

SENSORS = ("gyroscope", "accelerometer", "localisation")
SIZES = (0.2, 1.0, 0.3)
"""rad/s, m/s^2, m: a jump that a mission draws."""


class Sensor(Fault):
    """Adds (x, y, z) to what a sensor says: rad/s or m/s^2 in B, m in W."""

    slot = "sense"

    class Table(Fault.Table):
        """Which sensor and by how much; `jump` has its unit: rad/s, m/s^2 or m."""

        sensor: Literal["gyroscope", "accelerometer", "localisation"] = "localisation"
        jump: list[float] = [0.3, 0.0, 0.0]

    class Me(Record):
        start: float  # s
        sensor: int
        jump: Vec3

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the jump; raises InputError unless it has three numbers."""
        if len(table.jump) != 3:
            raise InputError(
                f"plant.faults.{self.name}.jump has {len(table.jump)} numbers; valid: 3"
            )
        me.start, me.sensor = table.start_s, SENSORS.index(table.sensor)
        me.jump[:] = table.jump

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Any sensor, in any direction."""
        k, way = int(rng.integers(len(SENSORS))), rng.standard_normal(3)
        jump = SIZES[k] * way / np.linalg.norm(way)
        return {"sensor": SENSORS[k], "jump": [float(x) for x in jump]}

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        imu: InOut[ImuBatch],
        mocap: InOut[MocapSample] | None,
        fix: InOut[Fix] | None,
    ) -> None:
        if clock.t < me.start:
            return
        for a in range(3):
            if me.sensor == 0:
                for k in range(imu.n):
                    imu.gyro[k, a] += me.jump[a]
            elif me.sensor == 1:
                for k in range(imu.n):
                    imu.accel[k, a] += me.jump[a]
            else:
                if mocap is not None and mocap.fresh > 0.0:
                    mocap.p_WB[a] += me.jump[a]
                    mocap.p_WT[a] += me.jump[a]
                if fix is not None and fix.fresh > 0.0:
                    fix.p[a] += me.jump[a]
