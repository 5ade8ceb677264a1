"""Alignment of clocks and frames: closed forms, identities, and what is not determined."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skywright.errors import InputError
from skywright.models.localisation.calibration import calibrate
from skywright.models.localisation.drift_noise import (
    DriftNoise,
    compute_walk,
    estimate_noise,
    find_outliers,
    whiten,
)
from skywright.models.localisation.frame_alignment import (
    METHODS,
    diagnose_geometry,
    estimate_affine,
    estimate_frame,
    estimate_level,
    estimate_similarity,
)
from skywright.models.localisation.time_alignment import estimate_offset
from skywright.models.localisation.trajectory import Trajectory
from skywright.vehicle.sensor_flight import (
    PRISM,
    CameraErrors,
    build_inspection_path,
    simulate_flight,
)

seeds = st.integers(0, 10**6)
scales = st.floats(0.2, 5.0)


def cloud(seed: int, n: int = 20) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 3)) * [3.0, 2.0, 1.0]


def rotation(seed: int) -> np.ndarray:
    return Rotation.random(random_state=seed).as_matrix()


# --- frames -------------------------------------------------------------------------------------


@given(seeds, scales)
def test_exact_pairs_give_the_exact_similarity(seed, scale):
    x, R, t = cloud(seed), rotation(seed), np.array([10.0, -20.0, 3.0])
    y = scale * x @ R.T + t
    for found in (estimate_similarity(x, y), estimate_affine(x, y)):
        assert found.matrix == pytest.approx(scale * R, abs=1e-8)
        assert found.offset == pytest.approx(t, abs=1e-7)
        assert found.scale == pytest.approx(scale)
        assert found.rotation == pytest.approx(R, abs=1e-8)
        assert found.apply(x) == pytest.approx(y, abs=1e-7)
    assert estimate_affine(x, y).shear == pytest.approx(0.0, abs=1e-7)
    assert estimate_similarity(x, y, with_scale=False).scale == pytest.approx(1.0)


@given(seeds)
def test_affine_is_the_papers_stacked_system(seed):
    """Eq. (4) written out: rows of three per point, unknowns (5), solved as a whole."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(15, 3))
    y = x @ rng.normal(size=(3, 3)).T + rng.normal(size=3) + 0.1 * rng.normal(size=(15, 3))
    rows = np.concatenate([np.hstack([np.kron(np.eye(3), p), np.eye(3)]) for p in x])
    u = np.linalg.lstsq(rows, y.ravel(), rcond=None)[0]
    found = estimate_affine(x, y)
    assert found.matrix == pytest.approx(u[:9].reshape(3, 3), abs=1e-9)
    assert found.offset == pytest.approx(u[9:], abs=1e-9)


@given(seeds)
def test_similarity_is_never_a_reflection_and_never_worse_than_its_neighbours(seed):
    rng = np.random.default_rng(seed)
    x = cloud(seed)
    y = x @ np.diag([1.0, 1.0, -1.0]) + 0.3 * rng.normal(size=x.shape)  # mirrored data
    best = estimate_similarity(x, y)
    assert np.linalg.det(best.matrix) > 0
    cost = np.sum((y - best.apply(x)) ** 2)
    for _ in range(5):
        step = Rotation.from_rotvec(0.01 * rng.normal(size=3)).as_matrix()
        scale = 1.0 + 0.01 * rng.normal()
        m = scale * step @ best.matrix
        moved = x @ m.T
        shifted = moved + (y - moved).mean(axis=0)  # its best offset
        assert np.sum((y - shifted) ** 2) >= cost - 1e-9


@given(seeds, st.floats(-math.pi, math.pi), scales)
def test_level_finds_the_heading_even_on_a_line(seed, angle, scale):
    line = np.outer(np.linspace(0, 5, 10), [1.0, 0.3, 0.2])
    R = Rotation.from_euler("z", angle).as_matrix()
    y = scale * line @ R.T + [1.0, 2.0, 3.0]
    found = estimate_level(line, y)
    assert found.matrix == pytest.approx(scale * R, abs=1e-9)


def test_a_plane_leaves_the_affine_matrix_open_and_the_similarity_not():
    rng = np.random.default_rng(3)
    flat = cloud(3, 200) * [1.0, 1.0, 0.0]
    flat[:, 2] = 0.005 * rng.normal(size=200)
    R = rotation(5)
    y = flat @ R.T + 0.005 * rng.normal(size=flat.shape)
    up = np.array([[0.0, 0.0, 3.0]])
    truth = up @ R.T
    seven = np.linalg.norm(estimate_similarity(flat, y).apply(up) - truth)
    twelve = np.linalg.norm(estimate_affine(flat, y).apply(up) - truth)
    assert seven < 0.02 and twelve > 10.0 * seven


