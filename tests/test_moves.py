"""Rows at rest and moves between rows leave the rows that they are given as they are."""

from __future__ import annotations

import numpy as np

import skywright
from skywright.core.types import REFERENCE
from skywright.missions.skills.moves import STILL, build_move, set_rest
from skywright.models.rigid_body import build_body_model
from skywright.vehicle.follower import copy_row


def build_rows() -> np.ndarray:
    rows = np.zeros(3, REFERENCE)
    rows["R_WB"] = rows["R_WT"] = np.eye(3)
    rows["p_WB"][:, 0], rows["v_WB"], rows["t"] = [0.0, 1.0, 2.0], 0.3, [0.0, 5.0, 9.0]
    return rows


def test_a_copy_of_a_row_shares_nothing_with_it() -> None:
    rows = build_rows()
    for row in (rows[1], copy_row(rows[1]), copy_row(rows[1])[()]):
        copied = copy_row(row)
        assert copied.tobytes() == row.tobytes() and copied.dtype == REFERENCE
        copied["p_WB"] = 7.0
        assert row["p_WB"].tolist() == [1.0, 0.0, 0.0]


def test_a_row_of_a_plan_that_is_set_at_rest_stays_as_planned() -> None:
    rows = build_rows()
    still = set_rest(rows[1])
    assert all(not np.any(still[name]) for name in STILL)
    np.testing.assert_array_equal(rows, build_rows())


def test_a_move_leaves_its_ends_as_they_are() -> None:
    robot, rows = skywright.load("pipe-weld-scan").robot, build_rows()
    table = build_move(build_body_model(robot), 2, rows[0], rows[2], speed=0.5)
    np.testing.assert_allclose(table["p_WB"][-1], [2.0, 0.0, 0.0])
    np.testing.assert_array_equal(rows, build_rows())
