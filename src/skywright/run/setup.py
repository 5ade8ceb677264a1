"""The models for planning, flight and evaluation of a mission, built once and shared."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from skywright.description.loader import Description
from skywright.description.mission.spec import T
from skywright.description.world.scenario import get_limits
from skywright.models.arm_body import Deviation
from skywright.models.deviation import build_deviation
from skywright.models.geometry import ClearanceQuery, build_clearance
from skywright.models.kinematic_tree import PlanningScene, build_planning_scene
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import posture
from skywright.models.scene import Scene, build_scene
from skywright.planning.inverse_dynamics import Loads, build_loads
from skywright.planning.problem import Limits
from skywright.run.limits import compute_wind_allowance

Array = NDArray[np.float64]


class Setup(Nominal, Generic[T]):
    """A description and the quantities computed from it; each is built on first use.

    All are nominal, as controllers and planners use them, except `deviation` and `true`.
    """

    def __init__(self, description: Description[T]) -> None:
        super().__init__(description.robot, description.world)
        self.description = description

    @property
    def task(self) -> T:
        """The task of the mission's kind."""
        return self.description.mission.task

    @cached_property
    def true(self) -> Nominal:
        """True geometry of robot and world: for evaluation, not for planners."""
        return Nominal(self.robot, self.description.true_world)

    @cached_property
    def scene(self) -> Scene:
        """The nominal scene, in which planners compute distances."""
        return build_scene(self.robot, self.world, nominal=self)

    @cached_property
    def clearance(self) -> ClearanceQuery:
        """Distances in the nominal scene, including the ground."""
        return build_clearance(self.scene, in_air=True, folded=posture(self.robot, "folded"))

    @cached_property
    def clearance_aloft(self) -> ClearanceQuery:
        """Distances in the nominal scene, without the ground."""
        return build_clearance(self.scene, with_ground=False)

    @cached_property
    def planning_scene(self) -> PlanningScene:
        """The nominal scene for planners of platform and joints."""
        return build_planning_scene(self.scene, self.robot, get_limits(self.world))

    @cached_property
    def deviation(self) -> Deviation:
        """Deviations of the plant from the nominal model."""
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
            self.world.air_density_kg_m3, compute_wind_allowance(self),
        )  # fmt: skip

    @cached_property
    def limits(self) -> Limits:
        """The limits of motion that the robot's file sets."""
        c, mission = self.robot.control, self.description.mission
        return Limits(
            margin=mission.surface_clearance_m,
            margin_transit=mission.clearance_m,
            margin_self=mission.self_clearance_m,
            margin_shapes=2.0 * mission.self_clearance_m,
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
