"""A surface-breaking crack or notch in the world's pipe: the target of a flaw inspection."""

from typing import Literal

from pydantic import Field

from skywright.core.spec import Coordinate
from skywright.description.world.thing import Thing


class Crack(Thing):
    """A flaw on the unrolled surface of the pipe; it adds no geometry.

    Its centre is at `s_m` along the axis and `around_deg` around it. `angle_deg` is the angle of
    its mouth from the circumferential direction towards +s, as for a weld.
    """

    kind: str = "crack"
    s_m: Coordinate = 0.0
    around_deg: float = Field(default=0.0, ge=-180, le=180)
    angle_deg: float = Field(default=0.0, ge=-90, le=90)
    length_m: float = Field(default=0.006, ge=0.0005, le=1.0)
    depth_m: float = Field(default=0.001, ge=1e-5, le=0.05)
    # depth profile; semi-ellipse: a fatigue crack; rectangle: a machined notch
    shape: Literal["semi-ellipse", "rectangle"] = "semi-ellipse"

    def describe(self) -> str:
        """Return a description with its size."""
        return f"crack of {1e3 * self.length_m:g} x {1e3 * self.depth_m:g} mm in the pipe"
