"""Where tracked things are, as the robot believes: the mean of motion capture's samples of them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from skywright.core.record import Mat3, Record, Vec3
from skywright.core.rotations import orthonormalise
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.thing import Placed
from skywright.description.world.things import find_carrier
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Component, Out, Output, helper
from skywright.vehicle.readings import TargetCapture

PIPE = "pipe"
"""Name of the world's pipe among what is tracked."""
STANDS = 1.0
"""s, after which the mean has forgotten where something was that is not meant to move."""
CARRIED = 0.15
"""s, likewise of what is carried or lies loose."""
LOST = 1.0
"""s without a sample after which the mean begins anew."""
NEVER = 1e3
"""s, age of a target that was not measured yet."""


class Target(Output):
    """Where a target is."""

    p_WO: Vec3  # m
    R_WO: Mat3
    age: float  # s, since it was last seen
    samples: float  # in the mean, 0: none came yet


class TargetEstimate(Component):
    """Fills Target: the running mean of the samples of one tracked thing."""

    slot = "estimate"

    class Me(Record):
        memory: float  # s

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self.ports = {"sample": f"tracked {name.removesuffix(' target')}"}

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for each tracked thing."""
        for name in list_tracked(context.robot, context.world):
            yield cls(f"{name} target")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """No sample came yet."""
        things, name = context.world.things, self.name.removesuffix(" target")
        moves = name in things and (things[name].movable or find_carrier(things, name) is not None)
        me.memory = CARRIED if moves else STANDS
        key = (Target, self.name) if (Target, self.name) in context.records else (Target, "")
        target = context.records[key][0]
        target["R_WO"], target["age"] = np.eye(3), NEVER

    @staticmethod
    def step(me: Me, clock: Clock, sample: TargetCapture, target: Out[Target]) -> None:
        target.age += clock.dt
        if sample.fresh > 0.0:
            take_sample(target, sample.p_WO, sample.R_WO, me.memory)


@helper
def take_sample(target: Any, p: Any, R: Any, memory: float) -> None:
    """Take a sample (p (3,) m, R (3, 3)) into the mean, which forgets within `memory` (s)."""
    if target.age > LOST:
        target.samples = 0.0
    target.samples += 1.0
    gain = max(1.0 / target.samples, 1.0 - math.exp(-target.age / memory))
    target.age = 0.0
    for a in range(3):
        target.p_WO[a] += gain * (p[a] - target.p_WO[a])
        for c in range(3):
            target.R_WO[a, c] += gain * (R[a, c] - target.R_WO[a, c])
    orthonormalise(target.R_WO)


def list_tracked(robot: Robot, world: World) -> list[str]:
    """List what motion capture tracks: the pipe (PIPE) and things; a camera sees markers itself."""
    if not world.tracks_markers:
        return []
    pipe = [PIPE] if world.pipe is not None and world.pipe.tracked else []
    return pipe + [
        name
        for name, thing in world.things.items()
        if isinstance(thing, Placed)
        and thing.tracked
        and not (thing.is_marker and robot.camera is not None)
    ]
