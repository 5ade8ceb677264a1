"""The parts of the public Python API, each for one task on your own data.

Names are imported from `skywright` itself; docs/reference/python.md shows each in a script. SI and
radians; frames W (ENU, z up), B (platform, FLU), T (tip). Wrong input raises InputError.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike, NDArray

from skywright.description.loader import (
    Description,
    Sets,
    load_description,
    split_assignments,
)
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.errors import InputError, check_path, naming_arguments

if TYPE_CHECKING:
    from skywright.analysis.campaign.campaign import CampaignResult
    from skywright.analysis.identify.identify import Identification
    from skywright.analysis.locate.locate import LocateReport
    from skywright.inspection.weld_data import WeldReport
    from skywright.links.broadcast.options import Live
    from skywright.models.as_mujoco import MjModel
    from skywright.models.capability import Capability
    from skywright.planning.motion.transit import Configuration, Transit
    from skywright.planning.shapes import Shape
    from skywright.run.session import Vehicle
    from skywright.vehicle.component import Component
    from skywright.vehicle.motions import Arrival
    from skywright.vehicle.simulated import SimulatedVehicle
    from skywright.vehicle.stepped import LawStep

Path_ = str | os.PathLike[str]


@naming_arguments(sets="--set")
def load_robot(robot: Path_, *, sets: Sets = ()) -> Robot:
    """Load a robot by its built-in name or file; `sets` changes values ("robot.platform.mass_kg").

    Returns frozen, validated tables, whose keys contain their units. Raises InputError, which names
    file and key.
    """
    from skywright.description.robot.loader import load_robot as load

    check_path("robot", robot)
    return load(robot, split_assignments(sets))[0]


def load_world(world: Path_) -> World:
    """Load a world by its built-in name or file; raises InputError naming file and key."""
    from skywright.description.world.loader import load_world as load

    check_path("world", world)
    return load(world)[0]


def compute_capability(
    robot: Robot | Path_, *, posture: str | Sequence[float] = "extended"
) -> Capability:
    """Compute the static limits of a robot: forces (N), tilts (rad), wind (m/s), payload, power.

    For its wind limit a robot with lateral force stays level; the others tilt up to `tilt_max`.
    `posture` is "extended", "folded", "worst", or the joints' angles (rad). Directions are
    horizontal in B, from +x counter-clockwise. Raises InputError if the robot cannot lift itself.
    """
    from skywright.models import capability

    return capability.compute_capability(_as_robot(robot), posture=posture)


def build_mjcf(
    robot: Robot | Path_, world: World | Path_ = "open", *, nominal: bool = False
) -> str:
    """Return robot and world as MJCF, as simulated; with `nominal=True` the nominal model.

    SI and radians, numbers to six digits; MuJoCo's world frame is W. Rotors are the actuators
    `thrust0`, ... (N); the nominal model has no actuators.
    """
    from skywright.models import as_mujoco

    return as_mujoco.build_mjcf(_as_robot(robot), _as_world(world), nominal=nominal)


def build_model(
    robot: Robot | Path_, world: World | Path_ = "open", *, nominal: bool = False
) -> MjModel:
    """Return the same as `build_mjcf` as a compiled mujoco.MjModel."""
    from skywright.models import as_mujoco

    return as_mujoco.build_model(_as_robot(robot), _as_world(world), nominal=nominal)


def build_urdf(robot: Robot | Path_) -> str:
    """Return the robot as URDF: links with masses, inertias, shapes; the root `platform` is B."""
    from skywright.models import urdf

    return urdf.build_urdf(_as_robot(robot))


def build_vehicle(description: Description | Path_) -> SimulatedVehicle:
    """Build the simulated vehicle of a mission, motors off at its start, to tick it in a loop.

    `vehicle.tick()` runs 20 ms and returns `t` (s) and whether the tracked motion has `arrived`;
    `Uav(vehicle)` commands it. `vehicle.save()` and `vehicle.restore(state, seed)` return to a
    state, bit for bit or with other noise. `vehicle.last_sample` (1,) holds the columns of a
    recording; later ticks overwrite it. `vehicle.estimate` is what controllers receive.
    """
    from skywright.run.backends import build_vehicle as build

    return build(as_description(description))


@naming_arguments(sets="--set")
def fly(
    robot: Path_ | None = None,
    *,
    world: Path_ | None = None,
    mission: Path_ = "waypoints",
    backend: str = "physics",
    seed: int | None = None,
    sets: Sets = (),
    arrival: Arrival | None = None,
    checklist: bool = True,
    live: Live | None = None,
    parts: Sequence[Component] = (),
) -> Vehicle:
    """Return a vehicle that a script flies, on the ground with its motors off.

    Robot and world default to those of `mission`, whose phases are not flown. A command returns
    when it has ended. `backend` is "physics", "kinematic" (references are
    followed exactly), "mavlink:URL" (a vehicle over MAVLink), or "recording": `mission` is then a
    run's directory, which is played.
    `checklist` selects whether `[mission.checklist]` and the spin check are evaluated before the
    motors start. `parts` are further components, such as real servos (links/servo_bus/arms.py).
    `live` publishes the vehicle to ROS 2 and Foxglove, and accepts commands of ROS 2 at every tick.
    Raises InputError if an argument is invalid, and NoEstimate, a SkywrightError, if the position
    is not estimated within 10 s on the ground.
    """
    from skywright.run.session import open_recording, open_vehicle

    if backend == "recording":
        if live is not None:
            raise InputError(
                "live: not valid with the back end recording; valid back ends: physics, kinematic"
            )
        return open_recording(Path(mission))
    description = load_description(mission, robot, world, sets, seed)
    if live is None:
        return open_vehicle(description, backend, arrival, checklist, parts)
    from skywright.links.broadcast.open import open_live

    link = open_live(live, description)
    try:
        vehicle = open_vehicle(description, backend, arrival, checklist, parts)
        link.attach(vehicle)
    except BaseException:
        link.close()
        raise
    return vehicle


def build_law(description: Description | Path_) -> LawStep:
    """Build the control law of a mission, to step it on your own state; see `LawStep`."""
    from skywright.vehicle.stepped import LawStep

    return LawStep(build_vehicle(description))


def run_estimator(
    description: Description | Path_,
    *,
    t: ArrayLike,
    gyro: ArrayLike,
    accel: ArrayLike,
    t_fix: ArrayLike,
    p_fix: ArrayLike,
    R_fix: ArrayLike | None = None,
    heading: ArrayLike | None = None,
) -> NDArray[Any]:
    """Run the estimator of a mission on your own inertial samples and position fixes.

    `t` (n,) s, evenly spaced; `gyro` (n, 3) rad/s and `accel` (n, 3) m/s^2 (specific force), in
    B; fixes at `t_fix` (m,) s on the same clock: `p_fix` (m, 3) m in W, and with motion capture
    `R_fix`, rotation matrices (m, 3, 3) or unit quaternions (m, 4) with w first, else (satellites)
    `heading` (m,) rad of B's x axis. Positions are
    those of B's origin, with satellites those of the antenna; the robot must then be at rest at
    the start. The estimator assumes the noise of the mission's robot and world: set the keys
    `world.mocap.position_noise_m` and `attitude_noise_rad` to those of your data. A UserWarning
    states the noise found if the estimator rejects several fixes in a row. Raises InputError for an
    input that is missing, not read, or implausible in these units and axes.

    Returns a structured array with one row per control period: `t`, `p_WB`, `v_WB`, `R_WB`,
    `w_WB_B`, `p_std` (m, stated deviations) and `ready`. Until the first fixes start the
    estimator, `ready` is false and the others, except for `t`, are NaN.
    """
    from skywright.vehicle.own_data import check_samples
    from skywright.vehicle.stepped import EstimatorRun

    samples = check_samples(t, gyro, accel, t_fix, p_fix, R_fix, heading)
    return EstimatorRun(build_vehicle(description)).feed(*samples)


def plan_motion(
    robot: Robot | Path_,
    start: Sequence[float] | Configuration,
    goal: Sequence[float] | Configuration,
    shapes: Sequence[Shape] = (),
    *,
    margin: float = 0.1,
    seed: int = 1,
) -> Transit:
    """Plan a motion of platform and arm among `Box`, `Cylinder` and `Sphere` over the ground.

    `start` and `goal` are x, y, z (m) and yaw (rad) with the arm folded, or `Configuration`s with
    the joints' angles q (rad). `margin` (m) is the least distance to all shapes. Returns the
    corners of the path, `p_WB` (k, 3) m, `yaw` (k,) rad and `q` (k, joints) rad, which straight
    lines connect, and its `clearance` (m). Equal seeds give equal paths. A path uses the space
    up to 2 m beyond start, goal and shapes, so it may lead over a wall.
    Raises InfeasibleError, whose `blocked_by` names the obstacle.
    """
    from skywright.planning.shapes import plan_between

    world = load_world("open")
    return plan_between(_as_robot(robot), world, start, goal, shapes, margin, seed)


@naming_arguments(sets="--set")
def campaign(
    mission: Path_,
    runs: int,
    vary: Mapping[str, str],
    *,
    robot: Path_ | None = None,
    world: Path_ | None = None,
    seed: int | None = None,
    sets: Sets = (),
    out: Path_ | None = None,
    workers: int | None = None,
) -> CampaignResult:
    """Fly a mission `runs` times, keys drawn from distributions: {"world.wind.mean_mps":
    "uniform(0, 5)"}.

    With {} the runs differ by their seeds only.
    `out` is the folder (default: one under `campaigns/`); the same call continues a campaign.
    `sets` is that of `load`. `workers` is the number of processes (default: all cores). The result
    has `rows` (one per run: outcome, metrics, varied values), the `verdict` and the `folder`.
    Raises InputError before the first flight.
    """
    from skywright.analysis.campaign.campaign import run_campaign
    from skywright.analysis.campaign.spec import build_campaign

    check_path("mission", mission)
    if not isinstance(vary, Mapping):
        raise InputError(
            f"vary: got {type(vary).__name__}; valid: a dictionary of distributions by key, or {{}}"
        )
    try:
        runs = operator.index(runs)
    except TypeError:
        raise InputError(f"runs: got {runs!r}; valid: an integer of 1 or more") from None
    varied = [f"{key}={text}" for key, text in vary.items()]
    plan = build_campaign(mission, varied, robot=robot, world=world, seed=seed, sets=sets)
    return run_campaign(plan, runs, out=None if out is None else Path(out), workers=workers)


@naming_arguments(surface_file="--surface")
def weld(
    data: Path_,
    *,
    calibrate: str | Sequence[float] | None = None,
    calibration_file: Path_ | None = None,
    surface_file: Path_ | None = None,
    columns: str | None = None,
    lift_off_threshold: float | None = None,
    weld_threshold: float | None = None,
) -> WeldReport:
    """Find the weld in a scan: a CSV file, a run's directory or its recording.

    `calibrate` is (T0, T1) or "T0:T1" (s), the thresholds are in units of the instrument, `columns`
    names columns and units: "t=Time[ms],x=X[mm]". `report.result` holds arrays, `report.to_json()`
    what the command prints. Raises InputError.
    """
    from skywright.inspection.weld_data import process_file
    from skywright.recordings.text_table import join_numbers

    check_path("data", data)
    return process_file(
        Path(data),
        join_numbers("calibrate", calibrate, "T0:T1"),
        None if calibration_file is None else Path(calibration_file),
        lift_off_threshold,
        weld_threshold,
        None if surface_file is None else Path(surface_file),
        columns,
    )


@naming_arguments(span="--calibrate")
def locate(
    *data: Path_,
    station: Path_ | None = None,
    camera: Path_ | None = None,
    reference: Path_ | None = None,
    align: str = "similarity",
    span: str | Sequence[float] | None = None,
    time_offset: float | None = None,
    prism: str | Sequence[float] | None = None,
    frame: tuple[Path_, Path_] | None = None,
    compare: str = "rigid",
    reference_offset: float | None = None,
) -> LocateReport:
    """Fuse the recordings of a total station and a tracking camera, or evaluate a trajectory.

    `data` are files as of `skywright locate`. `span` is (T0, T1) or "T0:T1" (s), the offsets are
    in s, `prism` is (x, y, z) or "X,Y,Z" (m, in the camera's frame), `frame` a pair of files of
    points (known, measured).
    `report.trajectory` has `t` (n,) s and `p` (n, 3) m. Raises InputError.
    """
    from skywright.analysis.locate.locate import locate as locate_files
    from skywright.recordings.text_table import join_numbers

    for file in data:
        check_path("data", file)
    roles = [None if file is None else os.fspath(file) for file in (station, camera, reference)]
    return locate_files(
        [os.fspath(file) for file in data],
        station=roles[0], camera=roles[1], reference=roles[2], align=align,
        span=join_numbers("span", span, "T0:T1"), time_offset=time_offset,
        prism=join_numbers("prism", prism, "X,Y,Z"),
        frame=frame, compare=compare, reference_offset=reference_offset,
    )  # fmt: skip


@naming_arguments()
def identify(
    *logs: Path_, robot: Robot | Path_ | None = None, mass: float | None = None
) -> Identification:
    """Fit a robot's parameters to flights: run directories, recordings or PX4 ULogs.

    `robot` is required for a ULog; `mass` (kg) is the measured mass of the robot.
    `found.to_json()` has every parameter with its interval.
    """
    from skywright.analysis.identify.identify import identify as identify_logs

    for log in logs:
        check_path("logs", log)
    spec = None if robot is None else _as_robot(robot)
    return identify_logs([Path(log) for log in logs], spec, mass)


def _as_robot(robot: Robot | Path_) -> Robot:
    if isinstance(robot, Robot):
        return robot
    check_path("robot", robot, ", or what load_robot returns")
    return load_robot(robot)


def _as_world(world: World | Path_) -> World:
    if isinstance(world, World):
        return world
    check_path("world", world, ", or what load_world returns")
    return load_world(world)


def as_description(description: Description | Path_) -> Description:
    """Return a description unchanged, or load the mission of that name, file or run."""
    if isinstance(description, Description):
        return description
    check_path("description", description, " of a mission, or what load returns")
    return load_description(description)
