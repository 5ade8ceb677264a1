"""The station's pose from terrain points: least squares, its tests, and what they miss."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skywright.analysis.locate.reach import TERRAIN
from skywright.analysis.locate.station_frame import estimate_station_pose
from skywright.errors import InputError

NAMES = [f"P{i}" for i in range(len(TERRAIN))]
STD = 2e-3


def measure(rng: np.random.Generator, std: float = STD, points: np.ndarray = TERRAIN):
    """Points as a station somewhere sees them, and where it is."""
    R = Rotation.from_euler("z", rng.uniform(-math.pi, math.pi)).as_matrix()
    p = rng.uniform(-30.0, 30.0, 3)
    return (points - p + std * rng.normal(size=points.shape)) @ R, R, p


@given(st.integers(0, 10**6), st.booleans())
def test_exact_points_give_the_exact_pose(seed, level):
    measured, R, p = measure(np.random.default_rng(seed), 0.0)
    pose = estimate_station_pose(NAMES, TERRAIN, measured, level=level)
    assert pytest.approx(R, abs=1e-9) == pose.R_WS
    assert pose.p_WS == pytest.approx(p, abs=1e-8)
    assert pose.apply(measured) == pytest.approx(TERRAIN, abs=1e-8)
    assert pose.chi2 < 1e-6 and all(x.used for x in pose.points) and not pose.notes


@pytest.mark.parametrize("level", [True, False])
def test_errors_residuals_and_redundancies_are_those_of_the_theory(level):
    rng = np.random.default_rng(1)
    target = np.array([1.0, 0.0, 4.0])
    errors, totals, statistics, shares = [], [], [], []
    for _ in range(400):
        measured, R, p = measure(rng)
        pose = estimate_station_pose(NAMES, TERRAIN, measured, std=STD, level=level)
        if not all(x.used for x in pose.points):
            continue  # one in a thousand
        errors.append(pose.apply(((target - p) @ R)[None])[0] - target)
        totals.append(pose.chi2)
        statistics.append([x.statistic for x in pose.points])
        shares.append(sum(x.redundancy for x in pose.points))
    redundancy = 3 * len(NAMES) - (4 if level else 6)
    rms = math.sqrt(np.mean(np.sum(np.square(errors), axis=1)))
    assert rms == pytest.approx(pose.predict_std(target), rel=0.1)
    assert np.mean(totals) == pytest.approx(redundancy, rel=0.1)
    assert pose.redundancy == redundancy
    assert np.mean(shares) == pytest.approx(redundancy / 3.0, rel=1e-6)
    assert np.mean(statistics) == pytest.approx(3.0, rel=0.1)


def test_a_moved_point_is_found_and_left_out():
    rng = np.random.default_rng(2)
    found = clean = 0
    for k in range(60):
        wrong = k % len(NAMES)
        moved = TERRAIN.copy()
        direction = rng.normal(size=3)
        moved[wrong] += 0.02 * direction / np.linalg.norm(direction)
        measured, _, p = measure(rng, points=moved)
        pose = estimate_station_pose(NAMES, TERRAIN, measured)
        out = [x.name for x in pose.points if not x.used]
        found += out == [NAMES[wrong]]
        clean += np.linalg.norm(pose.p_WS - p) < 0.01
    assert found >= 57 and clean >= 57
    assert any("left out" in note for note in pose.notes)


def test_two_moved_points_are_both_found():
    rng = np.random.default_rng(3)
    moved = TERRAIN.copy()
    moved[1] += [0.3, 0.0, 0.0]
    moved[4] += [0.0, -0.2, 0.1]
    measured, _, p = measure(rng, points=moved)
    pose = estimate_station_pose(NAMES, TERRAIN, measured)
    assert [x.name for x in pose.points if not x.used] == ["P1", "P4"]
    assert pose.p_WS == pytest.approx(p, abs=0.01)


def test_good_points_are_rarely_rejected():
    rng = np.random.default_rng(4)
    alarms = sum(
        any(not x.used for x in estimate_station_pose(NAMES, TERRAIN, measure(rng)[0]).points)
        for _ in range(500)
    )
    assert alarms <= 4  # expected: 0.5


def test_an_inconsistent_point_of_four_cannot_be_identified():
    rng = np.random.default_rng(5)
    moved = TERRAIN[:4].copy()
    moved[2] += [0.5, 0.0, 0.0]
    measured, _, _ = measure(rng, points=moved)
    pose = estimate_station_pose(NAMES[:4], TERRAIN[:4], measured)
    assert len(pose.notes) == 1 and "cannot be identified" in pose.notes[0]
    measured, _, _ = measure(rng, std=0.006)
    pose = estimate_station_pose(NAMES, TERRAIN, measured, std=STD)
    assert pose.notes and pose.sigma > STD


def test_places_that_do_not_fix_the_frame_are_refused():
    near = TERRAIN * 1e-4
    with pytest.raises(InputError, match="too close to one place"):
        estimate_station_pose(NAMES, near, near)
    line = np.outer(np.linspace(0, 30, 6), [1.0, 1.0, 0.0])
    with pytest.raises(InputError, match="too close to one line"):
        estimate_station_pose(NAMES, line, line, level=False)
    assert estimate_station_pose(NAMES, line, line).chi2 < 1e-9  # levelled, a line is enough
    with pytest.raises(InputError, match="2 common points"):
        estimate_station_pose(NAMES[:2], TERRAIN[:2], TERRAIN[:2])


def test_the_detectable_offset_is_found_in_80_of_100_cases():
    """In random directions, at five points."""
    rng = np.random.default_rng(5)
    exact, _, _ = measure(rng, 0.0, TERRAIN[:5])
    size = estimate_station_pose(NAMES[:5], TERRAIN[:5], exact).points[0].detectable
    found = 0
    for _ in range(500):
        aside = rng.normal(size=3)
        measured = exact + STD * rng.normal(size=exact.shape)
        measured[0] += size * aside / np.linalg.norm(aside)
        pose = estimate_station_pose(NAMES[:5], TERRAIN[:5], measured)
        found += not pose.points[0].used
    assert found / 500 == pytest.approx(0.8, abs=0.06)