def test_geometry_is_diagnosed():
    rng = np.random.default_rng(0)
    full = cloud(0, 100)
    assert diagnose_geometry(full, 0.005).kind == "full"
    flat = full * [1.0, 1.0, 0.01]
    assert diagnose_geometry(flat, 0.005).note == ""  # a similarity needs no more
    assert "nearly flat" in diagnose_geometry(flat, 0.005, "affine").note
    line = full * [1.0, 0.01, 0.01]
    assert "straight line" in diagnose_geometry(line, 0.005).note
    assert diagnose_geometry(line, 0.005, "level").note == ""
    assert "vertical line" in diagnose_geometry(line[:, [2, 1, 0]], 0.005, "level").note
    still = 0.004 * rng.normal(size=(100, 3))
    assert "no motion in the calibration" in diagnose_geometry(still, 0.005).note


def test_wrong_methods_and_too_few_points():
    x = cloud(0)
    with pytest.raises(InputError, match="valid: similarity, rigid, level, affine"):
        estimate_frame("umeyama", x, x)
    for method in METHODS:
        with pytest.raises(InputError, match="3 pairs of points"):
            estimate_frame(method, x[:3], x[:3])


# --- noise --------------------------------------------------------------------------------------


@given(seeds, st.floats(1e-3, 0.1), st.floats(1e-4, 0.1))
def test_whitened_least_squares_is_generalised_least_squares(seed, white, walk):
    """The same normal equations as with the full covariance of white noise plus random walk."""
    rng = np.random.default_rng(seed)
    n = 12
    steps = walk**2 * rng.uniform(0.5, 2.0, n)
    steps[0] = 0.0
    m = rng.normal(size=(n, 4))
    position = np.cumsum(steps)
    covariance = np.minimum.outer(position, position) + white**2 * np.eye(n)
    w = whiten(m, white, steps, np.zeros(n))
    expected = m.T @ np.linalg.solve(covariance, m)
    assert w.T @ w == pytest.approx(expected, rel=1e-6)


def test_noise_is_found_again():
    rng = np.random.default_rng(4)
    n = 1500
    dt = np.concatenate([[0.0], rng.uniform(0.05, 0.15, n - 1)])
    path = dt * (0.5 + 0.5 * np.sin(np.arange(n) / 40.0))
    for true in (DriftNoise(0.003, 0.02, 0.0), DriftNoise(0.003, 0.0, 0.02),
                 DriftNoise(0.01, 0.001, 0.0)):  # fmt: skip
        walk = compute_walk(true, dt, path)
        r = np.cumsum(np.sqrt(walk)[:, None] * rng.normal(size=(n, 3)), axis=0)
        r += true.station * rng.normal(size=(n, 3))
        r[100] += [1.0, 0.0, 0.0]  # a gross error
        found = estimate_noise(r, dt, path)
        assert found.station == pytest.approx(true.station, rel=0.1)
        total = compute_walk(found, dt, path).sum()
        assert total == pytest.approx(walk.sum(), rel=0.25)
        assert find_outliers(r, found.station, compute_walk(found, dt, path), 21.1)[0][100] == 1.0


def test_noise_that_the_walk_hides_comes_from_the_data_sheet():
    """A camera that walks 5 mm between two fixes hides 1 mm of the station; 60 s, 30 flights."""
    n, true = 570, 0.0011
    dt = np.full(n, 0.105) * (np.arange(n) > 0)
    walk = DriftNoise(true, 0.005, 0.02)
    apart = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        r = np.sqrt(compute_walk(walk, dt, 0.7 * dt))[:, None] * rng.normal(size=(n, 3))
        r = np.cumsum(r, axis=0) + true * rng.normal(size=(n, 3))
        apart.append([estimate_noise(r, dt, 0.7 * dt, sheet).station for sheet in (None, 0.0017)])
    alone, told = np.array(apart).T / true
    assert np.min(alone) < 0.6  # why the data sheet is asked
    assert np.all((told > 0.7) & (told < 1.6))


# --- clocks -------------------------------------------------------------------------------------


def two_clocks(offset: float, seed: int = 1, *, same: bool = True) -> tuple[Trajectory, Trajectory]:
    """A path seen at 200 Hz, and irregularly, by a clock that is `offset` behind."""
    path = build_inspection_path(seed, duration=60.0)
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(1.0, 59.0, 550))
    p = np.stack([np.interp(t, path.t, path.p_WB[:, i]) for i in range(3)], axis=1)
    R = rotation(seed)
    slow = Trajectory("slow", t, p + 0.002 * rng.normal(size=p.shape))
    return slow, Trajectory("fast", path.t + offset, 0.9 * path.p_WB @ R.T)


