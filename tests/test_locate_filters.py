"""Filters: closed forms, consistency, rates, outliers; the floor of drift; error metrics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation

from skywright.analysis.locate.drift_floor import compute_drift_floor
from skywright.analysis.locate.fusion import find_outages
from skywright.analysis.locate.paper_filter import PaperNoise, run_paper_filter
from skywright.analysis.locate.trajectory_error import compute_error
from skywright.errors import InputError
from skywright.models.localisation.drift_filter import (
    CAMERA,
    STATION,
    DriftModel,
    run_drift_filter,
)
from skywright.models.localisation.trajectory import Trajectory

MODEL = DriftModel(0.002, 0.0005, 0.01, 0.0, rotation_0=1e-3, scale_0=1e-3)


# --- the paper's ---------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [20.0, 200.0])
def test_papers_covariance_settles_at_the_riccati_equation_s(rate):
    """A camera that gives position and velocity, H = I_6, against SciPy's solution."""
    n, dt, noise = 40000, 1.0 / rate, PaperNoise()
    t = dt * np.arange(n)
    kind = np.full(n, CAMERA)
    p, v, cov = run_paper_filter(t, kind, np.zeros((n, 3)), np.zeros((n, 3)))
    A = np.array([[1.0, dt], [0.0, 1.0]])
    prior = solve_discrete_are(A.T, np.eye(2), noise.q * np.eye(2), noise.r_camera * np.eye(2))
    after = prior - prior @ np.linalg.solve(prior + noise.r_camera * np.eye(2), prior)
    assert cov[-1] == pytest.approx([after[0, 0], after[0, 1], after[1, 1]], rel=1e-6)
    assert np.all(p == 0.0) and np.all(v == 0.0)


def test_papers_filter_follows_whoever_reports_more_often():
    """A camera at 200 Hz, 20 cm off, and a right station at 10 Hz: 200/1e-2 against 10/5e-3."""
    t = 0.005 * np.arange(12000)
    kind = np.full(len(t), CAMERA)
    z = np.zeros((len(t), 3))
    z[:, 0] = 0.2
    velocity = np.zeros((len(t), 3))
    kind[::20], z[::20], velocity[::20] = STATION, 0.0, np.nan
    p, _, _ = run_paper_filter(t, kind, z, velocity)
    assert p[-2000:, 0].mean() == pytest.approx(0.2 * 10.0 / 11.0, rel=0.02)


