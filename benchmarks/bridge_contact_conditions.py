"""Draw the conditions of the bridge's campaign: `python benchmarks/bridge_contact_conditions.py`.

Writes a table for `skywright campaign bridge-contact --vary FILE.csv`. Slope (to 10 deg) and its
direction, the spot on the deck, the wind (calm, steady or Dryden turbulence, to 4 m/s, from any
direction), the station's position (15 to 40 m away, with a view of the start) and the drift of the
camera vary together. The largest force is 30 to 100 % of the maximum that the mission admits: 80 %
of the computed press force, 95 % if level and calm. The deck is known (plant.map_error_* = 0).
Ranges cannot express this, because the limit depends on slope, wind and their directions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from conditions_table import write_table

from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.run.planning import plan_mission

SLOPE_DEG, WIND_MPS = 10.0, 4.0
KINDS = ("none", "steady", "dryden", "steady")
LEAST_N = 1.0
"""N, minimum limit of a row; below it no force profile exists."""


def draw_spot(rng: np.random.Generator) -> str:
    """Draw a spot on the deck, as a list of one spot."""
    return f"[{{x_m = {rng.uniform(-0.6, 0.6):.2f}, y_m = {rng.uniform(-0.3, 0.3):.2f}}}]"


def draw_row(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """Draw one row without the forces."""
    far, toward = rng.uniform(15.0, 40.0), rng.uniform(-math.pi, math.pi)
    row: dict[str, Any] = {
        "world.structure.slope_deg": round(rng.uniform(0.0, SLOPE_DEG), 2) * (rng.random() < 0.8),
        "world.structure.slope_toward_deg": round(rng.uniform(-180.0, 180.0), 1),
        "mission.task.spots": draw_spot(rng),
        "world.wind.kind": kind,
        "world.wind.mean_mps": round(rng.uniform(0.5, WIND_MPS), 2) * (kind != "none"),
        "world.wind.toward_deg": round(rng.uniform(-180.0, 180.0), 1),
        "world.total_station.x_m": round(far * math.cos(toward), 2),
        "world.total_station.y_m": round(far * math.sin(toward), 2),
        "robot.tracking_camera.scale": round(rng.uniform(0.85, 1.05), 3),
        "robot.tracking_camera.walk_m_per_sqrt_m": round(rng.uniform(0.005, 0.03), 4),
        "robot.tracking_camera.yaw_rate_deg_per_min": round(rng.uniform(-2.0, 2.0), 2),
    }
    return row


def find_limit(row: dict[str, Any]) -> float:
    """Return the maximum force (N) that the mission admits; NaN if the robot cannot dock."""
    values = {k: v for k, v in row.items() if k != "mission.task.spots"}
    spots = [("mission.task.spots", row["mission.task.spots"])]
    sets = [*(f"{k}={v!r}" for k, v in values.items()), *(f"{k}={v}" for k, v in spots)]
    sets += ["mission.task.forces_n=[0.2]", "mission.task.without_gear=false"]
    sets += ["plant.map_error_m=0", "plant.map_error_deg=0"]
    plan = plan_mission(load_description("bridge-contact", sets=sets))
    if not plan.feasible:
        return math.nan
    way: Any = plan.way
    calm = row["world.structure.slope_deg"] == 0.0 and row["world.wind.mean_mps"] == 0.0
    return float(min((0.95 if calm else 0.8) * way.limit_n, way.borne_n))


def draw_table(rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows; rows without a dock or without a view of the start are drawn again."""
    rng, out = np.random.default_rng(seed), []
    drawn = 0
    while len(out) < rows:
        row = draw_row(rng, KINDS[len(out) % len(KINDS)])
        share = rng.uniform(0.3, 1.0)
        drawn += 1
        try:
            limit = find_limit(row)
        except InputError:
            continue
        if not limit >= LEAST_N:  # NaN: cannot dock
            continue
        top = math.floor(1e3 * max(share * limit, 0.5)) / 1e3
        row["mission.task.forces_n"] = f"[{0.5 * top:.3f}, {top:.3f}]"
        out.append(row)
        print(f"\r{len(out)} of {rows}", end="", flush=True)
    print(f", {drawn} drawn")
    return out


if __name__ == "__main__":
    write_table(draw_table, "bridge-contact", 200, "bridge-contact-conditions.csv")
