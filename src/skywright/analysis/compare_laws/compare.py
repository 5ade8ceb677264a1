"""Fly each law in each case with the same seeds, and compare the metrics in pairs."""

from __future__ import annotations

import hashlib
import math
import re
import shutil
from collections import Counter
from collections.abc import Callable, Container, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.analysis.campaign.campaign import run_campaign
from skywright.analysis.campaign.distributions import parse_variations
from skywright.analysis.campaign.local import keep_workers
from skywright.analysis.campaign.spec import Campaign, build_campaign
from skywright.analysis.compare_laws.cases import (
    NOMINAL,
    Case,
    LeftOut,
    check_varied,
    choose_cases,
    list_cases,
    list_law_sets,
    tell_left_out,
)
from skywright.analysis.compare_laws.check import check_law
from skywright.analysis.compare_laws.cost import measure_cost
from skywright.analysis.compare_laws.paired import (
    Difference,
    compare_metric,
    find_significant,
    pair_rows,
)
from skywright.description.loader import load_description
from skywright.description.mission.spec import Requirement
from skywright.errors import InputError
from skywright.run.kind import load_kind
from skywright.run.names import list_measures
from skywright.run.rows import Row
from skywright.run.setup import Setup

RUNS = 10
"""Default number of flights per law and case; see `paired.FEWEST`."""
SHOWN = (
    "position.rms_m", "tip.tracking_rms_m", "tip.tangential_rms_mm", "tip.hover_rms_mm",
    "force.mean_n", "force.min_n", "force.max_n", "force.rms_error_n", "platform.tilt_max_deg",
    "flight.saturated_s", "flight.energy_wh", "response.landed", "response.deviation_max_m",
)  # fmt: skip
"""Metrics that the report shows besides the requirements, if the mission has them."""


class Flown(NamedTuple):
    """Flights of one law in one case."""

    law: str
    case: str
    rows: list[Row]
    refused: str  # why no run flew, or ""

    @property
    def succeeded(self) -> int:
        """Number of runs that met every requirement."""
        return sum(r.succeeded for r in self.rows)

    @property
    def reason(self) -> str:
        """Most frequent reason of failure, with its count; "" if no run failed.

        Reasons that differ only in numbers, such as the time, count as one.
        """
        lost = [r.reason or f"{r.requirement} not met" for r in self.rows if not r.succeeded]
        if not lost:
            return ""
        plain = [re.sub(r"[\d.]+", "0", text) for text in lost]
        most, count = Counter(plain).most_common(1)[0]
        return f"{count} of {len(self.rows)}: {lost[plain.index(most)]}"

    def compute_median(self, metric: str) -> float:
        """Return the median over the runs that have the metric; NaN if none has."""
        values = [r.metrics.get(metric, math.nan) for r in self.rows]
        known = [v for v in values if math.isfinite(v)]
        return float(np.median(known)) if known else math.nan


