"""Result of a command, and the handle of a command in execution."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from skywright.vehicle.arm_commands import ArmCommand
from skywright.vehicle.commands import Command


class Result(NamedTuple):
    """Result of a command. It is true if the command succeeded."""

    ok: bool
    reason: str = ""  # why not, or what ended it
    t_s: float = 0.0  # mission time at which it ended

    def __bool__(self) -> bool:
        return self.ok


class Handle:
    """A command that was given: `done`, `result`, `wait()`. It is true unless it failed."""

    def __init__(self, command: Command | ArmCommand, tick: Callable[[], object]) -> None:
        self.command, self._tick = command, tick
        self.result: Result | None = None
        """None while it is under way."""

    @property
    def done(self) -> bool:
        """Whether it has ended, in one way or another."""
        return self.result is not None

    def end(self, result: Result) -> None:
        """Set the result; the first one remains."""
        if self.result is None:
            self.result = result

    def wait(self) -> Result:
        """Fly until it has ended; returns how."""
        while self.result is None:
            self._tick()
        return self.result

    def __bool__(self) -> bool:
        return self.result is None or self.result.ok

    def __repr__(self) -> str:
        how = "under way" if self.result is None else self.result.reason or "succeeded"
        return f"<{self.command}: {how}>"
