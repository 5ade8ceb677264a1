"""The report of a run: one HTML file that opens offline and prints well (ADR 0007)."""

from __future__ import annotations

import base64
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import jinja2
from matplotlib.figure import Figure

from skywright.errors import InputError
from skywright.evaluation.names import MEANINGS
from skywright.reports import explain
from skywright.reports.figures import paths, plan, series
from skywright.reports.figures.style import WIDTH, house_style, render_svg
from skywright.reports.kinds import list_figures, load_figures

if TYPE_CHECKING:
    from skywright.evaluation.run import RunResult


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


class Picture(NamedTuple):
    """A figure of the page."""

    title: str
    data: str  # data: URI
    caption: str
    width: float  # share of the page


def write_report(result: RunResult) -> None:
    """Write report.html into the run's directory. Raises InputError when it cannot be written."""
    path = result.directory / "report.html"
    try:
        path.write_text(render_report(result), encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error


def render_report(result: RunResult) -> str:
    """Return the page; everything that it shows is inside it."""
    from skywright.evaluation.run import collect_versions

    kind = result.description.mission.kind
    with house_style():
        task = _draw_task(result)
        motion = _draw_motion(result)
        planning = _picture(
            "Clearance and rotor margin of the plan", plan.draw_plan(result),
            "Both must stay above zero. The planner refuses a path that comes closer than its "
            "margins.",
        )  # fmt: skip
    return _template().render(
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
        versions=collect_versions(),
    )


def _draw_task(result: RunResult) -> list[Picture | None]:
    """What belongs to the mission's kind."""
    module = load_figures(result.description.mission.kind)
    return [
        _picture(title, module.FIGURES[name](result), caption)
        for name, (title, caption) in module.CAPTIONS.items()
    ]


def _draw_motion(result: RunResult) -> list[Picture | None]:
    return [
        _picture(
            "Tip path", paths.draw_tip_path(result),
            "The probe should follow the wide green line; the thin blue line is where it "
            "really went.",
        ),
        _picture(
            "Flight path", paths.draw_flight_path(result),
            "Robot and world drawn to scale, the robot at its start (pale) and at work.",
        ),
        _picture(
            "While the probe is at the surface", series.draw_contact_series(result),
            "Grey and white bands are phases, named on top. Dashed red lines are limits, "
            "dotted green ones what is expected.",
        ),
        _picture(
            "The whole flight", series.draw_flight_series(result),
            "Bands are phases. While pushing, the platform stands off its reference on "
            "purpose: the reference lies inside the surface."
            if result.description.mission.kind == "scan"
            else "Bands are phases. Dashed red lines are limits.",
        ),
    ]  # fmt: skip


def _picture(title: str, figure: Figure | None, caption: str) -> Picture | None:
    if figure is None:
        return None
    data = base64.b64encode(render_svg(figure)).decode("ascii")
    width = float(figure.get_size_inches()[0]) / WIDTH
    return Picture(title, f"data:image/svg+xml;base64,{data}", caption, width)


@lru_cache(maxsize=1)
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("skywright.reports"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template("report.html.j2")
