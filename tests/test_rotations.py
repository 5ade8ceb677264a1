"""Rotations against SciPy and identities."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

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