def test_papers_noise_belongs_to_a_rate_and_ours_does_not():
    """The same second of data at twice the rate: the paper's covariance grows by another Q."""
    ends, ours = [], []
    for rate in (50, 200):
        t = np.arange(20 * rate + 1) / rate  # a station's sample is the last
        kind = np.full(len(t), CAMERA)
        kind[:: rate // 10] = STATION
        z = np.zeros((len(t), 3))
        # without corrections by the camera both only predict between the station's samples
        velocity = np.full((len(t), 3), np.nan)
        ends.append(run_paper_filter(t, kind, z, velocity, PaperNoise(r_camera=1e9))[2][-1, 2])
        model = MODEL._replace(camera=1e3)
        ours.append(run_drift_filter(t, kind, z, model).p_std[-1, 0])
    assert ends[1] > 1.3 * ends[0]
    assert ours[1] == pytest.approx(ours[0], rel=0.05)


# --- the drift-aware -----------------------------------------------------------------------------


def simulate(seed: int, model: DriftModel, seconds: float = 40.0, turn: float = 0.0,
             scale: float = 1.0, rate: float = 100.0):  # fmt: skip
    """A camera of exactly the model's kind: times, kinds, measurements, truth."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate)
    p = np.stack([2.0 * np.sin(0.5 * t), 1.5 * np.cos(0.7 * t), 0.5 * np.sin(0.9 * t)], axis=1)
    v = np.gradient(p, t, axis=0)
    R = Rotation.from_euler("z", turn).as_matrix()
    felt = v @ R / scale  # R' v / s
    walk = rng.normal(size=p.shape) * model.walk_per_sqrt_s / math.sqrt(rate)
    a = p[0] + np.concatenate([[[0, 0, 0]], np.cumsum((felt / rate + walk)[:-1], axis=0)])
    a = a + model.camera * rng.normal(size=a.shape)
    kind = np.full(len(t), CAMERA)
    kind[:: int(rate / 10)] = STATION
    z = np.where((kind == STATION)[:, None], p + model.station * rng.normal(size=p.shape), a)
    return t, kind, z, p


def test_errors_are_those_that_the_filter_states():
    """Normalised squared errors of position over many runs: three, within what chance allows."""
    sizes = []
    for seed in range(40):
        t, kind, z, p = simulate(seed, MODEL)
        f = run_drift_filter(t, kind, z, MODEL)
        late = t > 10.0
        sizes.append(np.mean(np.sum(((f.p - p) / f.p_std)[late] ** 2, axis=1)))
    assert np.mean(sizes) == pytest.approx(3.0, rel=0.2)


def test_heading_and_scale_of_the_camera_are_found():
    model = MODEL._replace(rotation_0=0.2, scale_0=0.1)
    t, kind, z, _ = simulate(3, model, turn=0.08, scale=1.05)
    f = run_drift_filter(t, kind, z, model)
    assert f.turn[-1, 2] == pytest.approx(0.08, abs=0.01)
    assert f.scale[-1] == pytest.approx(1.05, abs=0.01)
    assert np.abs(f.turn[-1, :2]).max() < 0.01


def test_outliers_are_rejected_and_a_moved_station_is_believed():
    t, kind, z, p = simulate(5, MODEL)
    stations = np.flatnonzero(kind == STATION)
    wrong = stations[50::37]
    z[wrong] += [0.3, -0.2, 0.5]
    f = run_drift_filter(t, kind, z, MODEL)
    assert not f.accepted[wrong].any()
    assert np.linalg.norm(f.p - p, axis=1)[t > 5.0].max() < 0.03
    z[stations[200:]] += [0.5, 0.0, 0.0]  # the frame was set up anew: after five it is believed
    f = run_drift_filter(t, kind, z, MODEL)
    at = t > t[stations[200]] + 1.0
    assert np.linalg.norm(f.p - p - [0.5, 0, 0], axis=1)[at & (t < 25.0)].max() < 0.03


def test_a_jump_of_the_camera_is_no_motion():
    t, kind, z, p = simulate(6, MODEL)
    after = (t > 20.0) & (kind == CAMERA)
    z[after] += [0.03, -0.02, 0.01]
    out = (kind == STATION) & (t > 19.5) & (t < 21.0)  # nobody else saw it
    keep = ~out
    f = run_drift_filter(t[keep], kind[keep], z[keep], MODEL)
    k = int(np.searchsorted(f.t, 20.9))
    assert np.linalg.norm(f.p[k] - p[keep][k]) < 0.03
    assert np.count_nonzero(~f.accepted[f.kind == CAMERA]) == 1
    assert f.drift[k] - f.drift[k - 150] == pytest.approx([0.03, -0.02, 0.01], abs=0.03)


def test_only_the_station_or_only_the_camera():
    t, kind, z, p = simulate(7, MODEL, seconds=60.0)
    station = kind == STATION
    f = run_drift_filter(t[station], kind[station], z[station], MODEL)
    assert np.linalg.norm(f.p - p[station], axis=1)[50:].max() < 0.05
    keep = (kind == CAMERA) | (t < 20.0)
    f = run_drift_filter(t[keep], kind[keep], z[keep], MODEL)
    error = np.linalg.norm(f.p - p[keep], axis=1)
    assert np.all(np.isfinite(error))
    assert error[-1] < 4.0 * np.linalg.norm(f.p_std[-1])
    # the variance grows by the walk's, in each axis
    k = int(np.searchsorted(f.t, 21.0))
    grown = f.p_std[-1] ** 2 - f.p_std[k] ** 2
    assert np.all(grown >= 0.95 * MODEL.walk_per_sqrt_s**2 * (f.t[-1] - f.t[k]))


# --- the floor -----------------------------------------------------------------------------------


def test_floor_is_what_a_perfect_start_leaves():
    """Monte Carlo of the drift itself against the closed forms."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 13.0, 1301)
    p = np.stack([3.0 * np.sin(0.4 * t), 2.0 * np.cos(0.5 * t), 0.5 * np.sin(0.3 * t)], axis=1)
    step = np.diff(p, axis=0)
    ds, dt = np.linalg.norm(step, axis=1), np.diff(t)
    runs = 4000
    for walk in ({"walk_per_sqrt_s": 0.02}, {"walk_per_sqrt_m": 0.015}, {"yaw_walk": 0.0166},
                 {"scale_walk": 0.013}):  # fmt: skip
        name, value = next(iter(walk.items()))
        if name.startswith("walk"):
            size = value * np.sqrt(dt if name.endswith("s") else ds)
            ends = np.stack([(size * rng.normal(size=(runs, len(dt)))).sum(axis=1)
                             for _ in range(3)], axis=1)  # fmt: skip
        else:
            psi = np.cumsum(value * np.sqrt(dt) * rng.normal(size=(runs, len(dt))), axis=1)
            moved = step if name == "scale_walk" else np.cross([0.0, 0.0, 1.0], step)
            ends = psi @ moved
        rms = math.sqrt(np.mean(np.sum(ends**2, axis=1)))
        assert compute_drift_floor(t, p, **walk) == pytest.approx(rms, rel=0.04)
    both = compute_drift_floor(t, p, walk_per_sqrt_s=0.02, walk_per_sqrt_m=0.015)
    alone = compute_drift_floor(t, p, walk_per_sqrt_s=0.02)
    assert alone == pytest.approx(0.02 * math.sqrt(3 * 13.0))
    assert both > alone


# --- errors --------------------------------------------------------------------------------------


def path(seed: int = 0, n: int = 400) -> Trajectory:
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, 40, n))
    p = np.stack([np.sin(t / 3), np.cos(t / 4), 0.1 * t], axis=1)
    q = Rotation.from_euler("zyx", np.stack([t / 5, 0.1 * np.sin(t), 0 * t], axis=1)).as_quat()
    return Trajectory("path", t, p, np.roll(q, 1, axis=1))


