"""Recordings that `locate` must not trust: repeated samples, lines, other clocks, other frames."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skywright.analysis.locate.fusion import (
    build_model,
    describe_jumps,
    fuse,
    prepare_camera,
)
from skywright.analysis.locate.locate import bring_together
from skywright.analysis.locate.reach import process
from skywright.errors import InputError
from skywright.models.localisation.calibration import calibrate
from skywright.models.localisation.drift_filter import CAMERA
from skywright.models.localisation.drift_noise import compute_weight
from skywright.models.localisation.frame_alignment import UNKNOWN_ROTATION, diagnose_geometry
from skywright.models.localisation.time_alignment import estimate_offset
from skywright.models.localisation.trajectory import Trajectory, drop_repeats
from skywright.vehicle.sensor_flight import (
    Flight,
    build_inspection_path,
    build_path,
    simulate_flight,
)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return simulate_flight(build_inspection_path(3, duration=60.0, speed=0.6), 3)


def hold(camera: Trajectory, n: int) -> Trajectory:
    """A file that repeats every n-th sample until the next one."""
    assert camera.q is not None
    k = np.arange(len(camera.t)) // n * n
    return camera._replace(p=camera.p[k], q=camera.q[k])


# --- outages --------------------------------------------------------------------------------------


def find_outage(flight: Flight, station: Trajectory, notes: list[str]) -> list[float | None]:
    """Errors at the end of the first outage, calibrated over the first 38 s."""
    found = bring_together(
        station, flight.camera, align="similarity", span=(0.0, 38.0), time_offset=0.0, lever=None,
        pose=None, notes=notes,
    )  # fmt: skip
    return list(found.outages[0][2:])


def test_errors_after_an_outage_are_measured_from_an_accepted_sample(flight):
    """The robot moves on while the filter rejects two reflections 1 m off."""
    t = flight.station.t
    keep = (t < 40.0) | (t > 48.0)
    station, notes = flight.station._replace(t=t[keep], p=flight.station.p[keep]), list[str]()
    plain = find_outage(flight, station, notes)
    assert all(error is not None and 0.005 < error < 0.3 for error in plain)
    p, k = station.p.copy(), int(np.argmax(station.t > 48.0))
    p[k : k + 2, 0] += 1.0
    assert find_outage(flight, station._replace(p=p), notes) == pytest.approx(plain, abs=0.02)
    assert "after the outage" not in " ".join(notes)
    # no sample of the station is accepted before the next outage
    alone = (station.t < 48.0) | (station.t == station.t[k]) | (station.t > 52.0)
    lonely = station._replace(t=station.t[alone], p=p[alone])
    assert find_outage(flight, lonely, notes) == [None, None, None]
    assert "no measurement of the station was accepted after the outage from " in notes[-1]


# --- repeated samples -----------------------------------------------------------------------------


def test_repeated_samples_are_no_measurements(flight):
    held, notes = hold(flight.camera, 10), []
    new = prepare_camera(held, notes)
    assert len(new.t) == pytest.approx(len(held.t) / 10, abs=1)
    assert new.t == pytest.approx(flight.camera.t[::10]) and "repeat the previous one" in notes[0]
    assert prepare_camera(flight.camera, notes) is not None and len(notes) == 1
    c = calibrate(flight.station, new, 0.0)
    events, fused, model = fuse(flight.station, new, c)
    assert model.camera > 3.0 * build_model(held, c).camera  # the floor, without noise
    truth = np.stack(
        [np.interp(events.t - flight.station_delay, flight.truth.t, x) for x in flight.p_WP.T],
        axis=1,
    )
    error = np.linalg.norm(fused.p - truth, axis=1)[events.t > 5.0]
    assert math.sqrt(np.mean(error**2)) < 0.01
    assert describe_jumps(fused) == []
    _, wrong, _ = fuse(flight.station, held, c)
    assert "as jumps" in describe_jumps(wrong)[0]


def test_a_turn_alone_is_a_measurement(flight):
    camera = flight.camera
    still = camera._replace(p=np.ones_like(camera.p))
    assert len(drop_repeats(still).t) == len(still.t)
    with pytest.raises(InputError, match="have the same position"):
        prepare_camera(still._replace(q=None), [])


def test_a_camera_that_is_too_slow_is_refused_with_the_units(flight):
    with pytest.raises(InputError, match=r"interval of the camera is 5 s.*t_ms, t_us or t_ns"):
        prepare_camera(flight.camera._replace(t=1e3 * flight.camera.t), [])


# --- lines ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("direction", "method", "open_axes"),
    [
        ("x", "similarity", 1), ("x", "rigid", 1), ("x", "level", 0), ("z", "similarity", 1),
        ("z", "level", 1),
    ],
)  # fmt: skip
def test_a_line_leaves_the_rotation_about_it_open(direction, method, open_axes):
    line = np.random.default_rng(0).normal(size=(100, 3)) * [1.0, 0.001, 0.001]
    found = diagnose_geometry(line[:, [2, 1, 0]] if direction == "z" else line, 0.005, method)
    assert found.kind == "linear" and len(found.open_axes) == open_axes
    assert bool(found.note) == bool(open_axes)
    assert ("--align level" in found.note) == (direction == "x" and open_axes == 1)
    still = diagnose_geometry(0.001 * line, 0.005, method)
    assert len(still.open_axes) == (1 if method == "level" else 3)


def fly_aside(seed: int, blocked: tuple[tuple[float, float], ...]) -> Flight:
    """42 s along x, then 3 m along y."""
    t = np.arange(0.0, 70.0, 3.0)
    x = 2.0 * np.sin(0.3 * np.minimum(t, 42.0))
    y = 3.0 * np.clip((t - 57.0) / 9.0, 0.0, 1.0)
    points = np.column_stack([x, y, 1.0 + 0.0 * t])
    return simulate_flight(build_path(points, t, 0.0 * t), seed, blocked=blocked)


def test_motion_across_the_line_of_a_calibration_is_stated_as_unknown():
    """With an angle uniform over a turn, a displacement d is wrong by sqrt(2) d rms."""
    ratio = []
    for seed in range(1, 4):
        e = process(fly_aside(seed, ((54.0, 1e9),)), calibrated=40.0)
        assert e.calibration.rotation_std == UNKNOWN_ROTATION
        assert e.calibration.fitted_std < math.radians(5.0)
        std = float(np.linalg.norm(e.fused.p_std[-1]))
        assert std == pytest.approx(3.0 * math.sqrt(2.0), rel=0.05)
        along = (e.t > 20.0) & (e.t < 54.0) & (e.events.kind == CAMERA)
        assert np.median(np.linalg.norm(e.fused.p_std[along], axis=1)) < 0.01
        ratio.append(e.error(e.fused.p)[-1] / std)
    assert max(ratio) < 2.0  # the largest error is 2 d


# --- clocks ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("duration", "ahead"), [(30.0, 10.0), (60.0, 20.0), (80.0, 7.0)])
def test_clocks_that_differ_by_seconds(duration, ahead):
    for seed in (1, 2, 3):
        path = build_inspection_path(seed, duration=duration, speed=0.6)
        f = simulate_flight(path, seed, station_clock=ahead)
        found = estimate_offset(f.station, f.camera)
        assert found.offset == pytest.approx(-ahead, abs=0.1)
        assert not found.common_clock and "the clocks differ by" in found.note


def move(t: np.ndarray, x: np.ndarray, name: str) -> Trajectory:
    return Trajectory(name, t, np.stack([x, 0.0 * x, 0.0 * x], axis=1))


def test_doubtful_delays_have_a_note(flight):
    assert estimate_offset(flight.station, flight.camera).note == ""
    t = np.arange(0.0, 60.0, 0.05)
    periodic = move(t, 2.0 * np.sin(0.5 * t), "a")
    assert "agree at several offsets" in estimate_offset(periodic, periodic).note
    rng = np.random.default_rng(0)
    speed = np.abs(np.convolve(rng.normal(size=len(t)), np.ones(40) / 6.0, "same"))
    other = np.abs(np.convolve(rng.normal(size=len(t)), np.ones(40) / 6.0, "same"))
    both = move(t, 0.05 * np.cumsum(speed), "a"), move(t, 0.05 * np.cumsum(speed + other), "b")
    found = estimate_offset(*both)
    assert found.offset == pytest.approx(0.0, abs=0.1) and 0.5 < found.peak < 0.8
    assert "is doubtful" in found.note


# --- frames ---------------------------------------------------------------------------------------


def test_a_mirrored_camera_is_refused(flight):
    mirrored = flight.camera._replace(p=flight.camera.p * [1.0, -1.0, 1.0])
    with pytest.raises(InputError, match="the camera's frame is left-handed"):
        calibrate(flight.station, mirrored, 0.0)


def test_a_camera_of_another_motion_has_a_note(flight):
    other = simulate_flight(build_inspection_path(8, duration=60.0, speed=0.6), 8).camera
    c = calibrate(flight.station, other, 0.0)
    assert any("check units, axes" in note for note in c.notes)
    assert not any("check units" in n for n in calibrate(flight.station, flight.camera, 0.0).notes)


# --- long recordings ------------------------------------------------------------------------------


def test_weight_is_the_trace_of_the_inverse_covariance():
    rng = np.random.default_rng(1)
    n, white = 40, 0.003
    walk = 1e-5 * rng.uniform(0.1, 2.0, n)
    outlier = (rng.uniform(size=n) < 0.2).astype(float)
    level = np.cumsum(walk)
    covariance = np.minimum.outer(level, level) + white**2 * np.eye(n)
    good = outlier == 0.0
    expected = np.trace(np.linalg.inv(covariance[np.ix_(good, good)]))
    assert compute_weight(white, walk, outlier) == pytest.approx(expected, rel=1e-9)


def test_rotation_error_of_a_line_is_within_its_deviation():
    t = np.arange(0.0, 60.0, 3.0)
    points = np.column_stack([2.0 * np.sin(0.3 * t), 0.0 * t, 1.0 + 0.0 * t])
    f = simulate_flight(build_path(points, t, 0.0 * t), 2)
    c = calibrate(f.station, f.camera, 0.0)
    off = Rotation.from_matrix(c.frame.rotation @ f.R_CW).magnitude()
    assert off < 2.0 * c.rotation_std
