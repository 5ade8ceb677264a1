"""Commands that measure the project's claims: `reproduce`, `bench`."""

from pathlib import Path

import click

from skywright.cli.options import as_json_option, check_writable, print_json
from skywright.errors import InputError


@click.command()
@click.argument("paper", required=False)
@click.option("--claim", "only", multiple=True, metavar="ID", help="Only this claim. Repeatable.")
@click.option(
    "--cache", type=click.Path(path_type=Path), help="Folder of flights.  [default: user's cache]"
)
@click.option("--out", type=click.Path(path_type=Path), help="Page.  [default: claims.html]")
@as_json_option
def reproduce(
    paper: str | None, only: tuple[str, ...], cache: Path | None, out: Path | None, as_json: bool
) -> int:
    """Measure the claims of PAPER, or of all papers.

    Flights are kept, so that a second time takes seconds. Contradictions are results: exit 1 means
    that a claim could not be measured.
    """
    from skywright.evidence.reproduce.cache import default_folder
    from skywright.evidence.reproduce.present import Bar, print_reports, write_claims_page
    from skywright.evidence.reproduce.runner import check_papers, reproduce_papers

    check_papers(paper, only)  # an unknown name must not create files
    page = check_writable(out or Path("claims.html"), (".html",))
    reports = reproduce_papers(
        paper, cache=cache or default_folder(), only=only, steps=None if as_json else Bar()
    )
    write_claims_page(reports, page)
    if as_json:
        print_json({"claims": [c for r in reports for c in r.to_json()["claims"]]})
    else:
        print_reports(reports, page)
    return max(r.exit_code for r in reports)


class _BenchCommand(click.Command):
    """Help with the list of benchmarks, which have a registry of their own."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from skywright.evidence.bench.registry import BENCHMARKS

        with formatter.section("Benchmarks"):
            formatter.write_dl(
                [
                    (name, b.description + ("" if b.by_default else "  (by name, or with --full)"))
                    for name, b in BENCHMARKS.items()
                ]
            )


@click.command(cls=_BenchCommand)
@click.argument("names", metavar="[NAME]...", nargs=-1)
@click.option("--quick", is_flag=True, help="Few repetitions, to test the benchmarks.")
@click.option("--full", is_flag=True, help="Every benchmark with many repetitions.")
@click.option(
    "--out", type=click.Path(path_type=Path),
    help="Folder of results.  [default without NAME: benchmarks/results]",
)  # fmt: skip
@click.option(
    "--workers", type=click.IntRange(min=1), default=1, show_default=True,
    help="Number of processes for the planner comparison.",
)  # fmt: skip
@click.option(
    "--resume", type=click.Path(path_type=Path),
    help="Folder of finished comparisons, to continue after an interruption.",
)  # fmt: skip
@as_json_option
def bench(
    names: tuple[str, ...], quick: bool, full: bool, out: Path | None, workers: int,
    resume: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Measure computing times and memory, as ratios where possible.

    A missed limit is reported and is not an error: timings depend on the machine and its load.
    """
    from skywright.evidence.bench.present import Tables, print_end
    from skywright.evidence.bench.runner import run_benchmarks

    if quick and full:
        raise InputError("--quick and --full: choose one")
    report = run_benchmarks(
        names, effort="quick" if quick else "full" if full else "default", out=out,
        watcher=Tables(quiet=as_json), workers=workers, resume=resume,
    )  # fmt: skip
    if as_json:
        print_json(report.to_json())
    else:
        print_end(report)
    if report.interrupted:
        click.echo("skywright: interrupted; finished measurements are kept", err=True)
    return report.exit_code
