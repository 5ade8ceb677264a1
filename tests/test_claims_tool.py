"""Measures of Suarez 2020, section VI-A, on made-up flights."""

from __future__ import annotations

import numpy as np
import pytest

from skywright.errors import InputError
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.measures_tool import (
    measure_grasp,
    measure_tool,
    measure_tool_hover,
)


def make_flight(*, bend: float = 0.0, outcome: str = "succeeded", **metrics: float) -> Record:
    """Both tips rise 80 mm to the handle in 2 s, `bend` (m) aside in the middle; twice."""
    t = np.arange(0.0, 12.0, 0.01)
    phase = np.searchsorted([4.0, 6.0, 8.0], t, side="right")
    u = np.clip((t - 4.0) / 2.0, 0.0, 1.0)
    error = np.zeros((len(t), 2, 3))
    error[:, :, 2] = -0.08 * (1.0 - u)[:, None]
    error[:, 0, 0] = bend * np.sin(np.pi * u)
    error[t >= 8.0] = 0.5  # the second grasp is another place's
    metrics = {
        "tool.seat_error_mm": 2.0, "tool.seat_angle_deg": 0.5, "tool.returned": 1.0,
        "tip.hover_rms_mm": 7.0, "tip.hover_max_mm": 12.0, "platform.drift_max_mm": 4.0,
    } | metrics  # fmt: skip
    names = ("hover check", "grasp", "carry", "grasp")
    info = {
        "outcome": outcome, "reason": "", "metrics": metrics,
        "phases": [{"name": n, "start_s": 0.0, "end_s": 1.0} for n in names],
    }  # fmt: skip
    p = np.zeros((len(t), 3))
    arrays = {
        "t": t, "phase": phase, "p_WB": p, "tool_p_WO": p,
        "grasp_error_O": error, "wait_error_O": error,
    }  # fmt: skip
    return Record(info, arrays)


def test_the_first_grasp_is_measured_and_its_bend_found() -> None:
    values = measure_grasp({"flight": [make_flight(), make_flight(bend=0.02)]}).values
    assert values["aside_mm"] == pytest.approx(20.0, abs=0.3)
    assert values["began_mm"] == pytest.approx(80.0) and values["reached_mm"] < 1.0


def test_the_worst_flight_counts() -> None:
    flights = [make_flight(), make_flight(outcome="failed", **{"tool.seat_error_mm": 12.0})]
    values = measure_tool({"flight": flights}).values
    assert values["seat_mm"] == 12.0 and values["share"] == 0.5
    del flights[1].info["metrics"]["tool.seat_error_mm"]
    assert measure_tool({"flight": flights}).values["seat_mm"] == np.inf
    hover = measure_tool_hover({"flight": [make_flight(), make_flight(**{"tip.hover_rms_mm": 9})]})
    assert hover.values["tip_rms_mm"] == 9.0


def test_a_flight_without_a_grasp_says_so() -> None:
    flight = make_flight()
    flight.info["phases"] = [{"name": "start"}]
    with pytest.raises(InputError, match="no phase grasp"):
        measure_grasp({"flight": [flight]})
