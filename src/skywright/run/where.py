"""The phases in which a metric is measured, to which its limit applies, as text and as samples."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from skywright.run.flight import PhaseRecord


class Where(NamedTuple):
    """The samples in which a metric is measured; metrics select and reports state them."""

    phases: tuple[str, ...] = ()
    """Names; a name that ends in * matches all phases that begin with it."""
    note: str = ""
    """The part of the phases, or what is measured if there are no samples: "end of the phase"."""
    others: bool = False
    """Whether all phases except these are selected."""
    planned: bool = False
    """Whether phases that fly a segment of the plan are selected as well."""
    whole: bool = False
    """Whether interrupted phases are omitted."""

    def find(self, phases: Sequence[PhaseRecord], segments: Container[str] = ()) -> list[int]:
        """Return the indices of the phases; `segments` are the names of those that are planned."""
        found = [
            i
            for i, p in enumerate(phases)
            if any(
                p.name == x or (x[-1:] == "*" and p.name.startswith(x[:-1])) for x in self.phases
            )
            != self.others
            or (self.planned and p.name in segments)
        ]
        return [i for i in found if not (self.whole and phases[i].is_interrupted)]

    def select(
        self, samples: NDArray[Any], phases: Sequence[PhaseRecord], segments: Container[str] = ()
    ) -> NDArray[np.bool_]:
        """Return the mask (n,) of the samples that were taken in the phases."""
        return np.isin(samples["phase"], self.find(phases, segments))

    @property
    def text(self) -> str:
        """The phases in words."""
        names = ", ".join(p.replace("_", " ").replace("*", "…") for p in self.phases)
        one = len(self.phases) == 1 and names[-1:] != "…"
        kind = "all phases except" if self.others else "phase" if one else "phases"
        named = "whole run" if self.phases == ("*",) else f"{kind} {names}" if names else ""
        parts = ("planned segments" if self.planned else "", named, self.note)
        return ", ".join(part for part in parts if part)


WHOLE, FLYING = Where(("*",)), Where(("*",), "while the rotors turn")
ALOFT = Where(("start", "take_off", "land"), others=True)
TRACKED, HELD = Where(("hold*",), planned=True), Where(("hold*",), "ends of passed segments")
PLANNING = Where(note="the plan, before the flight")

COMMON_WHERE: Mapping[str, Where] = {
    "flight.": WHOLE,
    "arm.saturated": WHOLE,
    "estimate.": FLYING,
    "estimate.outage": FLYING._replace(note="during outages of the localisation"),
    **dict.fromkeys(
        ("contact.collisions", "flight.saturated"),
        WHOLE._replace(note="unless hanging arms touch the ground at take-off or landing"),
    ),
    "plan.": PLANNING,
    "position.": TRACKED,
    "platform.tilt_max_deg": TRACKED,
    "position.hold_error_m": HELD,
    "heading.hold_error_deg": HELD,
    "response.": Where(note="after a fault rule acted, while the rotors turn"),
    "position.final_error_m": Where(("hold*",), "the last one"),
}
"""Where the metrics of every kind are measured, by name or by prefix of the name."""


def find_where(name: str, own: Mapping[str, Where]) -> Where:
    """Return where a metric is measured: by the longest key that is a prefix of its name.

    `own` are those of its kind; they precede COMMON_WHERE. An unknown name gives an empty Where.
    """
    known = {"": Where(), **COMMON_WHERE, **own}
    return known[max((k for k in known if name.startswith(k)), key=len)]
