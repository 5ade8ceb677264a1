"""Requirements: metrics with a limit that a run must meet."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from skywright.description.mission.spec import Mission, Requirement
from skywright.errors import InputError, neighbours
from skywright.run.flight import Flown
from skywright.run.kind import MissionKind
from skywright.run.names import list_measures
from skywright.run.where import COMMON_WHERE, Where, find_where

_SENSES: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    "<": operator.lt,
    ">=": operator.ge,
    ">": operator.gt,
    "==": operator.eq,
}


class Verdict(NamedTuple):
    """One requirement with the value of a run; None if it was not measured."""

    name: str
    value: float | None
    unit: str
    limit: float
    sense: str
    passed: bool
    source: str
    where: str = ""  # the phases in which the value is measured


NOT_MET, BROKEN = "not met: ", "evaluation: "
"""Beginnings of the reasons that the evaluation of a run states."""


def is_judgement(reason: str) -> bool:
    """Return whether a run's reason is that of its evaluation, not one that the flight states."""
    return reason.startswith((NOT_MET, BROKEN))


def describe_missed(verdicts: list[Verdict]) -> str:
    """Return the requirements that were not met, as text."""
    missed = []
    for v in verdicts:
        if not v.passed:
            value = "not measured" if v.value is None else f"{v.value:.3g}"
            limit = f"{v.sense} {v.limit:g} {v.unit}".rstrip()
            missed.append(f"{v.name} {value} (limit {limit})")
    return NOT_MET + ", ".join(missed)


def describe_outcome(outcome: str, verdicts: list[Verdict]) -> str:
    """Return the reason for an outcome without a stated reason; "" if all requirements were met."""
    if not all(v.passed for v in verdicts):
        return describe_missed(verdicts)
    return "" if outcome == "succeeded" else f"{outcome} before its end, without a stated reason"


def check_requirements(mission: Mission) -> None:
    """Raise InputError for a requirement on what is not a metric of the kind, or in another unit.

    It could never be met, or would compare numbers in different units.
    """
    valid = list_measures(mission.kind)
    for name, requirement in mission.requirements.items():
        if name not in valid:
            raise InputError(
                f"mission.requirements: {name!r} is not a metric of kind {mission.kind!r}; valid: "
                f"{neighbours(name, valid)}"
            )
        unit = valid[name][0]
        given = "" if requirement.unit == "-" else requirement.unit.replace(" ", "")  # "Nm"
        if given not in ("", unit.replace(" ", "")):
            raise InputError(
                f"mission.requirements: the unit of {name!r} is {unit or 'none'}, not "
                f"{requirement.unit!r}: convert the limit {requirement.limit:g}"
            )


def judge(
    requirements: Mapping[str, Requirement],
    metrics: Mapping[str, float],
    where: Mapping[str, Where] = COMMON_WHERE,
) -> list[Verdict]:
    """Compare metrics with the requirements; a missing or NaN metric does not pass.

    `where` states in which phases the metrics of the kind are measured.
    """
    verdicts = []
    for name, r in requirements.items():
        value = metrics.get(name)
        known = value is not None and math.isfinite(value)
        passed = known and value is not None and bool(_SENSES[r.sense](value, r.limit))
        here, reached = find_where(name, where).text, value if known else None
        verdicts.append(Verdict(name, reached, r.unit, r.limit, r.sense, passed, r.source, here))
    return verdicts


def judge_run(
    kind: MissionKind[Any, Any], run: Flown[Any, Any], metrics: dict[str, float]
) -> tuple[list[Verdict], dict[str, str]]:
    """Evaluate the requirements of a flight; returns verdicts, and those that do not apply."""
    required = kind.requirements(run.setup, run.way)
    waived = {k: why for k, why in kind.list_waived(metrics).items() if k in required}
    asked = {k: r for k, r in required.items() if k not in waived}
    return judge(asked, metrics, kind.where), waived
