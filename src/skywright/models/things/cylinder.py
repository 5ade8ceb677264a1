"""A cylinder along its z: a bottle, a post, or with `pitch_deg = 90` a roller."""

from skywright.core.spec import Positive
from skywright.description.world.thing import Frame, Part, Solid, build_frame
from skywright.models.things._block import Block


class Cylinder(Block):
    """A cylinder whose axis is its own z."""

    kind: str = "cylinder"
    diameter_m: Positive
    length_m: Positive

    @property
    def foot_m(self) -> float:
        """Half its height, as it is pitched."""
        return self.pitch_height(self.length_m, self.diameter_m)

    def list_parts(self) -> list[Part]:
        """One solid."""
        size = [0.5 * self.diameter_m, 0.5 * self.length_m]
        solid = Solid("cylinder", size, mass_kg=self.mass_kg or 0.0, contact=self.contact,
                      color=self.color)  # fmt: skip
        return [Part([solid])]

    def list_frames(self) -> dict[str, Frame]:
        """`top`, its upper end."""
        return {"top": build_frame(z=0.5 * self.length_m)}

    def describe(self) -> str:
        """Return a description with its size."""
        does = "moves" if self.moves else "stands"
        return f"cylinder of {self.diameter_m:g} m diameter, {self.length_m:g} m long, that {does}"
