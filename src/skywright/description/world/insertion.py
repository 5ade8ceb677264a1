"""A bar with a peg, and blocks with a square hole: `world.peg`, `world.socket`, `world.rack`.

The peg bar is a T: a round crossbar that two hooks hold, below its middle a post, a flange and the
square peg. Frame O: origin in the middle of the flange's underside, where the peg begins; x ahead,
y along the crossbar, z up. The socket takes the peg until the flange lies on it; the rack, where
the bar stands at first, is the same block with a wide hole. Frame S of a block: origin in the
middle of its upper face, z up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from skywright.core.rotations import rot_y, rot_z
from skywright.core.spec import Coordinate, NonNegative, Positive, Spec

Array = NDArray[np.float64]

SHARES = {"handle": 0.2, "post": 0.1, "flange": 0.2, "peg": 0.5}
"""Of the bar's mass: an aluminium tube as crossbar, a solid peg."""
FLANGE_M, POST_M = 0.01, 0.012  # thickness of the flange, half width of the post
COLLAR_M = 0.02  # m, thickness of the boxes whose faces are the chamfer


class Peg(Spec):
    """A bar with a peg below its middle; it stands in the rack at first."""

    mass_kg: Positive = 0.4
    friction: NonNegative = 0.4  # with hooks, socket and rack
    side_m: Positive = 0.03  # of the square peg
    length_m: Positive = 0.05  # of the peg below the flange
    flange_m: Positive = 0.09  # width of the square flange
    handle_length_m: Positive = 0.45
    handle_diameter_m: Positive = 0.016
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
                f"handle_height_m = {self.handle_height_m:g} is in the flange; valid: from "
                f"{FLANGE_M + self.handle_diameter_m:g}"
            )
        return self


class Socket(Spec):
    """A block with a square hole that opens upward, on a post; (x, y, z) is its upper face."""

    x_m: Coordinate
    y_m: Coordinate
    z_m: Coordinate
    yaw_deg: float = 0.0
    hole_m: Positive  # side of the hole; less the peg's side this is the clearance
    chamfer_m: NonNegative = 0.0  # at 45 deg, around the hole
    width_m: Positive = 0.12  # of the block
    depth_m: Positive = 0.08  # of block and hole: the hole goes through
    post_m: Positive = 0.06  # side of the square post that carries the block

    @model_validator(mode="after")
    def _hole_is_in_the_block(self) -> Socket:
        room = self.width_m - self.hole_m - 2.0 * self.chamfer_m
        if room < 0.01 or self.chamfer_m > 0.5 * self.depth_m:
            raise ValueError(
                f"a hole of {self.hole_m:g} m with a chamfer of {self.chamfer_m:g} m leaves no "
                f"wall in a block of width_m = {self.width_m:g} and depth_m = {self.depth_m:g}"
            )
        return self


class Block(NamedTuple):
    """A box: centre p (3,) m, attitude R (3, 3), half edges (3,) m, mass (kg)."""

    name: str
    p: Array
    R: Array
    half: Array
    mass: float = 0.0


def list_peg_parts(peg: Peg) -> list[Block]:
    """Return the boxes of a peg bar in O, without its round crossbar (`SHARES["handle"]`)."""
    half, flange = 0.5 * peg.side_m, 0.5 * peg.flange_m
    top = peg.handle_height_m - FLANGE_M
    parts = {
        "peg": (-0.5 * peg.length_m, [half, half, 0.5 * peg.length_m]),
        "flange": (0.5 * FLANGE_M, [flange, flange, 0.5 * FLANGE_M]),
        "post": (FLANGE_M + 0.5 * top, [POST_M, POST_M, 0.5 * top]),
    }
    return [
        Block(f"peg bar {name}", np.array([0.0, 0.0, z]), np.eye(3), np.array(size),
              SHARES[name] * peg.mass_kg)
        for name, (z, size) in parts.items()
    ]  # fmt: skip


def list_socket_parts(socket: Socket) -> list[Block]:
    """Return the boxes around the hole in S: per side a wall and, with a chamfer, its slope.

    A wall begins below the chamfer; above it a collar stands back. The slope is the upper face of a
    turned box that lies within wall and collar. Neighbours overlap: MuJoCo's boxes have no edges
    where they meet.
    """
    hole, outer, w = 0.5 * socket.hole_m, 0.5 * socket.width_m, socket.chamfer_m
    low, inner = -socket.depth_m, hole + w
    shapes = [
        ("wall", 0.5 * (hole + outer), 0.5 * (low - w), 0.0,
         [0.5 * (outer - hole), outer, 0.5 * (-w - low)]),
    ]  # fmt: skip
    if w > 0.0:
        # its face goes from (hole, -w) to (hole + w, 0); into the solid is (1, -1) / sqrt(2)
        t = min(COLLAR_M, 0.5 * (outer - inner))
        into = 0.5 * t * math.sqrt(0.5)
        shapes += [
            ("collar", 0.5 * (inner + outer), -0.5 * w, 0.0,
             [0.5 * (outer - inner), outer, 0.5 * w]),
            ("slope", hole + 0.5 * w + into, -0.5 * w - into, -0.25 * math.pi,
             [w * math.sqrt(0.5), inner, 0.5 * t]),
        ]  # fmt: skip
    out = []
    for k in range(4):
        turn = rot_z(0.5 * math.pi * k)
        for name, x, z, tilt, half in shapes:
            p = turn @ np.array([x, 0.0, z])
            out.append(Block(f"{name} {k}", p, turn @ rot_y(tilt), np.array(half)))
    return out
