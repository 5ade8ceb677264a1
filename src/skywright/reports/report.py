"""The report of a run: one HTML file that opens offline and prints well (ADR 0007)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from skywright.errors import InputError
from skywright.reports import explain
from skywright.reports.figures import paths, plan, series
from skywright.reports.figures.style import house_style
from skywright.reports.kinds import list_figures, load_figures
from skywright.reports.page import Picture, build_picture, render_page
from skywright.reports.phases import explain_phase
from skywright.run.names import MEANINGS

if TYPE_CHECKING:
    from skywright.run.run import RunResult


def _draw_hero(result: RunResult) -> Figure | None:
    from skywright.reports.figures.hero import draw_hero  # slow: only for README and docs

    return draw_hero(result)


FIGURES: dict[str, Callable[[RunResult], Figure | None]] = {
    "hero": _draw_hero,
    **list_figures(),
    "tip_path": paths.draw_tip_path,
    "flight_path": paths.draw_flight_path,
    "contact_series": series.draw_contact_series,
    "flight_series": series.draw_flight_series,
    "plan": plan.draw_plan,
}
"""Every figure by name; each is None where a run has nothing to show."""


def write_report(result: RunResult) -> None:
    """Write report.html into the run's directory. Raises InputError when it cannot be written."""
    path = result.directory / "report.html"
    try:
        path.write_text(render_report(result), encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error


def render_report(result: RunResult) -> str:
    """Return the page; everything that it shows is inside it."""
    from skywright.run.run import collect_versions

    kind = result.description.mission.kind
    with house_style():
        task = _draw_task(result)
        motion = _draw_motion(result)
        planning = build_picture(
            "Clearance and rotor margin of the plan", plan.draw_plan(result),
            "Both must stay above zero. The planner refuses a path that comes closer than its "
            "margins.",
        )  # fmt: skip
    return render_page(
        "report.html.j2",
        result=result,
        d=result.description,
        kind=kind,
        truth=result.description.mission.estimator == "truth",
        completed=result.outcome in ("succeeded", "failed"),
        outcome=explain.describe_outcome(result),
        meanings=MEANINGS,
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
        explain_phase=partial(explain_phase, result.description.mission.kind),
        versions=collect_versions(),
    )


def _draw_task(result: RunResult) -> list[Picture | None]:
    """What belongs to the mission's kind."""
    module = load_figures(result.description.mission.kind)
    return [
        build_picture(title, module.FIGURES[name](result), caption)
        for name, (title, caption) in module.CAPTIONS.items()
    ]


def _draw_motion(result: RunResult) -> list[Picture | None]:
    return [
        build_picture(
            "Tip path", paths.draw_tip_path(result),
            "The probe should follow the wide green line; the thin blue line is where it "
            "really went.",
        ),
        build_picture(
            "Flight path", paths.draw_flight_path(result),
            "Robot and world drawn to scale, the robot at its start (pale) and at work.",
        ),
        build_picture(
            "While the probe is at the surface", series.draw_contact_series(result),
            "Grey and white bands are phases, named on top. Dashed red lines are limits, "
            "dotted green ones what is expected.",
        ),
        build_picture(
            "The whole flight", series.draw_flight_series(result),
            "Bands are phases. While pushing, the platform stands off its reference on "
            "purpose: the reference lies inside the surface."
            if result.description.mission.kind == "scan"
            else "Bands are phases. Dashed red lines are limits.",
        ),
    ]  # fmt: skip
