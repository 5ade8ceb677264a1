"""The command `pod`: probability of detection."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skywright.cli.options import (
    as_json_option,
    check_writable,
    layers,
    print_json,
    trust_option,
)
from skywright.errors import InputError

if TYPE_CHECKING:
    from skywright.analysis.pod.method import Method
    from skywright.analysis.pod.table import Inspections

TABLES = (".csv", ".tsv", ".txt", ".dat")
"""Suffixes of tables; all other arguments are missions."""


class _Ceiling(click.ParamType):
    name = "ceiling"

    def convert(
        self, value: str, param: click.Parameter | None, context: click.Context | None
    ) -> float | str:
        """Return a number, "fit" or "contact"."""
        if value in ("fit", "contact"):
            return value
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r}; valid: fit, contact or a number from 0 to 1", param, context)


@click.command()
@trust_option
@click.argument("data", metavar="DATA.csv|MISSION")
@click.option(
    "--columns", metavar="SPEC", help="The file's own names: size=Depth[mm],hit=Found,flaw=Id,..."
)
@click.option(
    "--model", type=click.Choice(["hit-miss", "a-hat"]), help="Data.  [default: the columns']"
)
@click.option(
    "--decision", type=float, metavar="Y", help="Signal from which a flaw is called (a-hat)."
)
@click.option("--left", type=float, metavar="Y", help="Signals up to Y are censored (a-hat).")
@click.option("--right", type=float, metavar="Y", help="Signals from Y on are censored (a-hat).")
@click.option(
    "--link",
    type=click.Choice(["logit", "probit"]),
    default="logit",
    show_default=True,
    help="Curve of hit/miss data.",
)
@click.option(
    "--size-axis", type=click.Choice(["linear", "log"]), help="Axis of size.  [default: by AIC]"
)
@click.option(
    "--signal-axis", type=click.Choice(["linear", "log"]), help="Axis of the signal, likewise."
)
@click.option(
    "--bounds",
    type=click.Choice(["wald", "likelihood"]),
    default="wald",
    show_default=True,
    help="Confidence bounds: Wald, or likelihood ratio.",
)
@click.option(
    "--ceiling",
    type=_Ceiling(),
    metavar="fit|contact|C",
    help="POD that no size exceeds.  [default: the column contact, else 1]",
)
@click.option("--group", metavar="COLUMN", help="A curve for each value of a column.")
@click.option("--runs", type=int, help="MISSION: number of flights.")
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=DIST",
    help="MISSION: distribution of a key, as in campaign; include keys of the flaw's size.",
)
@click.option("--size", metavar="NAME", help="MISSION: measure of a flaw.  [default: its first]")
@layers
@click.option("--workers", type=int, help="MISSION: processes.  [default: all cores]")
@click.option("--ray", metavar="local|ADDRESS", help="MISSION: fly on a Ray cluster.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Picture (.png or .svg); of a MISSION its folder.",
)
@as_json_option
def pod(
    data: str, columns: str | None, model: str | None, decision: float | None, left: float | None,
    right: float | None, link: str, size_axis: str | None, signal_axis: str | None, bounds: str,
    ceiling: float | str | None, group: str | None, runs: int | None, vary: tuple[str, ...],
    size: str | None, robot: str | None, world: str | None, sets: tuple[str, ...],
    seed: int | None, workers: int | None, ray: str | None, out: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Compute a probability of detection from known flaws.

    DATA.csv has one row for each inspection: a size, and whether the flaw was found (hit) or its
    signal (ahat). Size 0 is a site without a flaw. A MISSION is flown --runs times over flaws that
    --vary sizes; its table, pod.csv, stays in the campaign's folder.
    """
    from skywright.analysis.pod.method import Method

    method = Method(
        model, link, size_axis, signal_axis, bounds, decision, left, right, ceiling
    )  # fmt: skip
    path = Path(data)
    if path.is_dir() and (path / "pod.csv").is_file() and runs is None:
        path = path / "pod.csv"
    if path.suffix.lower() not in TABLES:
        if columns is not None:
            raise InputError("--columns: valid for a table; a mission names its own columns")
        given = {"robot": robot, "world": world, "sets": sets, "seed": seed}
        return _fly(data, runs, vary, size, given, workers, ray, method, group, out, as_json)
    for name, value in (
        ("--runs", runs), ("--vary", vary), ("--size", size), ("--robot", robot),
        ("--world", world), ("--set", sets), ("--seed", seed), ("--workers", workers),
        ("--ray", ray),
    ):  # fmt: skip
        if value not in (None, ()):
            raise InputError(f"{name}: valid for a mission, not for the table {path}")
    from skywright.analysis.pod.table import load_inspections

    table = load_inspections(path, columns)
    picture = (
        None if out is None and as_json else check_writable(out or Path(f"{path.stem}-pod.png"))
    )
    _conclude(table, method, group, picture, as_json, str(path), {})
    return 0


def _conclude(
    table: Inspections, method: Method, group: str | None, picture: Path | None,
    as_json: bool, label: str, more: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """Fit, draw and print; return the values of --json."""
    from skywright.analysis.pod.groups import compare_groups
    from skywright.analysis.pod.pod import compute_pod

    try:
        found = compute_pod(table, method)
        compared = None if group is None else compare_groups(table, group, method)
    except InputError as error:
        raise InputError(f"{label}: {error}") from None
    if picture is not None:
        from skywright.analysis.pod.figures import write_pod_figure

        write_pod_figure(found, compared, picture)
    told = found.to_json() | more
    if compared is not None:
        told["groups"] = compared.to_json()
    if as_json:
        print_json(told)
    else:
        from skywright.analysis.pod.present import print_pod

        print_pod(found, compared, picture)
    return told


def _fly(
    mission: str, runs: int | None, vary: tuple[str, ...], size: str | None,
    given: dict[str, Any], workers: int | None, ray: str | None, method: Method,
    group: str | None, out: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Fly a campaign over seeded flaws and evaluate its inspections."""
    from skywright.analysis.campaign.campaign import run_campaign
    from skywright.analysis.campaign.spec import build_campaign
    from skywright.analysis.pod.flights import collect_inspections, describe_flights, save_table

    if runs is None:
        raise InputError(
            f"{mission}: a mission requires --runs N; a table ends in {', '.join(TABLES)}"
        )
    plan = build_campaign(mission, vary, **given)
    result = run_campaign(
        plan, runs, out=out, workers=workers, ray=ray, progress=not as_json
    )  # fmt: skip
    flights = collect_inspections(result.rows, size)
    path = save_table(flights, result.folder)
    if not as_json:
        click.echo(
            f"SIMULATED: {flights.flown} flights in {result.folder}, size {flights.size}"
            + "".join(f"; {n} runs {name}, left out" for name, n in flights.left_out.items())
        )
    more = describe_flights(flights, result)
    picture = result.folder / "pod.png"
    told = _conclude(flights.table, method, group, picture, as_json, str(path), more)
    (result.folder / "pod.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    if result.interrupted:
        click.echo("skywright: interrupted; the same command continues", err=True)
    return int(result.interrupted)
