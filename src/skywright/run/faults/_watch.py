"""Evaluates all rules in every mission tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from skywright.core.find import explain
from skywright.errors import SkywrightError
from skywright.run.faults._rule import RESPONSES, Acted, Response, Rule
from skywright.run.faults._senses import Senses

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

RANK = {name: k for k, name in enumerate(RESPONSES)}
MOST = 1e9
"""Replaces an infinite value, which JSON cannot represent."""


class RuleActed(Exception):
    """Raised when a rule ends the mission and its response must be flown."""

    def __init__(self, rule: Rule, acted: Acted) -> None:
        super().__init__(acted.says)
        self.rule, self.acted = rule, acted


class Watch:
    """The rules of one run, and those that acted."""

    def __init__(
        self, rules: Sequence[Rule], senses: Senses, on_acted: Callable[[Acted], None] | None = None
    ) -> None:
        """`on_acted` is called as soon as the response is chosen."""
        self.rules = [r for r in rules if r.table.on]
        self.senses, self._on_acted = senses, on_acted
        self._begun: list[Rule] = []
        self._ticks = 0
        self._forget()

    def _forget(self) -> None:
        self.acted: list[Acted] = []
        self.rank = -1  # of the response that is flown now
        self.told: set[str] = set()  # rules reported to the pilot
        self._before = -1  # rank before the last rule acted
        self._repaired: set[tuple[str, int]] = set()  # rules with a repair, and parts, that acted

    def begin(self, airborne: bool) -> None:
        """Activate the rules for take-off, or all rules if the robot is `airborne`."""
        for rule in self.rules:
            if rule not in self._begun and (airborne or rule.from_take_off):
                try:
                    rule.begin(self.senses)
                except Exception as error:
                    self._note(rule, error)
                self._begun.append(rule)

    def land(self) -> None:
        """Called when the robot lands: only the rules from take-off stay active."""
        self._end([rule for rule in self.rules if not rule.from_take_off])

    def reset(self) -> None:
        """Called between two flights: all rules begin again in the next one, and none has acted."""
        self._end(self.rules)
        self._forget()

    def _end(self, rules: Sequence[Rule]) -> None:
        """Replace rules by new ones, whose baselines and hold times are those of their next use."""
        self.rules = [type(r)(r.name, r.table) if r in rules else r for r in self.rules]
        self._begun = [rule for rule in self._begun if rule not in rules]

    def answer(self, rule: Rule, s: Supervisor) -> Response:
        """Call `repair` of the rule that acted last; returns the response to fly.

        It is never weaker than the response that was flown before.
        """
        self._repaired.add((rule.name, rule.part))
        response: Response = rule.table.response
        try:
            response = rule.repair(s)
            if response not in RANK:
                raise ValueError(f"repair returned {response!r}; valid: {', '.join(RANK)}")
        except RuleActed:
            raise
        except Exception as error:
            self._note(rule, error)
            response = rule.table.response
        self.rank = max(RANK[response], self._before)
        response = list(RANK)[self.rank]
        self.acted[-1] = self.acted[-1]._replace(response=response)
        if self._on_acted is not None:
            self._on_acted(self.acted[-1])
        return response

    def bears(self, says: str) -> bool:
        """Whether a rule responds to the failure `says` of the robot's computer in the air."""
        falls = self.rank == RANK["let_go"]
        if not falls and not any(rule.answers_failed_computer for rule in self._begun):
            return False
        if not falls and self.senses.reference["active"] < 0.5:
            return False
        self.senses.failure = says
        return True

    def look(self, phase: str) -> None:
        """Evaluate all rules; raises RuleActed for the one with the strongest response."""
        if not self._begun or self.senses.told("active") < 0.5:
            return
        self._ticks += 1
        senses, over, tick = self.senses, list[Rule](), self._ticks
        for rule in self._begun:
            if tick % rule.every and not senses.failure:
                continue
            try:
                acts = bool(rule.failure) or rule.is_over(senses)
            except Exception as error:
                self._note(rule, error)
                acts = True
            answers = RANK[rule.table.response] > self.rank or self._must_repair(rule)
            if acts and answers and rule.name not in self.told:
                over.append(rule)
        if over:
            self._act(max(over, key=lambda r: RANK[r.table.response]), phase)

    def tell(self, phase: str) -> None:
        """Evaluate all rules while a pilot flies: each is reported once, and none ends the mission.

        Rules that override the pilot are the exception: the robot no longer follows the stick.
        """
        try:
            self.look(phase)
        except RuleActed as acted:
            if acted.rule.overrides_pilot:
                raise
            self.rank, self.senses.responding = self._before, self._before >= 0
            self.acted.pop()
            self.told.add(acted.rule.name)
            if self._on_acted is not None:
                self._on_acted(acted.acted._replace(response="told"))

    def let_go(self, says: str) -> None:
        """Replace the response that is flown by the fall of a robot without motors.

        Raises RuleActed, for the code that flies the response.
        """
        rule = Rule("flight_termination", Rule.Table(response="let_go"))
        rule.value, rule.failure = 1.0, says
        self._act(rule, "")

    def rise(self, response: Response, flown: Response | None) -> Response:
        """Return the stronger of two responses and make it the active one."""
        if flown is not None and RANK[flown] > RANK[response]:
            response = flown
        self.rank, self.senses.responding = RANK[response], True
        return response

    def _must_repair(self, rule: Rule) -> bool:
        """Whether the rule has a repair that has not run for its part.

        Rank decides which response is flown, not whether a repair runs: without a lost rotor given
        up, for example, no response can be flown.
        """
        repairs = type(rule).repair is not Rule.repair
        return repairs and (rule.name, rule.part) not in self._repaired

    def _act(self, rule: Rule, phase: str) -> None:
        self._before = self.rank
        self.rank, self.senses.responding = max(RANK[rule.table.response], self.rank), True
        value = min(rule.value, MOST) if math.isfinite(rule.value) or rule.value > 0.0 else 0.0
        try:
            says = rule.failure or rule.explain(rule.value)
        except Exception as error:
            self._note(rule, error)
            says = rule.failure
        t, table = self.senses.t, rule.table
        says = f"{says} in {phase or 'the flight'} at t = {t:.1f} s"
        if rule.shows_control and (noise := self.senses.explain_noise()):
            says = f"{says}: {noise}"
        acted = Acted(rule.name, t, float(value), table.limit, rule.unit, table.response, says)
        self.acted.append(acted)
        raise RuleActed(rule, acted)

    def _note(self, rule: Rule, error: Exception) -> None:
        """Treat a user's rule that raised as one that acts; re-raise errors of built-in rules."""
        cls = type(rule)
        if cls.__module__.startswith("skywright.") or isinstance(error, SkywrightError):
            raise error
        rule.failure = f"rule {rule.name} ({cls.__qualname__}) failed: {explain(error)}"
