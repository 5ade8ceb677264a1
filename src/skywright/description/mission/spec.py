"""Keys of a mission file: the roots `mission` and `plant`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, Literal, Self, TypeVar

from pydantic import Field, model_validator

from skywright.core.find import find
from skywright.core.spec import Coordinate, Fraction, Name, NonNegative, Positive, Spec
from skywright.description.mission.safety import Checklist, Fence
from skywright.description.parts import Part, type_parts
from skywright.description.robot.spec import Robot
from skywright.errors import InputError


class Requirement(Spec):
    """A metric with a limit that a run must meet."""

    limit: float
    sense: Literal["<=", "<", ">=", ">", "=="] = "<="
    unit: str = ""
    source: str = ""


class Task(Spec):
    """The table `mission.task`; each kind of mission has its own."""

    def adapt_robot(self, robot: Robot) -> Robot:
        """Return the robot in the configuration of this mission; a kind may change it."""
        return robot

    def find_files(self, folder: Path) -> Self:
        """Return the task with absolute paths of its files, which are relative to `folder`."""
        return self

    def list_files(self) -> tuple[Path, ...]:
        """Return the files that keys of the task name; a campaign notices that they change.

        Relative paths are looked up in the mission's folder, then in the current folder.
        """
        return ()

    def get_gap_limit(self) -> float | None:
        """Return the largest gap (m) of a probe that counts as contact; None: the default."""
        return None


T = TypeVar("T", bound=Task)


class Rules(Spec):
    """Rules that respond to faults: `[mission.faults.NAME]`, one table per rule."""


class Faults(Spec):
    """Faults of the plant, by name: `[plant.faults.NAME] kind = ...`."""


class Mission(Spec, Generic[T]):
    """The root `mission`; T is the task of its kind."""

    name: Name
    description: str = ""
    kind: str  # name, or "file.py:Class"
    robot: str
    world: str
    seed: int = Field(default=1, ge=0)
    resolved: bool = False  # set in a run's mission.toml: the file is complete
    mode: Literal["fast", "interactive"] = "fast"
    timestep_ms: Literal[1, 2] = 1  # of the physics; 2 if no contact is too stiff for it
    law: Part | None = None
    estimator: Part = Part(kind="filter")
    hover_height_m: float = Field(default=1.2, gt=0, le=500)
    start_x_m: Coordinate = 0.0
    start_y_m: Coordinate = 0.0
    start_yaw_deg: float = 0.0
    # least clearance in free flight; missions with mission.task.way_clearance_m use that instead
    clearance_m: float = Field(default=0.05, ge=0.01, le=1)
    # clearance of all parts except the probe's tip from the surface at which the robot works
    surface_clearance_m: float = Field(default=0.03, ge=0.005, le=1)
    # clearance between parts of the robot: 0.4 deg of a joint over 0.6 m, and 4 mm of a link
    # (plant); path planners, whose shapes are coarser, use twice as much
    self_clearance_m: float = Field(default=0.01, ge=0, le=0.2)
    # clearance from all obstacles on the vertical path between the ground and the hover point
    climb_clearance_m: float = Field(default=0.1, ge=0, le=1)
    wind_fraction: Fraction = 0.7  # usable fraction of the computed wind limit
    # gusts in standard deviations: 3 is the expected maximum of the tens of gusts that pass during
    # a scan (peak factor, Davenport 1964)
    gust_sigmas: float = Field(default=3.0, ge=0, le=6)
    # thrust commands due to the gyroscope's noise that the rotors' limits must permit, in standard
    # deviations
    noise_sigmas: float = Field(default=3.0, ge=0, le=6)
    # least phase margin of the attitude loop with the delay of the control link
    link_phase_deg: float = Field(default=0.0, ge=0, le=60)
    # wall time of a mission tick (20 ms of flight) after which a component counts as stuck
    step_limit_s: float = Field(default=20.0, ge=0.1, le=3600)
    calibrate_springs: bool = True  # with known loads, before the flight (models/spring_bench.py)
    record_raw: bool = True  # every sample of sensors that declare streams, at its own rate
    planner_time_s: Positive = 20.0  # time limit of the planner
    task: T
    requirements: dict[str, Requirement] = {}
    faults: Rules = Rules()
    fence: Fence = Fence()
    checklist: Checklist = Checklist()

    @model_validator(mode="before")
    @classmethod
    def _task_may_be_left_out(cls, data: Any) -> Any:
        return {"task": {}, **data} if isinstance(data, dict) else data

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by kind: the class is created at run time, and the task may be a user's."""
        return revive_mission, (self.kind, self.model_dump())


