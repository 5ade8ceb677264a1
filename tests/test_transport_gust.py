"""The linear model of the carried bar in a gust."""

from __future__ import annotations

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.evidence.transport_gust import AT_ONCE, build_loop, build_matrices, simulate

LOOP = build_loop(load_description("bar-transport"))


def test_the_loop_is_stable_and_keeps_the_bar_in_a_steady_wind() -> None:
    """The platform gives way by what link and lean take the bar aside; the bar stays."""
    A, _, _ = build_matrices(LOOP)
    assert np.linalg.eigvals(A).real.max() < -0.1
    wind = np.tile([-5.0, -1.5], (2000, 1))
    platform, bar = simulate(LOOP, wind, 0.01)
    assert np.abs(bar).max() < 1e-9
    aside = 1.5 / (LOOP.first * LOOP.gravity) * LOOP.below
    lean = 5.0 / (LOOP.mass * LOOP.gravity) * LOOP.joint
    assert platform[0] == pytest.approx(aside + lean)
    wind[1:] = 0.0  # it stops: after a while everything hangs straight below its place
    platform, bar = simulate(LOOP, wind, 0.01)
    assert np.abs(bar).max() > 0.05 and abs(bar[-1]) + abs(platform[-1]) < 1e-3


def test_estimates_without_lag_leave_less_error_of_a_gust_that_falls() -> None:
    wind = np.interp(np.arange(0.0, 15.0, 0.01), [5.0, 7.5], [-6.0, -3.0])
    inputs = np.outer(wind, [1.0, 0.3])
    worst = [
        np.abs(simulate(LOOP._replace(**lag), inputs, 0.01)[1]).max()
        for lag in ({}, {"force": AT_ONCE}, {"force": AT_ONCE, "torque": AT_ONCE})
    ]
    assert worst[0] > 1.1 * worst[1] > 1.2 * worst[2]
