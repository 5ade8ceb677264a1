"""What a mission file may say: the roots `mission` and `plant`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator

from skywright.core.spec import Coordinate, Fraction, Name, NonNegative, Positive, Spec
from skywright.description.robot.spec import Robot


class Scan(Spec):
    """A scan pattern on the pipe's unrolled surface (s along the axis, c around it)."""

    pattern: Literal["raster", "line", "spiral"] = "raster"
    side: Literal["side", "top", "underside", "angle"] = "side"
    centre_angle_deg: float = 0.0  # circumferential angle of the sector's middle, side = "angle"
    arc_deg: float = Field(default=40.0, gt=0, le=180)
    passes: int = Field(default=4, ge=1, le=100)  # axial passes; each makes two corners
    pass_length_m: float = Field(default=0.2, ge=1e-3, le=100.0)
    centre_s_m: float = 0.0
    speed_mps: float = Field(default=0.01, ge=1e-4, le=1.0)
    depth_m: Positive | None = None  # of the desired tip inside the surface; default from force_n
    stand_off_m: Positive = 0.05  # tip distance before touching
    retries: int = Field(default=2, ge=0, le=10)


class Waypoint(Spec):
    """A platform pose to reach and hold."""

    x_m: Coordinate
    y_m: Coordinate
    z_m: float = Field(gt=0, le=1000)
    yaw_deg: float = 0.0
    hold_s: float = Field(default=2.0, ge=0, le=3600)


class Requirement(Spec):
    """A metric with a limit that a run must meet."""

    limit: float
    sense: Literal["<=", "<", ">=", ">", "=="] = "<="
    unit: str = ""
    source: str = ""


KINDS = {
    "bar-insertion": "skywright.missions.bar_insertion.fly",
    "bar-transport": "skywright.missions.bar_transport.fly",
    "impact": "skywright.missions.impact.fly",
    "scan": "skywright.missions.scan.fly",
    "waypoints": "skywright.missions.waypoints.fly",
    "bimanual-bench": "skywright.missions.bimanual_bench.fly",
    "sensor-install": "skywright.missions.sensor_install.fly",
    "tool-install": "skywright.missions.tool_install.fly",
    "excitation": "skywright.missions.excitation.fly",
    "bridge-contact": "skywright.missions.bridge_contact.fly",
    "arm-test-bench": "skywright.missions.arm_test_bench.fly",
    "flight-modes": "skywright.missions.flight_modes.fly",
    "follow-plan": "skywright.missions.follow_plan.fly",
}
"""Kind of mission -> its module; a new kind is one more module and one more line."""

TASKS = {
    "bar-insertion": "skywright.missions.bar_insertion.task:BarInsertionMission",
    "bar-transport": "skywright.missions.bar_transport.task:BarTransportMission",
    "bridge-contact": "skywright.missions.bridge_contact.task:BridgeContactMission",
    "arm-test-bench": "skywright.missions.arm_test_bench.fly:ArmTestBenchMission",
    "flight-modes": "skywright.missions.flight_modes.fly:FlightModesMission",
    "bimanual-bench": "skywright.missions.bimanual_bench.task:BimanualBenchMission",
    "follow-plan": "skywright.missions.follow_plan.task:FollowPlanMission",
    "impact": "skywright.missions.impact.task:ImpactMission",
    "sensor-install": "skywright.missions.sensor_install.task:SensorInstallMission",
    "tool-install": "skywright.missions.tool_install.task:ToolInstallMission",
    "excitation": "skywright.missions.excitation.fly:ExcitationMission",
}
"""Kind of mission -> "module:class" of its spec, where it has a table `mission.task`."""


class Mission(Spec):
    """The root `mission`; a kind with a table `task` of its own has a subclass."""

    name: Name
    description: str = ""
    kind: str
    robot: str
    world: str
    seed: int = Field(default=1, ge=0)
    resolved: bool = False  # written in a run's mission.toml: the file is complete in itself
    mode: Literal["fast", "interactive"] = "fast"
    law: str | None = None  # registry name or "file.py:function"
    estimator: Literal["filter", "observer", "truth"] = "filter"
    hover_height_m: float = Field(default=1.2, gt=0, le=500)
    start_x_m: Coordinate = 0.0
    start_y_m: Coordinate = 0.0
    start_yaw_deg: float = 0.0
    wind_fraction: Fraction = 0.7  # of the computed wind limit that a mission may use
    planner_time_s: Positive = 20.0  # before the planner gives up
    scan: Scan | None = None
    waypoints: list[Waypoint] = []
    requirements: dict[str, Requirement] = {}

    def adapt_robot(self, robot: Robot) -> Robot:
        """Return the robot as this mission flies it; a kind may change it."""
        return robot

    def find_files(self, folder: Path) -> Mission:
        """Return the mission with absolute paths of the files that it names, beside `folder`."""
        return self

    @field_validator("kind")
    @classmethod
    def _kind_is_known(cls, kind: str) -> str:
        if kind not in KINDS:
            raise ValueError(f"unknown kind {kind!r}; valid: {', '.join(KINDS)}")
        return kind

    @model_validator(mode="after")
    def _kind_has_its_table(self) -> Mission:
        if self.kind == "scan" and self.scan is None:
            raise ValueError("kind = 'scan' needs a [mission.scan] table")
        if self.kind == "waypoints" and not self.waypoints:
            raise ValueError("kind = 'waypoints' needs at least one [[mission.waypoints]]")
        return self


class Plant(Spec):
    """The root `plant`: how the simulated truth deviates from what the controllers believe.

    Errors are fractions of the nominal value, or absolute where the key carries a unit.
    """

    mass_error: float = Field(default=0.03, gt=-0.9, lt=10)
    rotor_gain_error: float = Field(default=-0.03, gt=-0.9, lt=10)  # common to all rotors
    rotor_gain_spread: NonNegative = 0.02  # 1 sigma between rotors, drawn from the seed
    com_x_error_m: float = 0.004
    com_y_error_m: float = -0.003
    com_z_error_m: float = 0.004
    inertia_error: float = Field(default=0.05, gt=-0.9, lt=10)
    link_length_error_m: float = 0.004  # of the last link: a kinematic calibration error
    joint_offset_error_deg: float = 0.4  # encoder zero of every joint
    drag_error: float = Field(default=0.2, gt=-1, lt=10)
    marker_error_m: NonNegative = 0.001  # 1 sigma a axis: motion-capture markers of the probe
    # a pipe that is tracked is this far, either way, from where the planner's map has it
    map_error_m: float = Field(default=0.02, ge=0, le=0.2)  # each axis
    map_error_deg: float = Field(default=2.0, ge=0, le=20)  # heading
    # where tracked things that do not move, as a socket, stand against the world file
    socket_x_error_m: float = Field(default=0.0, ge=-0.1, le=0.1)  # in the socket's frame
    socket_y_error_m: float = Field(default=0.0, ge=-0.1, le=0.1)
    socket_z_error_m: float = Field(default=0.0, ge=-0.1, le=0.1)
    socket_roll_error_deg: float = Field(default=0.0, ge=-10, le=10)
    socket_pitch_error_deg: float = Field(default=0.0, ge=-10, le=10)
    socket_yaw_error_deg: float = Field(default=0.0, ge=-10, le=10)
    survey_error_m: NonNegative = 0.001  # 1 sigma a axis: markers on bar and socket, together
    survey_error_deg: NonNegative = 0.5  # 1 sigma about each axis, likewise
