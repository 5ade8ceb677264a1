"""Draw requests for benchmarks/oracle.py: `python benchmarks/oracle_conditions.py MISSION`.

Writes a table for `skywright campaign MISSION --record all --vary FILE.csv`. The requests vary, not
only the obstacles. For the weld scan: the sector, the pattern and its passes; the number of welds
(none in a sixth of the rows, two in a quarter), their position, angle and width (seams along the
axis in a tenth); the pipe's pose and size, the errors of the map and of the arm. For the others:
the robot, the task and its difficulty, the position of things, wind, loads, and unknown deviations.
Requests near limits are intended: impossible ones must be refused, or reported as not done.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from conditions_table import save_table

Row = dict[str, Any]

APART_M = 0.009  # between passes; smaller distances are refused
PLANS = 4  # number of plan files of a table


def draw_scan(rng: np.random.Generator) -> Row:
    """Draw one request for a weld scan."""
    diameter = rng.uniform(0.3, 0.6)
    arc = rng.uniform(20.0, 120.0)
    pattern = rng.choice(["raster", "spiral", "line"], p=[0.7, 0.2, 0.1])
    passes = int(rng.integers(1, 9))
    around = 0.5 * diameter * math.radians(arc)
    passes = min(passes, 1 + int(around / APART_M))
    angle = 90.0 if rng.random() < 0.1 else rng.uniform(-60.0, 60.0)
    offset = rng.uniform(-0.05, 0.05)
    other = offset + rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.09)
    lean = 0.0 if angle == 90.0 else rng.uniform(-10.0, 10.0)
    second = 90.0 if rng.random() < 0.1 else angle + lean
    welds = rng.choice([0, 1, 2], p=[1 / 6, 7 / 12, 1 / 4])
    row = {
        "mission.task.pattern": str(pattern),
        "mission.task.side": "angle",
        "mission.task.centre_angle_deg": rng.uniform(-30.0, 30.0)
        + (180.0 if rng.random() < 0.15 else 0.0),
        "mission.task.arc_deg": arc,
        "mission.task.passes": passes,
        "mission.task.pass_length_m": rng.uniform(0.12, 0.25),
        "mission.task.speed_mps": rng.uniform(0.01, 0.02),
        "world.weld.present": str(welds > 0).lower(),
        "world.weld.angle_deg": angle,
        "world.weld.offset_m": offset,
        "world.weld.half_width_m": rng.uniform(0.004, 0.007),
        "world.welds.second.present": str(welds > 1).lower(),
        "world.welds.second.angle_deg": second,
        "world.welds.second.offset_m": other,
        "world.pipe.diameter_m": diameter,
        "world.pipe.length_m": 2.0,  # its posts are outside the sector
        "world.pipe.yaw_deg": rng.uniform(-180.0, 180.0),
        "world.pipe.inclination_deg": rng.uniform(-20.0, 20.0),
        "plant.map_error_m": rng.uniform(0.0, 0.03),
        "plant.map_error_deg": rng.uniform(0.0, 3.0),
        "plant.map_error_size_m": rng.uniform(0.0, 0.005),
        "plant.link_length_error_m": rng.uniform(-0.005, 0.005),
        "plant.joint_offset_error_deg": rng.uniform(-0.5, 0.5),
    }
    return row


def draw_wind(rng: np.random.Generator, most: float) -> Row:
    """Draw calm air in 40 % of the rows, else a steady or gusty wind from any side."""
    kind = str(rng.choice(["none", "steady", "dryden"], p=[0.4, 0.3, 0.3]))
    calm = kind == "none"
    return {
        "world.wind.kind": kind,
        "world.wind.mean_mps": 0.0 if calm else rng.uniform(0.2, most),
        "world.wind.toward_deg": rng.uniform(-180.0, 180.0),
    }


def draw_plant(rng: np.random.Generator) -> Row:
    """Draw deviations of masses and thrusts that the robot does not know."""
    return {
        "plant.mass_error": rng.uniform(-0.05, 0.05),
        "plant.rotor_gain_error": rng.uniform(-0.05, 0.05),
        "plant.com_x_error_m": rng.uniform(-0.005, 0.005),
        "plant.inertia_error": rng.uniform(-0.1, 0.1),
    }


def draw_map(rng: np.random.Generator, size: bool = True) -> Row:
    """Draw the bounds of the map errors."""
    out = {
        "plant.map_error_m": rng.uniform(0.0, 0.03),
        "plant.map_error_deg": rng.uniform(0.0, 3.0),
    }
    return {**out, "plant.map_error_size_m": rng.uniform(0.0, 0.005)} if size else out


def write_list(items: list[str]) -> str:
    """Return a TOML array."""
    return f"[{', '.join(items)}]"


def draw_waypoints(rng: np.random.Generator) -> Row:
    """Draw way-points; some have no hold, some are close to the ground."""
    points = []
    for _ in range(int(rng.integers(1, 6))):
        x, y, z = rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(0.5, 3.0)
        hold = 0.0 if rng.random() < 0.2 else rng.uniform(0.5, 4.0)
        yaw = rng.uniform(-360.0, 360.0)
        points.append(
            f"{{x_m={x:.3f}, y_m={y:.3f}, z_m={z:.3f}, yaw_deg={yaw:.2f}, hold_s={hold:.2f}}}"
        )
    robots = ["hexarotor", "othex", "f550-bridge", "bimanual", "ars-lrm"]
    return {
        "mission.robot": str(rng.choice(robots)),
        "mission.task.points": write_list(points),
        "mission.hover_height_m": rng.uniform(1.0, 2.5),
        **draw_wind(rng, 7.0),
        **draw_plant(rng),
    }


def draw_excitation(rng: np.random.Generator) -> Row:
    """Draw robots and amplitudes."""
    robot = str(rng.choice(["f550-bridge", "othex", "hexarotor"]))
    poses = ["folded"] if robot == "hexarotor" else ["folded", "working"]
    return {
        "mission.robot": robot,
        "mission.task.poses": write_list([f"'{p}'" for p in poses]),
        "mission.task.duration_s": rng.uniform(20.0, 60.0),
        "mission.task.tilt_deg": rng.uniform(0.0, 10.0),
        "mission.task.yaw_deg": rng.uniform(0.0, 25.0),
        "mission.task.acceleration_mps2": rng.uniform(0.2, 2.0),
        "mission.task.high_hz": rng.uniform(0.8, 2.0),
        "mission.task.joint_deg": 0.0 if robot == "hexarotor" else rng.uniform(0.0, 15.0),
        **draw_wind(rng, 3.0),
        **draw_plant(rng),
    }


def draw_modes(rng: np.random.Generator) -> Row:
    """Draw tilts around the hover limit, distances, headings and winds."""
    robot, law = [("f550-bridge", "backstepping"), ("f550-bridge-torque", "backstepping_torque")][
        int(rng.integers(2))
    ]
    return {
        "mission.robot": robot,
        "mission.law": law,
        "mission.task.tilt_deg": rng.uniform(2.0, 9.5),
        "mission.task.distance_m": rng.uniform(0.3, 3.0),
        "mission.task.standard_tilt_deg": rng.uniform(1.0, 5.0),
        "mission.task.hold_s": rng.uniform(1.0, 5.0),
        "mission.start_yaw_deg": rng.uniform(-180.0, 180.0),
        **draw_wind(rng, 3.0),
        **draw_plant(rng),
    }


def draw_impact(rng: np.random.Generator) -> Row:
    """Draw the impacting part, its speed, and joints with or without springs."""
    robot = str(rng.choice(["bimanual-longreach", "bimanual"], p=[0.7, 0.3]))
    parts = ["arm", "link"] if robot == "bimanual-longreach" else ["arm"]
    return {
        "mission.robot": robot,
        "mission.task.part": str(rng.choice(parts)),
        "mission.task.joints": str(rng.choice(["compliant", "stiff"])),
        "mission.task.speed_mps": rng.uniform(0.1, 1.2),
        "mission.task.reaction_s": rng.uniform(0.0, 0.3),
        "world.things.pad.stiffness_n_per_m": rng.uniform(1000.0, 10000.0),
        **draw_plant(rng),
    }


def draw_transport(rng: np.random.Generator) -> Row:
    """Draw bars, goals and structures."""
    return {
        "mission.task.bar_length_m": rng.uniform(1.0, 2.4),
        "mission.task.bar_mass_kg": rng.uniform(0.1, 0.5),
        "mission.task.margin_m": rng.uniform(0.1, 0.25),
        "mission.task.goal_x_m": rng.uniform(8.8, 9.6),
        "mission.task.goal_z_m": rng.uniform(1.5, 2.5),
        "world.scenario_seed": int(rng.integers(1, 10**6)),
        "world.difficulty": rng.uniform(0.2, 1.0),
        **draw_wind(rng, 3.0),
    }


def draw_bench(rng: np.random.Generator) -> Row:
    """Draw staircases of forces, some beyond the servos' capability."""
    forces = sorted(rng.uniform(0.5, 12.0, int(rng.integers(1, 6))))
    return {
        "mission.task.forces_n": write_list([f"{x:.2f}" for x in forces]),
        "mission.task.hold_s": rng.uniform(1.0, 8.0),
        "mission.task.ramp_s": rng.uniform(0.3, 3.0),
        "mission.task.settle_s": rng.uniform(1.0, 4.0),
        "world.structure.friction": rng.uniform(0.2, 0.8),
        "plant.link_length_error_m": rng.uniform(-0.005, 0.005),
        "plant.joint_offset_error_deg": rng.uniform(-0.5, 0.5),
        "plant.servo_lag_error": rng.uniform(-0.2, 0.2),
    }


