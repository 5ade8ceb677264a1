"""The report of a run: one HTML file that opens offline and prints well (ADR 0007)."""

from collections.abc import Callable
from functools import partial

from matplotlib.figure import Figure

from skywright.core.find import blame
from skywright.errors import InputError
from skywright.reports import explain
from skywright.reports.figures import paths, plan, series
from skywright.reports.figures.style import house_style
from skywright.reports.page import Picture, build_picture, render_page
from skywright.reports.phases import explain_phase
from skywright.run.kind import load_kind
from skywright.run.names import list_measures
from skywright.run.parts import uses_truth
from skywright.run.run import RunResult


def list_figures(kind: str) -> dict[str, Callable[[RunResult], Figure | None]]:
    """Return the figures of missions of a kind by name; each is None with nothing to show."""
    return {
        **{name: chart.draw for name, chart in load_kind(kind).figures().charts.items()},
        "tip_path": paths.draw_tip_path,
        "flight_path": paths.draw_flight_path,
        "flight_series": series.draw_flight_series,
        "plan": plan.draw_plan,
    }


def write_report(result: RunResult) -> None:
    """Write report.html into the run's directory. Raises InputError when it cannot be written."""
    path = result.directory / "report.html"
    try:
        path.write_text(render_report(result), encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error


def render_report(result: RunResult) -> str:
    """Return the page; everything that it shows is inside it."""
    from skywright.run.versions import collect_versions

    kind = result.description.mission.kind
    figures = load_kind(kind).figures()
    with house_style(), blame(type(load_kind(kind)), "a chart"):
        task = [
            build_picture(chart.title, chart.draw(result), chart.caption)
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
        metrics=explain.list_metrics(result),
        explain_phase=partial(explain_phase, kind),
        versions=collect_versions(),
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
            "Bands are phases. Dashed red lines are limits. During contact the platform "
                "is intentionally offset from its reference, which lies inside the surface.",
        ),
    ]  # fmt: skip
