"""Fly with satellites while a bias jumps: `python benchmarks/fly_bias_jumps.py [--rate HZ]`.

The bias of the gyroscope (0.2 rad/s) or the accelerometer (1 m/s^2) jumps in a random direction, at
a random time. Prints the largest error of the estimated position and the error at the end.
"""

from __future__ import annotations

import argparse

import numpy as np

from skywright.description.loader import load_description
from skywright.run.run import fly_and_evaluate

SIZES = (("gyroscope", 0.2), ("accelerometer", 1.0))

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=float, default=10.0, help="fixes a second")
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=3)
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    for k in range(asked.runs):
        sensor, size = SIZES[k % 2]
        way = rng.standard_normal(3)
        jump = (size * way / np.linalg.norm(way)).tolist()
        seed, start = int(rng.integers(100)), round(float(rng.uniform(6.0, 14.0)), 1)
        sets = [
            "world.localisation=gnss", f"world.gnss.rate_hz={asked.rate}",
            "plant.faults.a.kind=sensor", f"plant.faults.a.sensor={sensor}",
            f"plant.faults.a.jump={jump}", f"plant.faults.a.start_s={start}",
        ]  # fmt: skip
        flown = fly_and_evaluate(load_description("waypoints", "hexarotor", seed=seed, sets=sets))
        s = flown.samples
        error = np.linalg.norm(s["est_p_WB"] - s["p_WB"], axis=1)
        print(f"{sensor}: largest {error.max():.2f} m, at the end {error[-1]:.2f} m;", flown.reason)