class Plant(Spec):
    """The root `plant`: deviations of the simulated truth from the nominal model.

    Errors are fractions of the nominal value, or absolute if the key has a unit.
    """

    mass_error: float = Field(default=0.03, gt=-0.9, lt=10)
    rotor_gain_error: float = Field(default=-0.03, gt=-0.9, lt=10)  # common to all rotors
    # 1 sigma between rotors, drawn from the seed and cut off at 3 sigma
    rotor_gain_spread: float = Field(default=0.02, ge=0, le=0.3)
    com_x_error_m: float = 0.004
    com_y_error_m: float = -0.003
    com_z_error_m: float = 0.004
    inertia_error: float = Field(default=0.05, gt=-0.9, lt=10)
    link_length_error_m: float = 0.004  # of the last link: a kinematic calibration error
    # additional error, 1 sigma of each link that carries another, drawn from the seed
    link_length_spread_m: float = Field(default=0.0, ge=0, le=0.02)
    joint_offset_error_deg: float = 0.4  # encoder zero of every joint
    # additional error, 1 sigma of each joint's encoder zero, drawn from the seed
    joint_offset_spread_deg: float = Field(default=0.0, ge=0, le=5)
    drag_error: float = Field(default=0.2, gt=-1, lt=10)  # of the platform and the rotors
    spring_error: float = Field(default=0.0, gt=-0.9, lt=10)  # of joints' and probe's springs
    spring_spread: float = Field(default=0.1, ge=0, le=0.3)  # 1 sigma of each, from the seed
    hardening_error: float = Field(default=0.1, gt=-0.9, lt=10)  # beyond the linear range
    backlash_error: float = Field(default=0.1, ge=-1, lt=10)
    servo_lag_error: float = Field(default=0.1, gt=-0.9, lt=10)  # of the arm's servos
    sensor_noise_error: float = Field(default=0.2, ge=0, le=0.7)  # 1 sigma of its logarithm
    marker_error_m: NonNegative = 0.001  # 1 sigma per axis: motion-capture markers of the probe
    # 1 sigma per axis: position and direction of the probe's camera relative to the probe
    probe_camera_error_m: NonNegative = 0.0005
    probe_camera_error_deg: NonNegative = 0.2
    # largest deviation of the true pipe or structure from the map (world file), in either direction
    map_error_m: float = Field(default=0.0, ge=0, le=0.2)  # each axis
    # heading, inclination or slope, rotation of a pipe about its axis
    map_error_deg: float = Field(default=0.0, ge=0, le=20)
    map_error_size_m: float = Field(default=0.0, ge=0, le=0.05)  # radius
    # deviation of tracked things that do not move, such as a socket, from the world file
    socket_x_error_m: float = Field(default=0.0, ge=-0.1, le=0.1)  # in the socket's frame
    socket_y_error_m: float = Field(default=0.0, ge=-0.1, le=0.1)
    socket_z_error_m: float = Field(default=0.0, ge=-0.1, le=0.1)
    socket_roll_error_deg: float = Field(default=0.0, ge=-10, le=10)
    socket_pitch_error_deg: float = Field(default=0.0, ge=-10, le=10)
    socket_yaw_error_deg: float = Field(default=0.0, ge=-10, le=10)
    survey_error_m: NonNegative = 0.001  # 1 sigma per axis: markers on bar and socket, together
    survey_error_deg: NonNegative = 0.5  # 1 sigma about each axis, likewise
    faults: Faults = Faults()


def find_mission_spec(kind: object, folders: Sequence[Path] = ()) -> tuple[str, type[Mission[Any]]]:
    """Return a kind's resolved name (the path of a file is absolute) and its missions' spec.

    Raises InputError if there is no such kind.
    """
    found = find("kind", kind, folders, "mission.kind")
    task = found.cls.task if hasattr(found.cls, "task") else None
    if not isinstance(task, type) or not issubclass(task, Task):
        raise InputError(f"mission.kind: {found.name!r} does not define its task class: task = ...")
    mission: Any = Mission  # the task is known at run time only
    return found.name, mission[task]


def revive_mission(kind: str, values: Mapping[str, Any]) -> Mission[Any]:
    """Build a mission from the output of `Mission.__reduce__`."""
    spec: Any = type_parts(find_mission_spec(kind)[1], "mission", {"mission": dict(values)})
    mission: Mission[Any] = spec.model_validate(values)
    return mission
