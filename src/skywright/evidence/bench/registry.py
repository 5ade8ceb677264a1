"""Registry of the benchmarks: a function `measure(session) -> list[Row]` and one entry here."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from skywright.errors import InputError, neighbours

if TYPE_CHECKING:
    from skywright.evidence.bench.rows import Row, Session

HERE = "skywright.evidence.bench."


class Benchmark(NamedTuple):
    """An entry of the registry."""

    module: str
    description: str
    by_default: bool = True
    """Whether it runs when no name is given; `--full` runs all."""
    function: str = "measure"


BENCHMARKS = {
    "loop": Benchmark(HERE + "loop", "closed loop, both ways of running, over bare mj_step"),
    "tick": Benchmark(HERE + "tick", "each estimator, each control law and the inertial unit"),
    "laws": Benchmark(HERE + "laws", "a step of each control law over one of push_and_slide"),
    "planning": Benchmark(HERE + "planning", "planning time, clearance queries, motion planners"),
    "startup": Benchmark(HERE + "startup", "the command line, imports, the first report"),
    "cold": Benchmark(HERE + "cold", "first run with an empty cache of compiled code", False),
    "clone": Benchmark(HERE + "clone", "from a fresh clone to the first report", False),
    "run": Benchmark(HERE + "run", "real-time factor of whole runs"),
    "memory": Benchmark(HERE + "memory", "memory over a long flight and over many runs"),
    "workers": Benchmark(HERE + "workers", "a campaign on one worker, on two, in bare processes"),
    "scan": Benchmark(HERE + "scan", "growth of cost with the length of a scan"),
    "sensors": Benchmark(HERE + "sensors", "cost of sensors, link, wind and friction"),
    "instruments": Benchmark(HERE + "instruments", "cost of the instruments of an inspection"),
    "contacts": Benchmark(HERE + "contacts", "growth of cost with contacts"),
    "insertion": Benchmark(HERE + "insertion", "a step of bar-insertion over one of a scan"),
    "locate": Benchmark(HERE + "locate", "calibration and filter of total station and camera"),
    "robots": Benchmark(HERE + "robots", "growth of cost with the number of robots"),
    "studies": Benchmark(
        HERE + "studies", "import of a robot, comparisons of robots and laws", False
    ),
    "envs": Benchmark(HERE + "envs", "steps and resets of the environments", False),
    "consistency": Benchmark(
        HERE + "evidence",
        "consistency of the filter (NEES)",
        False,
        "measure_consistency",
    ),
    "estimators": Benchmark(
        HERE + "evidence",
        "errors of each estimator in good and degraded conditions",
        False,
        "measure_estimators",
    ),
    "margins": Benchmark(
        HERE + "evidence", "margins of the weld scan's loops", False, "measure_margins"
    ),
    "force": Benchmark(
        HERE + "evidence", "force estimators of a compliant arm", False, "measure_force"
    ),
}


def choose_benchmarks(names: Sequence[str], full: bool) -> list[str]:
    """Check names and return them in registry order; without names all (`full`) or the default
    ones.

    Raises InputError that lists the valid names.
    """
    for name in names:
        if name not in BENCHMARKS:
            valid = neighbours(name, BENCHMARKS, count=len(BENCHMARKS))
            raise InputError(f"unknown benchmark {name!r}; valid: {valid}")
    if names:
        return [n for n in BENCHMARKS if n in names]
    return [n for n, b in BENCHMARKS.items() if full or b.by_default]


def load_benchmark(name: str) -> Callable[[Session], list[Row]]:
    """Import a benchmark and return its measuring function."""
    entry = BENCHMARKS[name]
    measure: Callable[[Session], list[Row]] = getattr(
        importlib.import_module(entry.module), entry.function
    )
    return measure
