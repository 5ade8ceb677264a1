"""Surfaces from touches: known points, stated deviations, short arcs, a false touch."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from skywright.core.arrays import Array
from skywright.core.rotations import rot_x, rot_z
from skywright.description.world.surface import Cylinder, roll_points
from skywright.errors import InputError
from skywright.inspection.touches import (
    MapError,
    compute_normal_std,
    fit_cylinder_touches,
    fit_plane_touches,
)

MAP = Cylinder(np.array([2.0, 0.3, 1.5]), np.ascontiguousarray(rot_z(0.4) @ rot_x(0.2)), 0.2, 0.25)
ERROR = MapError(0.01, math.radians(1.0), 0.002)
TIP, STD = 0.004, 5e-4


def move(x: Array) -> Cylinder:
    """The map's cylinder with a deviation x as the fit states it."""
    turn = rot_x(x[0]) @ rot_z(x[1])  # to first order the fit's rotation vector
    return Cylinder(
        MAP.p_WP + MAP.R_WP @ [x[2], 0.0, x[3]], MAP.R_WP @ turn, MAP.radius + x[4], MAP.half_length
    )


def touch(surface: Cylinder, arc: float, per_ring: int = 3, rings: int = 2) -> Array:
    """Middles of the tip at touches on `rings` rings over `arc` (rad)."""
    s, phi = np.meshgrid(np.linspace(-0.1, 0.1, rings), np.linspace(-arc / 2, arc / 2, per_ring))
    p, n = roll_points(surface, s.ravel(), surface.radius * phi.ravel())
    return p + TIP * n


def draw(rng: np.random.Generator) -> Array:
    bounds = [ERROR.turn, ERROR.turn, ERROR.place, ERROR.place, ERROR.size]
    return np.array(bounds) * rng.uniform(-1.0, 1.0, 5)


def test_exact_touches_all_around_give_the_cylinder_back() -> None:
    x = np.array([0.01, -0.008, 0.007, -0.009, 0.0015])
    found = fit_cylinder_touches(MAP, ERROR, touch(move(x), 2.0 * math.pi, 9, 3), TIP, 1e-6)
    np.testing.assert_allclose(found.fit.x, x, atol=1e-4)
    assert found.cylinder.radius == pytest.approx(0.2015, abs=1e-5)
    assert found.fit.consistent and np.all(found.fit.used)


def test_a_plane_through_exact_touches() -> None:
    R, p = rot_z(0.3) @ rot_x(math.pi), np.array([1.0, 2.0, 3.0])
    turn = rot_x(0.01)
    at = np.array([[x, y, 0.0] for x in (-0.2, 0.2) for y in (-0.3, 0.3)])
    centres = p + R @ [0, 0, 0.006] + at @ (R @ turn).T + TIP * (R @ turn)[:, 2]
    found = fit_plane_touches(p, R, ERROR, centres, TIP, 1e-6)
    np.testing.assert_allclose(found.fit.x, [0.01, 0.0, 0.006], atol=1e-5)
    np.testing.assert_allclose(found.R_WS, R @ turn, atol=1e-5)
    np.testing.assert_allclose(found.p_WS, p + R @ [0, 0, 0.006], atol=1e-5)


def test_stated_covariance_is_that_of_the_errors() -> None:
    """NEES over 500 draws; priors are even, so a little below the normal one's five."""
    rng, nees = np.random.default_rng(1), []
    for _ in range(500):
        x = draw(rng)
        centres = touch(move(x), math.radians(40.0)) + STD * rng.standard_normal((6, 3))
        fit = fit_cylinder_touches(MAP, ERROR, centres, TIP, STD).fit
        e = fit.x - x
        nees.append(float(e @ np.linalg.solve(fit.covariance, e)))
    low, high = chi2.ppf([0.001, 0.999], 5 * 500) / 500
    assert 0.9 * low < np.mean(nees) < high
    assert np.mean(np.array(nees) > chi2.ppf(0.95, 5)) < 0.07


def test_a_short_arc_leaves_the_radius_at_the_map_a_long_one_does_not() -> None:
    size = ERROR.size / math.sqrt(3.0)
    short = fit_cylinder_touches(MAP, ERROR, touch(MAP, math.radians(40.0)), TIP, STD).fit
    long = fit_cylinder_touches(MAP, ERROR, touch(MAP, math.radians(300.0), 7), TIP, STD).fit
    assert math.sqrt(short.covariance[4, 4]) > 0.95 * size
    assert math.sqrt(long.covariance[4, 4]) < 0.35 * size


