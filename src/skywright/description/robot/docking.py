"""Keys of a docking gear: `[robot.docking]`.

A frame on top of the platform whose feet are pressed against a ceiling, so that the structure
supports the robot while its arm works (Sanchez-Cuevas et al. 2020, section 2.3).
"""

from __future__ import annotations

from pydantic import Field

from skywright.core.spec import NonNegative, Positive, Spec


class Docking(Spec):
    """Feet on a circle above the rotors, lined with rubber."""

    mass_kg: Positive
    height_m: Positive  # contact plane above the origin of B
    radius_m: Positive  # of the circle of feet
    feet: int = Field(default=4, ge=3, le=8)
    azimuth_deg: float = 45.0  # of the first foot, from x forward counter-clockwise
    foot_radius_m: Positive = 0.015
    friction: Positive = 0.8  # of the lining on the structure
    stiffness_n_per_m: Positive = 5000.0  # of one foot
    damping_ns_per_m: NonNegative = 50.0
    foot_load_n: NonNegative = 0.5  # least normal force on each foot that counts as docked
