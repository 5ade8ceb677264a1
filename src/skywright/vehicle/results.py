"""Result of a command, and handle of a command in execution."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from skywright.vehicle.arm_commands import ArmCommand
from skywright.vehicle.commands import Command


class Result(NamedTuple):
    """Result of a command. It is true if the command succeeded."""

    ok: bool
    reason: str = ""  # of a failure, or of the end
    t_s: float = 0.0  # mission time at which it ended

    def __bool__(self) -> bool:
        return self.ok


class Handle:
    """Handle of a command: `done`, `result`, `wait()`. It is true unless the command failed."""

    def __init__(self, command: Command | ArmCommand, tick: Callable[[], object]) -> None:
        self.command, self._tick = command, tick
        self.result: Result | None = None
        """None during the execution."""

    @property
    def done(self) -> bool:
        """Whether the command has ended, with success or not."""
        return self.result is not None

    def end(self, result: Result) -> None:
        """Set the result; later calls have no effect."""
        if self.result is None:
            self.result = result

    def wait(self) -> Result:
        """Advance the vehicle until the command has ended; returns the result."""
        while self.result is None:
            self._tick()
        return self.result

    def __bool__(self) -> bool:
        return self.result is None or self.result.ok

    def __repr__(self) -> str:
        how = "under way" if self.result is None else self.result.reason or "succeeded"
        return f"<{self.command}: {how}>"
