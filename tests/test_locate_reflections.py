"""Reflections: the station measures a false place of the prism for some samples in a row."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skywright.analysis.locate.locate import Fusion, bring_together, build_result
from skywright.models.localisation.calibration import Calibration, calibrate
from skywright.models.localisation.drift_filter import STATION
from skywright.models.localisation.drift_noise import CHANGE, EXCLUSION, GATE, find_outliers
from skywright.models.localisation.trajectory import Trajectory
from skywright.vehicle.sensor_flight import (
    CameraErrors,
    Flight,
    build_inspection_path,
    simulate_flight,
)

SEEDS = (2, 3, 4)
OUTAGE = (30.0, 42.0)  # s; one more until the station has found the prism


@cache
def fly(seed: int) -> Flight:
    return simulate_flight(
        build_inspection_path(seed, duration=60.0), seed, errors=CameraErrors(rate_hz=50.0),
        blocked=(OUTAGE,),
    )  # fmt: skip


def reflect(flight: Flight, place: str, n: int, size: float, seed: int) -> Trajectory:
    """The station's recording with n samples moved by `size` (m) in a direction of chance."""
    s = flight.station
    before, after = np.searchsorted(s.t, OUTAGE)
    first = {  # the camera has no sample at the first one of the station
        "before": before - n, "around": before - n // 2, "after": after, "within": after + 60,
        "start": 1, "end": len(s.t) - n,
    }[place]  # fmt: skip
    way = np.random.default_rng(100 + seed).normal(size=3)
    p = s.p.copy()
    p[first : first + n] += size * way / np.linalg.norm(way)
    return s._replace(p=p)


def process(station: Trajectory, flight: Flight) -> tuple[Fusion, float]:
    """Return the fusion, and the rms error (m) of its trajectory after the first 5 s."""
    f = bring_together(
        station, flight.camera, align="similarity", span=None, time_offset=None, lever=None,
        pose=None, notes=[],
    )  # fmt: skip
    found, _ = build_result(f, False)
    truth = [np.interp(found.t, flight.truth.t, flight.p_WP[:, i]) for i in range(3)]
    off = np.linalg.norm(found.p - np.stack(truth, axis=1), axis=1)[found.t > 5.0]
    return f, float(np.sqrt(np.mean(off**2)))


@cache
def process_clean(seed: int) -> tuple[Fusion, float]:
    return process(fly(seed).station, fly(seed))


def expect_same(c: Calibration, clean: Calibration) -> None:
    """The calibrations differ by no more than their standard deviations."""
    turn = Rotation.from_matrix(c.frame.rotation @ clean.frame.rotation.T).magnitude()
    assert turn < np.sqrt(3.0) * clean.rotation_std
    assert abs(c.frame.scale / clean.frame.scale - 1.0) < 1.5 * clean.scale_std
    assert abs(c.time_offset - clean.time_offset) < 1.5 * clean.offset_std
    assert np.linalg.norm(c.p_BP - clean.p_BP) < 0.08
    assert c.noise.station == pytest.approx(clean.noise.station, rel=0.2)


@pytest.mark.parametrize("size", [0.3, 1.0, 3.0])
@pytest.mark.parametrize(
    ("place", "n"),
    [
        ("after", 1), ("after", 3), ("after", 5), ("after", 10), ("before", 1), ("before", 5),
        ("around", 10), ("within", 5), ("within", 10), ("start", 3), ("end", 10),
    ],
)  # fmt: skip
def test_a_reflection_does_not_spoil_the_calibration(place, n, size):
    for seed in SEEDS:
        clean = process_clean(seed)[0].calibration
        c = calibrate(reflect(fly(seed), place, n, size, seed), fly(seed).camera, 0.0)
        assert n <= len(c.left_out) <= n + len(clean.left_out) + 1
        expect_same(c, clean)


