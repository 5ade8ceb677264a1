"""One sentence for each phase of a mission."""

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
    """Return a description of the phase `name` of a mission kind, or "".

    A key such as "hold *" describes every phase with that prefix ("hold 2", "hold 5 N").
    """
    phases = {**COMMON, **load_kind(kind).figures().phases}
    words = name.split()
    names = [name, *(" ".join([*words[:n], "*"]) for n in range(len(words) - 1, 0, -1))]
    return next((phases[key] for key in names if key in phases), "")
