"""Mass and inertia of a bar held by both hands, and of the half that each hand carries."""

from typing import Any

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.bar import Bar
from skywright.errors import InputError

BESIDE = 1e-3
"""m, largest distance of the right hand from the bar's axis: the lining of the fingers."""


def compute_bar_inertia(bar: Bar) -> Array:
    """Return the inertia (3, 3) kg m^2 of a cylinder along y about its centre."""
    across = bar.mass_kg * (bar.length_m**2 / 12 + bar.diameter_m**2 / 16)
    return np.diag([across, bar.mass_kg * bar.diameter_m**2 / 8, across])


def compute_bar_share(bar: Bar, separation: float) -> tuple[float, Array]:
    """Return mass (kg) and inertia (3, 3) kg m^2, about the hand, of the half that a hand carries.

    Two such halves, at hands `separation` (m) apart, have the mass and inertia of the bar if both
    arms have the same angles.
    """
    half = 0.5 * bar.mass_kg
    lever = 0.5 * separation
    own = 0.5 * compute_bar_inertia(bar) - half * lever**2 * np.diag([1.0, 0.0, 1.0])
    return half, own


def compute_span(k: Any) -> float:
    """Return the distance (m) of the hands; `k` is a Kinematics record."""
    between = k["p_BH"][0] - k["p_BH"][1]
    return round(float(np.linalg.norm(between)), 9)  # 0.3, not 0.3 + 1e-17: equal recordings


def check_bar_span(name: str, working: Any, folded: Any) -> None:
    """Raise InputError if a bar along y of the left hand misses the right hand.

    `working` and `folded` are the Kinematics records of these postures.
    """
    span = compute_span(working)
    for which, k in (("working", working), ("folded", folded)):
        on_bar = k["p_BH"][0] - span * k["R_BH"][0][:, 1]
        off = float(np.linalg.norm(k["p_BH"][1] - on_bar))
        if off > BESIDE:
            raise InputError(
                f"robot {name!r}: [robot.arm.bar] is along y of the left hand and {span:.3f} m "
                f"long between the hands; in the {which} posture it misses the right hand by "
                f"{1e3 * off:.0f} mm; valid: at most {1e3 * BESIDE:g} mm: choose {which}_deg of "
                "the joints such that the hands are opposite each other, as far apart as in the "
                "working posture"
            )
