"""What the page tells of a reserve: force in each direction against an optimiser, clearance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from skywright.description.loader import load_description
from skywright.ground.reserve import DIRECTIONS, Reserve


@pytest.fixture(scope="module")
def tilted() -> Reserve:
    return Reserve(load_description("wall-contact"))  # six tilted rotors


def _hover(reserve: Reserve) -> Any:
    """Thrusts (n,) N of a level hover."""
    weight = np.zeros(6)
    weight[2] = 0.5 * float(np.sum(reserve.rotors.thrust_max)) * 0.8
    return np.linalg.pinv(reserve.rotors.B) @ weight


def test_the_force_that_is_left_is_what_an_optimiser_finds(tilted: Reserve) -> None:
    """Six tilted rotors: one set of thrusts makes a wrench, so the bound is exact."""
    r, hover = tilted.rotors, _hover(tilted)
    left = tilted.measure_force(hover)
    assert len(left) == DIRECTIONS + 2
    for k in (0, 1, 4, 7, DIRECTIONS, DIRECTIONS + 1):
        d = np.zeros(6)
        if k < DIRECTIONS:
            angle = 2.0 * math.pi * k / DIRECTIONS
            d[:2] = math.cos(angle), math.sin(angle)
        else:
            d[2] = 1.0 if k == DIRECTIONS else -1.0
        n = len(hover)  # maximise s: B T - s d = B hover
        found = linprog(
            np.r_[np.zeros(n), -1.0], A_eq=np.c_[r.B, -d], b_eq=r.B @ hover,
            bounds=[*zip(r.thrust_min, r.thrust_max, strict=True), (0, None)],
        )  # fmt: skip
        value = left[k]
        assert value is not None and found.success
        assert value == pytest.approx(-found.fun, abs=0.02)


def test_a_rotor_at_its_limit_leaves_nothing_where_it_would_be_needed(tilted: Reserve) -> None:
    thrust = _hover(tilted)
    thrust[0] = tilted.rotors.thrust_max[0]
    left = tilted.measure_force(thrust)
    assert left[DIRECTIONS] == 0.0  # up
    assert left[DIRECTIONS + 1] > 0.0  # type: ignore[operator]


def test_parallel_rotors_push_sideways_by_tilting_alone() -> None:
    reserve = Reserve(load_description("sensor-install"))
    left = reserve.measure_force(0.5 * np.array(reserve.rotors.thrust_max))
    assert left[:DIRECTIONS] == [None] * DIRECTIONS
    assert left[DIRECTIONS] is not None and left[DIRECTIONS] > 1.0


def test_the_clearance_shrinks_by_what_the_robot_comes_nearer(tilted: Reserve) -> None:
    q = np.zeros(16)
    seen = []
    for x in (1.2, 1.5, 1.8):  # the tunnel's wall is at x = 3
        row: Any = {"p_WB": np.array([x, 0.0, 1.5]), "q_WB": np.array([1.0, 0, 0, 0]), "q": q}
        seen.append(tilted.measure_clearance(row))
    near = [s for s in seen if s is not None]
    assert near and all(" and " in pair for _, pair in near)
    distances = [d for d, _ in near]
    assert distances == sorted(distances, reverse=True)
    assert len(distances) < 2 or distances[0] - distances[-1] > 0.2


def test_a_robot_without_an_arm_tells_no_distance() -> None:
    assert not Reserve(load_description("waypoints")).measures_clearance
