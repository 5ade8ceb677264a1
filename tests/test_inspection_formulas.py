"""The formulas of the inspection by themselves, on inputs with a known answer.

The runs of test_weld.py show that a weld is found; a term that matters little there is seen here.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from skywright.description.world.surface import Cylinder, roll_points
from skywright.inspection import surface_fit, weld, weld_data, weld_line
from skywright.inspection.calibration import Calibration
from skywright.inspection.crossings import Crossing

RNG = np.random.default_rng(3)
PIPE = Cylinder(np.zeros(3), np.eye(3), 0.2, 0.5)


def test_the_circle_fit_is_exact_on_a_circle() -> None:
    angle = np.linspace(0.2, 1.9, 30)
    found = surface_fit._fit_circle(3.0 + 0.7 * np.cos(angle), -2.0 + 0.7 * np.sin(angle))
    assert found == pytest.approx((3.0, -2.0, 0.7), abs=1e-9)


def test_the_starts_of_the_cylinder_fit_are_directions_of_a_hemisphere() -> None:
    p = RNG.normal(size=(40, 3))
    starts = surface_fit._start_candidates(p, count=150)
    axes = np.array([axis for _, axis, _, _ in starts])
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1.0, atol=1e-12)
    assert np.all(axes[:, 2] > 0.0)
    # an even spread: no direction is further than 15 deg from one of them
    for way in RNG.normal(size=(200, 3)):
        assert np.max(np.abs(axes @ way) / np.linalg.norm(way)) > math.cos(math.radians(15.0))


def test_a_surface_that_is_seen_all_around_has_a_frame_of_its_own() -> None:
    axis = np.array([0.3, 0.9, 0.2])
    angle = np.linspace(0.0, 2.0 * math.pi, 41)[:-1]
    u, v = surface_fit._plane_basis(axis / np.linalg.norm(axis))
    p = 0.2 * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
    R = surface_fit.build_surface(np.zeros(3), axis, 0.2, p).R_WP
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_the_fitted_cylinder_begins_at_the_middle_of_its_points() -> None:
    axis = np.array([0.0, math.cos(0.3), math.sin(0.3)])
    u, v = surface_fit._plane_basis(axis)
    angle, along = RNG.uniform(-1.0, 1.0, 400), RNG.uniform(2.0, 2.6, 400)
    p = 0.2 * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v) + np.outer(along, axis)
    found = surface_fit.fit_cylinder(p + 1e-4 * RNG.normal(size=p.shape)).cylinder
    assert found.p_WP @ axis == pytest.approx(float(np.mean(p @ axis)), abs=1e-3)
    assert found.radius == pytest.approx(0.2, abs=1e-3)


def test_white_residuals_count_each_and_correlated_ones_once() -> None:
    white = RNG.normal(size=4000)
    # a mean that the fit leaves does not make them correlated
    assert surface_fit._effective_share(white + 5.0) == pytest.approx(1.0, abs=0.15)
    held = np.repeat(RNG.normal(size=400), 10)  # each value ten times
    assert surface_fit._effective_share(held) == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0.3, 0.3), (math.pi / 2, math.pi / 2), (-math.pi / 2, math.pi / 2), (2.0, 2.0 - math.pi)],
)
def test_the_angle_of_a_line_lies_within_a_half_turn(angle: float, wrapped: float) -> None:
    assert weld_line._wrap_angle(angle) == pytest.approx(wrapped)


def test_the_distance_from_a_line_takes_lag_and_lean_into_account() -> None:
    angle, offset, lag, lean = 0.4, 0.01, 0.2, 0.15
    line = weld_line._Fit(np.array([0.1, -0.2]), offset, angle, lag, lean, np.eye(4))
    t, n = (
        np.array([math.cos(angle), math.sin(angle)]),
        np.array([-math.sin(angle), math.cos(angle)]),
    )
    bow, v = RNG.uniform(0.0, 0.05, 6), RNG.normal(size=(6, 2)) * 0.05
    on_line = line.middle + offset * n + np.outer(RNG.normal(size=6), t)
    # seen a lag later, further along its way; the plane's cut bows in s
    seen = on_line + lag * v + np.outer(lean * bow, [0.0, 1.0])
    np.testing.assert_allclose((line.measure(seen, bow, v)), 0.0, atol=1e-12)


def test_two_crossings_make_a_line_where_they_are_apart() -> None:
    std, none = np.full(2, 1e-3), np.zeros(2)
    for apart, found in ((6.0e-3, True), (4.0e-3, False)):  # 2.5 deviations from their middle
        q = np.array([[0.0, 0.0], [apart, 0.0]])
        assert (
            weld_line._solve(q, none, np.zeros((2, 2)), std, weld_line.LAG_PRIOR) is not None
        ) == found


def test_the_covariance_of_a_line_is_that_of_its_residuals() -> None:
    """Against a numerical Jacobian; passes both ways, so that lag and angle mix."""
    n = 12
    q = np.stack([np.linspace(-0.2, 0.2, n), 1e-4 * RNG.normal(size=n)], axis=1)
    v = np.where(np.arange(n) % 2, 1.0, -1.0)[:, None] * [0.08, 0.1]
    v[: n // 2] *= 3.0
    q += 0.2 * v  # a lag of 0.2 s
    bow, std = np.zeros(n), np.full(n, 1e-3)
    fit = weld_line._solve(q, bow, v, std, weld_line.LAG_PRIOR)
    assert fit is not None

    def measure(x: np.ndarray) -> np.ndarray:
        line = weld_line._Fit(fit.middle, x[0], x[1], x[2], x[3], fit.cov)
        return line.measure(q, bow, v)

    at = np.array([fit.offset, fit.angle, fit.lag, fit.lean])
    jac = np.stack([(measure(at + e) - measure(at - e)) / 2e-6 for e in 1e-6 * np.eye(4)], axis=1)
    residual = measure(at)
    scale = math.sqrt(
        (weld_line.SCALE_PRIOR_COUNT + np.sum((residual / std) ** 2))
        / (weld_line.SCALE_PRIOR_COUNT + n - 2)
    )
    normal = jac.T @ jac / (1e-3 * scale) ** 2
    normal[2, 2] += 1 / weld_line.LAG_PRIOR**2
    normal[3, 3] += 1 / weld_line.LEAN_PRIOR**2
    np.testing.assert_allclose(
        fit.cov[:3, :3], np.linalg.inv(normal)[:3, :3], rtol=0.02, atol=1e-12
    )


def test_one_spike_does_not_move_a_long_crossing() -> None:
    n = 60
    t, s = np.linspace(0.0, 1.2, n), np.linspace(-0.03, 0.03, n)
    signal = np.exp(-0.5 * ((s - 0.004) / 0.008) ** 2)
    args = (t, s, 1e-6 * RNG.normal(size=n))
    clean = weld._locate(*args, signal, 1e-3, PIPE)
    spiked = signal.copy()
    spiked[n // 2 + 12] = 20.0
    found = weld._locate(*args, spiked, 1e-3, PIPE)
    assert clean is not None and clean.s == pytest.approx(0.004, abs=5e-4)
    assert found is not None and found.peak < 2.0


@pytest.mark.parametrize(("pause", "crossings"), [(1.0, 1), (3.0, 2)])
def test_a_long_pause_on_the_weld_makes_two_crossings(pause: float, crossings: int) -> None:
    t = 0.02 * np.arange(20.0) + np.where(np.arange(20) < 10, 0.0, pause)
    s, c = np.linspace(0.0, 0.002, 20), np.zeros(20)
    runs = weld._runs(np.ones(20, bool), t, s, c)
    assert len(weld._merge_runs(runs, t, s, c)) == crossings


@pytest.mark.parametrize(("first", "last"), [(False, False), (True, False), (False, True)])
def test_a_crossing_that_begins_or_ends_with_the_contact_is_one_sided(
    first: bool, last: bool
) -> None:
    """Base metal that was seen 7 mm before, and then lost, does not make it a whole one."""
    n = 101
    t, s, c = 0.02 * np.arange(n), np.linspace(-0.05, 0.05, n), np.zeros(n)
    signal = np.exp(-0.5 * (s / 0.004) ** 2)
    on_weld = signal > 0.3  # |s| < 6.2 mm
    base = ~on_weld
    base &= ~(first & (s > -0.0125) & (s < 0.0))  # not in contact
    base &= ~(last & (s < 0.0125) & (s > 0.0))
    crossings, _ = weld.find_crossings(t, s, c, signal, on_weld, 1e-3, PIPE, base, [])
    assert len(crossings) == 1
    assert crossings[0].s == pytest.approx(0.0, abs=5e-4)
    assert crossings[0].one_sided == (first or last)
    assert (crossings[0].std >= weld_line.HALF_WIDTH) == (first or last)


def test_a_line_is_described_from_its_first_to_its_last_crossing() -> None:
    line = weld_line.WeldLine(0.1, 0.02, 0.6, 1e-3, 1e-2, 0.0, 0.01, (0, 1, 2), radius=0.2)
    ends = line.follow(np.array([-0.05, 0.01, 0.08]))
    at = list(zip(*ends, roll_points(PIPE, *ends)[0], strict=True))
    crossings = tuple(
        Crossing(float(i), s, c, tuple(p), 2.0, 0.05, 0.05, 1e-3, 20, line=0)
        for i, (s, c, p) in enumerate(at)
    )
    none = np.zeros(0)
    calibration = Calibration(0j, 1 + 0j, 60.0, (0.0, 0.0, 0.0), 0.1, 15.0, 1.2)
    found = weld.WeldResult(
        none, none, none, none, none, none, none > 0, none > 0, 1.0, crossings, (line,),
        calibration, PIPE, (), 1.2, (2.0,),
    )  # fmt: skip
    points = np.array(weld_data.describe_welds(found)["lines"][0]["points_m"])
    # the line bends on the pipe by less than a millimetre over this length
    np.testing.assert_allclose(points[[0, -1]], [at[0][2], at[-1][2]], atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(points[:, [0, 2]], axis=1), PIPE.radius, atol=1e-6)


def test_the_deviations_of_a_cylinder_all_around_are_those_of_theory() -> None:
    """White noise of the distance at N points, even around the axis and along a length of 0.5 m."""
    rng, sigma, radius, length = np.random.default_rng(3), 3e-4, 0.2, 0.5
    phi, z = (a.ravel() for a in np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False), np.linspace(-0.5, 0.5, 40) * length
    ))  # fmt: skip
    order = rng.permutation(len(phi))
    phi, z = phi[order], z[order]
    r, n = radius + sigma * rng.standard_normal(len(phi)), math.sqrt(len(phi))
    fit = surface_fit.fit_cylinder(np.column_stack([r * np.cos(phi), z, r * np.sin(phi)]))
    assert fit.std_radius == pytest.approx(sigma / n, rel=0.1)
    assert fit.std_axis_point == pytest.approx(2.0 * sigma / n, rel=0.1)  # of both directions
    spread = float(np.sqrt(np.mean(z**2)))
    assert fit.std_axis == pytest.approx(2.0 * sigma / n / spread, rel=0.1)
    assert fit.rms == pytest.approx(sigma, rel=0.1)
