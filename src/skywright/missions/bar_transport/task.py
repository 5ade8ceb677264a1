"""Keys of a mission of the kind "bar-transport"."""

from pathlib import Path

from pydantic import Field

from skywright.core.spec import Coordinate, NonNegative, Positive
from skywright.description.mission.spec import Task
from skywright.description.robot.bar import Bar
from skywright.description.robot.spec import Robot
from skywright.planning.motion.plan_file import name_files


class BarTransport(Task):
    """Carry a bar in both hands through a world's structures, in the plane y = 0.

    The flight starts at (`mission.start_x_m`, 0, `mission.hover_height_m`), arms in working
    posture.
    """

    bar_length_m: NonNegative = 2.0  # length of the bar; 0: no bar
    bar_diameter_m: Positive = 0.04  # diameter of the bar
    bar_mass_kg: Positive = 0.3  # mass of the bar
    goal_x_m: Coordinate = 9.0  # goal of the platform, x in W
    goal_z_m: float = Field(default=2.0, gt=0, le=100)  # goal of the platform, height in W
    margin_m: Positive = 0.2  # least distance between robot or bar and the structures in the plan
    p1: Positive = 1.0  # weight of the platform's path in the cost (6) of Caballero 2018
    p2: Positive = 0.1  # weight of the joints' paths in the same cost
    # limit of the planning work; a slice takes about 1 ms
    planner_slices: int = Field(default=1000, ge=1, le=1_000_000)
    swing_plan_deg: Positive = 2.5  # largest planned angle of the passive joint off its equilibrium
    plan_file: str = ""  # plan file (NAME.csv or NAME.toml) to fly instead of planning
    # duration of the transport; default: the shortest feasible one
    duration_s: Positive | None = None

    def list_files(self) -> tuple[Path, ...]:
        """Return the two files of the plan."""
        return name_files(self.plan_file) if self.plan_file else ()

    def adapt_robot(self, robot: Robot) -> Robot:
        """Add the bar to the robot's hands."""
        if robot.arm is None or robot.arm.sides != 2:
            return robot
        bar = None
        if self.bar_length_m > 0.0:
            bar = Bar(
                length_m=self.bar_length_m, diameter_m=self.bar_diameter_m,
                mass_kg=self.bar_mass_kg,
            )  # fmt: skip
        return robot.model_copy(update={"arm": robot.arm.model_copy(update={"bar": bar})})
