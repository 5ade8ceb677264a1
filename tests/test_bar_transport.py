"""The carried bar: its mass, the flight along the plan, and what is refused."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.models.body_records import Body, Kinematics
from skywright.models.rigid_body import build_body_model, fill_body, fill_kinematics
from skywright.models.scene import build_scene
from skywright.run.planning import plan_mission
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate


@cache
def fly_nominal() -> RunResult:
    return fly_and_evaluate(load_description("bar-transport"))


def test_the_rigid_body_carries_the_bar_as_the_scene_does() -> None:
    d = load_description("bar-transport")
    scene = build_scene(d.robot, d.world)
    q = np.array([0.2, -0.7, -1.1, -0.7, -1.1])  # both arms alike: they hold one bar
    data = mujoco.MjData(scene.model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[scene.places.joint_qpos] = q
    mujoco.mj_forward(scene.model, data)
    M = np.zeros((scene.model.nv, scene.model.nv))
    mujoco.mj_fullM(scene.model, data, M)
    model, k, body = (
        build_body_model(d.robot),
        np.zeros(1, Kinematics.dtype),
        np.zeros(1, Body.dtype),
    )
    full = np.zeros(len(model[0]["q_min"]))
    full[:5] = q
    fill_kinematics(model[0], full, k[0])
    fill_body(model[0], k[0], body[0])
    assert body[0]["mass"] == pytest.approx(M[0, 0], rel=1e-12)
    np.testing.assert_allclose(body[0]["I_B"], M[3:6, 3:6], atol=1e-12)
    bare = load_description("bar-transport", sets={"mission.task.bar_length_m": 0.0})
    assert body[0]["mass"] - build_mass(bare.robot) == pytest.approx(0.3)


def build_mass(robot: object) -> float:
    model = build_body_model(robot)  # type: ignore[arg-type]
    return float(model[0]["mass0"] + model[0]["mass"].sum())


def test_the_flight_meets_its_requirements() -> None:
    result = fly_nominal()
    assert result.outcome == "succeeded", result.reason
    assert [p.name for p in result.phases] == [
        "start", "release", "start pose", "transport", "settle"
    ]  # fmt: skip
    m = result.metrics
    assert m["plan.lower_bound"] <= m["plan.cost"] < 1.1 * m["plan.lower_bound"]
    # the clearance that was flown is the planned one, but for what tracking takes away
    away = m["tip.tracking_max_m"] + m["platform.tracking_max_m"]
    assert m["transport.clearance_min_m"] > m["plan.clearance_min_m"] - away
    # the bar is where the hands are, in the plant as well: the grip gives way by little
    s = result.samples[result.samples["phase"] == 3]
    apart = np.linalg.norm(s["left_p_WH"] - s["right_p_WH"], axis=1)
    assert np.ptp(apart) < 0.01


def test_the_same_seed_gives_the_same_plan() -> None:
    a, b = fly_nominal().plan, plan_mission(load_description("bar-transport"))
    np.testing.assert_array_equal(a.segments["transport"], b.segments["transport"])


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        ({"mission.task.goal_x_m": 2.7, "mission.task.goal_z_m": 2.0}, "goal: "),
        ({"mission.start_x_m": 3.0}, "start: "),
        ({"mission.start_y_m": 0.5}, "plane y = 0"),
        ({"mission.task.bar_length_m": 0.1}, "0.32 m apart"),
        ({"world.area.x_max_m": -2.0}, "x_min_m -1.5 must be below"),
    ],
)
def test_wrong_input_is_told(sets: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        plan_mission(load_description("bar-transport", sets=sets))


def test_a_bar_longer_than_the_gap_has_no_plan() -> None:
    sets = {"mission.task.bar_length_m": 2.7, "mission.task.planner_slices": 50}
    plan = plan_mission(load_description("bar-transport", sets=sets))
    assert not plan.feasible
    assert "'lower gap': 2.60 m wide; the bar requires 3.10 m" in str(plan.blocked_by)


def test_another_robot_is_refused() -> None:
    with pytest.raises(InputError, match="cannot carry a bar"):
        plan_mission(load_description("bar-transport", robot="bimanual"))
    with pytest.raises(InputError, match="cannot carry a bar"):
        plan_mission(load_description("bar-transport", robot="hexarotor"))


def test_an_empty_world_is_flown_straight() -> None:
    plan = plan_mission(
        load_description("bar-transport", world="open", sets={"mission.task.planner_slices": 50})
    )
    assert plan.feasible
    assert plan.metrics["plan.cost"] == pytest.approx(9.0, abs=0.05)
