"""The mission `bimanual-bench`: trials meet their requirements, and fail for the right reason."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cut_flights import check_cuts
from skywright.core.types import TASK_SQUEEZE
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.arms.ports import Hands
from skywright.vehicle.arms_interface import Arms


def fly(*trials: str, sets: tuple[str, ...] = (), seed: int = 1) -> RunResult:
    listed = ", ".join(f'"{x}"' for x in trials)
    return fly_and_evaluate(
        load_description(
            "bimanual-bench", seed=seed, sets=[f"mission.task.trials=[{listed}]", *sets]
        )
    )


def get_phase(result: RunResult, name: str) -> np.ndarray:
    phase = next(p for p in result.phases if p.name == name)
    s = result.samples
    return s[(s["t"] >= phase.start_s) & (s["t"] < phase.end_s)]


def test_all_trials_meet_their_requirements() -> None:
    """With another seed, a heavier robot and a more slippery hand than believed."""
    result = fly(
        "squeeze", "unplug", "bar", "position-sensor", seed=2,
        sets=("plant.mass_error=0.05", "robot.arm.hand.friction=0.45", "mission.timestep_ms=2"),
    )  # fmt: skip
    assert result.outcome == "succeeded", [v for v in result.requirements if not v.passed]
    assert len(result.requirements) == 9
    # (32): the box hangs between forces that are opposite, and friction carries half of it a hand
    held = get_phase(result, "hold box")
    inward = held["right_f_W"].mean(axis=0)[1], -held["left_f_W"].mean(axis=0)[1]
    assert inward == pytest.approx((3.5, 3.5), abs=0.2)
    weight = 0.2 * 9.81
    carried = held["left_f_W"].mean(axis=0)[2] + held["right_f_W"].mean(axis=0)[2]
    assert carried == pytest.approx(weight, rel=0.05)
    # V-E: the base did drift, and the arms felt it
    assert result.metrics["bench.drift_rms_mm"] > 10.0 * result.metrics["bench.drift_error_mm"]
    check_cuts(result)


def test_a_squeeze_too_weak_for_friction_loses_the_box() -> None:
    """1.2 N at a coefficient of 0.5 carry 1.2 N of the box's 2 N."""
    result = fly(
        "squeeze",
        sets=("mission.task.squeeze_n=1.2", "mission.task.hold_s=1", "mission.timestep_ms=2"),
    )
    failed = {v.name for v in result.requirements if not v.passed}
    assert "bench.box_lift_share" in failed
    assert {v.name for v in result.requirements} == {
        "bench.box_lift_share", "bench.box_slip_mm", "bench.squeeze_off", "arm.saturated_max_s",
    }  # fmt: skip


def test_a_plug_that_stays_is_no_success() -> None:
    """Hands slip off a plug that is stuck: (33) takes that for the release, the evaluation not."""
    result = fly("unplug", sets=("world.things.plug.held_n=15", "mission.timestep_ms=2"))
    assert {v.name for v in result.requirements if not v.passed} == {
        "bench.unplug_delay_s", "bench.plug_slip_mm",
    }  # fmt: skip
    plug = result.samples["object1_p_WO"]
    assert np.max(np.linalg.norm(plug - plug[0], axis=1)) < 0.005


def test_squeezing_winds_the_joints_that_yield() -> None:
    """The output links stay where they are; at a fixed roll of the shafts they would walk away."""
    result = fly(
        "position-sensor", sets=("mission.task.drift_m=0", "mission.task.drift_period_s=1")
    )
    grasp = get_phase(result, "grasp post")
    moved = np.degrees(np.abs(grasp["q"][-1] - grasp["q"][0]))
    wound = np.degrees(np.abs(grasp["deflection"][-1] - grasp["deflection"][0]))
    assert wound[:4].max() > 15.0 and moved[:4].max() < 0.25 * wound[:4].max()


def test_points_of_a_squeeze_are_led_and_forces_ramped() -> None:
    d = load_description("bimanual-bench")
    vehicle = build_vehicle(d)
    arms = Arms(vehicle)
    start = vehicle.read(Hands).p_WH
    goal = start + [0.0, 0.0, 0.1]
    arms.squeeze(2.0, goal[0], goal[1], ramp_s=1.0, speed=0.05)
    seen = []
    for _ in range(round(4.5 / 0.02)):
        vehicle.tick()
        row = vehicle.reference
        seen.append((row["p_WH"][0].copy(), row["v_WH"][0].copy(), row["f_WH"][0][0]))
    p, v, f = (np.array(x) for x in zip(*seen, strict=True))
    assert np.all(vehicle.reference["task"] == TASK_SQUEEZE)
    np.testing.assert_allclose(p[-1], goal[0], atol=1e-9)
    assert np.max(np.linalg.norm(v, axis=1)) <= 0.05 + 1e-6
    np.testing.assert_allclose(np.cumsum(v, axis=0)[-1] * 0.02, goal[0] - p[0], atol=2e-3)
    assert f[-1] == pytest.approx(2.0) and np.all(np.diff(f) >= -1e-12) and f[10] < 0.6
    assert not math.isnan(float(f.sum()))


def test_wrong_benches_are_told() -> None:
    for robot, world, sets, found in (
        ("hexarotor", None, [], "shoulder_roll"),
        (None, "open", [], "has no bench"),
        (None, None, ['mission.task.trials=["lift"]'], "trials"),
        (None, None, ["mission.task.trials=[]"], "trials"),
        (None, None, ['mission.task.trials=["bar", "bar"]'], "a trial appears twice"),
        (None, None, ["mission.task.squeeze_n=-1"], "squeeze_n"),
    ):
        with pytest.raises(InputError, match=found):
            plan_mission(load_description("bimanual-bench", robot=robot, world=world, sets=sets))


def test_squeezes_that_would_throw_are_refused() -> None:
    """k L / 2 of the springs as the thing's weight winds them; 5 N threw plug and bar."""

    def ask(robot: str | None = None, **sets: float) -> str:
        keys = {k.replace("__", "."): v for k, v in sets.items()}
        return str(
            plan_mission(load_description("bimanual-bench", robot=robot, sets=keys)).blocked_by
        )

    assert ask() == ask(mission__task__squeeze_n=4.5) == "None"
    assert "4.97 N, 90% (mission.task.squeeze_fraction) of the 5.52 N" in ask(
        mission__task__squeeze_n=5.0
    )
    assert "'bar'" in ask(mission__task__squeeze_n=4.7)  # led ahead the arms are softer
    assert "box would buckle" in ask(world__things__box__size_y_m=0.2)
    assert "147 mm from the side of world.things.box" in ask(world__things__box__x_m=0.6)
    assert "ends 356 mm" in ask("bimanual-longreach")
