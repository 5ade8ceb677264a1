"""One sentence for each phase of a mission, for whoever sees it for the first time."""

from skywright.run.kind import load_kind

COMMON = {
    "start": "The estimator runs; the motors are off.",
    "take_off": "The platform climbs to its hover height.",
    "return": "The robot returns to a position above the take-off point.",
    "draw back": "The robot retreats from the contact along the normal, as the operator ordered.",
    "wait for order": "The robot holds until the operator orders retry or next.",
    "manual": "A pilot flies the platform by stick; the arms hold their joints.",
    "rejoin": "The robot flies to the point where the mission continues.",
    "land": "The robot descends until the landing gear touches the ground; then the motors stop.",
}


def explain_phase(kind: str, name: str) -> str:
    """Return what is done in the phase `name` of a mission of a kind, or ""."""
    return load_kind(kind).figures().phases.get(name, COMMON.get(name, ""))
