"""The slowest localisation that a mission may fly by: what its own rules would not bear."""

from __future__ import annotations

from typing import Any

from skywright.run.kind import load_kind
from skywright.run.parts import build_rules
from skywright.run.setup import Setup

TOUCHING = frozenset({"probe", "hands"})
"""What kinds need whose robots touch something."""


def find_slow_localisation(setup: Setup[Any]) -> str | None:
    """Say that places are told less often than a rule of the mission bears, or return None.

    A total station has no rate of its own here: a tracking camera tells places in between.
    """
    d = setup.description
    table = getattr(d.world, d.world.localisation, None)
    if table is None:
        return None
    period, touches = 1.0 / table.rate_hz, bool(load_kind(d.mission.kind).needs & TOUCHING)
    for rule in build_rules(d):
        bears = rule.bear_period(touches)
        if 0.0 < bears <= period:
            return (
                f"localisation is too slow: world.{d.world.localisation}.rate_hz = "
                f"{table.rate_hz:g} gives a position every {period:.2g} s; the period must "
                f"be below {bears:g} s (mission.faults.{rule.name}.limit), a rate above "
                f"{1.0 / bears:g} Hz"
            )
    return None