def draw_bimanual(rng: np.random.Generator) -> Row:
    """Draw one to four trials, forces, things and their retention."""
    trials = ["squeeze", "unplug", "bar", "position-sensor"]
    asked = [x for x in trials if rng.random() < 0.6] or [str(rng.choice(trials))]
    return {
        "mission.task.trials": write_list([f"'{x}'" for x in asked]),
        "mission.task.squeeze_n": rng.uniform(2.0, 6.0),
        "mission.task.lift_m": rng.uniform(0.02, 0.1),
        "mission.task.unplug_threshold_m": rng.uniform(0.015, 0.11),
        "mission.task.bar_turn_deg": rng.uniform(0.0, 20.0),
        "mission.task.drift_m": rng.uniform(0.0, 0.03),
        "world.things.box.mass_kg": rng.uniform(0.1, 0.3),
        "world.things.plug.held_n": rng.uniform(1.0, 4.0),
        "world.things.box.friction": rng.uniform(0.3, 1.0),
        "plant.joint_offset_error_deg": rng.uniform(-0.5, 0.5),
        "plant.hardening_error": rng.uniform(-0.2, 0.2),
    }


def draw_install(rng: np.random.Generator) -> Row:
    """Draw forces, poses of arm and pipe, and unknown deviations."""
    return {
        "mission.task.force_n": rng.uniform(1.0, 4.0),
        "mission.task.hold_s": rng.uniform(2.0, 10.0),
        "mission.task.pose": str(rng.choice(["L", "stretched"], p=[0.85, 0.15])),
        "mission.task.hover_s": 0.0 if rng.random() < 0.5 else rng.uniform(10.0, 50.0),
        "mission.task.swing_deg": 0.0 if rng.random() < 0.3 else rng.uniform(5.0, 20.0),
        "world.pipe.diameter_m": rng.uniform(0.15, 0.3),
        "world.pipe.z_m": rng.uniform(2.2, 3.5),
        "world.pipe.yaw_deg": rng.uniform(-180.0, 180.0),
        "world.pipe.inclination_deg": rng.uniform(-10.0, 10.0),
        "world.things.tape.press_n_s": rng.uniform(1.0, 10.0),
        **draw_wind(rng, 2.0),
        **draw_map(rng),
        "plant.joint_offset_error_deg": rng.uniform(-0.4, 0.4),
    }


