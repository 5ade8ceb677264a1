"""Calibration, crossings and the weld line on simulated scans, and contact quality."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.signal import lfilter

from skywright.description.world.spec import Pipe, Weld
from skywright.description.world.surface import (
    Cylinder,
    build_cylinder,
    build_weld_curve,
    roll_points,
    unroll_points,
)
from skywright.errors import InputError
from skywright.inspection.calibration import (
    Calibration,
    build_calibration,
    compute_components,
    load_calibration,
    save_calibration,
)
from skywright.inspection.contact_quality import compute_contact_map
from skywright.inspection.surface_fit import (
    build_surface,
    fit_cylinder,
)
from skywright.inspection.weld import WeldResult, process_scan
from skywright.inspection.weld_line import compute_line_error, estimate_weld_line
from skywright.models.eddy_current import build_probe_signal, ec_signal
from skywright.reports.figures.style import new_figure
from skywright.reports.weld_map import draw_weld_signal, write_weld_map

APPROACH = 6.0  # s
RATE = 50.0  # Hz


class Fake(NamedTuple):
    """A raster scan flown without a robot: tip wander, tilt, chatter and noisy motion capture."""

    t: np.ndarray
    ec: np.ndarray
    p: np.ndarray
    cylinder: Cylinder
    s: np.ndarray  # true
    c: np.ndarray
    gap: np.ndarray
    tilt: np.ndarray


@njit
def readings(ps, s, c, gap, tilt, noise):
    out = np.empty((s.size, 2))
    for i in range(s.size):
        out[i, 0], out[i, 1] = ec_signal(ps, s[i], c[i], gap[i], tilt[i], noise[i, 0], noise[i, 1])
    return out


RADIUS = Pipe().diameter_m / 2


def fly_scan(
    seed: int,
    weld: Weld | None = None,
    *,
    passes: int = 4,
    speed: float = 0.008,
    lag: float = 0.008,
    around: bool = False,
    noise: float = 3e-4,
    touch: tuple[float, float] | None = None,
) -> Fake:
    """`touch`: (s, c) of the calibration's approach, where it is not the start of the scan."""
    rng = np.random.default_rng(seed)
    pipe = Pipe(yaw_deg=30.0, inclination_deg=12.0)
    ps, cylinder = (
        build_probe_signal(pipe, [weld] if weld and weld.present else [], rng),
        build_cylinder(pipe),
    )
    ends = [
        (-0.1, x) if i % 2 == 0 else (0.1, x)
        for i, x in enumerate(np.linspace(-0.07, 0.07, passes))
    ]
    path = np.array([q for s, c in ends for q in ((s, c), (-s, c))])
    path = path[:, ::-1] if around else path
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    t = np.arange(0, APPROACH + length[-1] / speed, 1 / RATE)
    u = np.clip(t - APPROACH, 0, None) * speed

    def wander(std: float, time: float) -> np.ndarray:
        a = math.exp(-1 / (time * RATE))
        return std * lfilter([math.sqrt(1 - a * a)], [1, -a], rng.standard_normal(t.size))

    s = np.interp(u, length, path[:, 0]) + wander(0.002, 2.0)
    c = np.interp(u, length, path[:, 1]) + wander(0.002, 2.0)
    if touch is not None:
        early = t < APPROACH
        s[early] += touch[0] - path[0, 0]
        c[early] += touch[1] - path[0, 1]
    gap = np.clip(0.04 - 0.01 * t, 0, None) + np.abs(wander(2e-5, 0.05))
    tilt = np.abs(math.radians(2) + wander(math.radians(1.2), 1.0))
    ec = readings(ps, s, c, gap, tilt, rng.standard_normal((t.size, 2)))
    phi, r = c / cylinder.radius, cylinder.radius + gap
    local = np.stack([-r * np.cos(phi), s, r * np.sin(phi)], axis=1)
    p = cylinder.p_WP + local @ cylinder.R_WP.T
    p = np.stack([np.interp(t - lag, t, x) for x in p.T], axis=1)
    p += noise * rng.standard_normal(p.shape)
    return Fake(t, ec, p, cylinder, s, c, gap, tilt)


def process(fake: Fake, **kw) -> WeldResult:
    kw = {"lift_off_threshold": 15.0, "weld_threshold": 1.4, **kw}
    cal = build_calibration(fake.ec[fake.t < APPROACH], **kw)
    return process_scan(fake.t, fake.ec, fake.p, fake.cylinder, cal, exclude=(0, APPROACH))


