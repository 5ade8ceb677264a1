"""A reference block with notches of known depth, for the set-up of an eddy-current instrument."""

from pydantic import Field

from skywright.core.spec import Positive
from skywright.description.world.thing import Frame, Part, Placed, Solid, build_frame


class NotchBlock(Placed):
    """A flat steel block with long notches across it; O is its centre.

    Conductivity and permeability must be those of the inspected part (EN 1711, ISO 17643): with
    another material the set-up gives another sensitivity.
    """

    kind: str = "notch_block"
    notches_m: list[float] = Field(default=[0.0005, 0.001, 0.002], min_length=1, max_length=20)
    conductivity_s_per_m: Positive = 5.0e6
    relative_permeability: Positive = 100.0
    size_x_m: Positive = 0.1
    size_y_m: Positive = 0.05
    size_z_m: Positive = 0.01

    @property
    def foot_m(self) -> float:
        """Half its height."""
        return 0.5 * self.size_z_m

    def list_parts(self) -> list[Part]:
        """One solid."""
        half = [0.5 * self.size_x_m, 0.5 * self.size_y_m, 0.5 * self.size_z_m]
        return [Part([Solid("box", half, color=(0.55, 0.57, 0.6))])]

    def list_frames(self) -> dict[str, Frame]:
        """`top`, the surface for the probe."""
        return {"top": build_frame(z=0.5 * self.size_z_m)}

    def describe(self) -> str:
        """Return a description with its notches."""
        depths = ", ".join(f"{1e3 * d:g}" for d in self.notches_m)
        return f"reference block with notches of {depths} mm"
