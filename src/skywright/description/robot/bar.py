"""What a robot file may say about a bar in its hands: `[robot.arm.bar]`."""

from __future__ import annotations

from skywright.core.spec import Positive, Spec


class Bar(Spec):
    """A straight, uniform bar that both hands hold, across the robot, its middle between them."""

    length_m: Positive
    diameter_m: Positive = 0.04
    mass_kg: Positive
