"""Commands about finished runs: `report`, `export`."""

from __future__ import annotations

from pathlib import Path

import click

from skywright.cli.options import (
    as_json_option,
    check_folder,
    print_json,
    report_unfinished,
    trust_option,
)
from skywright.errors import InputError

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
    """Evaluate the recording of RUN and write its report.html again."""
    from skywright.reports.report import write_figures, write_report
    from skywright.run.run import evaluate_directory

    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: is a file, which is not a run directory")
    check_folder(figures or directory)
    result = evaluate_directory(directory)
    report_unfinished(directory, result.outcome, result.reason)
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
    "--trajectory", metavar="NAME",
    help="Of tum: whose poses, such as tip, estimate.platform.  [default: platform]",
)  # fmt: skip
@as_json_option
def export(
    directory: Path, form: str, out: Path | None, trajectory: str | None, as_json: bool
) -> None:
    """Write the samples of RUN for other programs.

    csv, parquet and npz hold every column (SI, radians), tum a trajectory, rosbag2 a folder that
    `ros2 bag` opens.
    """
    from skywright.run.export import PLATFORM, export_run
    from skywright.run.results import open_run

    if trajectory is not None and form != "tum":
        raise InputError(f"--trajectory {trajectory}: not valid with --format {form}; valid: tum")
    run = open_run(directory)
    path = export_run(run, form, out, PLATFORM if trajectory is None else trajectory)
    report_unfinished(directory, run.outcome, run.reason)
    if as_json:
        print_json({"run": str(directory), "format": form, "file": str(path)})
    else:
        click.echo(str(path))
