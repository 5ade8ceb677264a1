"""Checks before connection which missions fly in the loop with PX4, and what they lose."""

from __future__ import annotations

from typing import Any

from skywright.description.world.thing import Fixture
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.links.mavlink.body_force import find_forceless
from skywright.links.px4.parameters import build_airframe
from skywright.run.kind import load_kind
from skywright.run.setup import Setup
from skywright.vehicle.component import Law
from skywright.vehicle.link_arc import compute_link_arc

FORCES = "dynamics"
"""Requirement of kinds of missions that evaluate the motion of the robot's own law."""


def find_losses(setup: Setup[Any], law: Law, force: bool) -> list[str]:
    """Return what a mission loses with PX4 in the loop: lines to print before take-off.

    `force`: body forces are sent.
    """
    robot, says = setup.robot, []
    if compute_link_arc(robot, setup.model) is not None:
        gains = build_airframe(robot, setup.world).gains
        says.append(
            f"PX4 does not damp the swing of the link of {robot.name!r}: its attitude loop of "
            f"{gains.attitude_p[:2].min():.1f} rad/s has no model of the link"
        )
    if not force and not find_forceless(robot, law, setup.world.gravity_mps2):
        says.append(
            f"PX4's position control pushes along body z only: {robot.name!r} leans to push "
            "sideways; px4?force sends forces"
        )
    return says


def find_refusal(setup: Setup[Any], tells_truth: bool) -> str:
    """Return why a mission cannot fly with PX4 in the loop, or "".

    `tells_truth`: the mission's estimator returns the truth.
    """
    d = setup.description
    kind = load_kind(d.mission.kind)
    name = repr(d.mission.name)
    if not kind.flies:
        return f"mission {name} does not fly"
    if kind.held:
        return f"mission {name} begins in the air, held by a clamp: PX4 takes off from the ground"
    if FORCES in kind.needs:
        return f"mission {name} judges how the robot's own law moves the platform; PX4 moves it"
    if tells_truth:
        return "mission.estimator = 'truth': the platform's estimate is PX4's; take 'filter'"
    if find_first(setup.world.things, Fixture) is not None:
        return f"world {setup.world.name!r} holds the platform by a bench"
    try:
        build_airframe(setup.robot, setup.world)
    except InputError as error:
        return str(error)
    return ""
