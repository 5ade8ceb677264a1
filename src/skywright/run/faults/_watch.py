"""Watches all rules in every mission tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skywright.run.faults._rule import RESPONSES, Acted, Response, Rule
from skywright.run.faults._senses import Senses

RANK = {name: k for k, name in enumerate(RESPONSES)}


class RuleActed(Exception):
    """A rule ends the mission: its response is to be flown."""

    def __init__(self, rule: Rule, acted: Acted) -> None:
        super().__init__(acted.says)
        self.rule, self.acted = rule, acted


class Watch:
    """The rules of one run, and which acted."""

    def __init__(
        self, rules: Sequence[Rule], senses: Senses, on_acted: Callable[[Acted], None] | None = None
    ) -> None:
        """`on_acted` is told as soon as it is known what is flown."""
        self.rules = [r for r in rules if r.table.on]
        self.senses, self._on_acted = senses, on_acted
        self.acted: list[Acted] = []
        self.rank = -1  # of the response that is flown now
        self._begun: list[Rule] = []
        self._ticks = 0

    def begin(self, airborne: bool) -> None:
        """Watch from now on: the rules for a take-off, or all, where the robot is `airborne`."""
        for rule in self.rules:
            if rule not in self._begun and (airborne or rule.from_take_off):
                rule.begin(self.senses)
                self._begun.append(rule)

    def land(self) -> None:
        """The robot lands: the ground is met, so only the rules for a take-off go on."""
        self._begun = [rule for rule in self._begun if rule.from_take_off]

    def answer(self, response: Response) -> Response:
        """Take note of the response that is flown to the rule that acted last; returns it."""
        self.rank = RANK[response]
        self.acted[-1] = self.acted[-1]._replace(response=response)
        if self._on_acted is not None:
            self._on_acted(self.acted[-1])
        return response

    def bears(self, says: str) -> bool:
        """Whether a rule answers what `says` that the robot's computer failed, in the air."""
        falls = self.rank == RANK["let_go"]
        if not falls and not any(rule.answers_failed_computer for rule in self._begun):
            return False
        if not falls and self.senses.reference["active"] < 0.5:
            return False
        self.senses.failure = says
        return True

    def look(self, phase: str) -> None:
        """Look at all rules; raises RuleActed for the strongest that acts."""
        if not self._begun or self.senses.reference["active"] < 0.5:
            return
        self._ticks += 1
        tick, all_of_them = self._ticks, bool(self.senses.failure)
        over = [
            rule
            for rule in self._begun
            if (all_of_them or tick % rule.every == 0)
            and rule.is_over(self.senses)
            and RANK[rule.table.response] > self.rank
        ]
        if not over:
            return
        rule = max(over, key=lambda r: RANK[r.table.response])
        self.rank, self.senses.responding = RANK[rule.table.response], True
        t, value = self.senses.t, rule.value
        says = f"{rule.explain(value)} in {phase or 'the flight'} at t = {t:.1f} s"
        acted = Acted(
            rule.name, t, value, rule.table.limit, rule.unit, rule.table.response, says
        )  # fmt: skip
        self.acted.append(acted)
        raise RuleActed(rule, acted)