def test_calibration_finds_axis_curve_and_noise() -> None:
    fake = fly_scan(1, Weld())
    cal = build_calibration(fake.ec[fake.t < APPROACH])
    assert math.degrees(np.angle(cal.lift_off_axis)) == pytest.approx(160.0, abs=2.0)
    assert cal.excursion == pytest.approx(60.0, abs=3.0)
    assert 0.02 < cal.noise < 0.5
    assert cal.lift_off_threshold == pytest.approx(0.25 * cal.excursion)
    assert 1.0 < cal.weld_threshold < 3.0
    # the bend of the lift-off curve (4 units) is taken out near contact, where welds are sought
    lift_off, weld = compute_components(fake.ec[fake.t < APPROACH], cal)
    near = np.abs(lift_off) < 25.0
    assert np.max(weld[near]) < 0.9


def test_threshold_is_capped_by_the_curve_at_one_millimetre() -> None:
    fake = fly_scan(1)
    early = fake.t < APPROACH
    loose = build_calibration(fake.ec[early], gap=fake.gap[early])
    # a wide coil: half the sensitivity, so that 1 mm comes before 25 %
    tight = build_calibration(fake.ec[early], gap=6.0 * fake.gap[early])
    assert loose.lift_off_threshold == pytest.approx(0.25 * loose.excursion)
    assert tight.lift_off_threshold < loose.lift_off_threshold


@pytest.mark.parametrize("angle", [-30.0, 0.0, 10.0, 30.0])
def test_default_scan_meets_the_requirements(angle: float) -> None:
    weld = Weld(angle_deg=angle, offset_m=0.01)
    for seed in range(3):
        result = process(fly_scan(seed, weld))
        assert len(result.crossings) == 4 and all(x.line == 0 for x in result.crossings)
        assert result.line is not None
        offset, error = compute_line_error(result.line, weld, RADIUS)
        assert abs(offset) < 1e-3 and abs(math.degrees(error)) < 0.6
        assert result.contact_fraction > 0.95
        # PCA and change of basis: the weld's own direction, tens of degrees off the lift-off
        axis = result.calibration.weld_axis
        assert axis is not None
        turn = axis * result.calibration.lift_off_axis.conjugate()
        assert 30 < abs(math.degrees(np.angle(turn))) < 80


@pytest.mark.parametrize("angle", [86.0, 89.9, 90.0])
def test_a_seam_along_the_axis_has_a_small_lean(angle: float) -> None:
    rng = np.random.default_rng(3)
    s, slope = np.sort(rng.uniform(-0.1, 0.1, 9)), 1.0 / math.tan(math.radians(angle))
    c = 0.05 + s * slope + 2e-4 * rng.standard_normal(9)
    line = estimate_weld_line(s, c, np.zeros(9), np.full(9, 0.02), np.full(9, 5e-4), radius=0.2)
    assert line is not None
    assert abs(math.degrees(line.angle)) == pytest.approx(angle, abs=0.5)
    assert abs(line.lean) < 0.01
    assert np.max(np.abs(line.measure_distance(s, c))) < 1e-3


@pytest.mark.parametrize("angle", [60.0, 88.0, 90.0, -89.0])
def test_steep_welds_and_seams_along_the_axis(angle: float) -> None:
    weld = Weld(angle_deg=angle, offset_m=0.0)
    result = process(fly_scan(2, weld, around=True))
    assert result.line is not None and len(result.crossings) >= 4
    offset, error = compute_line_error(result.line, weld, RADIUS)
    assert abs(offset) < 1e-3 and abs(math.degrees(error)) < 0.6
    assert -math.pi / 2 < result.line.angle <= math.pi / 2


def test_uncertainty_is_honest_over_seeds() -> None:
    weld = Weld(angle_deg=-20.0)
    z = []
    for seed in range(24):
        line = process(fly_scan(100 + seed, weld, speed=0.015)).line
        assert line is not None
        offset, error = compute_line_error(line, weld, RADIUS)
        z.append((offset / line.std_offset, error / line.std_angle))
        assert line.std_offset < 1e-3 and line.std_angle < math.radians(0.6)
    scale = np.sqrt(np.mean(np.square(z), axis=0))
    assert np.all(scale < 1.4) and np.all(scale > 0.15)  # neither boastful nor useless
    assert np.mean(np.abs(z) < 2) > 0.9


