"""A bar with a peg below its middle, for insertion into a socket.

It has the shape of a T: a round crossbar for two hooks, and below its middle a post, a flange and
the square peg. Frame O: origin in the middle of the flange's underside, where the peg begins; x
forward, y along the crossbar, z up. `on` a socket the flange rests on the block.
"""

from __future__ import annotations

from pydantic import model_validator

from skywright.core.spec import NonNegative, Positive
from skywright.description.world.thing import Frame, Part, Solid, build_frame
from skywright.models.things._handled import Handled

SHARES = {"handle": 0.2, "post": 0.1, "flange": 0.2, "peg": 0.5}
"""Shares of the bar's mass: an aluminium tube as crossbar, a solid peg."""
FLANGE_M, POST_M = 0.01, 0.012  # thickness of the flange, half width of the post


class Peg(Handled):
    """The bar; under its own weight its contacts penetrate a wall by less than 0.1 mm."""

    kind: str = "peg"
    mass_kg: Positive = 0.4
    friction: NonNegative = 0.4  # with hooks, socket and rack
    side_m: Positive = 0.03  # of the square peg
    length_m: Positive = 0.05  # of the peg below the flange
    flange_m: Positive = 0.09  # width of the square flange
    handle_height_m: Positive = 0.1  # of the crossbar's axis above the flange's underside

    @model_validator(mode="after")
    def _parts_follow_each_other(self) -> Peg:
        if self.flange_m <= self.side_m:
            raise ValueError(
                f"flange_m = {self.flange_m:g} must be above side_m = {self.side_m:g}: the flange "
                "stops the peg"
            )
        if self.handle_height_m < FLANGE_M + self.handle_diameter_m:
            raise ValueError(
                f"handle_height_m = {self.handle_height_m:g} lies inside the flange; "
                f"valid: from {FLANGE_M + self.handle_diameter_m:g}"
            )
        return self

    def list_parts(self) -> list[Part]:
        """Peg, flange, post and crossbar."""
        half, flange = 0.5 * self.side_m, 0.5 * self.flange_m
        top = self.handle_height_m - FLANGE_M
        boxes = {
            "peg": (-0.5 * self.length_m, [half, half, 0.5 * self.length_m]),
            "flange": (0.5 * FLANGE_M, [flange, flange, 0.5 * FLANGE_M]),
            "post": (FLANGE_M + 0.5 * top, [POST_M, POST_M, 0.5 * top]),
        }
        solids = [
            Solid("box", size, name, build_frame(z=z), SHARES[name] * self.mass_kg, self.contact,
                  (0.75, 0.2, 0.2))
            for name, (z, size) in boxes.items()
        ]  # fmt: skip
        return [Part([*solids, self.build_handle(SHARES["handle"] * self.mass_kg)])]

    def list_frames(self) -> dict[str, Frame]:
        """Return the frames of the handle, and `tip`, the centre of the peg's end."""
        return super().list_frames() | {"tip": build_frame(z=-self.length_m)}

    def describe(self) -> str:
        """Return a description with its mass and the peg's size."""
        return f"bar of {self.mass_kg:g} kg with a peg of {1e3 * self.side_m:g} mm"
