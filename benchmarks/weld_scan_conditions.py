"""Draw the conditions of the weld scan's campaign: `python benchmarks/weld_scan_conditions.py`.

Writes a table for `skywright campaign pipe-weld-scan --vary FILE.csv`. All conditions that the scan
claims to tolerate vary together, uniformly over their range. The wind is steady, a fixed fan, a
sweeping fan, or Dryden turbulence, each in a quarter of the rows, from any direction, at 20 to 100
% of the maximum that the mission admits for the robot (at most 6 m/s and the computed limits).
Ranges cannot express this, because the limit depends on the kind, the direction, the position and
the pipe.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from conditions_table import write_table

from skywright.description.loader import load_description
from skywright.run.limits import find_exceeded_push, find_exceeded_wind
from skywright.run.planning import plan_mission
from skywright.run.setup import Setup

FASTEST = 6.0  # m/s
KINDS = ("steady", "fan", "sweep", "dryden")
RANGES = {
    "world.pipe.diameter_m": (0.3, 0.6),
    "world.pipe.yaw_deg": (-180.0, 180.0),
    "world.pipe.inclination_deg": (-30.0, 30.0),
    "world.pipe.friction": (0.1, 0.3),
    "world.pipe.friction_variation": (0.0, 0.3),
    "world.weld.angle_deg": (-30.0, 30.0),
    "world.mocap.rate_hz": (30.0, 100.0),
    "world.mocap.outlier_fraction": (0.0, 0.02),
    "world.link.delay_s": (0.0, 0.003),
    "world.link.jitter_s": (0.0, 0.002),
    "plant.mass_error": (-0.05, 0.05),
    "plant.rotor_gain_error": (-0.05, 0.05),
}
FAN_DISTANCE = 3.5  # m, from the pipe
FAN_SWEEP_DEG, FAN_PERIOD_S = (10.0, 40.0), (8.0, 20.0)
SLOWEST_SHARE = 0.2


def draw_row(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """Draw one row without the wind speed."""
    row: dict[str, Any] = {k: round(rng.uniform(*r), 5) for k, r in RANGES.items()}
    toward = rng.uniform(-180.0, 180.0)
    row["world.wind.kind"] = "fan" if kind == "sweep" else kind
    row["world.wind.toward_deg"] = round(toward, 2)
    pipe = load_description("pipe-weld-scan").world.pipe
    assert pipe is not None
    away = FAN_DISTANCE * np.array([math.cos(math.radians(toward)), math.sin(math.radians(toward))])
    row["world.wind.fan.x_m"] = round(pipe.x_m - away[0], 3)
    row["world.wind.fan.y_m"] = round(pipe.y_m - away[1], 3)
    row["world.wind.fan.sweep_deg"] = round(rng.uniform(*FAN_SWEEP_DEG), 2) * (kind == "sweep")
    row["world.wind.fan.sweep_period_s"] = round(rng.uniform(*FAN_PERIOD_S), 2)
    return row


def find_limit(row: dict[str, Any]) -> float:
    """Return the fastest wind (m/s, at most FASTEST) that the mission admits with this row."""
    calm = {k: v for k, v in row.items() if not k.startswith("world.wind")}
    plan = plan_mission(load_description("pipe-weld-scan", sets=calm))
    if not plan.feasible:
        raise SystemExit(f"no plan in still air: {plan.blocked_by}")
    way = plan.way
    assert way is not None

    def allowed(speed: float) -> bool:
        sets = {**row, "world.wind.mean_mps": speed}
        setup = Setup(load_description("pipe-weld-scan", sets=sets))
        push = find_exceeded_push(setup, way.push_force_n)
        return push is None and find_exceeded_wind(setup, plan.segments) is None

    return _bisect(allowed, FASTEST)


def _bisect(allowed: Callable[[float], bool], high: float) -> float:
    if allowed(high):
        return high
    low = 0.0
    for _ in range(6):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low


def draw_table(rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows."""
    rng, out = np.random.default_rng(seed), []
    for i in range(rows):
        row = draw_row(rng, KINDS[i % len(KINDS)])
        share = rng.uniform(SLOWEST_SHARE, 1.0)
        row["world.wind.mean_mps"] = math.floor(1e3 * share * find_limit(row)) / 1e3
        out.append(row)
        print(f"\r{i + 1} of {rows}", end="", flush=True)
    print()
    return out


if __name__ == "__main__":
    write_table(draw_table, "pipe-weld-scan", 200, "weld-scan-conditions.csv")
