"""Pose of a tool, measured by motion capture with the marker on it."""

from typing import Any
from weakref import WeakKeyDictionary

from skywright.core.arrays import Array
from skywright.description.world.spec import World
from skywright.description.world.thing import Frame
from skywright.description.world.things import find_carrier, locate_thing
from skywright.errors import InputError
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import Marker

_MARKERS = WeakKeyDictionary[Any, Frame]()
"""Vehicle -> frame of the marker on the tool; cached because missions read it every tick."""


def measure_tool(s: Supervisor) -> tuple[Array, Array]:
    """Return (p_WO, R_WO) of the tool as motion capture measures it now."""
    v = s.vehicle
    marker = _MARKERS.get(v) or _MARKERS.setdefault(v, find_marker(v.world))
    seen = v.look(Marker)
    R = seen.R_WO @ marker.R.T
    return seen.p_WO - R @ marker.p, R


def find_marker(world: World, tool: str | None = None) -> Frame:
    """Return the frame of the marker on the thing that carries it; `tool` names this thing.

    Raises InputError if there is no such marker.
    """
    for name, thing in world.things.items():
        carrier = find_carrier(world.things, name)
        if thing.is_marker and carrier is not None and tool in (None, carrier):
            return locate_thing(world.things, name, carrier)
    raise InputError(
        f"world {world.name!r}: tracking of {tool or 'the payload'} requires a thing of "
        f"kind 'marker', on = {tool or 'NAME'!r}"
    )
