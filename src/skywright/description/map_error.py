"""Errors of the map relative to the true structure: the keys `plant.map_error_*`.

Planner, laws and estimators use the world of the world file: the map. The plant's pipe or structure
deviates from it. The deviation is drawn from the seed, uniform within the bounds of the keys. The
bounds are part of the map and available to planners; the deviation itself is not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from skywright.core.streams import build_stream
from skywright.description.mission.spec import Plant
from skywright.description.world.spec import Pipe, World
from skywright.description.world.structure import Structure
from skywright.errors import InputError

Array = NDArray[np.float64]

KEYS = ("map_error_m", "map_error_deg", "map_error_size_m")
X, Y, Z, YAW, TILT, SIZE, CROSS_TILT, ROLL = range(8)


def displace_world(world: World, plant: Plant, seed: int) -> World:
    """Return the true world: its pipe or structure deviates from the map by what `seed` draws."""
    if not any(getattr(plant, key) for key in KEYS):
        return world
    u = build_stream(seed, "map").uniform(-1.0, 1.0, 8)
    if world.pipe is not None:
        return world.model_copy(update={"pipe": _displace_pipe(world.pipe, plant, u)})
    if world.structure is not None:
        moved = _displace_structure(world.structure, plant, u)
        return world.model_copy(update={"structure": moved})
    return world


def _displace_pipe(pipe: Pipe, plant: Plant, u: Array) -> Pipe:
    turn = plant.map_error_deg
    return pipe.model_copy(update={
        **_displace_place(pipe, plant, u),
        "yaw_deg": pipe.yaw_deg + turn * float(u[YAW]),
        "inclination_deg": pipe.inclination_deg + turn * float(u[TILT]),
        "roll_deg": pipe.roll_deg + turn * float(u[ROLL]),
        "diameter_m": pipe.diameter_m + 2.0 * plant.map_error_size_m * float(u[SIZE]),
    })  # fmt: skip


def _displace_structure(s: Structure, plant: Plant, u: Array) -> Structure:
    turn = plant.map_error_deg
    new: dict[str, float] = {
        **_displace_place(s, plant, u), "yaw_deg": s.yaw_deg + turn * float(u[YAW])
    }  # fmt: skip
    if s.facing == "side":
        new["slope_deg"] = s.slope_deg + turn * float(u[TILT])
    else:  # the normal tilts in both horizontal directions
        toward, rise = math.radians(s.slope_toward_deg), math.tan(math.radians(s.slope_deg))
        x = rise * math.cos(toward) + math.tan(math.radians(turn * float(u[TILT])))
        y = rise * math.sin(toward) + math.tan(math.radians(turn * float(u[CROSS_TILT])))
        new["slope_deg"] = math.degrees(math.atan(math.hypot(x, y)))
        new["slope_toward_deg"] = math.degrees(math.atan2(y, x))
    if s.radius_m is not None:
        new["radius_m"] = s.radius_m + plant.map_error_size_m * float(u[SIZE])
    return s.model_copy(update=new)


def _displace_place(thing: Pipe | Structure, plant: Plant, u: Array) -> dict[str, float]:
    return {
        f"{axis}_m": getattr(thing, f"{axis}_m") + plant.map_error_m * float(u[i])
        for i, axis in enumerate("xyz")
    }


def check_map_error(world: World, plant: Plant, origin: Mapping[str, str]) -> None:
    """Raise InputError for a map error that has no effect in this world."""
    sized = world.pipe is not None or (
        world.structure is not None and world.structure.radius_m is not None
    )
    placed = world.pipe is not None or world.structure is not None
    for key in KEYS:
        value, has = getattr(plant, key), sized if key == "map_error_size_m" else placed
        if value == 0.0 or has:
            continue
        where = origin.get(f"plant.{key}", "")
        what = "curved surface" if placed else "pipe and no structure"
        raise InputError(
            f"{where + ': ' if where else ''}plant.{key} = {value:g} has no effect: world "
            f"{world.name!r} has no {what}; valid: 0"
        )
