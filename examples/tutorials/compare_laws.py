"""Fly one mission with several control laws under the same seeds, and compare a metric.

    python compare_laws.py MISSION LAW [LAW ...]

See docs/tutorials/control-engineer.md.
"""

import sys
from pathlib import Path
from statistics import mean

import skywright

SEEDS = (1, 2)
METRIC = "position.rms_m"
WIND = {
    "world.wind.kind": "dryden",
    "world.wind.mean_mps": 2.0,
    "plant.mass_error": 0.05,
}
"""The same conditions for every law: gusts, and a mass that the law does not know."""


def main(mission: str, laws: list[str]) -> None:
    """Print one line per law: mean and largest value over the seeds, and the failed runs."""
    print(f"{'law':30} {'mean':>8} {'largest':>8}  failed")
    for number, law in enumerate(laws):
        results = [
            skywright.run(
                skywright.load(mission, sets={**WIND, "mission.law": law}, seed=seed),
                out=Path("laws") / f"{number}-{seed}",
            )
            for seed in SEEDS
        ]
        values = [1e3 * result.metrics[METRIC] for result in results]
        failed = sum(result.outcome != "succeeded" for result in results)
        print(f"{law:30} {mean(values):5.1f} mm {max(values):5.1f} mm  {failed} of {len(SEEDS)}")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
