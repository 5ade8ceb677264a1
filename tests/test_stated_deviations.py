"""What filters state of their position holds: in flight and in outages, over several flights.

One flight tells little: its errors last for seconds and an outage has one drift. So ratios of the
errors to the stated deviations are judged over all flights of a kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from skywright.analysis.locate import blind, fusion, reach
from skywright.core.record import View
from skywright.description.loader import load_description
from skywright.evidence.stated_deviations import BEAR, HIDDEN, Silence
from skywright.models.localisation.drift_filter import CAMERA, STATION, DriftModel
from skywright.models.tracking_camera import CameraErrors
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.estimators._strapdown import head_covariance
from skywright.vehicle.estimators.filter import LEAST_NOISE, Filter, fuse
from skywright.vehicle.readings import MocapSample
from skywright.vehicle.sensors.mocap import MotionCapture


class Watch(Silence):
    """Compares what the filter states with its covariance."""

    off = 0.0

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        """Silence the sensor; compare the stated deviations with the covariance brought to now."""
        super().on_tick(t, phase, vehicle)
        flt = vehicle.read_memory("estimator")
        if t > 3.0 and round(50 * t) % 77 == 0:  # at any phase of the silence
            P = np.empty((15, 15))
            head_covariance(View(flt), vehicle.world.gravity_mps2, P)
            exact, told = np.sqrt(np.diag(P)[:3]), vehicle.read(EstimatorState)["p_std"]
            self.off = max(self.off, float(np.max(np.abs(told / exact - 1.0))))


def fly(robot: str | None, sets: Sequence[str], quiet: float, late: float) -> tuple[float, float]:
    """Return rms of error over stated deviation with a localisation and `late` (s) without it."""
    squares: dict[bool, list[float]] = {False: [], True: []}
    for seed in range(1, 4):
        watch = Watch(MotionCapture.Me, "mocap", quiet, 5.0)
        d = load_description("waypoints", robot, sets=sets, seed=seed)
        r = fly_and_evaluate(d, observers=[watch])
        assert r.outcome == "succeeded"
        assert watch.off < 0.03  # in closed form as by integration
        s = r.samples[(r.samples["rotor_thrust"].sum(axis=1) > 0.5) & (r.samples["t"] > 3.0)]
        over = np.mean(((s["est_p_WB"] - s["p_WB"]) / s["p_std"]) ** 2, axis=1)
        for out in (False, True):
            squares[out].append(float(np.mean(over[(s["fix_age"] > late) == out])))
        assert r.metrics["estimate.sigmas"] == pytest.approx(np.sqrt(np.mean(over)), rel=0.1)
    flight, outage = (float(np.sqrt(np.mean(squares[out]))) for out in (False, True))
    return flight, outage


def test_with_a_station_that_is_hidden_now_and_then() -> None:
    flight, outage = fly("f550-bridge", HIDDEN, quiet=0.0, late=0.6)
    assert 0.85 < flight < 1.15
    assert 0.75 < outage < 1.2


def test_with_motion_capture_that_is_silent_now_and_then() -> None:
    flight, outage = fly(None, BEAR, quiet=1.5, late=0.25)
    assert 0.85 < flight < 1.15
    assert 0.75 < outage < 1.2


@pytest.mark.parametrize("factor", [0.6, 1.0, 1.6])
def test_the_filter_learns_the_noise_of_motion_capture(factor: float) -> None:
    """At rest, from a data sheet that is wrong: 4 s of samples tell the noise to a few per cent."""
    rng = np.random.default_rng(2)
    f, sample = np.zeros(1, Filter.Me.dtype)[0], np.zeros(1, MocapSample.dtype)[0]
    f["r_p"], f["r_R"], f["R_f"] = 3e-4**2, 2e-3**2, np.eye(3)
    f["P"] = np.diag([1e-9] * 15)
    for _ in range(1200):
        f["P"] += np.diag([1e-11] * 3 + [0.0] * 3 + [1e-9] * 3 + [0.0] * 6)
        f["p_f"] += np.sqrt(1e-11) * rng.standard_normal(3)  # the truth stays at zero
        sample["p_WB"] = factor * 3e-4 * rng.standard_normal(3)
        turn = factor * 2e-3 * rng.standard_normal(3)
        sample["R_WB"] = np.eye(3) + np.cross(np.eye(3), turn) * -1.0
        f["fused"] += int(fuse(View(f), View(sample)))
    assert np.sqrt(f["r_p"]) / 3e-4 == pytest.approx(factor, rel=0.08)
    assert np.sqrt(f["r_R"]) / 2e-3 == pytest.approx(factor, rel=0.08)


def test_a_perfect_sensor_leaves_something_to_weigh() -> None:
    f, sample = np.zeros(1, Filter.Me.dtype)[0], np.zeros(1, MocapSample.dtype)[0]
    f["r_p"] = f["r_R"] = LEAST_NOISE
    f["R_f"], f["P"] = np.eye(3), np.diag([1e-6] * 15)
    sample["R_WB"] = np.eye(3)
    assert fuse(View(f), View(sample))
    assert f["r_p"] == f["r_R"] == LEAST_NOISE


def test_slow_errors_of_satellites_are_stated() -> None:
    """What no filter sees is in what it states: never less than the receiver's drift."""
    d = load_description("waypoints", sets=["world.localisation=gnss"])
    e = d.world.gnss.errors
    s = fly_and_evaluate(d).samples
    stated = s["p_std"][s["t"] > 3.0]
    assert np.all(stated[:, :2] > e.drift_level_m) and np.all(stated[:, 2] > e.drift_up_m)
    assert np.median(stated[:, 2]) < 1.3 * e.drift_up_m