def test_line_estimator_covers_its_errors_on_drawn_crossings() -> None:
    rng = np.random.default_rng(0)
    z, std = [], 5e-4
    for _ in range(300):
        angle = rng.uniform(-math.pi / 2, math.pi / 2)
        u = np.linspace(-0.07, 0.07, 5)
        n = np.array([math.cos(angle), -math.sin(angle)])  # (s, c)
        s, c = u * math.sin(angle) + 0.02, u * math.cos(angle) - 0.01
        e = std * rng.standard_normal(5)
        sign = np.array([1, -1, 1, -1, 1.0]) * 0.01
        line = estimate_weld_line(
            s + e * n[0], c + e * n[1], sign * n[0], sign * n[1], np.full(5, std)
        )
        assert line is not None
        truth = math.cos(angle) * (line.s - 0.02) - math.sin(angle) * (line.c + 0.01)
        z.append(
            (truth / line.std_offset, math.remainder(line.angle - angle, math.pi) / line.std_angle)
        )
    assert np.allclose(np.std(z, axis=0), 1.0, atol=0.2)


def test_a_lag_cancels_between_opposite_passes_and_is_estimated() -> None:
    weld = Weld(angle_deg=0.0)
    result = process(fly_scan(3, weld, lag=0.12, speed=0.03, passes=8))
    line = result.line
    assert line is not None
    # the measured position is late, so the signal leads it
    assert line.lag == pytest.approx(-0.12, abs=4 * line.std_lag) and line.std_lag < 0.02
    assert abs(compute_line_error(line, weld, RADIUS)[0]) < 3 * line.std_offset


def test_one_way_passes_admit_the_lag_they_cannot_see() -> None:
    u = np.linspace(-0.06, 0.06, 4)
    std, zero = np.full(4, 2e-4), np.zeros(4)
    one = estimate_weld_line(zero, u, np.full(4, 0.05), zero, std)
    both = estimate_weld_line(zero, u, np.array([1, -1, 1, -1]) * 0.05, zero, std)
    assert one is not None and both is not None
    assert one.std_offset > 1e-3 > 5e-4 > both.std_offset
    file = estimate_weld_line(zero, u, np.full(4, 0.05), zero, std, lag_std=0.1)
    assert file is not None and file.std_offset == pytest.approx(5e-3, rel=0.05)


@pytest.mark.parametrize("lag", [-0.55, -0.2, 0.0, 0.1, 0.5])
def test_a_large_lag_is_found_where_it_is_not_known(lag: float) -> None:
    """Crossings up to 11 mm either side of the weld, a false one among them."""
    u = np.linspace(-0.06, 0.06, 7)
    v = 0.02 * np.array([1, -1, 1, -1, 1, -1, 1])
    noise = 1e-4 * np.random.default_rng(1).standard_normal(7)
    s = 0.01 + 0.3 * u + lag * v + noise
    s[2] += 0.03
    line = estimate_weld_line(s, u, v, 0 * v, np.full(7, 2e-4), lag_std=0.1)
    assert line is not None and line.inliers == (0, 1, 3, 4, 5, 6)
    assert line.lag == pytest.approx(lag, abs=4 * line.std_lag) and line.std_lag < 0.02
    assert abs(line.s - 0.01 - 0.3 * line.c) < 4 * line.std_offset < 1e-3


@settings(max_examples=60)
@given(
    st.floats(-1.5, 1.5),
    st.floats(-0.1, 0.1),
    st.floats(-0.1, 0.1),
    st.integers(0, 5),
    st.floats(0.02, 0.08),
)
def test_a_false_crossing_is_left_out(
    angle: float, s0: float, c0: float, where: int, off: float
) -> None:
    u = np.array([-0.07, -0.04, -0.01, 0.03, 0.05, 0.075])
    s, c = s0 + u * math.sin(angle), c0 + u * math.cos(angle)
    s[where] += off * math.cos(angle)
    c[where] -= off * math.sin(angle)
    line = estimate_weld_line(s, c, np.zeros(6), np.zeros(6), np.full(6, 3e-4))
    assert line is not None and where not in line.inliers
    good = [i for i in range(6) if i != where]
    assert np.all(np.abs(line.measure_distance(s[good], c[good])) < 1e-6)
    assert abs(math.remainder(line.angle - angle, math.pi)) < 1e-6


