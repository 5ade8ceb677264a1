"""One sentence for each phase of a mission, for whoever sees it for the first time."""

from __future__ import annotations

from skywright.reports.kinds import load_figures

COMMON = {
    "start": "The estimator runs, the motors stand.",
    "take_off": "The platform rises to its hovering height.",
    "return": "Back over the place of take-off.",
    "land": "Down until the landing gear stands, then the motors stop.",
}


def explain_phase(kind: str, name: str) -> str:
    """Return what is done in the phase `name` of a mission of a kind, or ""."""
    known: dict[str, str] = {**COMMON, **getattr(load_figures(kind), "PHASES", {})}
    return known.get(name, "")
