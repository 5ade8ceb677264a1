"""Rotations against SciPy and identities."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from scipy.spatial.transform import Rotation

from skywright.core.compiled import helper
from skywright.core.rotations import (
    exp_so3,
    log_so3,
    orthonormalise,
    quat_from_rot,
    rot_from_quat,
    rot_x,
    rot_y,
    rot_z,
)

vectors = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)


@given(vectors)
def test_exp_matches_scipy_and_log_inverts_it(w):
    r, back = np.empty((3, 3)), np.empty(3)
    exp_so3(w, r)
    np.testing.assert_allclose(r, Rotation.from_rotvec(w).as_matrix(), atol=1e-12)
    log_so3(r, back)
    if np.linalg.norm(w) < np.pi - 1e-3:
        np.testing.assert_allclose(back, w, atol=1e-9)


@given(vectors)
def test_quaternion_round_trip(w):
    r = Rotation.from_rotvec(w).as_matrix()
    q = quat_from_rot(r)
    assert abs(np.linalg.norm(q) - 1.0) < 1e-12
    np.testing.assert_allclose(rot_from_quat(q), r, atol=1e-12)


def test_axis_rotations_are_right_handed():
    np.testing.assert_allclose(rot_z(np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(rot_x(np.pi / 2) @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    # a positive turn about y brings x down: the sign of every arm joint in the robot files
    np.testing.assert_allclose(rot_y(np.pi / 2) @ [1, 0, 0], [0, 0, -1], atol=1e-15)


@given(vectors)
def test_orthonormalise_repairs_a_drifted_matrix(w):
    r = Rotation.from_rotvec(w).as_matrix()
    drifted = np.ascontiguousarray(r + 1e-4 * np.arange(9).reshape(3, 3))
    orthonormalise(drifted)
    np.testing.assert_allclose(drifted @ drifted.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(drifted, r, atol=3e-3)


@helper
def _scale(v: Any, factor: float, out: Any) -> None:
    for i in range(3):
        out[i] = factor * v[i]


@njit
def _scale_all(records: Any, v: Any) -> None:
    _scale(records[0].v, 2.0, v)
    _scale(v, v[0], records[0].out)


def test_a_helper_is_compiled_once_for_arrays_inside_and_outside_of_records() -> None:
    records = np.zeros(1, [("v", float, 3), ("out", float, 3)])
    records["v"] = [1.0, 2.0, 3.0]
    _scale_all(records, np.zeros(3))
    np.testing.assert_array_equal(records["out"][0], [4.0, 8.0, 12.0])
    assert len(_scale.dispatcher.signatures) == 1
