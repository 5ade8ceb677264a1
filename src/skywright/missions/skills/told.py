"""Sentences that reports of inspections share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skywright.run.run import RunResult


def name_flight(result: RunResult[Any, Any]) -> str:
    """Return "ROBOT in world W", as a sentence begins."""
    d = result.description
    return f"{d.robot.name} in world {d.world.name}"


def tell_block(reasons: Sequence[str]) -> str:
    """Say what the block showed after the flight; without `reasons` the set-up holds."""
    return f"On the block after the flight: {'; '.join(reasons) or 'the set-up holds'}."
