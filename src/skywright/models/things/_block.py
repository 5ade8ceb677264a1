"""Common code of boxes and cylinders: fixed, movable, or stuck until they are pulled."""

from __future__ import annotations

import math

from pydantic import model_validator

from skywright.core.rotations import rot_y, rot_z
from skywright.core.spec import NonNegative, Positive
from skywright.description.world.thing import SOFT, Array, Contact, Placed


class Block(Placed):
    """A simple solid; O is its centre. `pitch_deg` rotates it about y, then `yaw_deg` about z of W.

    With `held_n` it is held, e.g. a plug in its socket, until it is pulled with that force.
    """

    pitch_deg: float = 0.0
    moves: bool = False
    mass_kg: Positive | None = None
    friction: NonNegative | None = None  # default: 0.5 if movable, else 1
    held_n: Positive | None = None

    @property
    def movable(self) -> bool:
        """Whether the table sets `moves`."""
        return self.moves

    @property
    def frees_at_n(self) -> float | None:
        """Pulling force (N) that frees the block, or None."""
        return self.held_n

    def pitch_height(self, height: float, depth: float) -> float:
        """Return half the height (m) above the floor, as it is pitched, of a solid that is upright
        `height` (m) high and `depth` (m) deep."""
        pitch = math.radians(self.pitch_deg)
        return 0.5 * (abs(math.cos(pitch)) * height + abs(math.sin(pitch)) * depth)

    @property
    def attitude(self) -> Array:
        """Rotation about y, then about z."""
        return rot_z(math.radians(self.yaw_deg)) @ rot_y(math.radians(self.pitch_deg))

    @property
    def contact(self) -> Contact:
        """Soft contact if the block is movable, so that hands can hold it."""
        if self.moves:
            return SOFT._replace(friction=0.5 if self.friction is None else self.friction)
        return Contact(friction=1.0 if self.friction is None else self.friction)

    @property
    def color(self) -> tuple[float, float, float]:
        """Green for movable blocks, brown for fixed ones."""
        return (0.3, 0.6, 0.4) if self.moves else (0.6, 0.5, 0.4)

    @model_validator(mode="after")
    def _what_moves_has_a_mass(self) -> Block:
        if self.moves and self.mass_kg is None:
            raise ValueError("moves = true requires mass_kg")
        if self.held_n is not None and not self.moves:
            raise ValueError("held_n requires moves = true")
        return self