class LawComparison(NamedTuple):
    """Comparison of laws on the same flights, as differences to one of them."""

    mission: str
    robot: str
    world: str
    seed: int
    runs: int
    laws: list[str]
    cases: list[Case]
    requirements: dict[str, Requirement]
    metrics: list[str]  # shown: those of the requirements, and SHOWN
    measures: dict[str, tuple[str, str]]  # unit and description
    flown: list[Flown]
    differences: list[Difference]
    significant: set[tuple[str, str, str]]
    cost_s: dict[str, float]  # time of a step; NaN: not measured
    left_out: tuple[LeftOut, ...] = ()  # built-in cases that are not flown

    @property
    def reference(self) -> str:
        """The law to which all differences are: see `choose_reference`."""
        return choose_reference(self.laws, self.flown)

    def list_constant(self) -> dict[str, float]:
        """Return the metrics with equal values in all flights, and their values."""
        out = {}
        for metric in self.metrics:
            seen = {r.metrics.get(metric, math.nan) for f in self.flown for r in f.rows}
            if len(seen) == 1 and math.isfinite(value := seen.pop()):
                out[metric] = value
        return out

    def find(self, law: str, case: str) -> Flown:
        """Return the flights of a law in a case."""
        return next(f for f in self.flown if (f.law, f.case) == (law, case))

    def find_difference(self, law: str, case: str, metric: str) -> Difference | None:
        """Return the difference to the reference law; None without pairs."""
        name = (law, case, metric)
        return next((d for d in self.differences if (d.law, d.case, d.metric) == name), None)

    def to_json(self) -> dict[str, Any]:
        """Return the object of `skywright compare laws --json`."""

        return {
            "mission": self.mission, "robot": self.robot, "world": self.world, "seed": self.seed,
            "reference": self.reference,
            "cases": {c.name: list(c.sets) for c in self.cases},
            "left_out": {x.case.name: list(x.keys) for x in self.left_out},
            "flown": [
                {
                    "law": f.law, "case": f.case, "runs": len(f.rows), "succeeded": f.succeeded,
                    "refused": f.refused or None,
                    "reason": None if f.refused else f.reason or None,
                    "medians": {m: _or_null(f.compute_median(m)) for m in self.metrics},
                }
                for f in self.flown
            ],
            "differences": build_json(self.differences, self.significant),
            "cost_us": {law: _or_null(1e6 * s) for law, s in self.cost_s.items()},
        }  # fmt: skip


def compare_laws(
    laws: Sequence[str],
    mission: str,
    *,
    robot: str | None = None,
    world: str | None = None,
    sets: Sequence[str] = (),
    vary: Sequence[str] = (),
    cases: Sequence[str] = (),
    runs: int = RUNS,
    seed: int | None = None,
    out: Path,
    workers: int | None = None,
    ray: str | None = None,
    step: Callable[[str], None] | None = None,
) -> LawComparison:
    """Fly `runs` flights of each law in each case; all laws fly the same seeds and conditions.

    A law is the name of a built-in one or FILE.py:CLASS, followed by :KEY=VALUE for each key of
    [mission.law] that it changes. `choose_cases` parses `cases`. Without `cases`, built-in cases
    that set a key of `vary` are left out. `step` receives progress as text.

    The campaigns are kept in `out`/LAW/CASE; the same call continues them. The result includes laws
    that a robot or a case refuses, with the reason. Raises InputError on a wrong name or key, for
    an error in a law's file, before any flight, and if every law is refused.
    """
    given = [law.strip() for law in laws if law.strip()]
    names = list(dict.fromkeys(given))
    if len(names) < 2:
        told = ", ".join(given) or "none"
        raise InputError(f"compare laws requires two or more different laws, A,B; found: {told}")
    base = load_description(mission, robot, world, sets, seed)
    chosen = choose_cases(base, cases)
    for text in (*sets, *(text for case in chosen for text in case.sets)):
        if text.strip().startswith("mission.law"):
            raise InputError(
                f"{text}: not valid here, because the compared laws set mission.law; leave it out"
            )
    varied = [v.key for v in parse_variations(vary)]
    chosen, left_out = check_varied(chosen, names, varied, given=bool(cases))
    if left_out and step is not None:
        step(tell_left_out(left_out))
    known = list_cases(base)
    planned: list[tuple[str, Case, Campaign | str]] = []
    for case in chosen:
        for law in names:
            assignments = (*sets, *case.sets, *list_law_sets(law))
            try:
                planned.append((law, case, build_campaign(
                    mission, vary, robot=robot, world=world, seed=base.mission.seed,
                    sets=assignments,
                )))  # fmt: skip
            except InputError as error:
                if case.name == NOMINAL or case not in known:  # the input is wrong
                    raise
                planned.append((law, case, str(error)))
    for _, case, campaign in planned:
        if case.name == NOMINAL and isinstance(campaign, Campaign):
            check_law(campaign.base)
    flown, new = [], not out.exists()
    with keep_workers():
        for law, case, campaign in planned:
            if isinstance(campaign, str):
                flown.append(Flown(law, case.name, [], campaign))
                continue
            if step is not None:
                step(f"{law}, {case.name}")
            folder = out / _name_folder(law) / case.name
            found = run_campaign(
                campaign, runs, out=folder, workers=workers, ray=ray, progress=step is not None
            )
            if found.interrupted:
                raise KeyboardInterrupt
            rows = [r for r in found.rows if r.run < runs]  # the folder may hold more runs
            flown.append(Flown(law, case.name, rows, _find_refusal(rows)))
    if all(f.refused for f in flown):
        if new:
            shutil.rmtree(out, ignore_errors=True)  # it contains only refusals
        reasons = "; ".join(f"{f.law}: {f.refused}" for f in flown if f.case == NOMINAL)
        raise InputError(f"no law can fly {mission}: {reasons}")
    required = load_kind(base.mission.kind).requirements(Setup(base), None)
    measures = dict(list_measures(base.mission.kind))
    seen = {name for f in flown for r in f.rows for name in r.metrics}
    metrics = [m for m in dict.fromkeys([*required, *SHOWN]) if m in seen]
    differences = compare_flown(choose_reference(names, flown), metrics, flown)
    return LawComparison(
        base.mission.name, base.robot.name, base.world.name, base.mission.seed, runs, names,
        chosen, dict(required), metrics, measures, flown, differences,
        find_significant(differences),
        {
            law: _measure(law, mission, robot, world, sets, seed)
            if any(not f.refused for f in flown if f.law == law) else math.nan
            for law in names
        },
        tuple(left_out),
    )  # fmt: skip


