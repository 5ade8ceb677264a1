"""`skywright compare`: two robots, two runs, or several control laws."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from skywright.cli.options import (
    as_json_option,
    check_folder,
    check_writable,
    layers,
    print_json,
    report_unfinished,
)
from skywright.errors import InputError


class CompareGroup(click.Group):
    """The subcommands; without one of their names it compares robots."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in (*self.commands, "-h", "--help"):
            args = ["robots", *args]
        return super().parse_args(ctx, args)


@click.group(cls=CompareGroup, no_args_is_help=True)
def compare() -> None:
    """Compare two robots with arms, two runs, or control laws.

    \b
    skywright compare A B              two robots
    skywright compare runs A B         two runs
    skywright compare laws A,B,...     control laws on the same flights
    """


out_option = click.option(
    "--out", type=click.Path(path_type=Path), default=Path("compare.html"), show_default=True,
    help="Page.",
)  # fmt: skip


@contextmanager
def _page(out: Path) -> Iterator[Path]:
    """Yield the path of the page; an empty page is removed after an error."""
    page = check_writable(out, (".html",))
    try:
        yield page
    except BaseException:
        if page.exists() and page.stat().st_size == 0:
            page.unlink()
        raise


@compare.command()
@click.argument("robot", metavar="A")
@click.argument("other", metavar="B")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE",
    help="Change the world, e.g. world.pipe.diameter_m=0.3. May be repeated.",
)  # fmt: skip
@click.option("--no-fly", is_flag=True, help="Omit the rows that need flights.")
@click.option("--seeds", type=int, default=2, show_default=True, help="Flights per wind speed.")
@click.option("--workers", type=int, help="Number of processes.  [default: fly in this process]")
@click.option("--ray", metavar="local|ADDRESS", help="Fly on a Ray cluster (extra 'cluster').")
@out_option
@as_json_option
def robots(
    robot: str, other: str, sets: tuple[str, ...], no_fly: bool, seeds: int,
    workers: int | None, ray: str | None, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Compare two robots with arms: clearance, reach, reactions, impact, accuracy, endurance."""
    from skywright.analysis.compare.compare import compare_robots
    from skywright.analysis.compare.report import (
        print_comparison,
        tell_step,
        write_compare_page,
    )

    with _page(out) as page:
        found = compare_robots(
            robot, other, sets=sets, fly=not no_fly, seeds=seeds,
            step=None if as_json else tell_step, workers=workers, ray=ray,
        )  # fmt: skip
        write_compare_page(found, page)
    if as_json:
        print_json(found.to_json())
    else:
        print_comparison(found, page)


@compare.command()
@click.argument("a", metavar="A", type=click.Path(path_type=Path))
@click.argument("b", metavar="B", type=click.Path(path_type=Path))
@out_option
@as_json_option
def runs(a: Path, b: Path, out: Path, as_json: bool) -> None:
    """Compare two runs: settings and metrics that differ, and overlaid plots of the main series."""
    from skywright.analysis.compare_runs.overlay import compare_runs
    from skywright.analysis.compare_runs.report import print_overlay, write_overlay_page
    from skywright.run.results import open_run

    with _page(out) as page:
        found = compare_runs(open_run(a), open_run(b))
        write_overlay_page(found, page)
    for run in (found.a, found.b):
        report_unfinished(run.directory, run.outcome, run.reason)
    if as_json:
        print_json({**found.to_json(), "page": str(page)})
    else:
        print_overlay(found, page)


@compare.command()
@click.argument("names", metavar="A,B,...")
@click.option("--mission", metavar="M", required=True, help="Mission to fly with every law.")
@layers
@click.option(
    "--case",
    "cases",
    multiple=True,
    metavar="NAME[:KEY=VALUE]",
    help="Fly only the nominal case and this one: a built-in case, or one of your own. May be "
    "repeated.",
)
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=DIST",
    help="Draw a value for each run, the same for all laws, as in a campaign. May be repeated.",
)
@click.option(
    "--runs", "count", type=int, default=10, show_default=True, help="Runs per law and case."
)
@click.option("--workers", type=int, help="Processes on this machine.  [default: all cores]")
@click.option("--ray", metavar="local|ADDRESS", help="Fly on a Ray cluster (extra 'cluster').")
@out_option
@as_json_option
def laws(
    names: str, mission: str, robot: str | None, world: str | None, sets: tuple[str, ...],
    seed: int | None, cases: tuple[str, ...], vary: tuple[str, ...], count: int,
    workers: int | None, ray: str | None, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Fly control laws on the same seeds and conditions, and compare them in pairs.

    A law is a name or FILE.py:CLASS; :KEY=VALUE behind it sets a key of [mission.law]. The
    differences are to the first law whose nominal flights succeed. The flights are campaigns in a
    folder beside the page; the same command continues an interrupted comparison.
    """
    from skywright.analysis.compare_laws.compare import compare_laws
    from skywright.analysis.compare_laws.report import print_laws, tell_step, write_laws_page

    if count < 1:
        raise InputError(f"--runs {count}: at least 1 is needed")
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: at least 1 is needed")
    with _page(out) as page:
        folder = check_folder(page.with_suffix(""))
        found = compare_laws(
            names.split(","), mission, robot=robot, world=world, sets=sets, vary=vary, cases=cases,
            runs=count, seed=seed, out=folder, workers=workers, ray=ray,
            step=None if as_json else tell_step,
        )  # fmt: skip
        write_laws_page(found, page)
    if as_json:
        print_json({**found.to_json(), "page": str(page), "folder": str(folder)})
    else:
        print_laws(found, page)
