"""Format of a claims file, and evaluation of its claims."""

from __future__ import annotations

from string import Formatter
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from skywright.errors import neighbours

Sense = Literal["<", "<=", ">", ">=", "=="]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Paper(_Strict):
    """A source paper."""

    id: str
    short: str  # as in "Tognon 2018"
    title: str
    reference: str


class Case(_Strict):
    """A flight, or a family of flights, that claims may share."""

    kind: Literal["mission", "tap", "bump", "press", "hover", "lean"] = "mission"
    mission: str = "pipe-weld-scan"
    robot: str = ""  # default: the mission's
    sets: dict[str, Any] = {}
    seeds: list[int] = Field(default=[1], min_length=1)
    needs: str = ""  # stated if the flight is refused
    # tap: an impulse on the probe at the stand-off, for each of these gains
    gain: Literal["position_n_per_m", "arm_per_s"] = "position_n_per_m"
    gains: list[float] = []
    # bump: the last touch, at each of these mean speeds
    speeds_mps: list[float] = []
    # press: a hand against a box, platform clamped, with the estimator in `sets`
    pose: Literal["L", "stretched"] = "L"
    direction: Literal["up", "forward"] = "up"
    # hover: the tip holds its position at each of these mean wind speeds (gusty)
    winds_mps: list[float] = []
    # lean: these forces pull the left hand back in turn, platform clamped, link free
    forces_n: list[float] = []

    @model_validator(mode="after")
    def _complete(self) -> Case:
        if self.kind == "tap" and not self.gains:
            raise ValueError("kind = 'tap' needs gains")
        if self.kind == "bump" and not self.speeds_mps:
            raise ValueError("kind = 'bump' needs speeds_mps")
        if self.kind == "hover" and not self.winds_mps:
            raise ValueError("kind = 'hover' needs winds_mps")
        if self.kind == "lean" and not self.forces_n:
            raise ValueError("kind = 'lean' needs forces_n")
        return self


class Criterion(_Strict):
    """A measured quantity against a bound. `==` and printed values use the tolerance."""

    quantity: str
    unit: str = ""
    sense: Sense = "<="
    paper_value: float | None = None  # as printed; None if the paper prints no number
    tolerance: float | None = Field(default=None, ge=0)  # around the printed value or bound
    bound: float | None = None  # interpretation of the paper's words, if it prints no number
    reading: str = ""  # how the bound follows from the words

    @property
    def limit(self) -> float | None:
        """Limit of the value; None without a comparison."""
        return self.paper_value if self.bound is None else self.bound

    @property
    def whose(self) -> Literal["paper", "ours", ""]:
        """Origin of the limit: a printed number is the paper's, an interpretation is ours."""
        if self.limit is None:
            return ""
        return "paper" if self.bound is None else "ours"


def _check_format(text: str) -> str:
    """Raise ValueError for a text into which no measured value can be written."""
    for _, name, form, conversion in Formatter().parse(text):
        if name is not None:
            if not name.isidentifier() or conversion:
                raise ValueError(f"{{{name}}}: the name of a measured quantity is needed")
            format(0.0, form or "")
    return text


class Why(_Strict):
    """Explanation of each verdict; `{quantity:.2f}` is replaced by the measured value."""

    reproduced: str = ""
    contradicted: str = ""
    not_comparable: str = ""

    _formats = field_validator("*")(_check_format)


class Claim(_Strict):
    """A statement of a paper that flights can confirm or contradict."""

    id: str
    where: str  # section and figure
    statement: str
    judged_by: Literal["flight", "bench", "computation"]  # bench: the platform is clamped
    by_construction: str = ""  # why the inputs determine the verdict
    fitted: str = ""  # which number was chosen from the figure of the comparison
    measure: str  # name in `measures.MEASURES`
    cases: dict[str, str] = {}  # role that the measure requests -> case
    tests: list[Criterion] = Field(min_length=1)  # the first one gives the claim's value
    why: Why = Why()

    _formats = field_validator("by_construction", "fitted")(_check_format)

    @property
    def flags(self) -> dict[str, str]:
        """Reasons why a met claim does not count as reproduced."""
        found = {"by_construction": self.by_construction, "fitted": self.fitted}
        return {name: reason for name, reason in found.items() if reason}


class ClaimsFile(_Strict):
    """A paper with its cases and claims."""

    paper: Paper
    sets: dict[str, Any] = {}  # for every case; the case's own have priority
    cases: dict[str, Case] = {}
    claims: list[Claim]

    @model_validator(mode="after")
    def _share_sets(self) -> ClaimsFile:
        for name, case in self.cases.items():
            self.cases[name] = case.model_copy(update={"sets": {**self.sets, **case.sets}})
        return self

    @model_validator(mode="after")
    def _names_exist(self) -> ClaimsFile:
        seen = set()
        for claim in self.claims:
            if claim.id in seen:
                raise ValueError(f"two claims are called {claim.id!r}")
            seen.add(claim.id)
            for case in claim.cases.values():
                if case not in self.cases:
                    raise ValueError(
                        f"claim {claim.id!r} names the case {case!r}; "
                        f"valid: {neighbours(case, self.cases)}"
                    )
        return self


class Verdict(NamedTuple):
    """Result of a claim; `passed` is None without a comparison."""

    name: Literal["reproduced", "contradicted", "not_comparable"]
    passed: list[bool | None]  # one per test


def judge(claim: Claim, values: dict[str, float]) -> Verdict:
    """Compare the measured values with a claim's tests.

    The claim is not comparable if the first quantity was not measured or has no limit, and if a
    claim with flags is met. It is reproduced if every other test passes. A missing or NaN quantity
    does not pass.
    """
    first = claim.tests[0]
    if first.limit is None or first.quantity not in values:
        return Verdict("not_comparable", [None] * len(claim.tests))
    passed = [_passes(test, values.get(test.quantity, float("nan"))) for test in claim.tests]
    if False in passed:
        return Verdict("contradicted", passed)
    return Verdict("not_comparable" if claim.flags else "reproduced", passed)


def _passes(test: Criterion, value: float) -> bool | None:
    limit, tolerance = test.limit, test.tolerance or 0.0
    if limit is None:
        return None  # reported only
    if test.sense == "==":
        return abs(value - limit) <= tolerance
    if test.sense in ("<", "<="):
        return value < limit + tolerance if test.sense == "<" else value <= limit + tolerance
    return value > limit - tolerance if test.sense == ">" else value >= limit - tolerance
