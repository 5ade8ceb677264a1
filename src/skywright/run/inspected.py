"""Detection results of a flight for the true flaws: data for a probability of detection.

A mission kind fills it from the truth (`MissionKind.inspected`); the robot's side does not read it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple


class InspectedFlaw(NamedTuple):
    """One flaw of the world that the mission was asked to inspect."""

    name: str
    sizes: dict[str, float]
    """True dimensions with their unit in the name, such as depth_mm; the first is the usual one."""
    hit: bool
    """Whether an indication was reported at its position."""
    contact: bool
    """Whether the probe covered the flaw, within its tolerances, in at least one pass."""
    signal: float | None = None
    """Largest signal at the flaw in the instrument's units, reported or not; None: none read."""
    conditions: dict[str, float] = {}
    """Quantities on which detection may depend at this position, such as gap_mm."""


class Inspected(NamedTuple):
    """The flaws of a flight, and the sites without a flaw."""

    flaws: tuple[InspectedFlaw, ...]
    sites: int = 0
    """Sites without a flaw that were inspected."""
    calls: int = 0
    """Of these, sites with an indication: false calls."""
    site: str = ""
    """Definition of a site, such as "30 mm of path"."""

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
    """Parse the result of `Inspected.to_json`. Raises KeyError and TypeError for other data."""

    def numbers(values: dict[str, float | None]) -> dict[str, float]:
        return {k: math.nan if v is None else float(v) for k, v in values.items()}

    flaws = [
        InspectedFlaw(**{
            **one, "sizes": numbers(one["sizes"]), "conditions": numbers(one["conditions"])
        })
        for one in data["flaws"]
    ]  # fmt: skip
    return Inspected(tuple(flaws), data["sites"], data["calls"], data["site"])