@given(st.integers(0, 1000), st.floats(0.2, 5.0), st.floats(-100.0, 100.0))
def test_a_moved_copy_has_no_error(seed, scale, offset):
    a = path(seed)
    rot = Rotation.random(random_state=seed)
    q = np.roll((rot * Rotation.from_quat(np.roll(a.q, -1, 1))).as_quat(), 1, 1)
    b = a._replace(t=a.t + offset, p=scale * a.p @ rot.as_matrix().T + [1.0, 2.0, 3.0], q=q)
    e = compute_error(a, b, time_offset=offset, alignment="similarity")
    assert e.absolute.max < 1e-6 and e.relative is not None and e.relative.max < 1e-6
    assert e.frame is not None and e.frame.scale == pytest.approx(scale)
    assert e.relative_angle is not None and e.relative_angle.max < 1e-5


def test_a_fixed_mounting_costs_no_angle_and_a_spin_does():
    a = path()
    mount = Rotation.from_euler("xyz", [0.5, -0.3, 1.0])
    turned = Rotation.from_quat(np.roll(a.q, -1, 1)) * mount
    b = a._replace(q=np.roll(turned.as_quat(), 1, 1))
    assert compute_error(a, b, alignment="none").relative_angle.max < 1e-6
    still = a._replace(q=np.tile([1.0, 0.0, 0.0, 0.0], (len(a.t), 1)))
    spin = mount * Rotation.from_rotvec(np.outer(a.t, [0, 0, 0.02]))
    c = a._replace(q=np.roll(spin.as_quat(), 1, 1))
    assert compute_error(still, c, alignment="none").relative_angle.median == pytest.approx(
        0.02, 0.1
    )


def test_known_error():
    a = path()
    b = a._replace(p=a.p + [0.03, 0.0, 0.04])
    e = compute_error(a, b, alignment="none")
    assert e.absolute.rms == pytest.approx(0.05) == e.absolute.median
    assert e.relative is not None and e.relative.max < 1e-12
    assert compute_error(a, b).absolute.max < 1e-9
    with pytest.raises(InputError, match="does not overlap path in time"):
        compute_error(a, b, time_offset=1e4)
    with pytest.raises(InputError, match="valid: rigid, similarity, none"):
        compute_error(a, b, alignment="best")


def test_outages():
    t = np.concatenate([np.arange(0, 10, 0.1), np.arange(23, 30, 0.1)])
    found = find_outages(Trajectory("s", t, np.zeros((len(t), 3))), 0.0, 40.0)
    assert [round(a, 3) for o in found for a in o] == [9.9, 23.0, 29.9, 40.0]