@pytest.mark.parametrize(("share", "faint"), [(0.55, True), (1.0, False)])
def test_a_faint_weld_is_told_with_its_signal_and_the_threshold(share: float, faint: bool) -> None:
    weld = Weld(conductivity_change=-0.1 * share, permeability_change=-0.35 * share)
    result = process(fly_scan(3, weld))
    told = [note for note in result.notes if "crossings can be missed" in note]
    assert result.line is not None and result.level == pytest.approx(1.4, abs=0.15)
    peak = float(np.median([x.peak for x in result.list_crossings(0)]))
    assert result.contrasts == pytest.approx((peak / result.level,))
    if faint:
        assert told == [
            f"the signal of the weld is {peak:.2g} units, {peak / result.level:.1f} times the "
            f"detection threshold of {result.level:.2g} units: below 2 times, crossings can be "
            "missed"
        ]
    else:
        assert not told and result.contrasts[0] > 3.0


def test_no_weld_no_line() -> None:
    for seed in range(6):
        result = process(fly_scan(seed, None))
        assert result.line is None and len(result.crossings) == 0


@pytest.mark.parametrize(("around", "angle"), [(0.0, 25.0), (60.0, 20.0), (-90.0, -15.0)])
def test_a_plane_s_cut_is_found_wherever_it_is_steepest(around: float, angle: float) -> None:
    """Points of a plane in space, on a wide arc, with noise: none falls off the line."""
    rng, z = np.random.default_rng(4), []
    slope, turn = math.tan(math.radians(angle)), math.radians(around)
    for _ in range(40):
        phi = np.repeat(np.linspace(-0.9, 0.9, 7), 2)
        s = 0.02 + RADIUS * slope * np.sin(phi - turn) + 2e-4 * rng.standard_normal(14)
        v = np.tile([0.05, -0.05], 7)
        line = estimate_weld_line(s, RADIUS * phi, v, 0 * v, np.full(14, 2e-4), radius=RADIUS)
        assert line is not None and len(line.inliers) == 14
        weld = Weld(angle_deg=angle, offset_m=0.02, around_deg=around)
        offset, error = compute_line_error(line, weld, RADIUS)
        assert abs(offset) < 2e-3 and abs(math.degrees(error)) < 1.0
        z.append((offset / line.std_offset, error / line.std_angle))
    assert np.all(np.sqrt(np.mean(np.square(z), axis=0)) < 2.0)


def test_a_weld_closes_behind_the_pipe() -> None:
    for angle, around in ((20.0, 0.0), (-50.0, 40.0), (90.0, 170.0)):
        curve = build_weld_curve(Weld(angle_deg=angle, around_deg=around), RADIUS)
        back = math.pi * RADIUS
        for s in (-0.05, 0.0, 0.1):
            one, two = curve.measure_distance(s, back), curve.measure_distance(s, -back)
            assert one == pytest.approx(float(two), abs=1e-12)
        s, c = curve.follow(1.0, 101)
        assert np.max(np.abs(curve.measure_distance(s, c))) < 1e-12
        flat = curve.touch(0.01)
        if angle < 90.0:  # the touching line has the curve's direction
            h = 1e-6
            rise = float(curve.place(flat.c + h) - curve.place(flat.c - h)) / (2 * h)
            assert math.tan(flat.angle) == pytest.approx(rise, rel=1e-6)


def test_one_crossing_gives_no_angle() -> None:
    result = process(fly_scan(0, Weld(angle_deg=0.0), passes=1))
    assert len(result.crossings) == 1 and result.line is None
    assert any("one crossing" in note for note in result.notes)


def test_following_the_weld_is_one_crossing_with_a_wide_line() -> None:
    weld = Weld(angle_deg=90.0, offset_m=0.07)
    fake = fly_scan(5, weld, passes=2)  # the second pass runs on the seam
    result = process(fake)
    assert result.line is not None
    offset, error = compute_line_error(result.line, weld, RADIUS)
    assert result.line.std_offset > 1e-3  # half the weld's width, not the count of samples
    assert abs(offset) < 3 * result.line.std_offset and abs(error) < 3 * result.line.std_angle


