"""`skywright run --plan FILE`: a plan file of any planner, checked and flown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skywright.cli import main
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.missions.skills.plan_flight import load_plan_description
from skywright.missions.skills.plan_table import LEAD_S, build_plan_table
from skywright.models.rigid_body import build_body_model, joint_names
from skywright.planning.motion.plan_file import PlanFile, write_plan_file
from skywright.run.planning import plan_mission
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.rest_to_rest import quintic


def build_line(robot: str, length: float = 1.0, duration: float = 4.0) -> PlanFile:
    """A straight flight forward at 2 m, from rest to rest, joints at work."""
    joints = tuple(joint_names(load_robot(robot)[0]))
    t = np.linspace(0.0, duration, round(duration / 0.02) + 1)
    s, ds, dds = quintic(t / duration)
    pose, rate, acceleration = (np.zeros((len(t), 4)) for _ in range(3))
    pose[:, 0], pose[:, 2] = length * s, 2.0
    rate[:, 0], acceleration[:, 0] = length * ds / duration, length * dds / duration**2
    q = np.zeros((len(t), len(joints)))
    return PlanFile(
        robot, "open", 1, joints, t, pose, rate, acceleration, q, np.zeros_like(q), {}
    )  # fmt: skip


def test_a_plan_flies_by_itself(tmp_path: Path) -> None:
    write_plan_file(tmp_path / "line", build_line("hexarotor"))
    result = fly_and_evaluate(load_plan_description(tmp_path / "line.csv"))
    assert result.outcome == "succeeded", result.reason
    assert result.samples["p_WB"][-1, 0] == pytest.approx(1.0, abs=0.05)


def test_the_platform_leads_what_hangs_on_it() -> None:
    plan = build_line("ars-lrm")
    model = build_body_model(load_robot("ars-lrm")[0])
    table = build_plan_table(plan, model)
    assert table["t"][-1] == pytest.approx(plan.t[-1] + LEAD_S, abs=0.03)
    np.testing.assert_allclose(table["p_WB"][[0, -1], 0], plan.pose[[0, -1], 0], atol=1e-12)
    # by z a / g at the largest acceleration, rounded over a second
    lead = table["p_WB"][:, 0] - np.interp(table["t"] - 0.5 * LEAD_S, plan.t, plan.pose[:, 0])
    below = float(table["p_WB"][0, 2] - table["p_WT"][0, 2])
    assert lead.max() == pytest.approx(below * plan.acceleration[:, 0].max() / 9.81, rel=0.1)
    # and its velocity and acceleration belong to its place
    v = np.gradient(table["p_WB"][:, 0], table["t"])
    np.testing.assert_allclose(table["v_WB"][:, 0], v, atol=2e-3)
    np.testing.assert_allclose(table["a_WB"][:, 0], np.gradient(v, table["t"]), atol=1e-2)


def test_what_a_robot_cannot_fly_is_refused(tmp_path: Path) -> None:
    fast = build_line("hexarotor", length=4.0)
    write_plan_file(tmp_path / "fast", fast)
    with pytest.raises(
        InputError, match=r"speed of the plan is 1.8. m/s; robot 'hexarotor' flies at most 1 m/s"
    ):
        plan_mission(load_plan_description(tmp_path / "fast"))
    bent = build_line("ars-lrm")
    bent.q[:, 2] = 0.5  # elbow
    write_plan_file(tmp_path / "bent", bent)
    with pytest.raises(
        InputError, match=r"left_elbow_pitch goes to 28.6\d* deg; its range is -150"
    ):
        plan_mission(load_plan_description(tmp_path / "bent"))
    write_plan_file(tmp_path / "carry", build_line("ars-lrm"))
    with pytest.raises(InputError, match="the plan begins at"):
        plan_mission(
            load_plan_description(
                tmp_path / "carry", "bar-transport", sets={"mission.start_x_m": 0.5}
            )
        )
    # through the rack
    low = build_line("ars-lrm", length=3.0, duration=8.0)._replace(world="pipe-structures")
    write_plan_file(tmp_path / "low", low)
    plan = plan_mission(load_plan_description(tmp_path / "low"))
    assert not plan.feasible
    assert "touch" in str(plan.blocked_by)


def test_the_command_refuses_what_is_no_plan(tmp_path: Path) -> None:
    files = write_plan_file(tmp_path / "line", build_line("hexarotor"))
    files[0].write_text("\n".join(files[0].read_text().splitlines()[:50]))
    for arguments, message in (
        (["run"], "--plan FILE"),
        (["run", "--plan", str(tmp_path / "none")], "no plan file"),
        (["run", "--plan", str(files[0])], "truncated"),
        (["run", "--plan", str(files[0]), "--robot", "ars-lrm"], "truncated"),
        (["run", "waypoints", "--plan", str(files[0])], "truncated"),
        (["run", "follow-plan"], "plan_file is empty"),
    ):
        found = CliRunner().invoke(main, arguments)
        assert found.exit_code == 2, (arguments, found.output)
        assert message in found.output + str(found.stderr)
    assert not list(tmp_path.glob("*.partial"))


def test_a_plan_of_another_robot_or_for_another_mission_is_refused(tmp_path: Path) -> None:
    files = write_plan_file(tmp_path / "line", build_line("hexarotor"))
    for arguments, message in (
        (["--robot", "othex"], "the plan is for robot 'hexarotor', not 'othex'"),
        (["bar-transport"], "the plan is for robot 'hexarotor', not 'ars-lrm'"),
        (["waypoints"], "mission 'waypoints' cannot fly a plan file; valid: bar-transport"),
    ):
        found = CliRunner().invoke(main, ["run", *arguments, "--plan", str(files[0])])
        assert found.exit_code == 2, (arguments, found.output)
        assert message in found.output + str(found.stderr)
