"""Skywright: simulate, plan, control and fly multirotors with arms that touch things.

Four functions correspond to commands of the command line:

    import skywright

    description = skywright.load("pipe-weld-scan", sets={"world.pipe.diameter_m": 0.3})
    plan = skywright.plan(description)
    result = skywright.run(description)
    print(result.outcome, result.metrics["weld.angle_error_deg"])
    again = skywright.evaluate(result.directory)

The parts behind them can be used alone; docs/reference/python.md lists what is stable.
Units are SI and radians; names with another unit state it. Importing the package opens no files
and loads no other library; each function imports its libraries at its first use.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skywright.errors import (
    InfeasibleError,
    InputError,
    SimulationError,
    SkywrightError,
    naming_arguments,
)

if TYPE_CHECKING:
    import os

    from skywright.analysis.campaign.campaign import CampaignResult
    from skywright.analysis.identify.identify import Identification
    from skywright.analysis.locate.locate import LocateReport
    from skywright.description.loader import Description, Sets
    from skywright.inspection.weld_data import WeldReport
    from skywright.links.broadcast.options import Live
    from skywright.models.capability import Capability
    from skywright.parts import (
        build_law,
        build_mjcf,
        build_model,
        build_urdf,
        build_vehicle,
        campaign,
        compute_capability,
        fly,
        identify,
        load_robot,
        load_world,
        locate,
        plan_motion,
        run_estimator,
        weld,
    )
    from skywright.planning.motion.transit import Configuration
    from skywright.planning.shapes import Box, Cylinder, Sphere
    from skywright.run.planning import MissionPlan
    from skywright.run.result import RunResult
    from skywright.run.results import Run, open_run
    from skywright.run.supervisor import NoEstimate
    from skywright.vehicle.motions import Arrival
    from skywright.vehicle.uav import Uav

    __version__: str

_PARTS = {
    "skywright.analysis.campaign.campaign": ("CampaignResult",),
    "skywright.analysis.identify.identify": ("Identification",),
    "skywright.analysis.locate.locate": ("LocateReport",),
    "skywright.description.loader": ("Description",),
    "skywright.inspection.weld_data": ("WeldReport",),
    "skywright.links.broadcast.options": ("Live",),
    "skywright.models.capability": ("Capability",),
    "skywright.parts": (
        "build_law", "build_mjcf", "build_model", "build_urdf", "build_vehicle", "campaign",
        "compute_capability", "fly", "identify", "load_robot", "load_world", "locate",
        "plan_motion", "run_estimator", "weld",
    ),
    "skywright.planning.motion.transit": ("Configuration",),
    "skywright.planning.shapes": ("Box", "Cylinder", "Sphere"),
    "skywright.run.planning": ("MissionPlan",),
    "skywright.run.result": ("RunResult",),
    "skywright.run.results": ("Run", "open_run"),
    "skywright.run.supervisor": ("NoEstimate",),
    "skywright.vehicle.motions": ("Arrival",),
    "skywright.vehicle.uav": ("Uav",),
}  # fmt: skip
"""Public names by the module that defines them; a module is imported at first use."""

__all__ = [
    "Arrival",
    "Box",
    "CampaignResult",
    "Capability",
    "Configuration",
    "Cylinder",
    "Description",
    "Identification",
    "InfeasibleError",
    "InputError",
    "Live",
    "LocateReport",
    "MissionPlan",
    "NoEstimate",
    "Run",
    "RunResult",
    "SimulationError",
    "SkywrightError",
    "Sphere",
    "Uav",
    "WeldReport",
    "build_law",
    "build_mjcf",
    "build_model",
    "build_urdf",
    "build_vehicle",
    "campaign",
    "compute_capability",
    "evaluate",
    "fly",
    "identify",
    "load",
    "load_robot",
    "load_world",
    "locate",
    "open_run",
    "plan",
    "plan_motion",
    "run",
    "run_estimator",
    "weld",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("skywright")
        except PackageNotFoundError:  # run from a source tree without installation
            return "0+unknown"
    for module, names in _PARTS.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module 'skywright' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


@naming_arguments(sets="--set")
def load(
    mission: str | os.PathLike[str],
    *,
    robot: str | os.PathLike[str] | None = None,
    world: str | os.PathLike[str] | None = None,
    seed: int | None = None,
    sets: Sets = (),
) -> Description:
    """Load a mission with its robot and world.

    `mission` is a built-in name, a file, or a finished run's directory. `sets` maps dotted keys to
    values (`{"world.pipe.diameter_m": 0.3}`), or is a list of `KEY=VALUE` strings as on the command
    line. Raises InputError, which names file and key, if the input is invalid.
    """
    from skywright.description.loader import load_description

    return load_description(mission, robot, world, sets, seed)


def plan(description: Description | str | os.PathLike[str]) -> MissionPlan:
    """Plan a mission without flying it; returns a `MissionPlan`.

    If no plan exists, `feasible` is False and `blocked_by` states the reason.
    Raises InputError when the robot cannot lift itself.
    """
    from skywright.models.capability import check_can_fly
    from skywright.parts import as_description
    from skywright.run.planning import plan_mission

    description = as_description(description)
    check_can_fly(description.robot, description.world.gravity_mps2)
    return plan_mission(description)


@naming_arguments()
def run(
    description: Description | str | os.PathLike[str],
    *,
    out: str | os.PathLike[str] | None = None,
    view: bool = False,
    progress: bool = False,
    report: bool = True,
    records: str | os.PathLike[str] | None = None,
    operator: str | None = None,
    gateway: str | None = None,
    gateway_key: str | os.PathLike[str] | None = None,
    station: str | None = None,
    live: Live | None = None,
    servos: str | None = None,
    command: str = "",
    backend: str = "physics",
) -> RunResult:
    """Plan, fly and evaluate a mission; writes the run's directory (`result.directory`).

    `out` is the directory (default: the next free `runs/<mission>-N`). `view` shows the run live in
    the browser, `progress` a bar on stderr, `report` writes `report.html` and `replay.html`;
    `records` is an SQLite file to which contact measurements are added. `operator` is the source of
    the stick, in missions with one ("view", "udp:PORT", "model:careful"; ground/operators.py).
    `gateway` ("udp:PORT") publishes the state of the arms; `gateway_key` is a file with the key
    that seals its packets. `station` (FD:FOLDER) is the connection to a ground station that started
    this process. `servos` ("serial:PORT") drives the arms' real servos; the platform is
    simulated. `live` publishes the flight to ROS 2 and Foxglove (links/broadcast/options.py).
    `command` is the command line that the report states.
    `backend` is "physics", "kinematic" (follows references exactly, without forces), or
    "mavlink:URL" (a vehicle over MAVLink flies the platform).
    Raises InputError when the input is wrong (nothing was started) and InfeasibleError when no
    plan exists. An interrupted or diverged run is returned with that `outcome`.
    """
    from skywright.parts import as_description
    from skywright.run.directory import check_free
    from skywright.run.run import Observer, run_mission

    description = as_description(description)
    if out is not None:
        check_free(Path(out))  # checked before planning
    observers: list[Observer] = []
    if progress:
        from skywright.models.capability import check_can_fly
        from skywright.reports.progress import Progress, announce_compilation, announce_planning

        check_can_fly(description.robot, description.world.gravity_mps2)  # before any waiting
        announce_compilation()
        announce_planning()
        observers.append(Progress())
    person: Any = None
    link = None
    if operator is not None:
        from skywright.run.operated import check_operator

        check_operator(description)
    published = None
    if live is not None and live.wanted:
        from skywright.links.broadcast.open import open_live

        published = open_live(live, description)
        observers.append(published)
    if gateway is not None or gateway_key is not None or (operator or "").startswith("udp"):
        from skywright.links.udp.flight import open_gateway

        link = open_gateway(gateway, operator, gateway_key, description)
        if link is not None:
            observers.append(link)
    if link is not None and operator is not None and gateway is None:
        from skywright.ground.gateway_operator import GatewayOperator

        person = GatewayOperator(link)
    elif operator is not None:
        from skywright.ground.operators import open_operator

        person = open_operator(operator, description)
    arms = None
    if servos is not None:
        from skywright.links.servo_bus.arms import open_servos

        arms = open_servos(servos, description.robot)
        observers.append(arms)
    watching = None
    if view or operator in ("view", "page") or station is not None:
        from skywright.ground.watch import Watching

        watching = Watching(person, station, backend=backend)
        observers.append(watching.feed)
    try:
        return run_mission(
            description,
            out=None if out is None else Path(out),
            observers=observers,
            write_report=_write_pages if report else None,
            records=None if records is None else Path(records),
            operator=_reach(person, description),
            command=command,
            backend=backend,
        )
    finally:
        if person is not None:
            person.close()
        if link is not None:
            link.close()
        if published is not None:
            published.close()
        if arms is not None:
            arms.close()
        if watching is not None:
            watching.close()


def _reach(person: Any, description: Description) -> Any:
    """Return the operator, behind the world's radio if there is one.

    The gateway applies the radio itself, to its packets.
    """
    if person is None or getattr(person, "gateway", None) is not None:
        return person
    from skywright.ground.radio_operator import add_radio

    return add_radio(person, description.world.radio, description.mission.seed)


def _write_pages(result: RunResult) -> None:
    """Write the pages of a run into its directory."""
    from skywright.reports.replay import write_replay
    from skywright.reports.report import write_report

    write_replay(result)
    write_report(result)  # links to the replay


def evaluate(directory: str | os.PathLike[str]) -> RunResult:
    """Evaluate a run's directory again from its recording.

    Raises InputError when the directory holds no run.
    """
    from skywright.run.run import evaluate_directory

    return evaluate_directory(Path(directory))
