"""What a flight said about the flaws that are really there: data for a probability of detection.

A mission kind fills it with truth (`MissionKind.inspected`); nothing on the robot's side sees it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple


class InspectedFlaw(NamedTuple):
    """One flaw of the world that the mission was asked to pass over."""

    name: str
    sizes: dict[str, float]
    """True measures with their unit in the name, such as depth_mm; the first is the usual one."""
    hit: bool
    """Whether an indication was reported at its place."""
    contact: bool
    """Whether the probe was where the flaw is, within its tolerances, in at least one pass."""
    signal: float | None = None
    """Largest signal at the flaw in the instrument's units, reported or not; None: none read."""
    conditions: dict[str, float] = {}
    """What detection may depend on at this place, such as gap_mm."""


class Inspected(NamedTuple):
    """The flaws of a flight, and the places without a flaw."""

    flaws: tuple[InspectedFlaw, ...]
    sites: int = 0
    """Places without a flaw that were inspected."""
    calls: int = 0
    """Of these, places with an indication: false calls."""
    site: str = ""
    """What a place is, such as "30 mm of path"."""

    def to_json(self) -> dict[str, Any]:
        """Return plain JSON; numbers that are not finite become None."""

        def plain(values: dict[str, float]) -> dict[str, float | None]:
            return {k: v if math.isfinite(v) else None for k, v in values.items()}

        return {
            "flaws": [
                f._asdict() | {"sizes": plain(f.sizes), "conditions": plain(f.conditions)}
                for f in self.flaws
            ],
            "sites": self.sites, "calls": self.calls, "site": self.site,
        }  # fmt: skip


def read_inspected(data: dict[str, Any]) -> Inspected:
    """Return what `Inspected.to_json` wrote. Raises KeyError and TypeError where it is not that."""

    def numbers(values: dict[str, float | None]) -> dict[str, float]:
        return {k: math.nan if v is None else float(v) for k, v in values.items()}

    flaws = [
        InspectedFlaw(**{
            **one, "sizes": numbers(one["sizes"]), "conditions": numbers(one["conditions"])
        })
        for one in data["flaws"]
    ]  # fmt: skip
    return Inspected(tuple(flaws), data["sites"], data["calls"], data["site"])
