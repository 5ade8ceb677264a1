"""The recorded phases of each visit of a station: a contact may be repeated or left out in it."""

from collections.abc import Sequence

from skywright.run.flight import PhaseRecord
from skywright.run.metrics import BACK
from skywright.run.orders import WAITING

APPROACH, DOCK = "approach", "dock"
"""Phases in which a docked visit and its contact begin."""
FREE_APPROACH, FREE_NEAR = "free approach", "free near"
"""The same in flight."""


def list_visits(phases: Sequence[PhaseRecord], docked: bool) -> list[list[int]]:
    """Return the indices of the phases of each visit, docked or in flight, in the order flown.

    The robot approaches a station once a visit. An approach that goes on after a pilot has flown
    belongs to the same visit, and so do contacts that are repeated from the stand-off. Phases
    before the first approach belong to the first visit.
    """
    approach = APPROACH if docked else FREE_APPROACH
    visits: list[list[int]] = [[]]
    begun = approaching = False
    for i, phase in enumerate(phases):
        if phase.name == approach:
            if begun and not approaching:
                visits.append([])
            begun = approaching = True
        elif phase.name not in BACK:
            approaching = False
        visits[-1].append(i)
    return visits


def is_left_out(phases: Sequence[PhaseRecord]) -> bool:
    """Return whether an order left the contact of a visit with these phases out.

    The robot then waited for an order and began no contact afterwards.
    """
    names = [p.name for p in phases]
    if WAITING not in names:
        return False
    after = names[len(names) - names[::-1].index(WAITING) :]
    return DOCK not in after and FREE_NEAR not in after
