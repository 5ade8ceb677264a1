"""PX4's flight modes in HEARTBEAT.custom_mode and MAV_CMD_DO_SET_MODE (px4_custom_mode.h)."""

from __future__ import annotations

from typing import NamedTuple

ARMED, CUSTOM = 128, 1
"""Bits of HEARTBEAT.base_mode."""
STABILIZE, GUIDED, AUTO_BIT, MANUAL_BIT = 16, 8, 4, 64


class Mode(NamedTuple):
    """A mode: main number, and sub-mode number of the automatic ones."""

    main: int
    sub: int = 0

    @property
    def custom(self) -> int:
        """HEARTBEAT.custom_mode."""
        return self.main << 16 | self.sub << 24

    @classmethod
    def read(cls, custom: int) -> Mode:
        """Return the mode of a custom_mode."""
        return cls(custom >> 16 & 0xFF, custom >> 24 & 0xFF)

    def __str__(self) -> str:
        return NAMES.get(self, f"mode {self.main}.{self.sub}")


MANUAL, ALTITUDE, POSITION, ACRO, OFFBOARD, STABILIZED = (Mode(m) for m in (1, 2, 3, 5, 6, 7))
READY, TAKEOFF, HOLD, MISSION, RETURN, LAND = (Mode(4, sub) for sub in range(1, 7))
NAMES = {
    MANUAL: "Manual", ALTITUDE: "Altitude", POSITION: "Position", ACRO: "Acro",
    OFFBOARD: "Offboard", STABILIZED: "Stabilized", READY: "Ready", TAKEOFF: "Takeoff",
    HOLD: "Hold", MISSION: "Mission", RETURN: "Return", LAND: "Land",
}  # fmt: skip
BY_STICK = frozenset({MANUAL, ALTITUDE, POSITION, ACRO, STABILIZED})
"""Modes in which a pilot flies."""
