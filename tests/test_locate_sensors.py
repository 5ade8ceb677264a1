"""Total station, tracking camera and range finder: what they do is what they are said to."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skywright.models.range_finder import (
    RANGE_BLOCK,
    RangePrecision,
    build_range_finder,
    step_range_finder,
)
from skywright.models.total_station import StationPrecision
from skywright.models.tracking_camera import CameraErrors
from skywright.vehicle.sensor_flight import Path, build_inspection_path, simulate_flight

EXACT = CameraErrors(
    scale=1.0, walk_m_per_sqrt_m=0.0, yaw_rate_deg_per_min=0.0, noise_std_m=0.0, jump_std_m=0.0
)


@pytest.fixture(scope="module")
def path() -> Path:
    return build_inspection_path(3, duration=120.0, speed=0.6)


def hover(seconds: float, at: tuple[float, float, float]) -> Path:
    t = np.arange(0.0, seconds, 0.005)
    return Path(t, np.tile(at, (len(t), 1)), np.tile(np.eye(3), (len(t), 1, 1)))


def at(path: Path, t: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(t, path.t, p[:, i]) for i in range(3)], axis=1)


def test_a_path_is_a_rigid_motion_at_the_asked_speed(path):
    assert path.R_WB @ np.swapaxes(path.R_WB, 1, 2) == pytest.approx(
        np.tile(np.eye(3), (len(path.t), 1, 1)), abs=1e-9
    )
    length = np.sum(np.linalg.norm(np.diff(path.p_WB, axis=0), axis=1))
    assert length / path.t[-1] == pytest.approx(0.6, rel=0.15)


def test_station_is_irregular_late_and_precise(path):
    s = StationPrecision()
    flight = simulate_flight(path, 1, precision=s, arrival_stamps=True)
    interval = np.diff(simulate_flight(path, 1, precision=s).station.t)
    assert interval.min() >= 1.0 / s.rate_max_hz - 1e-9
    assert 1.0 / interval.mean() == pytest.approx(s.rate_mean_hz, rel=0.1)
    assert interval.std() > 0.02
    assert flight.station_delay == pytest.approx(s.latency_mean_s, abs=0.02)
    seen = simulate_flight(path, 1, precision=s).station
    off = seen.p - at(path, seen.t, path.p_WB + path.R_WB @ flight.prism)
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) == pytest.approx(
        math.sqrt(s.range_std_m**2 + 2 * s.pointing_std_m**2), rel=0.1
    )


def test_noise_lies_along_and_across_the_line_of_sight():
    p_WS = np.array([-30.0, -10.0, 0.0])
    where = (5.0, 4.0, 12.0)
    s = StationPrecision(range_std_m=5e-3, pointing_std_m=1e-3, angle_std_rad=1e-4)
    seen = simulate_flight(hover(200.0, where), 2, precision=s, station_at=p_WS,
                           prism=np.zeros(3)).station  # fmt: skip
    sight = np.array(where) - p_WS
    distance = np.linalg.norm(sight)
    off = seen.p - where
    along = off @ sight / distance
    assert np.std(along) == pytest.approx(5e-3, rel=0.1)
    across = np.sqrt(np.mean(np.sum(off**2, axis=1) - along**2) / 2)
    assert across == pytest.approx(math.hypot(1e-3, 1e-4 * distance), rel=0.1)


def test_out_of_sight_nothing_is_measured_until_it_locks_on_again(path):
    s = StationPrecision(relock_s=1.5)
    seen = simulate_flight(path, 4, precision=s, blocked=((20.0, 25.0), (60.0, 60.3))).station
    for start, stop in ((20.0, 26.5), (60.0, 61.8)):
        assert not np.any((seen.t > start + 0.01) & (seen.t < stop - 0.01))
    assert np.any((seen.t > 26.5) & (seen.t < 27.2))


def test_an_exact_camera_is_the_truth_in_another_frame(path):
    flight = simulate_flight(path, 5, errors=EXACT)
    c = flight.camera
    assert c.rate == pytest.approx(200.0)
    back = c.p @ flight.R_CW  # R_CW transposed, times p
    assert back == pytest.approx(at(path, c.t, path.p_WB - path.p_WB[0]), abs=1e-9)
    assert c.q is not None
    turn = Rotation.from_quat(np.roll(c.q[-1], -1)).as_matrix()
    assert turn == pytest.approx(flight.R_CW @ path.R_WB[len(c.t) - 1], abs=1e-9)


def test_scale_heading_and_walk_of_the_camera(path):
    e = EXACT._replace(scale=0.9)
    flight = simulate_flight(path, 5, errors=e)
    size = np.linalg.norm(np.diff(flight.camera.p, axis=0), axis=1).sum()
    true = np.linalg.norm(np.diff(path.p_WB, axis=0), axis=1).sum()
    assert size / true == pytest.approx(0.9, rel=1e-6)

    flight = simulate_flight(path, 5, errors=EXACT._replace(yaw_rate_deg_per_min=30.0))
    assert flight.camera.q is not None
    last = Rotation.from_quat(np.roll(flight.camera.q[-1], -1)).as_matrix()
    drift = Rotation.from_matrix(flight.R_CW.T @ last @ path.R_WB[-1].T).as_rotvec()
    assert np.degrees(drift) == pytest.approx([0, 0, 30.0 * path.t[-1] / 60.0], abs=0.1)

    ends = []
    for seed in range(30):
        short = Path(path.t[:4001], path.p_WB[:4001], path.R_WB[:4001])
        f = simulate_flight(short, seed, errors=EXACT._replace(walk_m_per_sqrt_m=0.015))
        ends.append((f.camera.p[-1] @ f.R_CW) - (short.p_WB[-1] - short.p_WB[0]))
    length = np.linalg.norm(np.diff(path.p_WB[:4001], axis=0), axis=1).sum()
    assert np.std(ends) == pytest.approx(0.015 * math.sqrt(length), rel=0.25)


def test_a_camera_at_rest_does_not_drift_but_may_jump():
    still = hover(100.0, (0.0, 0.0, 1.0))
    assert np.ptp(simulate_flight(still, 6, errors=EXACT._replace(walk_m_per_sqrt_m=0.015)).camera.p
                  ) < 1e-12  # fmt: skip
    e = EXACT._replace(jump_interval_s=10.0, jump_std_m=0.02)
    step = np.linalg.norm(np.diff(simulate_flight(still, 6, errors=e).camera.p, axis=0), axis=1)
    jumps = step[step > 1e-9]
    assert 3 <= len(jumps) <= 25 and 0.005 < np.median(jumps) < 0.08


def test_same_seed_same_data_and_streams_do_not_mix(path):
    a, b = simulate_flight(path, 7), simulate_flight(path, 7)
    assert np.array_equal(a.station.p, b.station.p) and np.array_equal(a.camera.p, b.camera.p)
    c = simulate_flight(path, 7, precision=StationPrecision(rate_mean_hz=5.0))
    assert np.array_equal(a.camera.p, c.camera.p)
    assert not np.array_equal(a.camera.p, simulate_flight(path, 8).camera.p)


def test_range_finder():
    s = RangePrecision()
    rf = build_range_finder(np.random.default_rng(0), s)[0]
    seen, stamps = [], []
    for k in range(20 * 20 * 10):  # 20 s at 200 Hz
        t = 0.005 * k
        step_range_finder(rf, t, 3.0 if t < 19.0 else math.inf)
        if rf["fresh"]:
            stamps.append(t)
            seen.append(float(rf["distance"]) if rf["valid"] else math.nan)
    assert np.diff(stamps) == pytest.approx(np.full(len(stamps) - 1, 0.05), abs=1e-9)
    values = np.array(seen)
    known = values[~np.isnan(values)]
    assert np.isnan(values[-10:]).all() and len(known) >= 379
    assert known / s.resolution_m == pytest.approx(np.round(known / s.resolution_m), abs=1e-6)
    assert known.mean() == pytest.approx(3.0 + float(rf["bias"]), abs=0.01)
    assert np.std(known) == pytest.approx(math.hypot(s.noise_std_m, s.resolution_m / 3.46), rel=0.2)
    assert rf["index"] < RANGE_BLOCK
    step_range_finder(rf, 1e3, s.range_min_m / 2)
    assert rf["fresh"] and not rf["valid"] and rf["distance"] == 0.0
