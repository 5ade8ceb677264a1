"""A hand wheel on a post, as a thing of a world: the example of docs/howto/your-own-thing.md.

[world.things.wheel]
kind = "hand_wheel.py:HandWheel"
x_m = 1.5
y_m = 0.0
z_m = 1.2
"""

from __future__ import annotations

import math

from pydantic import Field

from skywright.core.rotations import rot_y
from skywright.core.spec import NonNegative, Positive
from skywright.description.world.thing import Frame, Joint, Part, Placed, Solid, build_frame

FACING = rot_y(-0.5 * math.pi)  # the wheel's axis, its z, looks along -x


class HandWheel(Placed):
    """A valve's wheel of spokes and a knob; O is its hub, its axis looks along -x."""

    diameter_m: Positive = 0.3
    mass_kg: Positive = 0.5  # of the wheel
    friction_nm: NonNegative = 0.2  # of the valve's stem
    turns: float = Field(default=2.0, gt=0, le=20)  # from closed to open

    def list_parts(self) -> list[Part]:
        """The post, fixed, and the wheel, on its hinge."""
        r, height = 0.5 * self.diameter_m, 0.5 * self.z_m
        post = Solid("cylinder", [0.03, height], frame=build_frame(x=0.1, z=-height))
        spokes = [
            Solid("capsule", [0.01], f"spoke {k}", mass_kg=0.2 * self.mass_kg,
                  ends=((0.0, 0.0, 0.0), (r * math.cos(a), r * math.sin(a), 0.0)))
            for k, a in enumerate(0.5 * math.pi * k for k in range(4))
        ]  # fmt: skip
        knob = Solid("sphere", [0.02], "knob", build_frame(x=r, z=0.04), 0.2 * self.mass_kg)
        stem = Joint("hinge", (0.0, 0.0, 1.0), 0.0, 2.0 * math.pi * self.turns,
                     friction=self.friction_nm)  # fmt: skip
        return [
            Part([post]),
            Part([*spokes, knob], stem, "rim", build_frame(R=FACING)),
        ]

    def list_frames(self) -> dict[str, Frame]:
        """`knob`, where a hand takes hold while the valve is closed."""
        return {"knob": build_frame(z=0.5 * self.diameter_m, x=-0.04)}

    def describe(self) -> str:
        """Its size, for `skywright show`."""
        return f"hand wheel of {self.diameter_m:g} m, {self.turns:g} turns"
