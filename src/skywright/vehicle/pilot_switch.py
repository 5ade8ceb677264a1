"""A pilot's switch outside Skywright: what a back end whose vehicle has one overrides."""

from __future__ import annotations

from collections.abc import Callable


class NoPilotSwitch:
    """A back end that nobody takes over behind Skywright's back."""

    piloted = False
    """Whether a pilot flies by the vehicle's own controls."""
    stopped = ""
    """Why the motors stand although nothing here stopped them, "" otherwise."""

    def take_control(self) -> str:
        """Take the platform back from a pilot; returns why not, or ""."""
        return ""

    def give_control(self) -> str:
        """Give the platform to a pilot; returns why not, or ""."""
        return ""

    def on_say(self, say: Callable[[str], None]) -> None:
        """Tell what happens to `say`, one line each."""

    def close(self) -> None:
        """End the connection to the vehicle."""
