"""Quantities that depend on robot and world alone, computed once: rotors, rigid body, surfaces."""

from functools import cached_property
from typing import Any

from numpy.typing import NDArray

from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.structure import Surface, build_surface
from skywright.description.world.surface import Cylinder, build_cylinder
from skywright.models.allocation import Allocator, build_allocator
from skywright.models.rigid_body import build_body_model
from skywright.models.rotors import RotorSet, build_rotors


class Nominal:
    """The nominal model of a robot in a world; its parts are built at first use."""

    def __init__(self, robot: Robot, world: World) -> None:
        self.robot, self.world = robot, world

    @cached_property
    def model(self) -> NDArray[Any]:
        """The rigid body, (1,) of `BodyModel`."""
        return build_body_model(self.robot, self.world.gravity_mps2)

    @cached_property
    def rotors(self) -> RotorSet:
        """The rotors."""
        return build_rotors(self.robot.rotors)

    @cached_property
    def allocator(self) -> Allocator:
        """The allocation from wrenches to rotor thrusts."""
        return build_allocator(self.rotors)

    @cached_property
    def cylinder(self) -> Cylinder | None:
        """The pipe's surface, if the world has a pipe."""
        return None if self.world.pipe is None else build_cylinder(self.world.pipe)

    @cached_property
    def surface(self) -> Surface | None:
        """The structure's surface, if the world has a structure."""
        return None if self.world.structure is None else build_surface(self.world.structure)