@pytest.mark.parametrize("offset", [0.0, 0.137, -1.9, 4000.0, -1.7e9])
def test_offset_of_the_clocks(offset):
    slow, fast = two_clocks(offset)
    found = estimate_offset(slow, fast)
    assert found.offset == pytest.approx(offset, abs=0.02)
    assert found.peak > 0.95
    assert found.common_clock == (abs(offset) < 5.0)
    c = calibrate(slow, fast, found.offset)
    # a double holds seconds since 1970 to a quarter of a microsecond
    assert c.time_offset == pytest.approx(offset, abs=2e-3)
    assert c.frame.scale == pytest.approx(1 / 0.9, rel=2e-3)


def test_a_skew_of_the_clocks_is_found():
    slow, fast = two_clocks(0.05)
    long = fast._replace(t=fast.t * 1.0)
    path = build_inspection_path(2, duration=200.0, speed=0.8)
    rng = np.random.default_rng(2)
    t = np.sort(rng.uniform(1.0, 199.0, 1900))
    p = np.stack([np.interp(t, path.t, path.p_WB[:, i]) for i in range(3)], axis=1)
    slow = Trajectory("slow", t * (1 + 5e-4), p + 0.002 * rng.normal(size=p.shape))
    long = Trajectory("fast", path.t, path.p_WB)
    c = calibrate(slow, long, estimate_offset(slow, long).offset)
    assert c.skew == pytest.approx(-5e-4, abs=3e-5)
    assert c.to_camera_time(slow.t) == pytest.approx(t, abs=3e-3)
    assert c.to_camera_time(c.to_station_time(path.t)) == pytest.approx(path.t, abs=1e-9)


def test_nothing_in_common_is_refused():
    slow, _ = two_clocks(0.0)
    _, other = two_clocks(500.0, seed=7)
    with pytest.raises(InputError, match="do not overlap in time"):
        estimate_offset(slow, other)
    with pytest.raises(InputError, match="at least 8 s"):
        estimate_offset(slow.cut(0.0, 5.0), other)


def test_standing_still_tells_no_delay():
    t = np.arange(0.0, 30.0, 0.1)
    still = Trajectory("a", t, 1e-4 * np.random.default_rng(0).normal(size=(300, 3)))
    found = estimate_offset(still, still._replace(name="b", p=still.p[::-1].copy()))
    assert found.offset == 0.0 and "do not determine the delay" in found.note


# --- all at once --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_calibration_of_a_flight_is_as_good_as_it_says(seed):
    path = build_inspection_path(seed, duration=60.0, speed=0.7)
    flight = simulate_flight(path, seed, errors=CameraErrors(yaw_rate_deg_per_min=0.0),
                             station_clock=0.1)  # fmt: skip
    c = calibrate(flight.station, flight.camera, -0.09)
    assert c.geometry.kind == "full" and not c.notes
    off = Rotation.from_matrix(c.frame.rotation @ flight.R_CW).magnitude()
    assert off < 4.0 * math.sqrt(3.0) * c.rotation_std
    assert abs(c.frame.scale * flight.errors.scale - 1.0) < 4.0 * c.scale_std
    assert abs(c.time_offset + 0.1 + c.skew * 30.0) < 4.0 * c.offset_std
    assert c.noise.station == pytest.approx(0.0017, rel=0.2)
    assert c.noise.per_sqrt_m == pytest.approx(0.015, rel=0.35)
    assert c.p_BP[:2] == pytest.approx(PRISM[:2], abs=0.06)


def test_drift_of_the_camera_does_not_bias_the_scale():
    """It is in the regressor: plain least squares is 1 % low here, five standard deviations."""
    off = []
    for seed in range(4, 12):
        path = build_inspection_path(seed, duration=60.0, speed=0.7)
        flight = simulate_flight(path, seed, errors=CameraErrors(yaw_rate_deg_per_min=0.0))
        c = calibrate(flight.station, flight.camera, 0.0, fixed_time=True, p_BP=PRISM)
        off.append(c.frame.scale * flight.errors.scale - 1.0)
    assert abs(np.mean(off)) < 0.004


def test_gross_errors_and_a_wrong_start_do_not_matter():
    path = build_inspection_path(4, duration=60.0, speed=0.7)
    flight = simulate_flight(path, 4, station_clock=0.1)
    clean = calibrate(flight.station, flight.camera, -0.1)
    p = flight.station.p.copy()
    rng = np.random.default_rng(0)
    bad = rng.choice(len(p), len(p) // 20, replace=False)
    p[bad] += rng.normal(size=(len(bad), 3))
    found = calibrate(flight.station._replace(p=p), flight.camera, 0.08)
    assert found.outliers >= 0.9 * len(bad)
    assert found.time_offset == pytest.approx(clean.time_offset, abs=3e-3)
    assert found.frame.matrix == pytest.approx(clean.frame.matrix, abs=1e-2)


def test_too_little_in_common_is_refused():
    path = build_inspection_path(1, duration=30.0)
    flight = simulate_flight(path, 1)
    with pytest.raises(InputError, match="a calibration requires at least 12"):
        calibrate(flight.station, flight.camera, 0.0, span=(0.0, 0.5))
