"""Comparison of two runs: settings, metrics, main series."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.toml_files import load_layer
from skywright.run.results import Run


class Metric(NamedTuple):
    """A metric of both runs; NaN if a run does not have it."""

    name: str
    a: float
    b: float
    requirement: str  # "<= 0.1 m" of the first run that required it, else ""
    passed: tuple[bool | None, bool | None]  # None: not required

    @property
    def difference(self) -> float:
        """Value of the second run minus that of the first."""
        return self.b - self.a


class Series(NamedTuple):
    """A quantity over time in both runs; `a` and `b` are (times s, values)."""

    title: str
    label: str
    a: tuple[Array, Array]
    b: tuple[Array, Array]


class Overlay(NamedTuple):
    """Comparison of two runs."""

    a: Run
    b: Run
    settings: list[tuple[str, Any, Any]]  # key and both values, if they differ; None: not set
    metrics: list[Metric]
    series: list[Series]

    def to_json(self) -> dict[str, Any]:
        """Return the object of `skywright compare runs --json`."""

        def number(x: float) -> float | None:
            return x if math.isfinite(x) else None

        return {
            "runs": [str(r.directory) for r in (self.a, self.b)],
            "outcomes": [r.outcome for r in (self.a, self.b)],
            "settings": {key: [a, b] for key, a, b in self.settings},
            "metrics": {
                m.name: {"a": number(m.a), "b": number(m.b), "difference": number(m.difference)}
                for m in self.metrics
            },
        }


def compare_runs(a: Run, b: Run) -> Overlay:
    """Compare settings, metrics and main series of two runs, also of different missions."""
    return Overlay(a, b, _list_settings(a, b), _list_metrics(a, b), _list_series(a, b))


def _list_settings(a: Run, b: Run) -> list[tuple[str, Any, Any]]:
    one, other = (
        dict(_iterate_leaves(load_layer(run.directory / "mission.toml").tree)) for run in (a, b)
    )
    keys = [*one, *(k for k in other if k not in one)]
    return [(k, one.get(k), other.get(k)) for k in keys if one.get(k) != other.get(k)]


def _iterate_leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys and the values of a tree of tables."""
    if not isinstance(value, dict):
        yield key, value
        return
    for name, inner in value.items():
        yield from _iterate_leaves(inner, f"{key}.{name}" if key else name)


def _list_metrics(a: Run, b: Run) -> list[Metric]:
    """Return the metrics of both runs; required ones come first."""
    required = [{r["name"]: r for r in run.requirements} for run in (a, b)]
    names = list(dict.fromkeys([*required[0], *required[1], *sorted({*a.metrics, *b.metrics})]))
    out = []
    for name in names:
        each = [r.get(name) for r in required]
        first = next((r for r in each if r is not None), None)
        wanted = "" if first is None else f"{first['sense']} {first['limit']:g} {first['unit']}"
        one, other = (run.metrics.get(name, math.nan) for run in (a, b))
        passed = [None if r is None else bool(r["passed"]) for r in each]
        out.append(Metric(name, one, other, wanted.strip(), (passed[0], passed[1])))
    return out


def _distance(first: str, second: str) -> Callable[[Run], Array]:
    """Return a function for a distance in mm; NaN while the motors are off, before estimates are
    valid."""

    def compute(run: Run) -> Array:
        distance: Array = 1e3 * np.linalg.norm(run[first] - run[second], axis=1)
        if "rotor_thrust" in run.names:
            distance[run["rotor_thrust"].sum(axis=1) <= 0.5] = np.nan  # N
        return distance

    return compute


def _tilt(run: Run) -> Array:
    q = run["q_WB"]
    return np.degrees(np.arccos(np.clip(1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2), -1.0, 1.0)))


_QUANTITIES: list[tuple[str, str, tuple[str, ...], Callable[[Run], Array]]] = [
    ("Platform from its reference", "mm", ("p_WB", "ref_p_WB"), _distance("p_WB", "ref_p_WB")),
    ("Tip from its reference", "mm", ("p_WT", "ref_p_WT"), _distance("p_WT", "ref_p_WT")),
    ("Normal force at the tip", "N", ("f_normal",), lambda run: run["f_normal"]),
    ("Error of the estimated position", "mm", ("p_WB", "est_p_WB"), _distance("p_WB", "est_p_WB")),
    ("Tilt of the platform", "deg", ("q_WB",), _tilt),
    ("Height of the platform", "m", ("p_WB",), lambda run: run["p_WB"][:, 2]),
    ("Largest thrust of a rotor", "N", ("rotor_thrust",), lambda r: r["rotor_thrust"].max(axis=1)),
    ("Electrical power", "W", ("power",), lambda run: run["power"]),
]  # fmt: skip


def _list_series(a: Run, b: Run) -> list[Series]:
    """Return the series that both runs recorded, except all-zero ones and the tip without an
    arm."""
    out = []
    for title, unit, needed, compute in _QUANTITIES:
        if any(set(needed) - set(run.names) or not len(run["t"]) for run in (a, b)):
            continue
        if "p_WT" in needed and any("q" not in r.names or not r["q"].size for r in (a, b)):
            continue
        lines = [(np.asarray(run["t"]), np.asarray(compute(run))) for run in (a, b)]
        if any(np.any(np.nan_to_num(y)) for _, y in lines):
            out.append(Series(title, unit, lines[0], lines[1]))
    return out
