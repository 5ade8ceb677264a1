"""The report of a run: one HTML file that opens offline and prints well (ADR 0007)."""

import re
import shlex
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from skywright.core.find import blame
from skywright.errors import InputError
from skywright.reports import explain
from skywright.reports.figures import paths, plan, series
from skywright.reports.figures.style import RUN_CLOCK, house_style, render_svg
from skywright.reports.page import Picture, build_picture, render_page, write_page, write_time
from skywright.reports.phases import explain_phase
from skywright.run.directory import SUFFIX
from skywright.run.kind import load_kind
from skywright.run.names import list_measures
from skywright.run.parts import uses_truth
from skywright.run.result import RunResult

FILES = {
    "replay.html": "3-D replay", "recording.mcap": "recording", "mission.toml": "settings",
    "metrics.json": "metrics",
}  # fmt: skip

CONTACT_OFFSET = (
    " During contact the platform is intentionally offset from its reference, which lies inside "
    "the surface."
)


def list_figures(kind: str) -> dict[str, Callable[[RunResult], Figure | None]]:
    """Return the figures of missions of a kind by name; each function may return None."""
    return {
        **{name: chart.draw for name, chart in load_kind(kind).figures().charts.items()},
        "tip_path": paths.draw_tip_path,
        "flight_path": paths.draw_flight_path,
        "flight_series": series.draw_flight_series,
        "plan": plan.draw_plan,
    }


def write_report(result: RunResult) -> None:
    """Write report.html into the run's directory. Raises InputError if it cannot be written."""
    write_page(result.directory / "report.html", render_report(result))


def write_figures(result: RunResult, folder: Path) -> list[Path]:
    """Write each figure of a run as SVG and PDF into a folder; return the files.

    Empty figures are omitted. Raises InputError if files cannot be written.
    """
    kind, written = result.description.mission.kind, list[Path]()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with house_style(), blame(type(load_kind(kind)), "a chart"):
            for name, draw in list_figures(kind).items():
                if (figure := draw(result)) is not None:
                    path = folder / f"{re.sub(r'[^A-Za-z0-9_-]', '_', name)}.svg"
                    path.write_bytes(render_svg(figure))
                    figure.savefig(path.with_suffix(".pdf"), metadata={"CreationDate": None})
                    written += [path, path.with_suffix(".pdf")]
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {error.strerror or error}") from None
    return written


def render_report(result: RunResult) -> str:
    """Return the HTML of the self-contained page."""
    from skywright.run.versions import collect_versions

    kind, folder = result.description.mission.kind, result.directory
    figures = load_kind(kind).figures()
    started = result.timing.get("started_unix_s")
    name = folder.resolve().name.removesuffix(SUFFIX)  # of "." too
    path, out = shlex.quote(f"./{name}"), shlex.quote(f"{name}-")  # a name alone may be built in
    trust = " --trust" if any(folder.glob("*.py")) else ""
    with house_style(), blame(type(load_kind(kind)), "a chart"):
        task = [
            build_picture(chart.title, chart.draw(result), chart.caption, clock=RUN_CLOCK)
            for chart in figures.charts.values()
        ]
        motion = _draw_motion(result)
        planning = build_picture(
            "Clearance and rotor margin of the plan", plan.draw_plan(result),
            "Both must remain above zero. The planner rejects paths that violate its "
                "margins.",
        )  # fmt: skip
    return render_page(
        "report.html.j2",
        result=result,
        d=result.description,
        section=figures.title,
        notes=figures.notes(result),
        truth=uses_truth(result.description),
        completed=result.outcome in ("succeeded", "failed"),
        outcome=explain.describe_outcome(result),
        meanings=list_measures(kind),
        signs={"<=": "≤", ">=": "≥", "==": "="},
        number=explain.format_value,
        task=[p for p in task if p],
        motion=[p for p in motion if p],
        planning=planning,
        timing=explain.list_timing(result),
        conditions=explain.list_conditions(result),
        plant=explain.list_plant(result),
        changes=explain.list_changes(result),
        assumptions=explain.list_assumptions(result),
        unsourced=explain.count_unsourced(result),
        metrics=explain.list_metrics(result),
        explain_phase=partial(explain_phase, kind),
        versions=collect_versions(),
        flown=started and write_time(datetime.fromtimestamp(started, UTC)),
        files={file: what for file, what in FILES.items() if (folder / file).is_file()},
        repeat=f"skywright run {path} --out {out}again{trust}",
        redraw=f"skywright report {path} --figures {out}figures{trust}",
    )


def _draw_motion(result: RunResult) -> list[Picture | None]:
    return [
        build_picture(
            "Tip path", paths.draw_tip_path(result),
            "Wide green line: desired path of the probe. Thin blue line: true path.",
        ),
        build_picture(
            "Flight path", paths.draw_flight_path(result),
            "Robot and world to scale, with the robot at its start (pale) and at work.",
        ),
        build_picture(
            "The whole flight", series.draw_flight_series(result),
            f"Bands are phases. {series.LIMITS_DRAWN}"
                + (CONTACT_OFFSET if result.description.robot.probe else ""),
        ),
    ]  # fmt: skip
