"""An inspection tool that two hands carry and put onto a pipe: `world.tool` (Suarez 2020, fig. 19).

A box with the sensor, two C-shaped feet of aluminium profile that fit the pipe's contour, and a bar
as handle. Frame O: origin in the middle between the feet's top plates, x ahead, y along the handle,
z up. Each foot is a short plate along x and two legs that open downward, so that pipes of different
diameters rest on the legs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skywright.core.spec import Coordinate, NonNegative, Positive, Spec

Array = NDArray[np.float64]

SHARES = {"box": 0.6, "handle": 0.15, "feet": 0.25}
"""Of the tool's mass: a sensor in a plastic box, on aluminium profiles."""


class Tool(Spec):
    """The inspection tool, standing on an obstacle of the world (`on`) at (x, y)."""

    mass_kg: Positive = 0.45
    on: str = "bench"  # a name in world.obstacles
    x_m: Coordinate
    y_m: Coordinate
    yaw_deg: float = 0.0
    friction: NonNegative = 0.5  # with hooks, pipe and bench
    handle_length_m: Positive = 0.45
    handle_diameter_m: Positive = 0.016
    handle_height_m: Positive = 0.16  # of the handle's axis above O
    box_x_m: Positive = 0.1
    box_y_m: Positive = 0.14
    box_z_m: Positive = 0.08
    feet_apart_m: Positive = 0.14
    plate_m: Positive = 0.04  # length along x of the plate between a foot's legs
    leg_length_m: Positive = 0.12
    leg_angle_deg: float = Field(default=45.0, ge=20, le=70)  # from the vertical
    profile_m: Positive = 0.01  # thickness of legs and plates
    # of its contacts, critically damped; two steps of the simulation at least
    contact_time_constant_s: float = Field(default=0.008, ge=0.002, le=0.05)

    @model_validator(mode="after")
    def _handle_is_above_the_box(self) -> Tool:
        top = 0.5 * self.profile_m + self.box_z_m
        if self.handle_height_m < top + self.handle_diameter_m:
            raise ValueError(
                f"handle_height_m = {self.handle_height_m:g} is in the box, whose top is {top:g} m "
                "above O"
            )
        return self

    @property
    def foot_height_m(self) -> float:
        """Height of O above a plane that the tool stands on."""
        return self.leg_length_m * math.cos(math.radians(self.leg_angle_deg)) + 0.5 * self.profile_m


class Rod(NamedTuple):
    """A round profile between two points in O, or with `half` a box around `a`."""

    name: str
    a: Array  # (3,) m
    b: Array  # (3,) m
    radius: float  # m
    mass: float  # kg
    half: Array | None = None  # (3,) m


class Seat(NamedTuple):
    """How a tool rests on a pipe: O above the pipe's axis, and where along a leg it touches."""

    height: float  # m
    along: float  # m, from the plate's end; valid: 0 to the leg's length
    fits: bool


def list_tool_parts(tool: Tool) -> list[Rod]:
    """Return the tool's solids in O; their masses add up to `mass_kg`."""
    out = []
    middle = np.array([0.0, 0.0, 0.5 * tool.profile_m + 0.5 * tool.box_z_m])
    half = 0.5 * np.array([tool.box_x_m, tool.box_y_m, tool.box_z_m])
    out.append(Rod("tool box", middle, middle, 0.0, SHARES["box"] * tool.mass_kg, half))
    r, z = 0.5 * tool.handle_diameter_m, tool.handle_height_m
    end = np.array([0.0, 0.5 * tool.handle_length_m - r, 0.0])
    up = np.array([0.0, 0.0, z])
    bars = [("tool handle", up - end, up + end)]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        foot = np.array([0.0, sign * 0.4 * tool.box_y_m, 0.0])
        bars.append((f"tool post {side}", foot + [0, 0, middle[2] + half[2]], foot + up))
    lengths = [float(np.linalg.norm(b - a)) for _, a, b in bars]
    for (name, a, b), length in zip(bars, lengths, strict=True):
        out.append(Rod(name, a, b, r, SHARES["handle"] * tool.mass_kg * length / sum(lengths)))
    angle = math.radians(tool.leg_angle_deg)
    total = 2.0 * (tool.plate_m + 2.0 * tool.leg_length_m)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        y = 0.5 * sign * tool.feet_apart_m
        ends = [np.array([s * 0.5 * tool.plate_m, y, 0.0]) for s in (1.0, -1.0)]
        rods = [(f"tool foot {side}", ends[0], ends[1])]
        for way, s, top in zip(("front", "back"), (1.0, -1.0), ends, strict=True):
            down = tool.leg_length_m * np.array([s * math.sin(angle), 0.0, -math.cos(angle)])
            rods.append((f"tool leg {side} {way}", top, top + down))
        for name, a, b in rods:
            mass = SHARES["feet"] * tool.mass_kg * float(np.linalg.norm(b - a)) / total
            out.append(Rod(name, a, b, 0.5 * tool.profile_m, mass))
    return out


def compute_seat(tool: Tool, diameter: float) -> Seat:
    """Return how the tool rests on a pipe of `diameter` (m) along y, both legs touching.

    A leg's axis keeps R + r from the pipe's axis. It does not fit where the pipe would touch
    beyond the leg's end, or the plate before the legs.
    """
    angle, w = math.radians(tool.leg_angle_deg), 0.5 * tool.plate_m
    reach = 0.5 * diameter + 0.5 * tool.profile_m
    height = (reach - w * math.cos(angle)) / math.sin(angle)
    along = height * math.cos(angle) - w * math.sin(angle)
    return Seat(height, along, bool(0.0 <= along <= tool.leg_length_m and height >= reach))


def compute_diameters(tool: Tool) -> tuple[float, float]:
    """Return the (smallest, largest) diameter (m) of a pipe that the feet fit."""
    angle, w = math.radians(tool.leg_angle_deg), 0.5 * tool.plate_m
    s, c = math.sin(angle), math.cos(angle)
    height = (tool.leg_length_m + w * s) / c
    r = 0.5 * tool.profile_m
    # the plate touches with the legs where (reach - w c) / s = reach
    return 2.0 * max(w * c / (1.0 - s) - r, 0.0), 2.0 * (w * c + height * s - r)
