"""The command line: the only place that wires everything together.

Heavy modules are imported inside the commands, so that `skywright --help` answers at once.
Exit codes: 0 all requirements met, 1 a requirement failed, no plan exists or the run was
interrupted, 2 the input is wrong and nothing was started, 3 the simulation failed.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import click

from skywright.errors import InfeasibleError, InputError, SkywrightError, neighbours

if TYPE_CHECKING:
    from skywright.missions.lookup import Subject

F = TypeVar("F", bound=Callable[..., Any])


class _Group(click.Group):
    """Commands in the order of the contract; every error is one line and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            valid = neighbours(args[0], self.commands, count=len(self.commands))
            raise click.UsageError(f"unknown command {args[0]!r}; valid: {valid}")
        return super().resolve_command(ctx, args)

    def main(self, args: Sequence[str] | None = None, *more: Any, **extra: Any) -> NoReturn:
        args = list(sys.argv[1:] if args is None else args)
        extra["standalone_mode"] = False
        signal.signal(signal.SIGTERM, _interrupt)  # a polite kill ends a run as Ctrl-C does
        try:
            code = super().main(args, *more, **extra)
        except BaseException as error:
            code = _report(error, as_json="--json" in args)
        sys.exit(code if isinstance(code, int) else 0)


def _interrupt(number: int, frame: object) -> NoReturn:
    raise KeyboardInterrupt


def _report(error: BaseException, as_json: bool) -> int:
    """Print an error as one line on stderr (and as an object where `--json` asks): exit code."""
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 0 if error.code is None else 2
    if os.environ.get("SKYWRIGHT_DEBUG") and isinstance(error, Exception):
        import traceback

        traceback.print_exc()
    facts: dict[str, Any] = {}
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        click.echo(error.format_message())
        return 0
    if isinstance(error, click.Abort | KeyboardInterrupt):
        code, message = 1, "interrupted"
    elif isinstance(error, click.ClickException):
        code, message = 2, error.format_message()
        command = getattr(getattr(error, "ctx", None), "command_path", "skywright")
        message = f"{message.rstrip('.')} (see {command} --help)"
    elif isinstance(error, SkywrightError):
        code, message = error.exit_code, str(error)
        if isinstance(error, InfeasibleError):
            facts["blocked_by"] = error.blocked_by
    elif isinstance(error, BrokenPipeError):  # the reader of our output went away
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    elif isinstance(error, OSError) and error.filename is not None:
        code, message = 2, f"{error.filename}: {error.strerror}"
    else:
        code = 3
        message = (
            f"internal error, please report: {type(error).__name__}: {error} "
            "(SKYWRIGHT_DEBUG=1 shows where)"
        )
    message = " ".join(message.split())
    click.echo(f"skywright: {message}", err=True)
    if as_json:
        _print_json({"error": message, "exit_code": code, **facts})
    return code


def _print_json(value: Any) -> None:
    click.echo(json.dumps(value, indent=2, allow_nan=False))


def _layers(command: F) -> F:
    """Options that choose and change the layers of a description."""
    for option in (
        click.option("--seed", type=click.IntRange(min=0), help="Seed of every random draw."),
        click.option(
            "--set", "sets", multiple=True, metavar="KEY=VALUE",
            help="Change any value, e.g. world.pipe.diameter_m=0.3. May be repeated.",
        ),
        click.option("--world", metavar="W", help="World instead of the mission's: name or file."),
        click.option("--robot", metavar="R", help="Robot instead of the mission's: name or file."),
    ):  # fmt: skip
        command = option(command)
    return command


_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object, nothing else.")


@click.group(
    cls=_Group,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    no_args_is_help=True,
)
@click.version_option(package_name="skywright", message="skywright %(version)s")
def main() -> None:
    """Simulate, plan, control and fly multirotors with arms that touch things.

    \b
    skywright run pipe-weld-scan         fly the main job and map a weld
    skywright list robots                what is there
    skywright new robot my-robot         start your own
    """