def _name_folder(law: str) -> str:
    """Return a folder name that is unique to the law."""
    plain = re.sub(r"[^\w.-]", "_", law)
    return plain if plain == law else f"{plain}-{hashlib.sha256(law.encode()).hexdigest()[:8]}"


def _find_refusal(rows: Sequence[Row]) -> str:
    """Return the reason if no run took off, else ""."""
    if any(r.outcome not in ("infeasible", "refused") for r in rows):
        return ""
    return rows[0].reason if rows else ""


def build_json(
    differences: Sequence[Difference], significant: Container[tuple[str, str, str]]
) -> list[dict[str, Any]]:
    """Return the differences as JSON objects; `significant`: their (law, case, metric)."""
    return [
        {
            **{k: getattr(d, k) for k in ("law", "case", "metric", "pairs", "median")},
            "interval": [d.low, d.high] if math.isfinite(d.low) else None,
            "p": _or_null(d.p),
            "significant": (d.law, d.case, d.metric) in significant,
        }
        for d in differences
    ]


def _or_null(x: float) -> float | None:
    return x if math.isfinite(x) else None


def choose_reference(laws: Sequence[str], flown: Sequence[Flown]) -> str:
    """Return the first law with a nominal flight that met every requirement.

    Without one, the first law with a nominal flight to its end, else the first that flew.
    """
    by = {f.law: f for f in flown if f.case == NOMINAL}
    for holds in (
        lambda f: f.succeeded, lambda f: any(r.completed for r in f.rows), lambda f: not f.refused,
    ):  # fmt: skip
        for law in laws:
            if law in by and holds(by[law]):
                return law
    return laws[0]


def compare_flown(
    reference: str, metrics: Sequence[str], flown: Sequence[Flown]
) -> list[Difference]:
    """Return the differences of all other laws to the law `reference`, where there are pairs."""
    by = {f.case: f.rows for f in flown if f.law == reference}
    out = []
    for f in flown:
        for metric in metrics if f.law != reference and f.case in by else ():
            pair = pair_rows(by[f.case], f.rows, metric)
            found = compare_metric(f.law, f.case, metric, *pair)
            if found is not None:
                out.append(found)
    return out


def _measure(
    law: str, mission: str, robot: str | None, world: str | None, sets: Sequence[str],
    seed: int | None,
) -> float:  # fmt: skip
    try:
        return measure_cost(
            load_description(mission, robot, world, [*sets, *list_law_sets(law)], seed)
        )
    except Exception:  # a user's law may raise; its flights report the error
        return math.nan
