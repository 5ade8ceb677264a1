"""A sprung plate on a face of a thing, with a gauge behind it: a target for collisions."""

import numpy as np

from skywright.core.spec import NonNegative, Positive
from skywright.description.world.thing import (
    Array,
    Contact,
    Frame,
    Joint,
    Part,
    Placed,
    Solid,
    build_frame,
)

REBOUND = 0.01  # m, travel of the plate beyond its rest position
_INWARD = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # x against the face's z


class Pad(Placed):
    """A plate on foam; O is the centre of its outer face, and x points into the face.

    It is `on` a frame whose z points outward, such as `BOX.front`. Its stiffness does not depend on
    the colliding robot. The stiffness of MuJoCo's soft contacts, in contrast, increases with the
    robot's mass, so collisions of different robots would not be comparable.
    """

    kind: str = "pad"
    width_m: Positive  # of the plate, along the face's y
    height_m: Positive
    stiffness_n_per_m: Positive = 3000.0
    damping_ns_per_m: NonNegative = 15.0
    mass_kg: Positive = 0.1  # of the plate
    thickness_m: Positive = 0.02  # of the plate
    travel_m: Positive = 0.05  # largest compression of the foam

    @property
    def frame(self) -> Frame:
        """Pose of O: above the face by the thickness of foam and plate."""
        depth = self.travel_m + self.thickness_m
        return build_frame(self.x_m, self.y_m, self.z_m + depth, self.attitude)

    @property
    def attitude(self) -> Array:
        """x points into the face."""
        return super().attitude @ _INWARD

    def list_parts(self) -> list[Part]:
        """The plate, on its spring."""
        plate = Solid(
            "box", [0.5 * self.thickness_m, 0.5 * self.width_m, 0.5 * self.height_m],
            mass_kg=self.mass_kg, color=(0.95, 0.75, 0.2),
            contact=Contact(0.5, priority=2, time_constant_s=0.002, impedance=0.95),
        )  # fmt: skip
        spring = Joint(
            "slide", (1.0, 0.0, 0.0), -REBOUND, self.travel_m, self.stiffness_n_per_m,
            self.damping_ns_per_m,
        )  # fmt: skip
        return [Part([plate], spring, frame=build_frame(x=0.5 * self.thickness_m), gauged=True)]

    def list_frames(self) -> dict[str, Frame]:
        """`face`, the outer face; its z points outward."""
        return {"face": build_frame(R=_INWARD.T)}

    def describe(self) -> str:
        """Return a description with its stiffness."""
        return f"pad of {self.stiffness_n_per_m:g} N/m on {self.on}"