@main.command()
@click.argument("mission", required=False)
@_layers
@click.option(
    "--plan", "plan_file", type=click.Path(), help="Fly this plan file (NAME.csv with NAME.toml)."
)
@click.option("--out", type=click.Path(path_type=Path), help="Directory of the run.")
@_json
@click.option("--view", is_flag=True, help="Watch the run live in the browser.")
@click.option(
    "--records",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Store contact measurements there (SQLite), with those of other flights.",
)
def run(
    mission: str | None, robot: str | None, world: str | None, sets: tuple[str, ...],
    seed: int | None, plan_file: str | None, out: Path | None, as_json: bool, view: bool,
    records: Path | None,
) -> int:  # fmt: skip
    """Plan, fly and evaluate a mission.

    MISSION is a built-in name, a file, or a finished run's directory (which repeats it). With
    --plan it may be left out: the plan is then flown by itself, with the robot and in the world
    that it names.
    """
    import skywright

    if plan_file is not None:
        from skywright.missions.plan_flight import load_plan_description

        description = load_plan_description(plan_file, mission, robot, world, sets, seed)
    elif mission is None:
        raise click.UsageError("Missing argument 'MISSION' (or --plan FILE).")
    else:
        description = skywright.load(mission, robot=robot, world=world, sets=sets, seed=seed)
    result = skywright.run(description, out=out, view=view, progress=not as_json, records=records)
    if as_json:
        _print_json({**result.to_json(), "directory": str(result.directory)})
    else:
        from skywright.reports.terminal import print_result

        print_result(result)
    return int(result.exit_code)


