"""The correction of an error state, against the textbook's matrices."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skywright.vehicle.estimators._kalman import correct, inject, place_point
from skywright.vehicle.estimators._strapdown import BA_, BG_, P_, R_, V_


def build_case(seed: int, m: int, n: int) -> tuple[Any, ...]:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    H = np.where(rng.random((m, n)) < 0.6, rng.normal(size=(m, n)), 0.0)
    return A @ A.T + 0.1 * np.eye(n), H, rng.normal(size=m), rng.uniform(0.1, 2.0, m)


@pytest.mark.parametrize(("seed", "m", "n"), [(1, 1, 15), (2, 3, 19), (3, 6, 25)])
def test_correction_is_the_kalman_gain_times_the_innovation(seed: int, m: int, n: int) -> None:
    P, H, nu, r = build_case(seed, m, n)
    S = H @ P @ H.T + np.diag(r)
    K = P @ H.T @ np.linalg.inv(S)
    found, dx, left = P.copy(), np.full(n, 9.0), nu.copy()
    size = correct(found, H, left, r, 1e6, dx)
    np.testing.assert_allclose(size, nu @ np.linalg.solve(S, nu), rtol=1e-9)
    np.testing.assert_allclose(dx, K @ nu, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found, P - K @ S @ K.T, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(left @ left, size, rtol=1e-9)  # whitened
    same, none = P.copy(), np.full(n, 9.0)
    assert correct(same, H, nu.copy(), r, 0.99 * size, none) == pytest.approx(size)
    np.testing.assert_array_equal(same, P)
    np.testing.assert_array_equal(none, np.zeros(n))


def build_state(seed: int) -> Any:
    rng = np.random.default_rng(seed)
    vectors = {name: rng.normal(size=3) for name in ("p_f", "v_f", "bg", "ba", "p_BI")}
    return SimpleNamespace(R_f=Rotation.random(random_state=seed).as_matrix(), **vectors)


def test_the_error_moves_every_part_of_the_state() -> None:
    me, old = build_state(4), build_state(4)
    dx = np.random.default_rng(5).normal(size=17)
    inject(me, dx)
    for name, at in (("p_f", P_), ("v_f", V_), ("bg", BG_), ("ba", BA_)):
        moved = getattr(old, name) + dx[at : at + 3]
        np.testing.assert_allclose(getattr(me, name), moved, atol=1e-12)
    turned = Rotation.from_rotvec(dx[R_ : R_ + 3]).as_matrix() @ old.R_f
    np.testing.assert_allclose(me.R_f, turned, atol=1e-12)


def test_a_points_place_and_its_jacobian_by_differences() -> None:
    me, p_B = build_state(6), np.array([0.3, -0.2, 0.5])
    H, out = np.zeros((3, 15)), np.zeros(3)
    place_point(me, p_B, H, out)
    np.testing.assert_allclose(out, me.R_f @ (p_B - me.p_BI), atol=1e-12)
    for k in range(15):
        step, ends = np.zeros(15), []
        for step[k] in (1e-6, -1e-6):
            other, lever = build_state(6), np.zeros(3)
            inject(other, step)
            place_point(other, p_B, np.zeros((3, 15)), lever)
            ends.append(other.p_f + lever)
        np.testing.assert_allclose(H[:, k], (ends[0] - ends[1]) / 2e-6, atol=1e-8)
