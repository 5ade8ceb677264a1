"""From claims to verdicts: flights (shared and cached), measures, evaluation."""

import os
import re
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from skywright.errors import InputError, SkywrightError, neighbours
from skywright.evidence.reproduce.cache import Cache, Record
from skywright.evidence.reproduce.figures import ClaimFigure
from skywright.evidence.reproduce.flights import build_description, describe_content, fly_case
from skywright.evidence.reproduce.load import list_papers, load_claims
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.measures import MEASURES
from skywright.evidence.reproduce.spec import (
    Case,
    Claim,
    ClaimsFile,
    Criterion,
    judge,
)


class CriterionResult(NamedTuple):
    """One test of a claim with the measured value; `passed` is None without a comparison."""

    test: Criterion
    value: float | None
    passed: bool | None


class ClaimResult(NamedTuple):
    """A claim with its verdict and measured values."""

    paper: str
    claim: Claim
    verdict: str
    explanation: str
    tests: list[CriterionResult]
    values: dict[str, float]
    figure: ClaimFigure | None
    trouble: str  # why it could not be measured, or ""

    @property
    def id(self) -> str:
        """Paper and claim, as PAPER/CLAIM."""
        return f"{self.paper}/{self.claim.id}"

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `reproduce --json`."""
        first = self.tests[0]
        return {
            "id": self.id,
            "paper": self.paper,
            "where": self.claim.where,
            "statement": self.claim.statement,
            "judged_by": self.claim.judged_by,
            "by_construction": bool(self.claim.by_construction),
            "fitted": bool(self.claim.fitted),
            "paper_value": first.test.paper_value,
            "value": _number(first.value),
            "unit": first.test.unit,
            "tolerance": first.test.tolerance,
            "verdict": self.verdict,
            "explanation": self.explanation,
            "tests": [
                {
                    "quantity": t.test.quantity,
                    "value": _number(t.value),
                    "unit": t.test.unit,
                    "sense": t.test.sense,
                    "paper_value": t.test.paper_value,
                    "bound": t.test.bound,
                    "tolerance": t.test.tolerance,
                    "bound_by": t.test.whose,
                    "reading": t.test.reading,
                    "passed": t.passed,
                }
                for t in self.tests
            ],
        }


class Report(NamedTuple):
    """Measured claims of a paper."""

    file: ClaimsFile
    claims: list[ClaimResult]
    flown: int
    cached: int
    notes: list[str]

    @property
    def exit_code(self) -> int:
        """0 if everything could be measured, whatever the verdicts; else 1."""
        return 1 if any(c.trouble for c in self.claims) else 0

    def to_json(self) -> dict[str, Any]:
        """Return the object of `reproduce --json`."""
        return {"claims": [c.to_json() for c in self.claims]}


def _number(value: float | None) -> float | None:
    return value if value is not None and abs(value) < float("inf") else None


class Steps:
    """Progress of the flights."""

    def begin(self, total: int) -> None:
        """`total` flights follow."""

    def step(self, name: str, cached: bool) -> None:
        """The flight with this name starts."""

    def close(self) -> None:
        """All flights are finished."""


def reproduce_papers(
    paper: str | None,
    *,
    cache: Path | None,
    only: Sequence[str] = (),
    steps: Steps | None = None,
) -> list[Report]:
    """Run `reproduce` for one paper or for all; `only` may name claims as PAPER/CLAIM."""
    chosen = check_papers(paper, only)
    return [reproduce(name, cache=cache, only=ids, steps=steps) for name, ids in chosen.items()]


def check_papers(paper: str | None, only: Sequence[str] = ()) -> dict[str, list[str]]:
    """Return the papers to measure, each with the requested claims (empty: all).

    Without a paper, a claim's name without prefix is searched in all papers. Raises InputError for
    unknown papers or claims.
    """
    if paper is not None:
        _choose(load_claims(paper), only)
        return {paper: list(only)}
    files = {name: load_claims(name) for name in list_papers()}
    if not only:
        return {name: [] for name in files}
    out: dict[str, list[str]] = {}
    for asked in only:
        where, slash, bare = asked.rpartition("/")
        if slash and where not in files:
            raise InputError(f"unknown paper {where!r}; valid: {neighbours(where, files)}")
        found = [n for n in files if not slash or n == where]
        found = [n for n in found if bare in [c.id for c in files[n].claims]]
        if not found:
            valid = [f"{n}/{c.id}" for n in files for c in files[n].claims]
            raise InputError(f"unknown claim {asked!r}; valid: {neighbours(asked, valid)}")
        for name in found:
            out.setdefault(name, []).append(bare)
    return {name: out[name] for name in files if name in out}


def reproduce(
    paper: str,
    *,
    cache: Path | None,
    only: Sequence[str] = (),
    steps: Steps | None = None,
    fly: Callable[..., Record] = fly_case,
) -> Report:
    """Measure the claims of a paper, those in `only` or all; flights are taken from `cache` if
    present.

    A flight that is refused or fails affects only the claims that need it. Raises InputError for
    unknown papers or claims.
    """
    file = load_claims(paper)
    claims = _choose(file, only)
    store = Cache(cache)
    steps = steps or Steps()
    needed = [name for name in file.cases if any(name in c.cases.values() for c in claims)]
    flights = [(n, s) for n in needed for s in file.cases[n].seeds]
    records: dict[str, list[Record]] = {}
    failed: dict[str, str] = {}
    counts = [0, 0]
    steps.begin(len(flights))
    try:
        for name, seed in flights:
            if name in failed:
                continue
            try:
                record, cached = _get(file.cases[name], seed, store, steps, name, fly)
            except Exception as error:  # one broken flight must not affect other claims
                failed[name] = _refusal(name, file.cases[name], error)
                continue
            counts[cached] += 1
            records.setdefault(name, []).append(record)
    finally:
        steps.close()
        store.prune()
    results = [_measure(file, claim, records, failed) for claim in claims]
    notes = [store.trouble] if store.trouble else []
    return Report(file, results, counts[0], counts[1], notes)


def _choose(file: ClaimsFile, only: Sequence[str]) -> list[Claim]:
    names = [c.id for c in file.claims]
    wanted = [
        name.removeprefix(f"{file.paper.id}/")
        for name in only
        if "/" not in name
        or name.startswith(f"{file.paper.id}/")
        or name.split("/")[0] not in list_papers()
    ]  # claims of other papers are measured there
    for name in wanted:
        if name not in names:
            raise InputError(
                f"unknown claim {name!r} of {file.paper.id}; valid: {neighbours(name, names)}"
            )
    return [c for c in file.claims if not wanted or c.id in wanted]


def _get(
    case: Case, seed: int, store: Cache, steps: Steps, name: str, fly: Callable[..., Record]
) -> tuple[Record, bool]:
    description = build_description(case, seed)
    content = describe_content(case, description)
    record = store.load(content)
    label = f"{name}, seed {seed}" if len(case.seeds) > 1 else name
    steps.step(label, record is not None)
    if record is not None:
        return record, True
    record = fly(case, description)
    store.store(content, record)
    return record, False


def _refusal(name: str, case: Case, error: Exception) -> str:
    needs = f" (it needs {case.needs})" if case.needs and isinstance(error, InputError) else ""
    return f"the flight {name!r} could not be flown{needs}: {_tell(error)}"


def _tell(error: Exception) -> str:
    """Format an error; for an error of the program, with its location."""
    if isinstance(error, SkywrightError):
        return str(error)
    if os.environ.get("SKYWRIGHT_DEBUG"):
        raise error
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})"


def _measure(
    file: ClaimsFile, claim: Claim, records: dict[str, list[Record]], failed: dict[str, str]
) -> ClaimResult:
    trouble = next((failed[c] for c in claim.cases.values() if c in failed), "")
    measured = Measured({}, None)
    if not trouble:
        roles: Records = _Roles({role: records[case] for role, case in claim.cases.items()})
        try:
            measured = MEASURES[claim.measure](roles)
        except Exception as error:
            trouble = f"could not be measured: {_tell(error)}"
    verdict = judge(claim, measured.values)
    tests = [
        CriterionResult(test, measured.values.get(test.quantity), passed)
        for test, passed in zip(claim.tests, verdict.passed, strict=True)
    ]
    why = trouble or _explain(claim, verdict.name, measured.values) + _tell_cut_short(
        claim, records
    )
    return ClaimResult(
        file.paper.id, claim, verdict.name, why, tests, measured.values, measured.figure, trouble
    )


class _Roles(dict[str, list[Record]]):
    """Flights by the role that a measure requests."""

    def __missing__(self, role: str) -> list[Record]:
        given = ", ".join(self) or "none"
        raise InputError(f"the measure requires the case {role!r}; the claim gives: {given}")


def _tell_cut_short(claim: Claim, records: dict[str, list[Record]]) -> str:
    """Return a text about flights that were not completed: the value covers only a part of them."""
    short = [
        f"{case!r} {record.info['outcome']} ({record.info.get('reason') or 'no reason given'})"
        for case in dict.fromkeys(claim.cases.values())
        for record in records[case]
        if record.info.get("outcome") in ("aborted", "diverged", "interrupted")
    ]
    return f" Measured on a part of the flight: {'; '.join(short)}." if short else ""


def _explain(claim: Claim, verdict: str, values: dict[str, float]) -> str:
    """Format the claim's explanation of this verdict with the measured values. For a met claim with
    flags, the reasons of the flags come first.
    """
    text: str = getattr(claim.why, verdict)
    if verdict == "not_comparable" and claim.flags and claim.tests[0].quantity in values:
        text = " ".join([*claim.flags.values(), text or claim.why.reproduced])
    if not text:
        return f"The claim's file explains no verdict {verdict!r}."
    missing = [n for n in re.findall(r"{(\w+)", text) if n not in values]
    for name in missing:
        text = re.sub(rf"{{{name}[^}}]*}}", "?", text)
    return text.format(**values)
