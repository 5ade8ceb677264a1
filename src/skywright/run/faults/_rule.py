"""Base class of fault rules: everything that the author of a rule imports."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from skywright.core.spec import NonNegative, Spec

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor

Response = Literal["hold", "come_home", "land_here", "let_go"]
RESPONSES: dict[Response, str] = {
    "hold": "retreat from the contact and hover until the value is within its limit, for 30 s at "
    "most, then return home",
    "come_home": "retreat from the contact, return along the flown path and land at the start",
    "land_here": "retreat from the contact and land in place",
    "let_go": "stop the motors and fall",
}
"""The responses, mildest first: while one is flown, only a stronger one may replace it."""


LET_GO = "let go"
"""Phase of a robot whose motors a fault rule has stopped in the air."""


class Acted(NamedTuple):
    """A rule that acted."""

    rule: str
    t_s: float
    value: float
    limit: float
    unit: str
    response: str
    says: str


class Rule:
    """Base class of rules: `Table` with defaults, `watches`, `unit` and `look`."""

    group: ClassVar[str] = "rule"
    watches: ClassVar[str] = ""
    """The monitored value, for the documentation."""
    unit: ClassVar[str] = ""
    source: ClassVar[str] = ""
    """Source of the limit."""
    from_take_off: ClassVar[bool] = False
    """Whether it is active from the start of the motors; otherwise from the end of take-off."""

    shows_control: ClassVar[bool] = False
    """Whether the rule acts if the platform does not follow the law. A noisy gyroscope may be the
    cause; the reason then states it."""

    every: ClassVar[int] = 5
    """Mission ticks (20 ms) between evaluations."""

    answers_failed_computer: ClassVar[bool] = False
    """Whether the rule acts if a step of the robot's computer failed (`Senses.failure`)."""

    overrides_pilot: ClassVar[bool] = False
    """Whether the rule also acts while a pilot flies, because the robot no longer follows the
    stick. All other rules only report then."""

    class Table(Spec):
        """Keys of `[mission.faults.NAME]`."""

        on: bool = True
        limit: NonNegative = 0.0  # in the rule's unit
        hold_s: NonNegative = 0.0
        response: Response = "come_home"

    def __init__(self, name: str, table: Any = None) -> None:
        self.name = name
        self.table: Any = self.Table() if table is None else table
        self.value = math.nan  # newest
        self.failure = ""  # error of the rule's own code
        self.part = 0  # rotor or joint at fault, for rules that watch several
        self._since: float | None = None

    def begin(self, v: Senses) -> None:
        """Called after take-off: store the values that are normal in this flight."""

    def look(self, v: Senses) -> float:
        """Return the present value; NaN if there is none."""
        raise NotImplementedError

    def explain(self, value: float) -> str:
        """Return the reason for the end of the mission; by default it states value and limit."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name.replace('_', ' ')} {value:.3g}{unit}, limit {self.table.limit:g}{unit}"

    def repair(self, s: Supervisor) -> Response:
        """Called when the rule acts, before the response; returns the response to fly.

        A rule with its own repair acts once for each `part` also while an equal or stronger
        response is flown: the robot may need the repair to fly that response.
        """
        response: Response = self.table.response
        return response

    def bear_period(self, touches: bool) -> float:
        """Return the longest time (s) between position fixes that the rule tolerates.

        `touches`: whether the mission touches something."""
        return math.inf

    def is_over(self, v: Senses) -> bool:
        """Whether the value has been beyond the limit for the hold time."""
        value = self.value = self.look(v)
        if not value > self.table.limit:  # false for NaN
            self._since = None
            return False
        if self._since is None:
            self._since = v.t
        return v.t - self._since >= self.table.hold_s - 1e-9


class Follow:
    """First-order lag of a vector that is sampled at irregular times."""

    def __init__(self, lag: float) -> None:
        """`lag` (s)."""
        self.lag, self._t = lag, 0.0
        self.value: list[float] | None = None

    def step(self, t: float, x: list[float]) -> list[float]:
        """Update with the sample `x` at time t (s); returns the filtered vector."""
        share, self._t = 1.0 - math.exp(-(t - self._t) / self.lag), t
        before = x if self.value is None else self.value
        self.value = [a + share * (b - a) for a, b in zip(before, x, strict=True)]
        return self.value
