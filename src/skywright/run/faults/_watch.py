"""Watches all rules in every mission tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skywright.run.faults._rule import RESPONSES, Acted, Response, Rule
from skywright.run.faults._senses import Senses
from skywright.run.faults.computer_failed import ComputerFailed

ROUND = 300
"""Mission ticks after which the turns of the rules are the same again: periods divide it."""
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
        """`on_acted` is told at once."""
        self.rules = [r for r in rules if r.table.on]
        self.senses, self._on_acted = senses, on_acted
        self.acted: list[Acted] = []
        self.rank = -1  # of the response that is flown now
        self._begun: list[Rule] = []
        self._ticks, self._turns = 0, dict[int, list[Rule]]()

    def begin(self, airborne: bool) -> None:
        """Watch from now on: the rules for a take-off, or all, where the robot is `airborne`."""
        for rule in self.rules:
            if rule not in self._begun and (airborne or rule.from_take_off):
                rule.begin(self.senses)
                self._begun.append(rule)
        self._turns.clear()

    def land(self) -> None:
        """The robot lands: the ground is met, so only the rules for a take-off go on."""
        self._begun = [rule for rule in self._begun if rule.from_take_off]
        self._turns.clear()

    def answer(self, response: Response) -> Response:
        """Take note of the response that is flown now; returns it."""
        self.rank = RANK[response]
        return response

    def bears(self, says: str) -> bool:
        """Whether a rule answers what `says` that the robot's computer failed, in the air."""
        falls = self.rank == RANK["let_go"]
        if not falls and not any(isinstance(rule, ComputerFailed) for rule in self._begun):
            return False
        if not falls and self.senses.reference["active"] < 0.5:
            return False
        self.senses.failure = says
        return True

    def _find_due(self) -> list[Rule]:
        """Return the rules whose turn it is; few sizes of period make a table of turns short."""
        turn = self._ticks % ROUND
        if turn not in self._turns:
            self._turns[turn] = [rule for rule in self._begun if turn % rule.every == 0]
        return self._turns[turn]

    def look(self, phase: str) -> None:
        """Look at all rules; raises RuleActed for the strongest that acts."""
        if not self._begun or self.senses.reference["active"] < 0.5:
            return
        self._ticks += 1
        due = self._begun if self.senses.failure else self._find_due()
        over = [rule for rule in due if rule.is_over(self.senses)]
        over = [rule for rule in over if RANK[rule.table.response] > self.rank]
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
        if self._on_acted is not None:
            self._on_acted(acted)
        raise RuleActed(rule, acted)
