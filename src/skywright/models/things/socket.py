"""A block with a square hole that opens upward: the socket of a peg, or its rack.

Frame O (S in the papers): origin in the middle of the block's upper face, z up. The hole takes a
peg until the flange rests on the block; a rack is the same block with a wide hole.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import model_validator

from skywright.core.rotations import rot_y, rot_z
from skywright.core.spec import NonNegative, Positive
from skywright.description.world.thing import SOFT, Frame, Part, Placed, Solid, build_frame

COLLAR_M = 0.02  # m, thickness of the boxes whose faces are the chamfer


class Socket(Placed):
    """The block; if it is `on` no other thing, a post from the ground supports it."""

    kind: str = "socket"
    hole_m: Positive  # side of the hole; minus the peg's side it is the clearance
    chamfer_m: NonNegative = 0.0  # at 45 deg, around the hole
    width_m: Positive = 0.12  # of the block
    depth_m: Positive = 0.08  # of block and hole; the hole is a through hole
    post_m: Positive = 0.06  # side of the square post that supports the block

    @model_validator(mode="after")
    def _hole_is_in_the_block(self) -> Socket:
        room = self.width_m - self.hole_m - 2.0 * self.chamfer_m
        if room < 0.01 or self.chamfer_m > 0.5 * self.depth_m:
            raise ValueError(
                f"a hole of {self.hole_m:g} m with a chamfer of {self.chamfer_m:g} m leaves no "
                f"wall in a block of width_m = {self.width_m:g} and depth_m = {self.depth_m:g}"
            )
        return self

    @property
    def foot_m(self) -> float:
        """Height of the upper face."""
        return self.depth_m

    def list_parts(self) -> list[Part]:
        """Return a wall and, with a chamfer, a slope for each side of the hole, and the post.

        A wall begins below the chamfer; the collar above it is set back. The slope is the upper
        face of a tilted box that lies within wall and collar. Neighbours overlap, so that MuJoCo's
        boxes have no edges at their joints.
        """
        hole, outer, w = 0.5 * self.hole_m, 0.5 * self.width_m, self.chamfer_m
        low, inner = -self.depth_m, hole + w
        shapes = [
            ("wall", 0.5 * (hole + outer), 0.5 * (low - w), 0.0,
             [0.5 * (outer - hole), outer, 0.5 * (-w - low)]),
        ]  # fmt: skip
        if w > 0.0:
            # its face goes from (hole, -w) to (hole + w, 0); the inward direction is (1, -1) /
            # sqrt(2)
            t = min(COLLAR_M, 0.5 * (outer - inner))
            into = 0.5 * t * math.sqrt(0.5)
            shapes += [
                ("collar", 0.5 * (inner + outer), -0.5 * w, 0.0,
                 [0.5 * (outer - inner), outer, 0.5 * w]),
                ("slope", hole + 0.5 * w + into, -0.5 * w - into, -0.25 * math.pi,
                 [w * math.sqrt(0.5), inner, 0.5 * t]),
            ]  # fmt: skip
        solids = []
        for k in range(4):
            turn = rot_z(0.5 * math.pi * k)
            for name, x, z, tilt, half in shapes:
                frame = Frame(turn @ np.array([x, 0.0, z]), turn @ rot_y(tilt))
                solids.append(self._build_box(f"{name} {k}", frame, half))
        height = self.z_m - self.depth_m
        if self.on is None and height > 0.01:
            half = [0.5 * self.post_m, 0.5 * self.post_m, 0.5 * height]
            solids.append(self._build_box("post", build_frame(z=low - 0.5 * height), half))
        return [Part(solids)]

    def _build_box(self, name: str, frame: Frame, half: list[float]) -> Solid:
        return Solid("box", half, name, frame, contact=SOFT, color=(0.45, 0.5, 0.58))

    def list_frames(self) -> dict[str, Frame]:
        """`hole`, the middle of its opening."""
        return {"hole": build_frame()}

    def describe(self) -> str:
        """Return a description with the hole's size."""
        return f"socket with a hole of {1e3 * self.hole_m:g} mm at {self.z_m:g} m"
