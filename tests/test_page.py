"""Common parts of all pages: the command to repeat, figures over time as panels that zoom."""

from __future__ import annotations

import html
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from skywright.reports.figures.interactive import build_plot
from skywright.reports.figures.plan import draw_plan
from skywright.reports.figures.style import RUN_CLOCK, house_style, new_figure
from skywright.reports.page import render_page, tell_command


@pytest.mark.parametrize(
    ("argv", "command"),
    [
        (["/opt/bin/skywright", "locate", "a b.csv"], "skywright locate 'a b.csv'"),
        (["/opt/skywright/__main__.py", "list"], "skywright list"),
        (["C:/bin/skywright.exe", "list"], "skywright list"),
        (["/usr/bin/pytest", "tests"], ""),
        (["study/my_script.py", "--runs", "3"], "python study/my_script.py --runs 3"),
        (["/opt/ipykernel_launcher.py", "-f", "kernel.json"], ""),
        (["/opt/colab_kernel_launcher.py", "-f", "kernel.json"], ""),
        (["/opt/ray/default_worker.py", "--node"], ""),
        (["/opt/pytest/__main__.py", "tests"], ""),
        ([""], ""),
    ],
)
def test_the_command_is_that_of_this_process(
    argv: list[str], command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", argv)
    assert tell_command() == command
    run = SimpleNamespace(outcome="succeeded", reason="")
    page = render_page(
        "compare_runs.html.j2", found=SimpleNamespace(a=run, b=run, settings=[], metrics=[]),
        names=("a", "b"), reports=("", ""), picture=None, number=str,
    )  # fmt: skip
    assert ("How to repeat this" in page) == bool(command)
    assert f"<pre>{command}</pre>" in html.unescape(page) or not command


@pytest.mark.parametrize(
    ("label", "zooms"),
    [
        ("time (s)", True), ("time since the contact (s)", True), ("time (microseconds)", False),
        ("timestep (s)", False), ("distance (m)", False),
    ],
)  # fmt: skip
def test_only_panels_over_time_in_seconds_zoom(label: str, zooms: bool) -> None:
    """The key of a panel writes its times in seconds."""
    figure = new_figure(6.0, 2.0)
    ax = figure.add_subplot()
    ax.plot([0.0, 1.0], [2.0, 3.0])
    ax.set_xlabel(label)
    assert (build_plot(figure) != "") == zooms


def test_a_plain_time_is_the_clock_of_its_page() -> None:
    """A user's figure over "time (s)" zooms with those of the run in a report, else by itself."""
    figure = new_figure(6.0, 2.0)
    ax = figure.add_subplot()
    ax.plot([0.0, 1.0], [2.0, 3.0])
    ax.set_xlabel("time (s)")
    for clock, more in (("time (s)", {}), (RUN_CLOCK, {"clock": RUN_CLOCK})):
        plot = json.loads(build_plot(figure, "one flight", **more))
        assert plot["group"] == "one flight" and plot["panels"][0]["clock"] == clock


def test_logarithmic_axes_and_marks_are_read() -> None:
    figure = new_figure(6.0, 2.0)
    ax = figure.add_subplot()
    ax.plot([0.0, 1.0], [2.0, 300.0])
    ax.axvline(0.25, color="#ff0000", lw=0.5)
    ax.set(xlabel="time (s)", yscale="log")
    (panel,) = json.loads(build_plot(figure))["panels"]
    assert panel["log"] and len(panel["lines"]) == 1
    assert panel["marks"] == [{"color": "#ff0000ff", "width": 0.5, "dash": [], "x": 0.25}]


def test_the_plan_zooms_and_names_its_least_values() -> None:
    t = np.linspace(0.0, 10.0, 101)
    segment, trace = np.zeros(101, [("t", float)]), np.zeros(101, [
        ("clearance", float), ("rotor_margin", float)
    ])  # fmt: skip
    segment["t"] = t
    trace["clearance"], trace["rotor_margin"] = 0.2 + 0.01 * (t - 4.0) ** 2, 0.5 - 0.02 * t
    plan = SimpleNamespace(segments={"approach": segment}, traces={"approach": trace})
    with house_style():
        figure = draw_plan(SimpleNamespace(plan=plan))  # type: ignore[arg-type]
        assert figure is not None
        panels = json.loads(build_plot(figure))["panels"]
    assert {p["clock"] for p in panels} == {"time along the plan (s)"}
    named = [line["label"] for p in panels for line in p["lines"] if line["label"]]
    assert named == ["clearance", "least 0.200 m", "margin", "least 30 %"]