@pytest.mark.parametrize("angle", [0.0, 20.0, -30.0])
def test_a_calibration_on_the_weld_is_moved_to_the_base_metal(angle: float) -> None:
    weld = Weld(angle_deg=angle, offset_m=0.01)
    for seed in range(3):
        result = process(fly_scan(seed, weld, touch=(0.01, 0.0)))
        assert any("taken as base metal" in note for note in result.notes)
        assert result.line is not None and len(result.crossings) == 4
        offset, error = compute_line_error(result.line, weld, RADIUS)
        assert abs(offset) < 1e-3 and abs(math.degrees(error)) < 0.6
        assert np.mean(result.on_weld[result.contact]) < 0.15
        clean = process(fly_scan(seed, weld))
        a, b = result.calibration.weld_axis, clean.calibration.weld_axis
        # the weld's own direction, not its opposite
        assert a is not None and b is not None and (a * b.conjugate()).real > 0.9
        assert not any("base metal" in note for note in clean.notes)


def test_a_calibration_on_the_flank_of_the_weld_does_no_harm() -> None:
    weld = Weld(angle_deg=10.0, offset_m=0.01)
    for off in (-0.009, -0.0075, -0.006, -0.004, 0.003, 0.005, 0.007):
        line = process(fly_scan(4, weld, touch=(0.01 + off, 0.0))).line
        assert line is not None
        offset, error = compute_line_error(line, weld, RADIUS)
        assert abs(offset) < 4 * line.std_offset and abs(error) < 4 * line.std_angle


def test_no_line_where_either_metal_may_be_the_base() -> None:
    # one pass on a seam after a touch beside it reads like one on base metal after a touch on it
    seam, away = Weld(angle_deg=90.0, offset_m=-0.07), (0.0, 0.0)
    fake = fly_scan(0, seam, passes=1, touch=away)
    result = process(fake)
    assert result.line is None and not result.crossings and not result.on_weld.any()
    assert any("base metal and weld cannot be distinguished" in note for note in result.notes)
    # a known weld axis tells them apart
    axis = process(fly_scan(0, Weld())).calibration.weld_axis
    known = process(fake, weld_axis=axis)
    assert any("follows the weld" in note for note in known.notes) and known.line is not None
    offset, error = compute_line_error(known.line, seam, RADIUS)
    assert abs(offset) < 3 * known.line.std_offset and abs(error) < 3 * known.line.std_angle


def test_crossings_at_the_ends_of_the_passes_are_admitted_uncertain() -> None:
    z, several = [], 0
    for seed in range(24):
        rng = np.random.default_rng(seed)
        side = float(rng.choice([-1.0, 1.0]))
        weld = Weld(
            angle_deg=float(rng.uniform(-35, 35)), offset_m=side * float(rng.uniform(0.06, 0.105))
        )
        result = process(fly_scan(200 + seed, weld, speed=0.02))
        cut = [x for x in result.crossings if x.one_sided]
        assert all(x.std >= 0.005 for x in cut)
        assert bool(cut) == any("turn back or end on the weld" in x for x in result.notes)
        several += bool(cut)
        if result.line is not None:
            offset, error = compute_line_error(result.line, weld, RADIUS)
            z.append((offset / result.line.std_offset, error / result.line.std_angle))
    assert several >= 6 and len(z) > 12
    assert np.max(np.abs(z)) < 4.0 and np.all(np.sqrt(np.mean(np.square(z), axis=0)) < 1.6)


def test_a_crossing_that_the_end_of_contact_cuts_off_is_admitted_uncertain() -> None:
    weld = Weld(angle_deg=0.0, offset_m=0.0)
    fake = fly_scan(7, weld)
    whole = process(fake)
    assert not any(x.one_sided for x in whole.crossings)
    # the record begins on the weld: half of the first crossing is missing
    first = whole.crossings[0].t
    late = (fake.t < APPROACH) | (fake.t > first)
    part = Fake(
        fake.t[late], fake.ec[late], fake.p[late], fake.cylinder, *(x[late] for x in fake[4:])
    )
    result = process(part)
    assert [x.one_sided for x in result.crossings] == [True, False, False, False]
    assert result.line is not None
    offset, error = compute_line_error(result.line, weld, RADIUS)
    assert abs(offset) < 3 * result.line.std_offset and abs(error) < 3 * result.line.std_angle


def test_a_line_that_a_refinement_loses_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    from skywright.inspection import crossings as module

    calls = []

    def lose(*columns: np.ndarray, **known: float) -> object:
        calls.append(len(calls))
        return estimate_weld_line(*columns, **known) if len(calls) == 1 else None

    monkeypatch.setattr(module, "estimate_weld_line", lose)
    result = process(fly_scan(0, Weld()))
    assert len(calls) == 2 and result.line is None
    assert any("too close together" in note for note in result.notes)


