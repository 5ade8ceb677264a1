"""Sentences that reports of inspections share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skywright.run.result import RunResult


def name_flight(result: RunResult[Any, Any]) -> str:
    """Return "ROBOT in world W" as the subject of a sentence."""
    d = result.description
    return f"{d.robot.name} in world {d.world.name}"


def tell_block(reasons: Sequence[str]) -> str:
    """Return a sentence on the check on the block after the flight; no `reasons`: it passed."""
    return f"On the block after the flight: {'; '.join(reasons) or 'the set-up holds'}."
