"""Common code of things that two hooks carry by a round bar."""

import numpy as np

from skywright.core.spec import NonNegative, Positive
from skywright.description.world.thing import (
    SOFT,
    Array,
    Contact,
    Frame,
    Placed,
    Solid,
    build_frame,
)


class Handled(Placed):
    """A movable thing with a handle along its y, above O.

    Its friction applies to all its contacts, independent of the friction of pipe or hook (priority
    2).
    """

    mass_kg: Positive
    friction: NonNegative = 0.5  # with hooks and with the support
    handle_length_m: Positive = 0.45
    handle_diameter_m: Positive = 0.016
    handle_height_m: Positive  # height of the handle's axis above O

    @property
    def movable(self) -> bool:
        """Always movable."""
        return True

    @property
    def contact(self) -> Contact:
        """Soft, with its own friction."""
        return SOFT._replace(friction=self.friction, priority=2)

    @property
    def handle_ends(self) -> tuple[Array, Array]:
        """Ends (3,) m of the handle's axis in O, without its caps: right, left."""
        up = np.array([0.0, 0.0, self.handle_height_m])
        end = np.array([0.0, 0.5 * self.handle_length_m - 0.5 * self.handle_diameter_m, 0.0])
        return up - end, up + end

    def build_handle(self, mass: float) -> Solid:
        """Return the handle as a solid of `mass` (kg)."""
        return Solid(
            "capsule", [0.5 * self.handle_diameter_m], "handle", mass_kg=mass,
            contact=self.contact, color=(0.75, 0.2, 0.2), ends=self.handle_ends,
        )  # fmt: skip

    def list_frames(self) -> dict[str, Frame]:
        """`handle`, the middle of its axis, and `handle.left`, `handle.right`, its ends."""
        right, left = self.handle_ends
        return {
            "handle": build_frame(z=self.handle_height_m),
            "handle.left": build_frame(*left),
            "handle.right": build_frame(*right),
        }
