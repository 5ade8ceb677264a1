"""Checks before connection whether a mission and a robot can fly over MAVLink."""

from __future__ import annotations

from typing import Any

from skywright.description.world.thing import Fixture
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.links.px4.parameters import build_airframe
from skywright.run.kind import load_kind
from skywright.run.setup import Setup
from skywright.vehicle.kinematic import OFFERS
from skywright.vehicle.link_arc import compute_link_arc

WHY = {
    "probe": "its probe is simulated in the physics only",
    "hands": "its compliant arms feel forces in the physics only",
    "dynamics": "it judges the motion that forces make",
}
"""Feature that a MAVLink vehicle does not offer -> reason."""


def find_refusal(setup: Setup[Any]) -> str:
    """Return why a mission cannot fly over MAVLink, or ""."""
    d = setup.description
    kind = load_kind(d.mission.kind)
    lacks = sorted(kind.needs - OFFERS)
    if lacks:
        reasons = "; ".join(f"{name} ({WHY.get(name, 'not offered')})" for name in lacks)
        return f"mission {d.mission.name!r} requires {reasons}"
    if not kind.flies:
        return f"mission {d.mission.name!r} does not fly"
    if kind.held:
        return f"mission {d.mission.name!r} begins in the air, held by a clamp"
    return find_unflyable(setup)


def find_unflyable(setup: Setup[Any]) -> str:
    """Return why an autopilot's position control cannot fly a robot in a world, or ""."""
    robot, world = setup.robot, setup.world
    if compute_link_arc(robot, setup.model) is not None:
        return (
            f"{robot.name!r} starts with a link on the ground: an autopilot's position control "
            "cannot lift it off along the link's arc"
        )
    if find_first(world.things, Fixture) is not None:
        return f"world {world.name!r} holds the platform by a bench"
    try:
        build_airframe(robot, world)
    except InputError as error:
        return str(error)
    return ""
