"""Welds on scans that cover more than half of the pipe: seams and their opposite side, girths."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from skywright.core.arrays import Array
from skywright.description.world.spec import Weld
from skywright.description.world.surface import (
    Cylinder,
    build_weld_curve,
    find_middle,
    roll_points,
    wrap,
)
from skywright.inspection.calibration import Calibration
from skywright.inspection.crossings import count_passes
from skywright.inspection.weld import WeldResult, process_scan
from skywright.inspection.weld_line import WeldLine, compute_line_error, estimate_weld_line

R = 0.2
PIPE = Cylinder(np.zeros(3), np.eye(3), R, 2.0)
CALIBRATION = Calibration(0j, 1 + 0j, 60.0, (0.0, 0.0, 0.0), 0.1, 15.0, 1.4)
ROWS = (-0.1, -0.05, 0.0, 0.05, 0.1)
Path = list[tuple[float, float]]  # s (m) and phi (deg)


def scan(path: Path, *welds: Weld, speed: float = 0.04, noise: float = 2e-4) -> WeldResult:
    """Scan along straight lines between the points of a path; the signal is a ridge 8 mm wide."""
    rng, parts = np.random.default_rng(0), []
    for (s0, f0), (s1, f1) in pairwise(path):
        count = max(int(math.hypot(s1 - s0, R * math.radians(f1 - f0)) / speed * 100), 2)
        parts.append(np.column_stack([np.linspace(s0, s1, count), np.linspace(f0, f1, count)]))
    s, c = np.concatenate(parts).T * [[1.0], [R * math.pi / 180]]
    d = np.min([np.abs(build_weld_curve(w, R).measure_distance(s, c)) for w in welds], axis=0)
    ec_noise = rng.normal(size=s.size) + 1j * rng.normal(size=s.size)
    signal = 8j * np.exp(-((d / 0.004) ** 2)) + 0.1 * ec_noise
    p = roll_points(PIPE, s, c)[0] + noise * rng.normal(size=(s.size, 3))
    return process_scan(0.01 * np.arange(s.size), signal, p, PIPE, CALIBRATION)


def turn_back(low: float, high: float) -> Path:
    """Return a path around the pipe from `low` to `high` (deg) and back, row by row."""
    return [(s, f) for i, s in enumerate(ROWS) for f in ((low, high), (high, low))[i % 2]]


def run_along(half: float) -> Path:
    """Return a path of six passes along the pipe, all around it."""
    return [
        (sign * half, f)
        for i, f in enumerate((0, 60, 120, 180, 240, 300))
        for sign in ((-1, 1), (1, -1))[i % 2]
    ]


def seam(phi: float) -> Weld:
    return Weld(angle_deg=90.0, offset_m=0.0, around_deg=phi)


GIRTH, OBLIQUE = Weld(angle_deg=0.0, offset_m=0.0), Weld(angle_deg=40.0, offset_m=0.0)


@pytest.mark.parametrize(
    ("path", "welds", "counts"),
    [
        (turn_back(-150, 150), (seam(-60),), (5,)),
        (turn_back(-150, 150), (seam(-90), seam(90)), (5, 5)),
        (turn_back(-150, 150), (seam(-60), seam(60)), (5, 5)),
        (turn_back(-130, 130), (seam(-60), seam(60)), (5, 5)),
        (turn_back(-100, 100), (seam(-60), seam(60)), (5, 5)),
        (turn_back(0, 200), (seam(60), seam(150)), (5, 5)),
        (turn_back(-150, 150), (seam(-120), seam(0), seam(120)), (5, 5, 5)),
        (
            [*turn_back(-150, 150), (0.1, -60), (0.12, -60), (0.12, -120)],
            (seam(90), seam(-90)), (6, 6),
        ),
        (turn_back(-200, 200), (seam(180),), (10,)),
        (run_along(0.1), (GIRTH,), (6,)),
        (run_along(0.3), (OBLIQUE,), (6,)),
        ([*run_along(0.1), (0.1, 330), (0.04, 330), (0.04, -30)], (GIRTH, seam(90)), (7, 2)),
    ],
)  # fmt: skip
def test_each_weld_is_one_line(
    path: Path, welds: tuple[Weld, ...], counts: tuple[int, ...]
) -> None:
    found = scan(path, *welds)
    assert len(found.lines) == len(welds), found.notes
    assert all(x.line >= 0 for x in found.crossings)
    left = list(welds)
    for k, line in enumerate(found.lines):
        errors = [compute_line_error(line, weld, R) for weld in left]
        nearest = int(np.argmin([abs(offset) + abs(angle) for offset, angle in errors]))
        offset, angle = errors[nearest]
        assert abs(offset) < 5e-4 and abs(math.degrees(angle)) < 1.5, (line, welds)
        assert len(found.list_crossings(k)) == counts[welds.index(left.pop(nearest))]
        s, c = line.follow(np.linspace(-0.05, 0.05, 9))
        assert np.max(np.abs(line.measure_distance(s, c))) < 1e-12 or not line.is_seam


@pytest.mark.parametrize("passes", [5, 9])
@pytest.mark.parametrize("noise", [1e-4, 3e-4, 1e-3])
def test_a_pass_on_the_cut_of_the_unrolled_pipe_is_one_pass(passes: int, noise: float) -> None:
    """Passes along the pipe, the first one repeated after a turn; one is at 180 deg, on the cut."""
    around = np.linspace(0.0, 360.0, passes).tolist()
    path = [(s, f) for i, f in enumerate(around) for s in ((-0.1, 0.1), (0.1, -0.1))[i % 2]]
    found = scan(path, GIRTH, noise=noise)
    assert len(found.list_crossings(0)) == len(found.crossings) == passes
    assert not any(x.one_sided for x in found.crossings) and not found.notes
    # the cut is in the largest gap: the places of contact on the unrolled pipe have no other jump
    c = np.sort(found.c[found.contact])
    assert np.max(np.diff(c)) < R * math.radians(360.0 / (passes - 1)) + 0.01
    assert np.ptp(c) < R * math.radians(361.0)
    assert np.ptp([x.c for x in found.crossings]) < np.ptp(c)


@pytest.mark.parametrize("phi", [-160.0, 120.0])
def test_a_seam_is_crossed_once_wherever_the_pipe_is_cut(phi: float) -> None:
    """Passes over 400 deg, whose mean is at 20 deg: a seam at 200 deg is opposite to it."""
    path = [
        (s, f)
        for i, s in enumerate(np.linspace(-0.1, 0.1, 6).tolist())
        for f in ((0.0, 400.0), (400.0, 0.0))[i % 2]
    ]
    found = scan(path, seam(phi))
    assert len(found.list_crossings(0)) == len(found.crossings) == 6
    assert not any(x.one_sided for x in found.crossings)
    assert found.lines[0].std_offset < 5e-5
    assert abs(compute_line_error(found.lines[0], seam(phi), R)[0]) < 1.5e-4


@pytest.mark.parametrize("turns", [-3.0, 0.0, 2.0])
def test_the_cut_lies_in_the_largest_gap(turns: float) -> None:
    """Places from -100 to 200 deg, most of them at one end: their middle is not their mean."""
    phi = np.radians([*np.linspace(-100.0, -90.0, 50), *np.linspace(-60.0, 200.0, 7)])
    middle = find_middle(wrap(R * phi, R) + turns * 2.0 * math.pi * R, R)
    assert middle == pytest.approx(R * math.radians(50.0))
    assert np.argmin(wrap(R * phi, R, middle)) == 0
    assert find_middle(R * phi, math.inf) == find_middle(phi[:0], R) == 0.0


def measure_line(angle: float = 90.0) -> WeldLine:
    return WeldLine(0.0, 0.1, math.radians(angle), 1e-4, 1e-3, 0.0, 0.01, (), 0.0, R, True)


def test_points_of_a_seam_a_turn_away_are_beside_the_same_place() -> None:
    line = measure_line(85.0)._replace(radius=0.2)
    turn = 2.0 * math.pi * 0.2
    s, c = line.follow(np.array([-0.3, 0.0, 0.4]))
    np.testing.assert_allclose(line.find_ways(s, c + [turn, -turn, 0.0]), [-0.3, 0.0, 0.4])


def test_the_opposite_side_is_half_a_turn_from_a_seam() -> None:
    line, half = measure_line(), math.pi * R
    assert abs(line.measure_distance(0.3, 0.1 + half - 0.02)) == pytest.approx(half - 0.02)
    assert line.measure_distance(0.3, 0.1 + 2 * half) == pytest.approx(0.0, abs=1e-12)
    assert line.measure_distance(0.0, 0.15) == pytest.approx(-line.measure_distance(0.0, 0.05))
    # 5 deg oblique: a step along the line changes nothing
    steep = measure_line(85.0)
    assert steep.measure_distance(*steep.follow(np.array([-0.1, 0.2]))) == pytest.approx(0.0)


@pytest.mark.parametrize(("low", "high", "passes"), [(-40, 100, 1), (60, 330, 0), (-170, 190, 1)])
def test_a_path_over_the_opposite_side_is_no_pass(low: float, high: float, passes: int) -> None:
    """The seam is at 28.6 deg; its opposite side, at 208.6 deg, is not it."""
    c = R * np.radians(np.linspace(low, high, 2000))
    assert count_passes(measure_line(), 0.0 * c, c, np.ones(c.size, bool)) == passes
    kept = np.abs(c - 0.1) > 0.05  # contact lost at the seam
    assert count_passes(measure_line(), 0.0 * c, c, kept) == passes


@pytest.mark.parametrize("place", [0.0, 1.2, 1.57, 3.1, -3.1])
@pytest.mark.parametrize("angle", [88.0, 90.0, -87.0])
def test_a_seam_anywhere_is_fitted_among_crossings_of_another(place: float, angle: float) -> None:
    """Seven crossings at `place` (rad), five of a seam on the opposite side, with noise."""
    rng, radians = np.random.default_rng(2), math.radians(angle)
    s = np.concatenate([np.linspace(-0.1, 0.1, 7), np.linspace(-0.1, 0.1, 5)])
    c = R * place + s / math.tan(radians) + R * math.pi * (np.arange(12) >= 7)
    c = (
        np.remainder(c + 2e-4 * rng.standard_normal(12) + math.pi * R, 2 * math.pi * R)
        - math.pi * R
    )
    v: Array = 0.05 * (-1.0) ** np.arange(12)
    line = estimate_weld_line(s, c, 0 * v, v, np.full(12, 2e-4), radius=R)
    assert line is not None and line.is_seam and line.inliers == tuple(range(7))
    at = R * place + line.s / math.tan(radians)
    assert math.remainder(line.c - at, 2 * math.pi * R) == pytest.approx(0.0, abs=3e-4)
    assert abs(math.remainder(line.angle - radians, math.pi)) < math.radians(0.3)