# --- recordings -----------------------------------------------------------------------------------


def test_hidden_stretches_lie_where_the_station_was_there() -> None:
    first, second = blind.choose_windows(0.0, 80.0, [(60.0, 73.0)])
    spans = sorted(first + second)
    long = spans[0][1] - spans[0][0]
    assert long == pytest.approx(67.0 / 7.0) and len(spans) == 5
    assert all(b <= 60.0 + 1e-9 or a >= 73.0 for a, b in spans)
    for windows in (first, second):  # as long with the station before each
        starts = [0.0, *(b for _, b in windows)]
        assert all(a - start >= long - 1e-9 for start, (a, _) in zip(starts, windows, strict=False))
    assert blind.choose_windows(0.0, 80.0, []) == []
    assert blind.choose_windows(0.0, 5.0, [(1.0, 4.0)]) == []


@pytest.mark.parametrize("true", [0.005, 0.05])
def test_drift_is_scaled_up_to_what_hidden_stretches_show(true: float) -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 200.0, 0.05)
    kind = np.where(np.arange(len(t)) % 2 == 0, CAMERA, STATION)
    seen = (kind == CAMERA) | (t < 150.0) | (t > 160.0)
    drift = np.cumsum(true * np.sqrt(0.05) * rng.standard_normal((len(t), 3)), axis=0)
    z = np.where((kind == CAMERA)[:, None], drift, 0.0) + 1e-3 * rng.standard_normal((len(t), 3))
    model = DriftModel(station=1e-3, camera=1e-3, walk_per_sqrt_s=0.01, walk_per_sqrt_m=0.0)
    scaled = blind.scale_drift(t[seen], kind[seen], z[seen], [(150.0, 160.0)], model)
    if true < 0.01:
        assert scaled == model  # never smaller
    else:
        assert 0.6 * true < scaled.walk_per_sqrt_s < 1.6 * true
        ratio = scaled.yaw / model.yaw
        assert ratio == pytest.approx(scaled.walk_per_sqrt_s / model.walk_per_sqrt_s)


def test_outages_of_a_recording_whose_camera_turns_more_than_it_shows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A heading that walks by 0.6 deg per sqrt(s), which the calibration does not show."""
    camera = CameraErrors(
        walk_m_per_sqrt_m=0.003, yaw_rate_deg_per_min=0.0, yaw_walk_deg_per_sqrt_s=0.6
    )

    def measure() -> float:
        found = reach.measure_outage.__wrapped__(6, camera)
        return float(np.sqrt(np.mean((found.fused / found.predicted) ** 2)))

    after = measure()
    monkeypatch.setattr(fusion, "scale_drift", lambda t, kind, z, outages, model: model)
    before = measure()
    assert before > 1.5
    assert after < 1.4 and after < 0.85 * before
