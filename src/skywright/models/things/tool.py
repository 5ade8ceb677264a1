"""An inspection tool that two hands carry and place on a pipe (Suarez 2020, fig. 19).

It is a box with the sensor, two C-shaped feet of aluminium profile that fit the pipe's contour, and
a bar as handle. Frame O: origin in the middle between the feet's top plates, x forward, y along the
handle, z up. Each foot is a short plate along x and two legs that open downward, so that the legs
contact pipes of different diameters.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field, model_validator

from skywright.core.spec import Positive
from skywright.description.world.thing import Array, Contact, Part, Solid, build_frame
from skywright.models.things._handled import Handled

SHARES = {"box": 0.6, "handle": 0.15, "feet": 0.25}
"""Shares of the tool's mass: a sensor in a plastic box, on aluminium profiles."""
_METAL = (0.65, 0.68, 0.72)


class Tool(Handled):
    """The inspection tool, standing on its feet."""

    kind: str = "tool"
    mass_kg: Positive = 0.45
    handle_height_m: Positive = 0.16
    box_x_m: Positive = 0.1
    box_y_m: Positive = 0.14
    box_z_m: Positive = 0.08
    feet_apart_m: Positive = 0.14
    plate_m: Positive = 0.04  # length along x of the plate between a foot's legs
    leg_length_m: Positive = 0.12
    leg_angle_deg: float = Field(default=45.0, ge=20, le=70)  # from the vertical
    profile_m: Positive = 0.01  # thickness of legs and plates
    # of its critically damped contacts; at least two time steps of the simulation
    contact_time_constant_s: float = Field(default=0.008, ge=0.002, le=0.05)

    @model_validator(mode="after")
    def _handle_is_above_the_box(self) -> Tool:
        top = 0.5 * self.profile_m + self.box_z_m
        if self.handle_height_m < top + self.handle_diameter_m:
            raise ValueError(
                f"handle_height_m = {self.handle_height_m:g} lies inside the box, whose "
                f"top is {top:g} m above O"
            )
        return self

    @property
    def foot_m(self) -> float:
        """Height of O above a plane under the tool."""
        return self.leg_length_m * math.cos(math.radians(self.leg_angle_deg)) + 0.5 * self.profile_m

    @property
    def contact(self) -> Contact:
        """Contact of carried things, with the time constant of its table."""
        return super().contact._replace(time_constant_s=self.contact_time_constant_s)

    def list_parts(self) -> list[Part]:
        """Box, handle with its posts, and feet; their masses add up to `mass_kg`."""
        middle = np.array([0.0, 0.0, 0.5 * self.profile_m + 0.5 * self.box_z_m])
        half = 0.5 * np.array([self.box_x_m, self.box_y_m, self.box_z_m])
        solids = [
            Solid("box", half, "box", build_frame(*middle), SHARES["box"] * self.mass_kg,
                  self.contact, (0.9, 0.9, 0.85))
        ]  # fmt: skip
        up = np.array([0.0, 0.0, self.handle_height_m])
        bars = [("handle", *self.handle_ends)]
        for side, sign in (("left", 1.0), ("right", -1.0)):
            foot = np.array([0.0, sign * 0.4 * self.box_y_m, 0.0])
            bars.append((f"post {side}", foot + [0, 0, middle[2] + half[2]], foot + up))
        total = sum(float(np.linalg.norm(b - a)) for _, a, b in bars)
        solids += self._list_rods(bars, 0.5 * self.handle_diameter_m, SHARES["handle"], total)
        solids[1] = solids[1]._replace(color=(0.75, 0.2, 0.2))
        angle = math.radians(self.leg_angle_deg)
        rods = []
        for side, sign in (("left", 1.0), ("right", -1.0)):
            y = 0.5 * sign * self.feet_apart_m
            ends = [np.array([s * 0.5 * self.plate_m, y, 0.0]) for s in (1.0, -1.0)]
            rods.append((f"foot {side}", ends[0], ends[1]))
            for way, s, top in zip(("front", "back"), (1.0, -1.0), ends, strict=True):
                down = self.leg_length_m * np.array([s * math.sin(angle), 0.0, -math.cos(angle)])
                rods.append((f"leg {side} {way}", top, top + down))
        total = 2.0 * (self.plate_m + 2.0 * self.leg_length_m)
        solids += self._list_rods(rods, 0.5 * self.profile_m, SHARES["feet"], total)
        return [Part(solids)]

    def _list_rods(
        self, rods: list[tuple[str, Array, Array]], radius: float, share: float, total: float
    ) -> list[Solid]:
        """Return round profiles between points in O; each has the share of mass of its length."""
        out = []
        for name, a, b in rods:
            mass = share * self.mass_kg * float(np.linalg.norm(b - a)) / total
            out.append(
                Solid("capsule", [radius], name, mass_kg=mass, contact=self.contact, color=_METAL,
                      ends=(a, b))
            )  # fmt: skip
        return out

    def describe(self) -> str:
        """Return a description with its mass and the pipe diameters that it fits."""
        low, high = compute_diameters(self)
        return f"tool of {self.mass_kg:g} kg for pipes of {low:.3f} to {high:.3f} m diameter"


class Seat(NamedTuple):
    """Pose of a tool on a pipe: height of O above the pipe's axis, and contact point along a
    leg."""

    height: float  # m
    along: float  # m, from the plate's end; valid: 0 to the leg's length
    fits: bool


def compute_seat(tool: Tool, diameter: float) -> Seat:
    """Return the contact of the tool on a pipe of `diameter` (m) along y, both legs touching.

    A leg's axis is at R + r from the pipe's axis. The tool does not fit if the pipe would touch
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
    # plate and legs touch at the same time where (reach - w c) / s = reach
    return 2.0 * max(w * c / (1.0 - s) - r, 0.0), 2.0 * (w * c + height * s - r)
