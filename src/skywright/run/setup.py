"""What a mission is planned, flown and evaluated with, built once and shared by all three."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from skywright.description.loader import Description
from skywright.description.mission.spec import T
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.structure import Surface, build_surface
from skywright.description.world.surface import Cylinder, build_cylinder
from skywright.models.allocation import Allocator, build_allocator
from skywright.models.arm_body import Deviation
from skywright.models.deviation import build_deviation
from skywright.models.geometry import ClearanceQuery, build_clearance
from skywright.models.kinematic_tree import PlanningScene, build_planning_scene
from skywright.models.rigid_body import build_body_model
from skywright.models.rotors import RotorSet, build_rotors
from skywright.models.scene import Scene, build_scene
from skywright.planning.inverse_dynamics import Loads, build_loads
from skywright.planning.problem import Limits
from skywright.run.limits import compute_wind_allowance

Array = NDArray[np.float64]


class Setup(Generic[T]):
    """A description and what is computed from it; each thing is built when it is first asked for.

    Everything but `deviation` and `plant_scene` is nominal: what controllers and planners believe.
    """

    def __init__(self, description: Description[T]) -> None:
        self.description = description

    @property
    def task(self) -> T:
        """What the mission's kind is asked to do."""
        return self.description.mission.task

    @property
    def robot(self) -> Robot:
        """The robot as the mission flies it."""
        return self.description.robot

    @property
    def world(self) -> World:
        """The world as its file has it."""
        return self.description.world

    @cached_property
    def model(self) -> NDArray[Any]:
        """The nominal rigid body, (1,) of `BodyModel`."""
        return build_body_model(self.robot, self.world.gravity_mps2)

    @cached_property
    def rotors(self) -> RotorSet:
        """The nominal rotors."""
        return build_rotors(self.robot.rotors)

    @cached_property
    def allocator(self) -> Allocator:
        """From wrenches to thrusts of the nominal rotors."""
        return build_allocator(self.rotors)

    @cached_property
    def scene(self) -> Scene:
        """The nominal scene: what planners measure distances in."""
        return build_scene(self.robot, self.world)

    @cached_property
    def clearance(self) -> ClearanceQuery:
        """Distances in the nominal scene, the ground included."""
        return build_clearance(self.scene)

    @cached_property
    def clearance_aloft(self) -> ClearanceQuery:
        """Distances in the nominal scene, the ground left out."""
        return build_clearance(self.scene, with_ground=False)

    @cached_property
    def planning_scene(self) -> PlanningScene:
        """The nominal scene as planners of platform and joints search it."""
        return build_planning_scene(self.scene, self.robot)

    @cached_property
    def cylinder(self) -> Cylinder | None:
        """The pipe's surface, in a world that has one."""
        return None if self.world.pipe is None else build_cylinder(self.world.pipe)

    @cached_property
    def surface(self) -> Surface | None:
        """The structure's surface, in a world that has one."""
        return None if self.world.structure is None else build_surface(self.world.structure)

    @cached_property
    def deviation(self) -> Deviation:
        """How the simulated truth deviates from all this."""
        d = self.description
        return build_deviation(d.plant, d.robot, d.mission.seed)

    @cached_property
    def loads(self) -> Loads:
        """Rotors with the mission's thrust fraction, and the mean wind as an allowance."""
        p, rotors = self.robot.platform, self.rotors
        return build_loads(
            self.allocator, rotors.position, rotors.axis, rotors.drag_coefficient,
            self.robot.rotors.thrust_fraction,
            np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2]),
            self.world.air_density_kg_m3, compute_wind_allowance(self.robot, self.world),
        )  # fmt: skip

    @cached_property
    def limits(self) -> Limits:
        """The limits of motion that the robot's file sets."""
        c = self.robot.control
        return Limits(
            speed=c.speed_max_mps,
            acceleration=c.acceleration_max_mps2,
            tilt=math.radians(c.tilt_max_deg),
            ground=self.robot.platform.gear_height_m + 0.05,
        )

    @property
    def hover(self) -> Array:
        """The hover point over the start, (4,): x, y, z (m) and yaw (rad)."""
        m = self.description.mission
        return np.array([m.start_x_m, m.start_y_m, m.hover_height_m, math.radians(m.start_yaw_deg)])