def test_a_free_radius_is_as_uncertain_as_a_monte_carlo_says() -> None:
    """Over 40 deg, 1 mm touches, R free: 14 mm (facts of an independent prototype)."""
    free = MapError(1.0, 0.5, 1.0)
    wide = Cylinder(MAP.p_WP, MAP.R_WP, 0.2, 0.25)
    s, phi = np.meshgrid([-0.15, 0.15], np.radians([-20.0, 0.0, 20.0]))
    p, n = roll_points(wide, s.ravel(), 0.2 * phi.ravel())
    fit = fit_cylinder_touches(wide, free, p + TIP * n, TIP, 1e-3).fit
    assert math.sqrt(fit.covariance[4, 4]) == pytest.approx(0.0138, rel=0.1)


def test_where_it_was_touched_the_surface_is_known() -> None:
    found = fit_cylinder_touches(MAP, ERROR, touch(MAP, math.radians(40.0)), TIP, STD)
    assert compute_normal_std(found, 0.0) < 0.8 * STD
    assert compute_normal_std(found, 2.0) > 3.0 * STD


@pytest.mark.parametrize("false", range(8))
def test_one_false_touch_is_left_out(false: int) -> None:
    x = np.array([0.01, -0.01, 0.006, -0.005, 0.001])
    clean = touch(move(x), math.radians(40.0), 4)
    centres = clean.copy()
    centres[false] -= 0.025 * MAP.R_WP[:, 0]  # felt 25 mm in front of it
    fit = fit_cylinder_touches(MAP, ERROR, centres, TIP, STD).fit
    assert fit.consistent and not fit.used[false] and np.count_nonzero(fit.used) == 7
    good = fit_cylinder_touches(MAP, ERROR, clean, TIP, STD).fit
    sigma = np.sqrt(np.diag(fit.covariance))
    assert np.all(np.abs(fit.x - good.x) < 3.0 * sigma)


def test_two_false_touches_are_told() -> None:
    centres = touch(MAP, math.radians(40.0), 4)
    centres[[1, 6]] -= 0.03 * MAP.R_WP[:, 0]
    assert not fit_cylinder_touches(MAP, ERROR, centres, TIP, STD).fit.consistent


def test_touches_in_one_line_or_none_leave_the_rest_to_the_map() -> None:
    prior = np.array([ERROR.turn, ERROR.turn, ERROR.place, ERROR.place, ERROR.size]) / math.sqrt(3)
    none = fit_cylinder_touches(MAP, ERROR, np.zeros((0, 3)), TIP, STD).fit
    np.testing.assert_allclose(np.sqrt(np.diag(none.covariance)), prior, rtol=1e-6)
    line = fit_cylinder_touches(MAP, ERROR, touch(MAP, 0.0, 1), TIP, STD).fit
    sigma = np.sqrt(np.diag(line.covariance))
    np.testing.assert_allclose(sigma[[0, 3]], prior[[0, 3]], rtol=1e-3)  # across the normal
    assert sigma[2] < 0.5 * prior[2]
    assert sigma[1] < 0.5 * prior[1]


def test_a_known_map_stays() -> None:
    exact = MapError(0.0, 0.0, 0.0)
    noisy = touch(MAP, 0.7) + 1e-3
    found = fit_cylinder_touches(MAP, exact, noisy, TIP, STD)
    np.testing.assert_allclose(found.cylinder.p_WP, MAP.p_WP, atol=1e-4)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=5), st.floats(0.3, 3.0))
def test_touches_lie_on_what_was_found(u: list[float], arc: float) -> None:
    """Property: noise-free touches of a cylinder within the bounds lie on the result."""
    x = np.array([ERROR.turn, ERROR.turn, ERROR.place, ERROR.place, ERROR.size]) * u
    fit = fit_cylinder_touches(MAP, ERROR, touch(move(x), arc), TIP, STD).fit
    assert np.max(np.abs(fit.residuals)) < STD
    assert np.all(np.linalg.eigvalsh(fit.covariance) > 0.0)


def test_a_place_that_is_no_number_is_refused() -> None:
    with pytest.raises(InputError, match="valid: finite"):
        fit_cylinder_touches(MAP, ERROR, np.full((3, 3), math.nan), TIP, STD)