def test_nan_samples_are_left_out() -> None:
    fake = fly_scan(0, Weld())
    ec, p = fake.ec.copy(), fake.p.copy()
    ec[1000:1010], p[2000:2020] = np.nan, np.nan
    a, b = process(fake), process(fake._replace(ec=ec, p=p))
    assert b.line is not None and a.line is not None
    assert b.line.angle == pytest.approx(a.line.angle, abs=2e-3)
    assert not b.contact[1005] and not b.contact[2005]


def test_scan_arrays_that_do_not_fit_are_refused() -> None:
    fake = fly_scan(0, passes=1)
    cal = build_calibration(fake.ec[fake.t < APPROACH])
    with pytest.raises(InputError, match="shape"):
        process_scan(fake.t[:-1], fake.ec, fake.p, fake.cylinder, cal)
    with pytest.raises(InputError, match="backwards"):
        process_scan(fake.t[::-1], fake.ec, fake.p, fake.cylinder, cal)


@pytest.mark.parametrize("case", ["few", "constant", "contact only", "noise", "nan"])
def test_calibration_refuses_what_is_no_approach(case: str) -> None:
    rng = np.random.default_rng(0)
    fake = fly_scan(0, passes=1)
    ec = {
        "few": fake.ec[:10],
        "constant": np.ones((100, 2)),
        "contact only": np.full((200, 2), 3.0) + 0.05 * rng.standard_normal((200, 2)),
        "noise": rng.standard_normal((200, 2)),
        "nan": np.full((100, 2), np.nan),
    }[case]
    with pytest.raises(InputError, match="calibration"):
        build_calibration(ec)


UNIT = st.floats(0, 2 * math.pi).map(lambda a: complex(math.cos(a), math.sin(a)))
SIZE = st.floats(1e-3, 1e6)


@settings(max_examples=50)
@given(
    st.complex_numbers(max_magnitude=1e6, allow_nan=False),
    UNIT,
    SIZE,
    SIZE,
    st.booleans(),
    st.sampled_from(["toml", "json"]),
)
def test_calibration_survives_its_file(
    tmp_path_factory: pytest.TempPathFactory,
    contact: complex,
    axis: complex,
    excursion: float,
    threshold: float,
    has_weld: bool,
    kind: str,
) -> None:
    weld_axis = axis * 1j if has_weld else None
    cal = Calibration(contact, axis, excursion, (0.1, 0.0, -1e-5), 0.2, threshold, 1.4, weld_axis)
    path = tmp_path_factory.mktemp("cal") / f"c.{kind}"
    save_calibration(cal, path)
    assert load_calibration(path) == cal


@settings(max_examples=60)
@given(
    st.floats(-50, 50),
    st.floats(-20, 20),
    UNIT,
    st.floats(0.2, math.pi - 0.2),
    st.sampled_from([-1, 1]),
)
def test_components_invert_the_oblique_basis(
    lift_off: float, weld: float, axis: complex, turn: float, side: int
) -> None:
    e_w = axis * complex(math.cos(turn), side * math.sin(turn))
    cal = Calibration(3 + 4j, axis, 60.0, (0.0, 0.0, 0.0), 0.1, 15.0, 1.4, e_w)
    found = compute_components(np.array([3 + 4j + lift_off * axis + weld * e_w]), cal)
    assert found[0][0] == pytest.approx(lift_off, abs=1e-9)
    assert found[1][0] == pytest.approx(weld, abs=1e-9)


@settings(max_examples=40)
@given(
    st.floats(0.05, 2.0),
    st.floats(-math.pi, math.pi),
    st.floats(-1.5, 1.5),
    st.floats(-1, 1),
    st.floats(-1, 1),
)
def test_unroll_and_roll_are_inverse(
    radius: float, yaw: float, inclination: float, s: float, c_share: float
) -> None:
    axis = np.array(
        [
            math.cos(inclination) * math.cos(yaw),
            math.cos(inclination) * math.sin(yaw),
            math.sin(inclination),
        ]
    )
    origin = np.array([1.0, -2.0, 3.0])
    p0 = origin + radius * np.cross(axis, [0.3, 0.5, -0.8])
    cylinder = build_surface(origin, axis, radius, p0[None])
    assert np.linalg.det(cylinder.R_WP) == pytest.approx(1.0)
    c = 0.99 * math.pi * radius * c_share
    found = unroll_points(cylinder, roll_points(cylinder, s, c)[0])
    assert [x[0] for x in found] == pytest.approx([s, c, 0.0], abs=1e-9)
    assert unroll_points(cylinder, p0[None])[1][0] == pytest.approx(0.0, abs=1e-9)


