"""Which missions fly in the loop with PX4: told before anything listens."""

from __future__ import annotations

from typing import Any

from skywright.description.world.thing import Fixture
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.links.px4.parameters import build_airframe
from skywright.run.kind import load_kind
from skywright.run.setup import Setup

FORCES = "dynamics"
"""What a kind needs that judges the motion which the robot's own law makes."""


def find_refusal(setup: Setup[Any], tells_truth: bool) -> str:
    """Return why a mission is not flown with PX4 in the loop, "" where it is.

    `tells_truth`: the mission's estimator gives the truth.
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