@main.command()
@click.argument("mission")
@_layers
@click.option("--out", type=click.Path(path_type=Path), help="Write a plan file (.csv and .toml).")
@_json
def plan(
    mission: str, robot: str | None, world: str | None, sets: tuple[str, ...], seed: int | None,
    out: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Plan MISSION without flying it."""
    import skywright

    description = skywright.load(mission, robot=robot, world=world, sets=sets, seed=seed)
    if out is not None and out.suffix not in (".csv", ".toml"):
        raise InputError(f"{out}: a plan file is called NAME.csv or NAME.toml")
    found = skywright.plan(description)
    if out is not None and found.feasible:
        from skywright.planning.motion.plan_file import write_plan_file

        file = getattr(found.task, "file", None)
        if file is None:
            raise InputError(
                f"mission {description.mission.name!r} has no plan file to write; missions of the "
                "kind bar-transport do"
            )
        _folder(out.parent).mkdir(parents=True, exist_ok=True)
        write_plan_file(out, file)
    if as_json:
        _print_json(found.to_json())
    else:
        from skywright.reports.terminal import print_plan

        print_plan(found)
    return 0 if found.feasible else 1


@main.command()
@click.argument("mission")
@click.option("--runs", type=int, required=True, help="Number of runs.")
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=DIST",
    help="uniform(a,b), normal(m,s), loguniform(a,b), choice(a,b,...), csv(FILE); or a CSV FILE "
    "whose columns are keys. May be repeated.",
)
@_layers
@click.option("--out", type=click.Path(path_type=Path), help="Folder; the same campaign continues.")
@click.option("--workers", type=int, help="Processes on this machine.  [default: all cores]")
@click.option("--ray", metavar="local|ADDRESS", help="Fly on a Ray cluster (extra 'cluster').")
@click.option(
    "--record",
    type=click.Choice(["none", "failed", "all"]),
    default="none",
    show_default=True,
    help="Run directories to keep, under FOLDER/runs.",
)
@click.option(
    "--target",
    type=float,
    default=0.9,
    show_default=True,
    help="Success rate that must be shown for a GO.",
)
@_json
def campaign(
    mission: str, runs: int, vary: tuple[str, ...], robot: str | None, world: str | None,
    sets: tuple[str, ...], seed: int | None, out: Path | None, workers: int | None,
    ray: str | None, record: str, target: float, as_json: bool,
) -> int:  # fmt: skip
    """Fly MISSION many times under varied conditions: go or no-go.

    An interrupted campaign is continued by the same command.
    """
    from skywright.studies.campaign.campaign import run_campaign
    from skywright.studies.campaign.spec import build_campaign

    if runs < 1:
        raise InputError(f"--runs {runs}: at least 1 is needed")
    plan = build_campaign(mission, vary, robot=robot, world=world, sets=sets, seed=seed)
    result = run_campaign(
        plan, runs, out=out, workers=workers, ray=ray, record=record, target=target,
        progress=not as_json,
    )  # fmt: skip
    if as_json:
        _print_json(result.to_json())
    else:
        from skywright.reports.terminal import print_campaign

        print_campaign(result.verdict, result.folder)
    if result.interrupted:
        done = result.verdict.runs
        message = f"interrupted after {done} of {runs} runs; the same command continues"
        click.echo(f"skywright: {message}", err=True)
    return int(result.exit_code)


@main.command()
@click.argument("paper", required=False)
@click.option("--claim", "only", multiple=True, metavar="ID", help="Only this claim. Repeatable.")
@click.option(
    "--cache", type=click.Path(path_type=Path), help="Folder of flights.  [default: user's cache]"
)
@click.option("--out", type=click.Path(path_type=Path), help="Page.  [default: claims.html]")
@_json
def reproduce(
    paper: str | None, only: tuple[str, ...], cache: Path | None, out: Path | None, as_json: bool
) -> int:
    """Measure the claims of PAPER, or of all papers.

    Flights are kept, so that a second time takes seconds. Contradictions are results: exit 1 means
    that a claim could not be measured.
    """
    from skywright.studies.reproduce.cache import default_folder
    from skywright.studies.reproduce.present import Bar, print_reports, write_page
    from skywright.studies.reproduce.runner import check_papers, reproduce_papers

    page = out or Path("claims.html")
    check_papers(paper, only)  # nothing is written for a name that does not exist
    fresh = not page.exists()
    page = _writable(page, (".html",))
    if fresh:
        page.unlink()  # it can be written; an interrupt leaves no empty page
    reports = reproduce_papers(
        paper, cache=cache or default_folder(), only=only, steps=None if as_json else Bar()
    )
    write_page(reports, page)
    if as_json:
        _print_json({"claims": [c for r in reports for c in r.to_json()["claims"]]})
    else:
        print_reports(reports, page)
    return max(r.exit_code for r in reports)


class _BenchCommand(click.Command):
    """Help that lists the benchmarks, which are a registry of their own."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from skywright.studies.bench.registry import BENCHMARKS

        with formatter.section("Benchmarks"):
            formatter.write_dl(
                [
                    (name, b.description + ("" if b.by_default else "  (by name, or with --full)"))
                    for name, b in BENCHMARKS.items()
                ]
            )


@main.command(cls=_BenchCommand)
@click.argument("names", metavar="[NAME]...", nargs=-1)
@click.option("--quick", is_flag=True, help="See that everything works: few repetitions.")
@click.option("--full", is_flag=True, help="Every benchmark with many repetitions.")
@click.option(
    "--out", type=click.Path(path_type=Path),
    help="Folder of results.  [default without NAME: benchmarks/results]",
)  # fmt: skip
@click.option(
    "--workers", type=click.IntRange(min=1), default=1, show_default=True,
    help="Processes that compare motion planners, by processor time.",
)  # fmt: skip
@click.option(
    "--resume", type=click.Path(path_type=Path),
    help="Folder that keeps finished comparisons; a second call goes on there.",
)  # fmt: skip
@_json
def bench(
    names: tuple[str, ...], quick: bool, full: bool, out: Path | None, workers: int,
    resume: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Measure what things cost, as ratios side by side.

    A missed limit is told, not an error: timings depend on the machine and on who else uses it.
    """
    from skywright.studies.bench.present import Tables, print_end
    from skywright.studies.bench.runner import run_benchmarks

    if quick and full:
        raise InputError("--quick and --full: choose one")
    report = run_benchmarks(
        names, effort="quick" if quick else "full" if full else "default", out=out,
        watcher=Tables(quiet=as_json), workers=workers, resume=resume,
    )  # fmt: skip
    if as_json:
        _print_json(report.to_json())
    else:
        print_end(report)
    if report.interrupted:
        click.echo("skywright: interrupted; what was measured is kept", err=True)
    return report.exit_code


@main.command()
@click.argument("robot")
@click.option("--set", "sets", multiple=True, metavar="KEY=VALUE", help="Change a robot's value.")
@click.option(
    "--posture", type=click.Choice(["extended", "folded", "worst"]),
    help="Posture of the arm.  [default: extended]",
)  # fmt: skip
@click.option("--bare", is_flag=True, help="The platform without arm and docking gear.")
@click.option("--sweep", type=click.Choice(["tilt"]), help="Limits against the rotors' tilt.")
@click.option("--docked", is_flag=True, help="Force that the arm can press while docked.")
@click.option("--slope", type=float, metavar="DEG", help="Docked: slope of the surface.")
@click.option(
    "--slope-toward", type=float, metavar="DEG",
    help="Docked: where it rises, 0 ahead, 90 to the left.  [default: the worst]",
)  # fmt: skip
@click.option("--wind", type=float, metavar="MPS", help="Docked: wind.")
@click.option(
    "--wind-toward", type=float, metavar="DEG", help="Docked: where it blows.  [default: the worst]"
)
@click.option(
    "--contact", metavar="X,Y",
    help="Docked: contact point, metres ahead and left of the centre.  [default: at work]",
)  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Picture (.png or .svg).")
@_json
def capability(
    robot: str, sets: tuple[str, ...], posture: str | None, bare: bool, sweep: str | None,
    docked: bool, out: Path | None, as_json: bool, **condition: Any,
) -> None:  # fmt: skip
    """Compute what ROBOT can do: force, tilt, wind, payload, power."""
    from skywright.core.keys import parse_assignment
    from skywright.models.docked_map import parse_condition
    from skywright.models.sweep import strip_robot
    from skywright.reports import capability_views as views
    from skywright.robots.loader import load_robot

    given = {name: value for name, value in condition.items() if value is not None}
    if given and not docked:
        flag = next(iter(given)).replace("_", "-")
        raise InputError(f"--{flag} is a condition of --docked: give both")
    if docked and (sweep or posture):
        raise InputError(f"--docked and --{'sweep' if sweep else 'posture'} exclude each other")
    asked = parse_condition(**given)
    spec, _ = load_robot(robot, [parse_assignment(text) for text in sets])
    if bare:
        spec = strip_robot(spec)
    if docked:
        view = views.view_docked(spec, asked)
    elif sweep:
        view = views.view_sweep(spec, posture or "extended")
    else:
        view = views.view_limits(spec, posture or "extended")
    if out is not None or not as_json:
        picture = _writable(out or Path(f"capability-{view.name}.png"))
        view.write_figure(picture)
    if as_json:
        _print_json(view.to_json())
    else:
        view.print(picture)


@main.command()
@click.argument("robot")
@click.argument("other", metavar="ROBOT")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE",
    help="Change the world, e.g. world.pipe.diameter_m=0.3. May be repeated.",
)  # fmt: skip
@click.option("--no-fly", is_flag=True, help="Leave out what needs flights: seconds, not minutes.")
@click.option("--seeds", type=int, default=2, show_default=True, help="Flights a wind.")
@click.option("--out", type=click.Path(path_type=Path), help="Page.  [default: compare.html]")
@_json
def compare(
    robot: str, other: str, sets: tuple[str, ...], no_fly: bool, seeds: int, out: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Compare two robots with arms: clearance, reach, reactions, impact, accuracy, endurance."""
    from skywright.studies.compare.compare import compare_robots
    from skywright.studies.compare.present import print_comparison, tell_step, write_page

    page = _writable(out or Path("compare.html"), (".html",))
    try:
        found = compare_robots(
            robot, other, sets=sets, fly=not no_fly, seeds=seeds,
            step=None if as_json else tell_step,
        )  # fmt: skip
    except BaseException:
        if page.exists() and page.stat().st_size == 0:
            page.unlink()  # nothing half-written, interrupted or not
        raise
    write_page(found, page)
    if as_json:
        _print_json(found.to_json())
    else:
        print_comparison(found, page)


@main.command(name="list")
@click.argument(
    "kind", type=click.Choice(["robots", "worlds", "missions", "claims"]), required=False
)
@_json
def list_(kind: str | None, as_json: bool) -> None:
    """List robots, worlds, missions or claims."""
    from skywright.missions.loader import list_missions
    from skywright.robots.loader import list_robots
    from skywright.worlds.loader import list_worlds

    listings = {"robots": list_robots, "worlds": list_worlds, "missions": list_missions}
    found = {name: call() for name, call in listings.items() if kind in (None, name)}
    if kind in (None, "claims"):  # their specs are heavy: imported only where asked for
        from skywright.studies.reproduce.spec import list_claims

        found["claims"] = list_claims()
    if as_json:
        _print_json({name: [e._asdict() for e in entries] for name, entries in found.items()})
        return
    for name, entries in found.items():
        if kind is None:
            click.echo(f"{name}:")
        width = max(len(e.name) for e in entries)
        for entry in entries:
            click.echo(f"{'  ' if kind is None else ''}{entry.name:{width}}  {entry.description}")


@main.command()
@click.argument("name", metavar="ROBOT|WORLD|MISSION")
@click.option("--out", type=click.Path(path_type=Path), help="Picture (.png or .svg).")
@click.option("--urdf", type=click.Path(path_type=Path), help="Write the robot as URDF instead.")
@_json
def show(name: str, out: Path | None, urdf: Path | None, as_json: bool) -> None:
    """Summary and picture of a robot, world or mission.

    With --urdf the robot (a mission's too) is written for other tools.
    """
    from skywright.missions.lookup import find_any
    from skywright.reports.summary import build_summary

    subject = find_any(name)
    if urdf is not None:
        _write_urdf(subject, urdf)
    summary = build_summary(subject)._replace(urdf=None if urdf is None else str(urdf))
    if out is not None or not (as_json or urdf is not None):
        from skywright.reports.show import write_show_figure

        picture = _writable(out or Path(f"show-{summary.name}.png"))
        write_show_figure(subject, picture)
        summary = summary._replace(picture=str(picture))
    if as_json:
        _print_json(summary.to_json())
    else:
        from skywright.reports.terminal import print_summary

        print_summary(summary)


def _write_urdf(subject: Subject, path: Path) -> None:
    from skywright.models.urdf import build_urdf

    mission = subject.description
    robot = subject.robot if mission is None else mission.robot
    if robot is None:
        raise InputError(
            f"--urdf: {subject.label!r} is a {subject.kind}; give a robot, or a mission with one"
        )
    text = build_urdf(robot)
    _writable(path, (".urdf", ".xml")).write_text(text, encoding="utf-8")


@main.command()
@click.argument("data", metavar="DATA.csv", type=click.Path(path_type=Path))
@click.option("--calibrate", metavar="T0:T1", help="Approach from air to contact, seconds.")
@click.option(
    "--calibration", type=click.Path(path_type=Path), help="Calibration file of an earlier scan."
)
@click.option("--surface", type=click.Path(path_type=Path), help="Cylinder, else it is fitted.")
@click.option("--lift-off", type=float, help="Contact threshold in the instrument's units.")
@click.option("--weld", "weld_threshold", type=float, help="Weld threshold, instrument's units.")
@click.option("--out", type=click.Path(path_type=Path), help="Map (.png or .svg).")
@_json
def weld(
    data: Path, calibrate: str | None, calibration: Path | None, surface: Path | None,
    lift_off: float | None, weld_threshold: float | None, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Find a weld in an instrument's data.

    DATA.csv has the columns t_s, re, im, x_m, y_m, z_m in any order.
    """
    from skywright.inspection.weld_data import process_file

    report = process_file(
        data,
        calibrate=calibrate,
        calibration_file=calibration,
        lift_off_threshold=lift_off,
        weld_threshold=weld_threshold,
        surface_file=surface,
    )
    if out is not None or not as_json:
        from skywright.reports.weld_map import write_weld_map

        picture = _writable(out or Path(f"{data.stem}-weld.png"))
        write_weld_map(report, picture)
    if as_json:
        _print_json(report.to_json())
    else:
        from skywright.reports.terminal import print_weld

        print_weld(report, picture)


@main.command()
@click.argument("data", nargs=-1, metavar="DATA...")
@click.option("--station", metavar="FILE", help="The total station's, where it cannot be told.")
@click.option("--camera", metavar="FILE", help="The camera's, the same.")
@click.option("--reference", metavar="FILE", help="What the result is judged by.")
@click.option(
    "--align",
    default="similarity",
    show_default=True,
    help="Frames: similarity, rigid, level, or affine (the paper's twelve numbers).",
)
@click.option("--calibrate", metavar="T0:T1", help="Align on this part only, seconds.")
@click.option("--time-offset", type=float, help="Camera's clock minus station's, seconds.")
@click.option("--prism", metavar="X,Y,Z", help="Prism in the camera's frame, metres.")
@click.option(
    "--frame",
    nargs=2,
    metavar="KNOWN MEASURED",
    type=click.Path(path_type=Path),
    help="Terrain points: places from before, and as the station sees them now.",
)
@click.option(
    "--compare",
    default="rigid",
    show_default=True,
    help="Alignment to the reference: rigid, similarity, none.",
)
@click.option("--reference-offset", type=float, help="Reference's clock minus the result's.")
@click.option("--demo", is_flag=True, help="Write the files of a simulated flight, and use them.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: locate-NAME]")
@_json
def locate(
    data: tuple[str, ...], station: str | None, camera: str | None, reference: str | None,
    align: str, calibrate: str | None, time_offset: float | None, prism: str | None,
    frame: tuple[Path, Path] | None, compare: str, reference_offset: float | None, demo: bool,
    out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Fuse a total station with a tracking camera, or judge a trajectory.

    DATA: the station's and the camera's recording, or one trajectory with --reference. TUM, EuRoC,
    CSV with a header, or MCAP as FILE:TOPIC.
    """
    from skywright.estimation.localisation.locate import locate as locate_files

    if demo:
        from skywright.studies.locate.demo import write_demo

        if data or station or camera or reference:
            raise InputError("--demo brings its own files; give either it or DATA")
        out = out or Path("locate-demo")
        files = write_demo(_folder(out))
        data, reference, compare = (str(files[0]), str(files[1])), str(files[2]), "none"
    if out is not None:
        _folder(out)
    report = locate_files(
        list(data), station=station, camera=camera, reference=reference, align=align,
        span=calibrate, time_offset=time_offset, prism=prism, frame=frame, compare=compare,
        reference_offset=reference_offset,
    )  # fmt: skip
    if out is not None or not as_json:
        from skywright.reports.locate import write_locate

        named = Path((station or (data or (camera or "",))[0]).partition(":/")[0]).stem
        out = out or Path(f"locate-{named}")
        write_locate(report, _folder(out))
    if as_json:
        _print_json({**report.to_json(), "directory": None if out is None else str(out)})
    else:
        from skywright.reports.terminal_locate import print_locate

        assert out is not None
        print_locate(report, out)


@main.command()
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--robot", metavar="R", help="Robot that flew: name or file (a ULog needs it).")
@click.option("--mass", type=float, metavar="KG", help="What it weighed.  [default: its file's]")
@click.option("--out", type=click.Path(path_type=Path), help="Page.  [default: identify.html]")
@_json
def identify(
    logs: tuple[Path, ...], robot: str | None, mass: float | None, out: Path | None, as_json: bool
) -> None:
    """Fit a robot's parameters to recorded flights.

    LOG is a run's directory, a recording.mcap or a PX4 ULog; several flights of one robot add up.
    Beside the page a robot file is written (PAGE.toml) that a run takes as --robot.
    """
    from skywright.robots.loader import load_robot
    from skywright.studies.identify.identify import identify as identify_logs
    from skywright.studies.identify.overrides import build_overrides
    from skywright.studies.identify.present import print_identification, write_page

    spec = None if robot is None else load_robot(robot)[0]
    found = identify_logs(logs, spec, mass)
    overrides = build_overrides(found, robot or found.robot.name)
    page = _writable(out or Path("identify.html"), (".html",))
    robot_file = _writable(page.with_suffix(".toml"), (".toml",))
    write_page(found, overrides, page)
    robot_file.write_text(overrides, encoding="utf-8")
    if as_json:
        _print_json({**found.to_json(), "page": str(page), "robot_file": str(robot_file)})
    else:
        print_identification(found, page, robot_file)


@main.command("records")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--structure", metavar="NAME", help="Of this structure (world) only.")
@click.option("--spot", metavar="NAME", help="Of this spot only.")
@click.option("--at", metavar="X,Y", help="History of a point (m in the structure's frame).")
@click.option(
    "--radius",
    type=click.FloatRange(min=0.0, min_open=True),
    default=0.05,
    show_default=True,
    metavar="M",
    help="What still counts as that point.",
)
@click.option("--csv", "table", type=click.Path(path_type=Path), help="Write them as CSV.")
@click.option("--geojson", type=click.Path(path_type=Path), help="Write them as GeoJSON.")
@click.option("--origin", metavar="LON,LAT[,HEIGHT]", help="Where the world's origin lies.")
@_json
def records_(
    file: Path, structure: str | None, spot: str | None, at: str | None, radius: float,
    table: Path | None, geojson: Path | None, origin: str | None, as_json: bool,
) -> None:  # fmt: skip
    """List contact measurements of many flights, and export them.

    FILE is what `skywright run --records FILE` wrote.
    """
    from skywright.evaluation.records import RecordStore
    from skywright.evaluation.records_export import parse_origin, write_csv, write_geojson
    from skywright.models.docked_map import parse_condition

    point = parse_condition(contact=at, named="at").contact
    if geojson is not None and origin is None:
        raise InputError(
            "--geojson needs --origin LON,LAT: GeoJSON holds longitude and latitude, the records "
            "metres from the world's origin"
        )
    place = None if origin is None else parse_origin(origin)
    store = RecordStore(file)
    try:
        for name, value in (("structure", structure), ("spot", spot)):
            known = store.list_names(name)
            if value is not None and value not in known:
                raise InputError(
                    f"{file}: no {name} {value!r}; there are: {', '.join(known) or '-'}"
                )
        found = store.find(structure=structure, spot=spot, at=point, radius=radius)
    finally:
        store.close()
    if table is not None:
        write_csv(found, _writable(table, (".csv",)))
    if geojson is not None and place is not None:
        write_geojson(found, place, _writable(geojson, (".geojson", ".json")))
    if as_json:
        _print_json({"records": [r._asdict() for r in found]})
    else:
        from skywright.reports.terminal_records import print_records

        print_records(found, file)


@main.command()
@click.argument("directory", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--no-open", is_flag=True, help="Only print the path.")
def replay(directory: Path, no_open: bool) -> None:
    """Open a run's 3-D replay in the browser."""
    page = directory if directory.suffix == ".html" else directory / "replay.html"
    if not directory.exists():
        raise InputError(f"{directory}: no such run; give the directory that a run wrote")
    if not page.is_file():
        raise InputError(f"{directory}: holds no replay.html; give the directory of a finished run")
    click.echo(str(page))
    if not no_open:
        import webbrowser

        webbrowser.open(page.resolve().as_uri())


@main.group(no_args_is_help=True)
def new() -> None:
    """Start your own from a commented template."""


@new.command(name="robot")
@click.argument("name")
def new_robot(name: str) -> None:
    """Write NAME/robot.toml and NAME/mission.toml: a quadrotor that flies, ready to change."""
    from skywright.missions.template import write_robot_template

    folder = write_robot_template(Path(name))
    click.echo(f"{folder / 'robot.toml'}    every key with a comment")
    click.echo(f"{folder / 'mission.toml'}  four way-points")
    click.echo(f"next: skywright check {folder}, skywright show {folder}, skywright run {folder}")


@main.command()
@click.argument("file", metavar="FILE")
@_json
def check(file: str, as_json: bool) -> int:
    """List every problem and guess of a description FILE."""
    from skywright.missions.check import check_file

    report = check_file(file)
    if as_json:
        _print_json(report._asdict())
        return 0 if report.valid else 2
    for line in report.problems:
        click.echo(line, err=True)
    for line in report.notes:
        click.echo(line)
    if report.valid:
        click.echo(f"{report.label}: a valid {report.kind}")
        return 0
    count = len(report.problems)
    click.echo(f"{report.label}: {count} problem{'s' if count != 1 else ''}", err=True)
    return 2


def _writable(path: Path, formats: tuple[str, ...] = (".png", ".svg")) -> Path:
    """Refuse a picture or page that cannot be written before the work begins."""
    if path.suffix.lower() not in formats:
        raise InputError(f"{path}: unknown format; valid: {', '.join(formats)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab"):
            pass
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _folder(path: Path) -> Path:
    """Refuse a folder that cannot be written before the work begins; nothing is made yet."""
    there = path.absolute()
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise InputError(f"{path}: no folder can be made there: {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written: {there} is not writable")
    return path


if __name__ == "__main__":
    main()
