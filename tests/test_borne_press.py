"""What a docked robot bears with a plant's errors, and feet whose load follows the press."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from exact_map import KNOWN
from skywright.core.rotations import exp_so3
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.missions.skills.pressing import LAGS, lag_feet
from skywright.models.docked import build_docked, find_stance
from skywright.models.docked_balance import (
    HALF,
    LEAST_N,
    MARGIN,
    SPREAD,
    compute_borne_press,
    compute_docked_balance,
)
from skywright.run.planning import plan_mission


def lean(angle: float) -> Any:
    R = np.empty((3, 3))
    exp_so3(np.array([0.0, angle, 0.0]), R)
    return R


def bear(angle: float, drag: float = 0.0, fraction: float = 1.0) -> float:
    robot = load_description("bridge-contact").robot
    docked = build_docked(robot, thrust_fraction=fraction)
    drag_B = np.array([drag, 0.0, 0.0, 0.0, 0.0, 0.0])
    return compute_borne_press(docked, find_stance(docked), R_WB=lean(angle), drag_B=drag_B)


def test_less_is_borne_on_a_slope_in_wind_and_with_weaker_rotors() -> None:
    level = bear(0.0)
    assert level > 5.0
    # the press turns the robot, so one direction helps
    assert min(bear(math.radians(a)) for a in (-6.0, 6.0)) < level
    assert min(bear(0.0, drag=f) for f in (-2.0, 2.0)) < level
    assert bear(0.0, fraction=0.9) < level
    assert math.isnan(bear(math.radians(25.0)))


@pytest.mark.parametrize("angle", [0.0, 0.07])
def test_the_borne_press_is_held_by_every_plant_within_the_spread(angle: float) -> None:
    """Checked with the other programme, for each plant on its own."""
    robot = load_description("bridge-contact").robot
    most, rng = bear(angle), np.random.default_rng(1)
    tight = []
    for k in range(8):
        worst = k < 4
        share = np.ones(2) if worst else rng.uniform(-1.0, 1.0, 2)
        weak = (1.0 - SPREAD.thrust * share[0]) * (1.0 - 2.0 * SPREAD.rotors * share[0])
        docked = build_docked(robot, thrust_fraction=weak)
        stance = find_stance(docked)
        off = [(1, 1), (1, -1), (-1, 1), (-1, -1)][k % 4]
        center = np.array([*off, 1.0]) * SPREAD.center * (1.0 if worst else 0.5)
        stance = stance._replace(
            mass=(1.0 + SPREAD.weight * share[1]) * stance.mass, p_BC=stance.p_BC + center
        )
        found = compute_docked_balance(docked, stance, most, R_WB=lean(angle), foot_load=LEAST_N)
        assert found is not None and found.margin >= MARGIN - 1e-6
        assert found.foot_load.min() >= LEAST_N - 1e-6
        assert found.foot_friction.max() <= HALF * robot.docking.friction + 1e-6  # type: ignore[union-attr]
        more = compute_docked_balance(
            docked, stance, 1.02 * most, R_WB=lean(angle), foot_load=LEAST_N
        )
        hold = HALF * robot.docking.friction  # type: ignore[union-attr]
        tight.append(more is None or more.margin < MARGIN or more.foot_friction.max() > hold + 1e-6)
    assert any(tight[:4])  # one plant at the end of the spread bears no more


@pytest.mark.parametrize(
    ("sets", "told"),
    [
        ({"world.structure.slope_deg": 8.26, "mission.task.forces_n": [3.76],
          "world.structure.slope_toward_deg": 28.7}, "lower mission.task"),
        ({"world.structure.slope_deg": 9.0, "world.wind.kind": "steady",
          "world.wind.mean_mps": 3.9, "mission.task.forces_n": [1.0]}, "when the feet leave"),
    ],
)  # fmt: skip
def test_what_a_plant_may_not_bear_is_refused_with_the_number(
    sets: dict[str, Any], told: str
) -> None:
    known = {k: v for k, v in KNOWN.items() if not k.endswith("size_m")}
    more = {"mission.task.without_gear": False}
    plan = plan_mission(load_description("bridge-contact", sets=known | more | sets))
    assert not plan.feasible and told in str(plan.blocked_by), plan.blocked_by


def test_the_load_of_the_feet_follows_with_a_first_order_lag() -> None:
    t = np.arange(0.0, 1.5 + 1e-9, 0.02)
    table = np.zeros(len(t), [("t", float), ("f_feet_B", float, 3), ("t_feet_B", float, 3)])
    table["t"], table["f_feet_B"][:, 2] = t, 4.0 * t
    lag = 0.4
    out = lag_feet(table, lag)
    assert out["t"][-1] == pytest.approx(1.5 + LAGS * lag, abs=0.02)
    ramp = out[: len(t)]
    behind = 4.0 * (ramp["t"] - lag * (1.0 - np.exp(-ramp["t"] / lag)))
    np.testing.assert_allclose(ramp["f_feet_B"][:, 2], behind, atol=0.05)
    np.testing.assert_array_equal(out["f_feet_B"][-1], table["f_feet_B"][-1])


@pytest.mark.parametrize(
    ("robot", "missing"),
    [
        ("othex-force", "[robot.force_sensor]"),
        ("hexarotor", "[robot.probe] and [robot.force_sensor]"),
    ],
)  # fmt: skip
def test_a_robot_that_cannot_press_is_told_what_it_lacks(robot: str, missing: str) -> None:
    """A probe, or a sensor of the tip's force elsewhere, is not said to be missing."""
    with pytest.raises(InputError) as refused:
        plan_mission(load_description("bridge-contact", robot=robot))
    assert f"in the slider of a probe: add {missing} (a sensor in" in str(refused.value)