def draw_contact(rng: np.random.Generator) -> Row:
    """Draw spots, forces and slopes of a deck."""
    spots = [
        f"{{x_m={rng.uniform(-0.3, 0.3):.3f}, y_m={rng.uniform(-0.3, 0.3):.3f}}}"
        for _ in range(int(rng.integers(1, 4)))
    ]
    forces = rng.uniform(1.0, 5.0, int(rng.integers(1, 4)))
    return {
        "mission.task.spots": write_list(spots),
        "mission.task.forces_n": write_list([f"{x:.2f}" for x in forces]),
        "mission.task.hold_s": rng.uniform(1.0, 6.0),
        "mission.task.without_gear": "false",
        "world.structure.slope_deg": rng.uniform(0.0, 5.0),
        "world.structure.friction": rng.uniform(0.4, 0.8),
        **draw_wind(rng, 3.0),
        **draw_map(rng, size=False),
        **draw_plant(rng),
    }


def draw_wall(rng: np.random.Generator) -> Row:
    """Draw forces and slides along a tunnel's wall."""
    forces = rng.uniform(1.0, 4.0, int(rng.integers(1, 4)))
    return {
        "mission.task.forces_n": write_list([f"{x:.2f}" for x in forces]),
        "mission.task.slide_m": 0.0 if rng.random() < 0.3 else rng.uniform(0.1, 0.5),
        "mission.task.slide_force_n": rng.uniform(0.6, 2.0),
        "mission.task.slide_speed_mps": rng.uniform(0.02, 0.08),
        "world.structure.friction": rng.uniform(0.2, 0.8),
        **draw_wind(rng, 2.0),
        **draw_map(rng),
        **draw_plant(rng),
    }


