"""One sentence for each phase of a mission, for whoever sees it for the first time."""

from skywright.run.kind import load_kind

COMMON = {
    "start": "The estimator runs, the motors stand.",
    "take_off": "The platform rises to its hovering height.",
    "return": "Back over the place of take-off.",
    "land": "Down until the landing gear stands, then the motors stop.",
}


def explain_phase(kind: str, name: str) -> str:
    """Return what is done in the phase `name` of a mission of a kind, or ""."""
    return load_kind(kind).figures().phases.get(name, COMMON.get(name, ""))
