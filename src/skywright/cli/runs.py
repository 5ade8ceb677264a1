"""Commands about finished runs: `report`, `export`, `compare`."""

from __future__ import annotations

from pathlib import Path

import click
from click.core import ParameterSource

from skywright.cli.options import (
    as_json_option,
    check_folder,
    check_writable,
    print_json,
    trust_option,
)

FORMATS = ("csv", "parquet", "tum", "npz", "rosbag2")


@click.command()
@trust_option
@click.argument("directory", metavar="RUN", type=click.Path(path_type=Path))
@click.option(
    "--figures", metavar="DIR", type=click.Path(path_type=Path),
    help="Also write each figure as SVG and PDF into this folder.",
)  # fmt: skip
@as_json_option
def report(directory: Path, figures: Path | None, as_json: bool) -> None:
    """Evaluate the recording of RUN and write its report.html anew."""
    from skywright.reports.report import write_figures, write_report
    from skywright.run.run import evaluate_directory

    check_folder(figures or directory)
    result = evaluate_directory(directory)
    write_report(result)
    written = [] if figures is None else write_figures(result, figures)
    paths = [str(directory / "report.html"), *map(str, written)]
    if as_json:
        print_json({"run": str(directory), "outcome": result.outcome, "files": paths})
    else:
        click.echo("\n".join(paths))


@click.command()
@click.argument("directory", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--format", "form", required=True, type=click.Choice(FORMATS), help="What to write.")
@click.option("--out", type=click.Path(path_type=Path), help="File; of rosbag2 a folder.")
@click.option(
    "--trajectory", metavar="NAME", default="platform", show_default=True,
    help="Of tum: whose poses, such as tip, estimate.platform, reference.tip.",
)  # fmt: skip
@as_json_option
def export(directory: Path, form: str, out: Path | None, trajectory: str, as_json: bool) -> None:
    """Write the samples of RUN for other programs.

    csv, parquet and npz hold every column (SI, radians), tum a trajectory, rosbag2 a folder that
    `ros2 bag` opens.
    """
    from skywright.run.export import export_run
    from skywright.run.results import open_run

    path = export_run(open_run(directory), form, out, trajectory)
    if as_json:
        print_json({"run": str(directory), "format": form, "file": str(path)})
    else:
        click.echo(str(path))


@click.command()
@click.argument("names", metavar="[robots|runs] A B", nargs=-1)
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE",
    help="Robots: change the world, e.g. world.pipe.diameter_m=0.3. May be repeated.",
)  # fmt: skip
@click.option("--no-fly", is_flag=True, help="Robots: leave out what needs flights.")
@click.option("--seeds", type=int, default=2, show_default=True, help="Robots: flights a wind.")
@click.option("--out", type=click.Path(path_type=Path), help="Page.  [default: compare.html]")
@as_json_option
@click.pass_context
def compare(
    context: click.Context, names: tuple[str, ...], sets: tuple[str, ...], no_fly: bool,
    seeds: int, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Compare two robots with arms, or two runs.

    Robots (the default): clearance, reach, reactions, impact, accuracy, endurance. Runs: settings
    and metrics that differ, and the main series over each other.
    """
    said = names[:1] in (("robots",), ("runs",))
    kind, pair = (names[0], names[1:]) if said else ("robots", names)
    if len(pair) != 2:
        raise click.UsageError(f"{len(pair)} {kind} given; valid: two, compare [robots|runs] A B")
    page = check_writable(out or Path("compare.html"), (".html",))
    try:
        if kind == "robots":
            _compare_robots(pair[0], pair[1], sets, no_fly, seeds, page, as_json)
        else:
            for option in ("sets", "no_fly", "seeds"):
                if context.get_parameter_source(option) is ParameterSource.COMMANDLINE:
                    flag = option.replace("_", "-").replace("sets", "set")
                    raise click.UsageError(f"--{flag} is for robots; runs have been flown")
            _compare_runs(Path(pair[0]), Path(pair[1]), page, as_json)
    except BaseException:
        if page.exists() and page.stat().st_size == 0:
            page.unlink()  # nothing half-written, interrupted or not
        raise


def _compare_robots(
    robot: str, other: str, sets: tuple[str, ...], no_fly: bool, seeds: int, page: Path,
    as_json: bool,
) -> None:  # fmt: skip
    from skywright.analysis.compare.compare import compare_robots
    from skywright.analysis.compare.report import (
        print_comparison,
        tell_step,
        write_compare_page,
    )

    found = compare_robots(
        robot, other, sets=sets, fly=not no_fly, seeds=seeds, step=None if as_json else tell_step
    )
    write_compare_page(found, page)
    if as_json:
        print_json(found.to_json())
    else:
        print_comparison(found, page)


def _compare_runs(a: Path, b: Path, page: Path, as_json: bool) -> None:
    from skywright.analysis.compare_runs.overlay import compare_runs
    from skywright.analysis.compare_runs.report import print_overlay, write_overlay_page
    from skywright.run.results import open_run

    found = compare_runs(open_run(a), open_run(b))
    write_overlay_page(found, page)
    if as_json:
        print_json({**found.to_json(), "page": str(page)})
    else:
        print_overlay(found, page)