def draw_tool(rng: np.random.Generator) -> Row:
    """Draw tools, positions on the pipe, waits and winds."""
    return {
        "mission.task.along_pipe_m": rng.uniform(-0.3, 0.3),
        "mission.task.wait_s": rng.uniform(2.0, 20.0),
        "mission.task.hover_s": 0.0 if rng.random() < 0.5 else rng.uniform(10.0, 50.0),
        "world.things.tool.mass_kg": rng.uniform(0.3, 0.6),
        "world.things.tool.friction": rng.uniform(0.2, 0.8),
        "world.pipe.diameter_m": rng.uniform(0.16, 0.25),
        "world.pipe.inclination_deg": rng.uniform(-1.5, 1.5),
        **draw_wind(rng, 4.0),
        "plant.map_error_m": rng.uniform(0.0, 0.03),
        "plant.map_error_deg": rng.uniform(0.0, 1.5),
        "plant.map_error_size_m": rng.uniform(0.0, 0.005),
    }


def draw_insertion(rng: np.random.Generator) -> Row:
    """Draw sockets with offsets, pegs, friction and winds."""
    return {
        "mission.task.bar_pose": str(rng.choice(["marker", "hands"])),
        "world.things.peg.mass_kg": rng.uniform(0.3, 0.5),
        "world.things.peg.friction": rng.uniform(0.2, 0.6),
        "plant.socket_x_error_m": rng.uniform(-0.02, 0.02),
        "plant.socket_y_error_m": rng.uniform(-0.02, 0.02),
        "plant.socket_yaw_error_deg": rng.uniform(-5.0, 5.0),
        "plant.socket_roll_error_deg": rng.uniform(-2.0, 2.0),
        "plant.socket_pitch_error_deg": rng.uniform(-2.0, 2.0),
        **draw_wind(rng, 1.5),
    }


def draw_plan(rng: np.random.Generator) -> Row:
    """Draw one of PLANS plan files, winds and loads; a missing file is planned and written.

    The files are in the current folder, and the requests name them relative to it. Their scenarios
    follow from the table's seed: 11 to 14 for seed 1, 20261 to 20264 for seed 2026.
    """
    seed = rng.bit_generator.seed_seq.entropy  # type: ignore[attr-defined]
    scenario = 10 * seed + 1 + int(rng.integers(PLANS))
    file = Path(f"carry-{scenario}.csv")
    if not file.exists():
        command = [sys.executable, "-m", "skywright", "plan", "bar-transport", "--out", str(file)]
        subprocess.run([*command, "--set", f"world.scenario_seed={scenario}"], check=True)
    first = np.genfromtxt(file, delimiter=",", names=True)[0]
    return {
        "mission.task.plan_file": file.name,
        "mission.world": "pipe-structures",
        "mission.start_x_m": float(first["x_m"]),
        "mission.start_y_m": float(first["y_m"]),
        "mission.hover_height_m": float(first["z_m"]),
        "mission.start_yaw_deg": float(np.degrees(first["yaw_rad"])),
        "world.scenario_seed": scenario,
        **draw_wind(rng, 4.0),
        **draw_plant(rng),
    }


DRAWS: dict[str, Callable[[np.random.Generator], Row]] = {
    "pipe-weld-scan": draw_scan,
    "waypoints": draw_waypoints,
    "excitation": draw_excitation,
    "flight-modes": draw_modes,
    "impact": draw_impact,
    "bar-transport": draw_transport,
    "arm-test-bench": draw_bench,
    "bimanual-bench": draw_bimanual,
    "sensor-install": draw_install,
    "bridge-contact": draw_contact,
    "wall-contact": draw_wall,
    "tool-install": draw_tool,
    "bar-insertion": draw_insertion,
    "follow-plan": draw_plan,
}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", choices=sorted(DRAWS))
    parser.add_argument("--rows", type=int)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    rng = np.random.default_rng(a.seed)
    n = a.rows or (200 if a.mission == "pipe-weld-scan" else 100)
    rows = [
        {k: round(v, 5) if isinstance(v, float) else v for k, v in DRAWS[a.mission](rng).items()}
        for _ in range(n)
    ]
    save_table(rows, Path(__file__).with_name(f"oracle-{a.mission}-conditions.csv"))
