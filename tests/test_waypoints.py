"""A flight through way-points: how long it rests and holds."""

from pathlib import Path

import pytest

from skywright.description.loader import load_description
from skywright.run.run import run_mission

Flown = tuple[dict[str, float], float]
"""Durations (s) of the phases, and the planned one."""


def fly(folder: Path, hold: float, settle: float) -> Flown:
    point = f"{{ x_m = 0.5, y_m = 0.0, z_m = 1.0, hold_s = {hold} }}"
    d = load_description(
        "waypoints", sets=[f"mission.task.points=[{point}]", f"mission.task.settle_s={settle}"]
    )
    result = run_mission(d, out=folder / "run", backend="kinematic")
    return {p.name: p.end_s - p.start_s for p in result.phases}, result.plan.duration_s


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    return fly(tmp_path_factory.mktemp("bare"), 0.0, 0.0)


@pytest.mark.parametrize("hold, settle", [(1.0, 0.5), (0.5, 3.0), (3.0, 0.0), (0.0, 2.0)])
def test_a_hold_lasts_as_long_as_asked_after_the_robot_has_settled(
    hold: float, settle: float, tmp_path: Path, bare: Flown
) -> None:
    phases, planned = fly(tmp_path, hold, settle)
    rest = settle if hold > 0.0 else 0.0
    assert phases["waypoint 1"] == pytest.approx(bare[0]["waypoint 1"] + rest, abs=0.021)
    assert phases.get("hold 1", 0.0) == pytest.approx(hold, abs=0.021)
    assert planned == pytest.approx(bare[1] + rest + hold, abs=0.011)
