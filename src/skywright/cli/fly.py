"""Commands that plan and fly: `run`, `plan`, `campaign`, `replay`."""

import shlex
from pathlib import Path
from typing import Any

import click

from skywright.cli.options import (
    as_json_option,
    build_live,
    check_folder,
    layers,
    live_options,
    print_json,
    trust_option,
)
from skywright.errors import InputError


@click.command()
@trust_option
@click.argument("mission", required=False)
@layers
@click.option(
    "--plan", "plan_file", type=click.Path(), help="Fly this plan file (NAME.csv with NAME.toml)."
)
@click.option("--out", type=click.Path(path_type=Path), help="Run directory.")
@as_json_option
@click.option("--view", is_flag=True, help="Watch the run live in the browser.")
@click.option(
    "--operator",
    metavar="SOURCE",
    help="Source of operator input, in missions with an operator: view, udp:PORT, "
    "model:practised, model:careful, model:hasty. The input is recorded in the run directory.",
)
@click.option("--station", hidden=True, help="FD:FOLDER of the ground station that started this.")
@click.option(
    "--gateway",
    metavar="udp:[HOST:]PORT",
    help="Publish the state of the arms by UDP; a connected flight runs in real time.",
)
@click.option(
    "--gateway-key",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Key of the gateway's packets; needed unless HOST is this computer.",
)
@live_options
@click.option(
    "--servos", metavar="serial:PORT[:BAUD]",
    help="The arms are real servos at this port; the platform is simulated.",
)  # fmt: skip
@click.option(
    "--records",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Add contact measurements to this SQLite file.",
)
@click.option(
    "--backend",
    default="physics",
    show_default=True,
    help="physics; kinematic: references are followed exactly, without forces; mavlink:URL: a "
    "vehicle over MAVLink (URL as of serve --mavlink); px4: the simulation, its platform flown by "
    "PX4 in software in the loop.",
)
def run(
    mission: str | None, robot: str | None, world: str | None, sets: tuple[str, ...],
    seed: int | None, plan_file: str | None, out: Path | None, as_json: bool, view: bool,
    operator: str | None, station: str | None, gateway: str | None, gateway_key: Path | None,
    servos: str | None, records: Path | None, backend: str, **live: Any,
) -> int:  # fmt: skip
    """Plan, fly and evaluate a mission.

    MISSION is a built-in name, a file, or a finished run's directory (which repeats the run). With
    --plan, MISSION is optional: without it, the plan is flown with the robot and the world that it
    names.
    """
    import skywright

    if operator == "page" and station is None:
        raise InputError("--operator page is for flights of `skywright serve`; here use view")
    if plan_file is not None:
        from skywright.missions.skills.plan_flight import load_plan_description

        description = load_plan_description(plan_file, mission, robot, world, sets, seed)
    elif mission is None:
        raise click.UsageError("Missing argument 'MISSION' (or --plan FILE).")
    else:
        description = skywright.load(mission, robot=robot, world=world, sets=sets, seed=seed)
    result = skywright.run(
        description, out=out, view=view, progress=not as_json, records=records, operator=operator,
        gateway=gateway, gateway_key=gateway_key, station=station, backend=backend,
        servos=servos, live=build_live(live),
        command=shlex.join(["skywright", *click.get_current_context().obj]),
    )  # fmt: skip
    if as_json:
        print_json({**result.to_json(), "directory": str(result.directory)})
    else:
        from skywright.reports.terminal import print_result

        print_result(result)
    return int(result.exit_code)


@click.command()
@trust_option
@click.argument("mission")
@layers
@click.option("--out", type=click.Path(path_type=Path), help="Write a plan file (.csv and .toml).")
@as_json_option
def plan(
    mission: str, robot: str | None, world: str | None, sets: tuple[str, ...], seed: int | None,
    out: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Plan MISSION without flying it."""
    import skywright

    description = skywright.load(mission, robot=robot, world=world, sets=sets, seed=seed)
    if out is not None:
        from skywright.planning.motion.plan_file import check_replaceable, write_plan_file

        if out.suffix not in (".csv", ".toml"):
            raise InputError(f"{out}: a plan file is called NAME.csv or NAME.toml")
        check_folder(out.parent)
        check_replaceable(out)
    if not as_json:
        from skywright.reports.progress import announce_planning

        announce_planning()
    found = skywright.plan(description)
    if out is not None and found.feasible:
        if found.file is None:
            raise InputError(
                f"mission {description.mission.name!r} cannot write a plan file: its kind "
                "does not plan platform and joints together"
            )
        out.parent.mkdir(parents=True, exist_ok=True)
        write_plan_file(out, found.file)
    if as_json:
        print_json(found.to_json())
    else:
        from skywright.reports.terminal import print_plan

        print_plan(found)
    return 0 if found.feasible else 1


@click.command()
@trust_option
@click.argument("mission")
@click.option("--runs", type=int, required=True, help="Number of runs.")
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=DIST",
    help="uniform(a,b), normal(m,s), loguniform(a,b), choice(a,b,...), csv(FILE); or a CSV FILE "
    "whose columns are keys. May be repeated.",
)
@layers
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder; an interrupted campaign in it is continued.",
)
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
    help="Success rate that must be demonstrated for a GO.",
)
@click.option("--parquet", is_flag=True, help="Also write results.parquet (extra 'parquet').")
@as_json_option
def campaign(
    mission: str, runs: int, vary: tuple[str, ...], robot: str | None, world: str | None,
    sets: tuple[str, ...], seed: int | None, out: Path | None, workers: int | None,
    ray: str | None, record: str, target: float, parquet: bool, as_json: bool,
) -> int:  # fmt: skip
    """Fly MISSION under varied conditions and decide go or no-go.

    The same command continues an interrupted campaign.
    """
    from skywright.analysis.campaign.campaign import run_campaign
    from skywright.analysis.campaign.spec import build_campaign

    if runs < 1:
        raise InputError(f"--runs {runs}: at least 1 is needed")
    plan = build_campaign(mission, vary, robot=robot, world=world, sets=sets, seed=seed)
    result = run_campaign(
        plan, runs, out=out, workers=workers, ray=ray, record=record, target=target,
        parquet=parquet, progress=not as_json,
    )  # fmt: skip
    if as_json:
        print_json(result.to_json())
    else:
        from skywright.reports.terminal import print_campaign

        print_campaign(result.verdict, result.folder)
    if result.interrupted:
        done = result.verdict.runs
        message = f"interrupted after {done} of {runs} runs; the same command continues"
        click.echo(f"skywright: {message}", err=True)
    return int(result.exit_code)


@click.command()
@trust_option
@click.argument("directory", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--no-open", is_flag=True, help="Only print the path.")
def replay(directory: Path, no_open: bool) -> None:
    """Open a run's 3-D replay in the browser."""
    page = directory if directory.suffix == ".html" else directory / "replay.html"
    if not directory.exists():
        raise InputError(f"{directory}: not found; give a run directory")
    if not page.is_file():
        raise InputError(
            f"{directory}: contains no replay.html; give the directory of a finished run"
        )
    click.echo(str(page))
    if not no_open:
        import webbrowser

        webbrowser.open(page.resolve().as_uri())
