"""Mass and inertia of a bar held by both hands, and of the half that each hand carries."""

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.bar import Bar


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
