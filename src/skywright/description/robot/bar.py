"""Keys of a bar in a robot's hands: `[robot.arm.bar]`."""

from __future__ import annotations

from skywright.core.spec import Positive, Spec


class Bar(Spec):
    """A straight, uniform bar across the robot that both hands hold, its middle between them."""

    length_m: Positive
    diameter_m: Positive = 0.04
    mass_kg: Positive