def test_cylinder_fit_is_right_and_says_how_well_it_knows() -> None:
    errors = []
    for seed in range(12):
        fake = fly_scan(seed, passes=4, speed=0.02)
        touch = fake.gap < 2e-4
        fit = fit_cylinder(fake.p[touch])
        errors.append((fit.cylinder.radius - 0.2) / fit.std_radius)
        assert abs(fit.cylinder.radius - 0.2) < 0.004
        assert abs(fit.cylinder.R_WP[:, 1] @ fake.cylinder.R_WP[:, 1]) > math.cos(0.02)
        assert fit.rms == pytest.approx(3e-4, rel=0.3)
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 2.0


def test_a_narrow_sector_is_known_less_well_or_refused() -> None:
    rng = np.random.default_rng(1)
    std = []
    for half in (40, 20, 10):
        phi = np.radians(rng.uniform(-half, half, 400))
        p = np.stack([0.2 * np.cos(phi), rng.uniform(-0.1, 0.1, 400), 0.2 * np.sin(phi)], axis=1)
        std.append(fit_cylinder(p + 3e-4 * rng.standard_normal(p.shape)).std_radius)
    assert std[0] * 2 < std[1] and std[1] * 2 < std[2]
    flat = np.concatenate([rng.uniform(-0.1, 0.1, (400, 2)), np.zeros((400, 1))], axis=1)
    with pytest.raises(InputError, match="--surface"):
        fit_cylinder(flat + 3e-4 * rng.standard_normal(flat.shape))
    with pytest.raises(InputError, match="--surface"):
        fit_cylinder(np.zeros((100, 3)))


def test_contact_map_keeps_the_worst_of_each_cell() -> None:
    s, c = np.array([0.001, 0.002, 0.011, np.nan]), np.array([0.001, 0.001, 0.001, 0.0])
    x = np.array([1e-4, 3e-4, 2e-4, 9.0])
    found = compute_contact_map(s, c, x, 2 * x, 3 * x, cell=0.01)
    assert found.gap.shape == (2, 1) and found.samples.ravel().tolist() == [2, 1]
    assert found.gap.ravel() == pytest.approx([3e-4, 2e-4])
    assert found.tilt.ravel() == pytest.approx([6e-4, 4e-4])
    with pytest.raises(InputError):
        compute_contact_map(s * np.nan, c, x, x, x)


def test_lift_off_is_visible_beside_the_weld_signal() -> None:
    """Between crossings both are near 0; the lift-off is drawn last, since it has less noise."""
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 20.0, 4000)
    fields: Any = {
        "t": t, "lift_off": 0.05 * rng.standard_normal(4000), "contact": np.ones(4000, bool),
        "weld": 0.1 * rng.standard_normal(4000), "crossings": (),
        "calibration": SimpleNamespace(lift_off_threshold=15.0, weld_threshold=1.0),
    }  # fmt: skip
    figure = new_figure(9.6, 2.0)
    ax = figure.add_subplot()
    draw_weld_signal(ax, SimpleNamespace(**fields))  # type: ignore[arg-type]
    ax.set_title("")
    figure.canvas.draw()
    red, green, blue, _ = np.asarray(figure.canvas.buffer_rgba(), float).transpose(2, 0, 1)  # type: ignore[attr-defined]
    is_blue = (blue > 1.4 * red) & (blue > 1.2 * green)
    columns = is_blue.any(axis=0)
    assert np.count_nonzero(columns) > 0.7 * len(columns)


def test_picture_is_written_with_and_without_a_line(tmp_path: Path) -> None:
    for weld in (Weld(), None):
        fake = fly_scan(0, weld, passes=2, speed=0.03)
        write_weld_map(
            process(fake), tmp_path / "map.png", ec=fake.ec, truth=[weld] if weld else []
        )
        assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="cannot be written"):
        write_weld_map(process(fake), tmp_path / "none" / "map.png", ec=fake.ec)
    with pytest.raises(InputError, match="format"):
        write_weld_map(process(fake), tmp_path / "map.xyz", ec=fake.ec)