@pytest.mark.parametrize(
    ("place", "n"), [("after", 1), ("after", 10), ("before", 5), ("within", 10), ("start", 3)]
)
def test_a_reflection_does_not_move_the_trajectory(place, n):
    for seed in SEEDS:
        usual = process_clean(seed)[1]
        f, rms = process(reflect(fly(seed), place, n, 1.0, seed), fly(seed))
        expect_same(f.calibration, process_clean(seed)[0].calibration)
        wrong = np.isin(f.events.t, f.calibration.left_out) & (f.events.kind == STATION)
        assert np.count_nonzero(wrong) >= n and not np.any(f.fused.accepted[wrong])
        assert rms < 1.3 * usual  # samples that are missing beside an outage make it longer


@pytest.mark.parametrize("size", [1.0, 3.0])
def test_a_reflection_that_lasts_for_seconds_does_not_spoil_the_calibration(size):
    for seed in SEEDS:
        station = reflect(fly(seed), "after", 50, size, seed)
        c = calibrate(station, fly(seed).camera, 0.0)
        assert len(c.left_out) < 3  # a change, and a change back
        expect_same(c, process_clean(seed)[0].calibration)


def test_scattered_reflections_after_an_outage_are_left_out():
    for seed in SEEDS:
        flight = fly(seed)
        after = int(np.searchsorted(flight.station.t, OUTAGE[1]))
        p = flight.station.p.copy()
        p[after : after + 60] += np.random.default_rng(seed).normal(size=(60, 3))
        c = calibrate(flight.station._replace(p=p), flight.camera, 0.0)
        assert 57 <= len(c.left_out) <= 62
        expect_same(c, process_clean(seed)[0].calibration)


def test_a_station_that_was_set_up_anew_is_no_reflection():
    """The frame changes for good by 0.5 m; the rotation keeps what both parts tell of it."""
    for seed in SEEDS:
        flight = fly(seed)
        p = flight.station.p.copy()
        p[200:, 0] += 0.5
        c = calibrate(flight.station._replace(p=p), flight.camera, 0.0)
        assert len(c.left_out) < 3
        expect_same(c, process_clean(seed)[0].calibration)


# --- the rule -------------------------------------------------------------------------------------


def test_the_chain_kept_is_the_cheapest_of_all():
    """Against every subset of nine samples."""
    rng = np.random.default_rng(1)
    n, white, skip = 9, 1.0, EXCLUSION * GATE
    for case in range(25):
        walk = rng.uniform(0.0, 4.0, n)
        r = np.cumsum(np.sqrt(walk)[:, None] * rng.normal(size=(n, 3)), axis=0)
        first = rng.integers(0, n)
        r[first : first + rng.integers(1, 4)] += rng.uniform(0.0, 30.0) * rng.normal(size=3)
        at = np.cumsum(walk)

        def price(kept: np.ndarray, r: np.ndarray = r, at: np.ndarray = at) -> float:
            step = np.sum(np.diff(r[kept], axis=0) ** 2, axis=1)
            size = step / (2.0 * white**2 + np.diff(at[kept]))
            return float(np.sum(np.minimum(size, CHANGE * skip)) + skip * (n - np.sum(kept)))

        every = (np.array(mask) for mask in product((False, True), repeat=n))
        best = min(price(mask) for mask in every if mask.any())
        out, change = find_outliers(r, white, walk, GATE)
        assert price(out == 0.0) == pytest.approx(best), case
        assert not np.any(change[out > 0.0])


@pytest.mark.parametrize(("white", "walk"), [(2e-3, 0.0), (2e-3, 2e-3), (5e-4, 5e-3)])
def test_a_valid_sample_is_left_out_less_than_once_in_ten_thousand(white, walk):
    rng = np.random.default_rng(0)
    n = 200_000
    r = np.cumsum(walk * rng.normal(size=(n, 3)), axis=0) + white * rng.normal(size=(n, 3))
    out, change = find_outliers(r, white, np.full(n, walk**2), GATE)
    assert np.mean(out) < 1.1e-4
    assert not np.any(change)
