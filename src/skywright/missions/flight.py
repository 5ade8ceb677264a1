"""How a mission went."""

from __future__ import annotations

from typing import NamedTuple


class PhaseRecord(NamedTuple):
    """One phase as it was flown."""

    name: str
    start_s: float
    end_s: float
    outcome: str  # "done", "retry", "failed"


class Flight(NamedTuple):
    """How a mission went."""

    completed: bool
    reason: str  # why it was cut short, or ""
