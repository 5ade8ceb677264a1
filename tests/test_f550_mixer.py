"""The mixer that Sanchez-Cuevas 2020 prints against the one that the rotors' geometry gives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skywright.description.robot.loader import load_robot
from skywright.evidence.reproduce.printed_mixer import (
    Mixer,
    build_correct,
    build_printed,
    can_hover,
    find_wrong_entries,
)
from skywright.models.rotors import build_rotors

TILT = math.radians(20.0)
WEIGHT = 2.0 * 9.81
T_MIN, T_MAX = 90 * 9.81e-3, 0.9 * 850 * 9.81e-3


@pytest.fixture(scope="module")
def correct() -> Mixer:
    return build_correct(build_rotors(load_robot("f550-bridge")[0].rotors))


@pytest.fixture(scope="module")
def printed() -> Mixer:
    return build_printed(TILT, TILT)


def test_blocks_are_the_robot_s_wrench_map(correct: Mixer) -> None:
    """L G + c H from the blocks is what the simulation flies with."""
    rotors = build_rotors(load_robot("f550-bridge")[0].rotors)
    np.testing.assert_allclose(correct.build(0.275, rotors.torque_per_thrust), rotors.B, atol=1e-12)


def test_each_wrong_entry_is_named(printed: Mixer, correct: Mixer) -> None:
    """What each wrong entry prints, and what the geometry gives, in sines and cosines."""
    s, c, h = math.sin(TILT), math.cos(TILT), math.sqrt(3.0) / 2.0
    expected = {
        ("A", 2, 3): (s / 2 + h * s * c, s / 2 - h * s * c),  # sign of the second term
        ("G", 2, 1): (h * c * s, -h * c * c),  # sign, and cos a sin b for cos a cos b
        ("G", 2, 3): (h * c * s, h * c * c),  # cos a sin b for cos a cos b, as the next two
        ("G", 2, 4): (h * c * s, h * c * c),
        ("G", 2, 6): (-h * c * s, -h * c * c),
        ("G", 3, 3): (c * c, s * c),  # cos a cos b for sin a cos b, as the next
        ("G", 3, 5): (c * c, s * c),
        ("H", 2, 3): (-(s / 2 + h * s * c), -(s / 2 - h * s * c)),  # inherited from A
    }
    found = {
        (e.block, e.row, e.column): (e.printed, e.correct)
        for e in find_wrong_entries(printed, correct)
    }
    assert found.keys() == expected.keys()
    for place, values in expected.items():
        assert found[place] == pytest.approx(values, abs=1e-12), place


def test_columns_must_be_unit_axes(printed: Mixer, correct: Mixer) -> None:
    """A witness that needs no geometry: a column of A is a direction, so its length is 1."""
    np.testing.assert_allclose(np.linalg.norm(correct.A, axis=0), 1.0, atol=1e-12)
    wrong = np.flatnonzero(np.abs(np.linalg.norm(printed.A, axis=0) - 1.0) > 1e-9)
    assert wrong.tolist() == [2]


def test_moments_are_normal_to_thrusts(printed: Mixer, correct: Mixer) -> None:
    """A second one: the moment p x a of a thrust has no component along the thrust a."""
    np.testing.assert_allclose(np.sum(correct.A * correct.G, axis=0), 0.0, atol=1e-12)
    wrong = np.flatnonzero(np.abs(np.sum(printed.A * printed.G, axis=0)) > 1e-9)
    assert wrong.tolist() == [0, 2, 3, 4, 5]  # every column with a wrong entry


def test_condition_number(printed: Mixer, correct: Mixer) -> None:
    """In N and N m at L = 0.275 m and 0.017 m of torque per thrust."""
    assert np.linalg.cond(correct.build(0.275, 0.017)) == pytest.approx(12.0, abs=0.1)
    assert np.linalg.cond(printed.build(0.275, 0.017)) == pytest.approx(63.9, abs=0.1)


def test_printed_mixer_cannot_hover_level(printed: Mixer, correct: Mixer) -> None:
    """It asks rotor 3 for 0.56 N, below the 90 gf that Table 2 implies."""
    good, bad = correct.build(0.275, 0.017), printed.build(0.275, 0.017)
    assert can_hover(good, WEIGHT, T_MIN, T_MAX)
    assert not can_hover(bad, WEIGHT, T_MIN, T_MAX)
    assert can_hover(bad, WEIGHT, 0.0, T_MAX)  # the lower bound is what it meets
    thrust = np.linalg.solve(bad, [0.0, 0.0, WEIGHT, 0.0, 0.0, 0.0])
    assert thrust.min() == pytest.approx(0.56, abs=0.01) and int(np.argmin(thrust)) == 2
    # flown on the true robot, those thrusts would turn it
    wrench = good @ thrust
    assert np.linalg.norm(wrench[3:]) > 0.3
