"""Interface to a pilot's switch outside Skywright; back ends of vehicles with one override it."""

from __future__ import annotations

from collections.abc import Callable


class NoPilotSwitch:
    """A back end without a pilot's switch: only Skywright controls the vehicle."""

    piloted = False
    """Whether a pilot flies with the vehicle's own controls."""
    stopped = ""
    """Reason for motors that stopped without a command of Skywright, else ""."""

    def take_control(self) -> str:
        """Take control from a pilot; returns the reason of a failure, or ""."""
        return ""

    def give_control(self) -> str:
        """Give control to a pilot; returns the reason of a failure, or ""."""
        return ""

    def on_say(self, say: Callable[[str], None]) -> None:
        """Report events to `say`, one line each."""

    def close(self) -> None:
        """End the connection to the vehicle."""
