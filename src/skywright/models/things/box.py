"""A box: an obstacle, a stand, a table, or with `moves = true` an object to carry."""

import numpy as np

from skywright.core.spec import Positive
from skywright.description.world.thing import Frame, Part, Solid, build_frame
from skywright.models.things._block import Block

_FRONT = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # z outward, along -x


class Box(Block):
    """A box; `size_x_m`, `size_y_m` and `size_z_m` are its full edge lengths."""

    kind: str = "box"
    size_x_m: Positive
    size_y_m: Positive
    size_z_m: Positive

    @property
    def foot_m(self) -> float:
        """Half its height, as it is pitched."""
        return self.pitch_height(self.size_z_m, self.size_x_m)

    def list_parts(self) -> list[Part]:
        """One solid."""
        half = [0.5 * self.size_x_m, 0.5 * self.size_y_m, 0.5 * self.size_z_m]
        solid = Solid("box", half, mass_kg=self.mass_kg or 0.0, contact=self.contact,
                      color=self.color)  # fmt: skip
        return [Part([solid])]

    def list_frames(self) -> dict[str, Frame]:
        """`top`, and `front`, the face towards -x; their z points outward."""
        return {
            "top": build_frame(z=0.5 * self.size_z_m),
            "front": build_frame(x=-0.5 * self.size_x_m, R=_FRONT),
        }

    def describe(self) -> str:
        """Return a description with its size."""
        does = "moves" if self.moves else "stands"
        return f"box of {self.size_x_m:g} x {self.size_y_m:g} x {self.size_z_m:g} m that {does}"
