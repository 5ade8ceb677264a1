"""Draw random sites of an inspection: `python benchmarks/inspection_conditions.py MISSION`.

Writes a table for `skywright campaign MISSION --vary FILE.csv`: diameter and sector of a pipe of
0.3 to 0.6 m, its paint and roughness, steady wind from any direction, map errors and deviations of
the plant vary together. The velocity of a wall is normally distributed about the block's. The wind
is 20 to 100 % of 0.7 of the robot's limit; it is reduced in steps of 20 % if the plan lacks reserve
of a rotor or of the press force. The shim of a set-up is the paint in steps of 0.1 mm. All other
values are uniform over their range. A thickness survey presses with 3 N, or with 1.5 N if the wind
admits no more. `one-coil` is a `crack-scan` of an area of 60 by 60 mm with one coil instead of the
array.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from conditions_table import save_table

from skywright.description.loader import load_description
from skywright.run.planning import plan_mission

PLANT = {
    "plant.map_error_m": (0.0, 0.02),
    "plant.map_error_deg": (0.0, 2.0),
    "plant.map_error_size_m": (0.0, 0.004),
    "plant.mass_error": (-0.05, 0.05),
    "plant.rotor_gain_error": (-0.05, 0.05),
    "world.wind.toward_deg": (-180.0, 180.0),
}
RANGES = {
    "thickness-survey": {
        "world.structure.radius_m": (0.15, 0.3),
        "world.structure.yaw_deg": (-120.0, 120.0),
        "world.things.steel.paint_m": (0.0, 0.0005),
        "world.things.steel.roughness_front_m": (0.0, 1.5e-5),
        "world.things.steel.roughness_back_m": (0.0, 4e-5),
    },
    "crack-scan": {
        "world.pipe.diameter_m": (0.3, 0.6),
        "mission.task.centre_angle_deg": (-90.0, 110.0),
        "world.things.steel.paint_m": (0.0, 0.0005),
        "world.things.crack1.angle_deg": (-90.0, 90.0),
        "world.things.crack2.angle_deg": (-90.0, 90.0),
    },
}
RANGES["one-coil"] = RANGES["crack-scan"]
PATCH = 0.06  # m, both sides, with one coil
FASTEST = {
    "thickness-survey": 5.0,
    "crack-scan": 8.0,
    "one-coil": 8.0,
}  # m/s, about 0.7 of the robots' limits
MISSION = {"one-coil": "crack-scan"}  # flown mission, if the name differs
SLOWEST_SHARE = 0.2
VELOCITY = 5920.0, 0.003  # m/s, and the relative standard deviation of a wall's velocity
ARC, HEIGHT = 0.5, 0.25  # rad and m, range of spots to both sides of the middle
INSIDE_DEG = {"crack-scan": 8.0, "one-coil": 3.0}  # range of a crack from the middle of its sector


def draw_row(mission: str, rng: np.random.Generator) -> dict[str, Any]:
    """Draw one row without the wind speed."""
    row: dict[str, Any] = {
        k: float(f"{rng.uniform(*r):.4g}") for k, r in {**RANGES[mission], **PLANT}.items()
    }
    if mission == "thickness-survey":
        mean, share = VELOCITY
        row["world.things.steel.velocity_m_per_s"] = round(rng.normal(mean, share * mean), 1)
        row["world.structure.shape"] = "cylinder"
        reach = ARC * row["world.structure.radius_m"]
        spots = [(rng.uniform(-reach, reach), rng.uniform(-HEIGHT, HEIGHT)) for _ in range(3)]
        told = (f"{{name='A{i}', x_m={x:.3f}, y_m={y:.3f}}}" for i, (x, y) in enumerate(spots, 1))
        row["mission.task.spots"] = f"[{', '.join(told)}]"
    else:
        row["world.things.steel.kind"] = "wall"
        row["world.pipe.length_m"] = 1.6  # the posts are outside the sector
        row["mission.task.side"] = "angle"
        row["world.things.datum.around_deg"] = row["mission.task.centre_angle_deg"]
        for k in ("crack1", "crack2"):
            away = rng.uniform(-INSIDE_DEG[mission], INSIDE_DEG[mission])
            around = row["mission.task.centre_angle_deg"] + away
            row[f"world.things.{k}.around_deg"] = round(around, 2)
        shim = round(row["world.things.steel.paint_m"], 4)
        row["mission.task.procedure.coating_m"] = shim
    if mission == "one-coil":
        row["robot.sensors.eddy.coils"] = 1
        row["mission.task.pass_length_m"] = PATCH
        row["mission.task.arc_deg"] = round(
            math.degrees(2.0 * PATCH / row["world.pipe.diameter_m"]), 2
        )
        for k in ("crack1", "crack2"):
            row[f"world.things.{k}.s_m"] = round(0.1 + rng.uniform(-0.02, 0.02), 4)
    return dict(sorted(row.items()))


def add_wind(mission: str, row: dict[str, Any], share: float) -> dict[str, Any] | None:
    """Return the row with a `share` of FASTEST, or with the next slower wind that its plan admits.

    A survey presses with 1.5 N if the wind does not admit 3 N. None without a plan in calm air.
    """
    forces = ["[3.0]", "[1.5]"] if mission == "thickness-survey" else [""]
    speed, calm = share * FASTEST[mission], False
    name = MISSION.get(mission, mission)
    while True:
        for force in forces:
            asked = {"mission.task.forces_n": force} if force else {}
            sets = {**row, **asked, "world.wind.mean_mps": round(speed, 3)}
            if plan_mission(load_description(name, sets=sets)).feasible:
                return dict(sorted(sets.items()))
        sets["world.wind.mean_mps"] = 0.0
        if not calm and not plan_mission(load_description(name, sets=sets)).feasible:
            return None
        calm, speed = True, 0.8 * speed


def draw_table(mission: str, rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows; a site without a plan in still air is drawn again."""
    rng, out, again = np.random.default_rng(seed), [], 0
    while len(out) < rows:
        row = add_wind(mission, draw_row(mission, rng), rng.uniform(SLOWEST_SHARE, 1.0))
        if row is None:
            again += 1
        else:
            out.append(row)
        print(f"\r{len(out)} of {rows}, {again} without a plan", end="", flush=True)
    print()
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", choices=sorted(RANGES))
    parser.add_argument("--rows", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    name = a.out or Path(__file__).with_name(f"{a.mission}-conditions.csv")
    save_table(draw_table(a.mission, a.rows, a.seed), name)
