"""A datum: a mark on the surface of the pipe or structure that is the origin of places on the
asset."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from skywright.core.spec import Coordinate
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.structure import build_surface, locate_point
from skywright.description.world.surface import build_cylinder, surface_frame, surface_point
from skywright.description.world.thing import Frame, Thing
from skywright.errors import InputError


class DatumThing(Thing):
    """The base of the kind "datum" (models/things/datum.py), which generic code may name."""

    s_m: Coordinate | None = None  # along the pipe's axis
    around_deg: float | None = Field(default=None, ge=-180, le=180)
    x_m: Coordinate | None = None  # in S, of a structure
    y_m: Coordinate | None = None

    @model_validator(mode="after")
    def _is_on_one_surface(self) -> Self:
        pipe, structure = (self.s_m, self.around_deg), (self.x_m, self.y_m)
        told = [pair for pair in (pipe, structure) if any(x is not None for x in pair)]
        if len(told) != 1 or None in told[0]:
            raise ValueError(
                "needs its place: s_m and around_deg on the pipe, or x_m and y_m on the structure"
            )
        return self

    @property
    def on_pipe(self) -> bool:
        """Whether its place is given on the pipe; otherwise it is on the structure."""
        return self.s_m is not None

    def get_place(self) -> tuple[float, float]:
        """Return (s m, phi rad) on the pipe, or (x, y) m in S."""
        if self.s_m is not None and self.around_deg is not None:
            return self.s_m, math.radians(self.around_deg)
        assert self.x_m is not None and self.y_m is not None
        return self.x_m, self.y_m

    def describe(self) -> str:
        """Return its place as text."""
        u, v = self.get_place()
        if self.on_pipe:
            return f"datum mark at s = {u:g} m, {math.degrees(v):g} deg"
        return f"datum mark at ({u:g}, {v:g}) m"


def find_seen_datum(robot: Robot, world: World) -> DatumThing | None:
    """Return the datum that a robot's probe camera can measure, or None; see find_datum."""
    return None if robot.probe is None or robot.probe.camera is None else find_datum(world)


def find_datum(world: World) -> DatumThing | None:
    """Return the world's datum, or None.

    Raises InputError for more than one, and for one on a pipe or structure that the world lacks.
    """
    found = {name: thing for name, thing in world.things.items() if isinstance(thing, DatumThing)}
    if not found:
        return None
    if len(found) > 1:
        raise InputError(f"world {world.name!r}: {', '.join(found)} are datums; valid: at most one")
    (name, datum), = found.items()  # fmt: skip
    if (world.pipe if datum.on_pipe else world.structure) is None:
        has = "no pipe" if datum.on_pipe else "no structure"
        keys = "x_m and y_m" if datum.on_pipe else "s_m and around_deg"
        raise InputError(
            f"world.things.{name}: world {world.name!r} has {has} for the datum to be on; valid: "
            f"{keys}, or a world with one"
        )
    _check_extent(world, name, datum)
    return datum


def _check_extent(world: World, name: str, datum: DatumThing) -> None:
    """Raise InputError for a mark beyond the pipe or the structure."""
    u, v = datum.get_place()
    if datum.on_pipe:
        assert world.pipe is not None
        within = [("s_m", u, 0.5 * world.pipe.length_m)]
    else:
        assert world.structure is not None
        place = {"x_m": u, "y_m": v}
        within = [(key, place[key], most) for key, most in world.structure.half_extents.items()]
    for key, value, most in within:
        if abs(value) > most:
            what = "pipe" if datum.on_pipe else "structure"
            raise InputError(
                f"world.things.{name}.{key} = {value:g} lies beside the {what} of world "
                f"{world.name!r}; valid: {-most:g} to {most:g}"
            )


def locate_datum(world: World, datum: DatumThing) -> Frame:
    """Return the frame of the mark in `world`: its middle (3,) m, and z of R (3, 3) its normal."""
    u, v = datum.get_place()
    if datum.on_pipe:
        assert world.pipe is not None
        cylinder, p, n, R = build_cylinder(world.pipe), np.empty(3), np.empty(3), np.empty((3, 3))
        surface_point(cylinder, u, v, p, n)
        surface_frame(cylinder, v, R)
        return Frame(p, R)
    assert world.structure is not None
    return Frame(*locate_point(build_surface(world.structure), np.array([u, v])))
