"""The docking gear: what a docked robot can press, its contact in the scene, the tilt sweep."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.cli import main
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.description.world.loader import load_world
from skywright.errors import InputError
from skywright.models.arm_body import Deviation
from skywright.models.capability import compute_capability
from skywright.models.docked import (
    DockedPress,
    build_docked,
    compute_docked_press,
    find_stance,
)
from skywright.models.docked_map import Condition, compute_worst_press
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.scene import build_scene, set_pose
from skywright.models.sweep import compute_tilt_sweep, strip_robot, tilt_rotors
from skywright.models.things.box import Box
from skywright.models.wind import DragBody, compute_drag

ROBOT = load_robot("f550-bridge")[0]
DOCKED = build_docked(ROBOT)
STANCE = find_stance(DOCKED)
LEVEL = compute_docked_press(DOCKED, STANCE)


def changed(**tables: dict[str, Any]) -> Robot:
    data = ROBOT.model_dump()
    for name, values in tables.items():
        data[name].update(values)
    return Robot(**data)


def balance(found: DockedPress, slope: float, toward: float, wind: float, blow: float) -> Any:
    """Sum of all forces and torques on the robot, from first principles in W and points."""
    z = np.array(
        [-math.sin(slope) * math.cos(toward), -math.sin(slope) * math.sin(toward), math.cos(slope)]
    )
    axis = np.cross([0, 0, 1], z)
    R = np.eye(3)
    if np.linalg.norm(axis) > 1e-12:
        axis /= np.linalg.norm(axis)
        K = np.cross(np.eye(3), axis)
        R = np.eye(3) + math.sin(slope) * K + (1 - math.cos(slope)) * K @ K
    up = R.T @ [0, 0, 1]
    wind_B = R.T @ (wind * np.array([math.cos(blow), math.sin(blow), 0.0]))
    p = ROBOT.platform
    areas = np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2])
    body = DragBody(STANCE.mass, 9.81, 1.2, STANCE.p_BC, areas)
    drag, drag_torque = compute_drag(DOCKED.layout, body, wind_B[None], found.thrust[None])
    rotors = DOCKED.layout.B @ found.thrust
    weight = -STANCE.mass * 9.81 * up
    press = np.array([0, 0, -found.force])
    force = rotors[:3] + weight + drag[0] + press
    torque = (
        rotors[3:] + np.cross(STANCE.p_BC, weight) + drag_torque[0] + np.cross(STANCE.tip, press)
    )
    return force, torque


@settings(max_examples=20, deadline=None)
@given(
    st.floats(0.0, 0.12), st.floats(-math.pi, math.pi), st.floats(0.0, 4.0),
    st.floats(-math.pi, math.pi),
)  # fmt: skip
def test_the_feet_balance_the_rest(slope: float, toward: float, wind: float, blow: float) -> None:
    """What rotors, weight, drag and press leave over is a push of the feet within their cones."""
    found = compute_docked_press(
        DOCKED, STANCE, slope=slope, slope_toward=toward, wind=wind, wind_toward=blow
    )
    assert math.isfinite(found.force)
    force, torque = balance(found, slope, toward, wind, blow)
    load, ratio = found.foot_load, found.foot_friction
    assert np.all(load >= 0.5 - 1e-6) and np.all(ratio <= 0.8 + 1e-6)
    assert force[2] == pytest.approx(load.sum(), abs=1e-3)  # the feet push down with their loads
    assert math.hypot(force[0], force[1]) <= 0.8 * load.sum() + 1e-3
    # normal forces alone make this roll and pitch torque; friction at that height may add to it
    arm = np.cross(DOCKED.feet, np.column_stack([np.zeros((4, 2)), -load])).sum(axis=0)
    left = -torque[:2] - arm[:2]
    assert np.linalg.norm(left) <= 0.45 * 0.8 * load.sum() + 1e-3
    assert np.all(found.thrust >= DOCKED.layout.t_min - 1e-6)
    assert np.all(found.thrust <= DOCKED.layout.t_max + 1e-6)


def test_tip_at_the_centre_is_a_closed_form() -> None:
    """Without levers every rotor gives its limit: press + feet = lift - weight."""
    robot = changed(docking={"foot_load_n": 0.25, "friction": 1e-6})
    docked = build_docked(robot)
    stance = find_stance(docked)._replace(tip=np.array([0, 0, 0.45]), p_BC=np.zeros(3))
    found = compute_docked_press(docked, stance)
    lift = float(docked.layout.B[2] @ docked.layout.t_max)
    assert found.force == pytest.approx(lift - stance.mass * 9.81 - 4 * 0.25, abs=1e-3)
    assert found.limit == "rotors"


def test_press_level_and_calm() -> None:
    assert 8.0 < LEVEL.force < 9.5 and LEVEL.limit == "rotors"
    assert LEVEL.lean < math.radians(0.1)


def test_what_costs_force() -> None:
    """Slope, wind, a slippery lining, weight and a far contact point each take force away."""

    def worst(robot: Robot, **condition: Any) -> float:
        docked = build_docked(robot)
        c = Condition(**condition)
        return compute_worst_press(docked, find_stance(docked, c.contact), c).force

    assert worst(ROBOT, slope=math.radians(5)) < LEVEL.force - 1.0
    assert worst(ROBOT, wind=3.0) < LEVEL.force - 1.0
    assert worst(changed(docking={"friction": 0.3})) < LEVEL.force - 0.3
    assert worst(changed(platform={"mass_kg": 2.2})) < LEVEL.force - 1.0
    assert worst(ROBOT, contact=(0.24, 0.0)) < LEVEL.force - 0.3
    assert worst(ROBOT, contact=(0.14, 0.0)) > LEVEL.force + 0.3


def test_docking_helps() -> None:
    """The feet's friction carries what free flight has to make with the rotors alone."""
    free = build_docked(changed(docking={"friction": 1e-6, "foot_load_n": 0.0}))
    assert compute_docked_press(free, find_stance(free)).force < LEVEL.force - 1.0


def test_servos_and_slider_can_be_the_limit() -> None:
    data = ROBOT.model_dump()
    for servo in data["arm"]["servos"].values():
        servo["stall_torque_nm"] = 0.5
    weak = build_docked(Robot(**data))
    found = compute_docked_press(weak, find_stance(weak))
    assert found.limit == "servos"
    # shoulder 0.15 m behind the tip: the elbow part (0.04 + 0.07 kg) hangs on it too
    assert found.force == pytest.approx(
        (0.5 - 9.81 * (0.06 * 0.075 + 0.11 * 0.15)) / 0.15, rel=1e-2
    )
    short = build_docked(changed(probe={"spring_travel_m": 0.003}))
    found = compute_docked_press(short, find_stance(short))
    assert found.limit == "slider" and found.force == pytest.approx(0.003 * 1205, rel=1e-6)


def test_too_steep_is_told() -> None:
    found = compute_docked_press(DOCKED, STANCE, slope=math.radians(40))
    assert math.isnan(found.force) and found.limit == "cannot stay docked"


@pytest.mark.parametrize(
    ("contact", "said"),
    [((0.5, 0.0), "does not reach"), ((0.2, 0.1), "does not reach"), ((0.08, 0.0), "inclined"),
     ((math.nan, 0.0), "finite")],
)  # fmt: skip
def test_contact_points_out_of_reach(contact: tuple[float, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        find_stance(DOCKED, contact)


def test_feet_are_as_stiff_as_the_file_says() -> None:
    """The plant, pushed up against a ceiling with 20 N: 1 mm over four feet of 5000 N/m."""
    robot = strip_robot(ROBOT).model_copy(update={"docking": ROBOT.docking})
    assert robot.docking is not None
    height, push = 2.0, 20.0
    bottom = height + robot.docking.height_m
    deck = Box(x_m=0.0, y_m=0.0, z_m=bottom + 0.1, size_x_m=2.0, size_y_m=2.0, size_z_m=0.2)
    world = load_world("open")[0].add_thing("deck", deck)
    scene = build_scene(robot, world, Deviation())
    data = mujoco.MjData(scene.model)
    set_pose(scene, data, np.array([0, 0, height]), np.array([1.0, 0, 0, 0]), np.zeros(0))
    mass, _, _ = compute_body(build_body_model(robot), np.zeros(0))
    data.xfrc_applied[scene.places.platform_body, 2] = mass * 9.81 + push
    rise = np.zeros(1000)
    for i in range(len(rise)):
        mujoco.mj_step(scene.model, data)
        rise[i] = data.qpos[2] - height
    # a mass on a spring with a damper: overshoot exp(-pi z / sqrt(1 - z^2)) after half a period
    k, z = 4 * 5000.0, 4 * 50.0 / (2 * math.sqrt(4 * 5000.0 * mass))
    assert rise.max() / rise[-1] - 1 == pytest.approx(
        math.exp(-math.pi * z / math.sqrt(1 - z * z)), rel=0.2
    )
    half = math.pi / math.sqrt(k / mass * (1 - z * z))
    assert 1e-3 * (np.argmax(rise) + 1) == pytest.approx(half, rel=0.1)
    at = scene.places.sensor_docking
    assert abs(data.sensordata[at + 2]) == pytest.approx(push, rel=1e-3)
    assert data.qpos[2] - height == pytest.approx(push / (4 * 5000.0), rel=0.02)
    assert abs(data.qvel[2]) < 1e-4  # the rubber has damped it
    for address in scene.places.sensor_collision:
        assert np.all(data.sensordata[address : address + 3] == 0.0)  # docking is no collision
    # a sideways load below the friction is held for good (the gear tilts a little under it)
    data.xfrc_applied[scene.places.platform_body, 0] = 4.0
    places = []
    for i in range(3000):
        mujoco.mj_step(scene.model, data)
        if i % 1000 == 999:
            places.append(data.qpos[0])
    assert abs(places[-1] - places[0]) < 5e-5


def test_gear_is_part_of_the_mass() -> None:
    """Stated flying mass 2.50 kg, centre of mass at the origin with the arm folded."""
    mass, com, _ = compute_body(build_body_model(ROBOT), posture(ROBOT, "folded"))
    assert mass == pytest.approx(2.50, abs=1e-9)
    np.testing.assert_allclose(com, 0.0, atol=1e-4)


def test_arm_convention_of_the_paper() -> None:
    """(24): the slider pushes along (sin, 0, cos)(gamma_1 - gamma_2), the elbow is at gamma_1."""
    from skywright.models.rigid_body import compute_tip

    g1, g2 = math.radians(61.0), math.radians(55.0)
    tip, R = compute_tip(build_body_model(ROBOT), np.array([g1 - math.pi / 2, -g2]))
    way = np.array([math.sin(g1 - g2), 0.0, math.cos(g1 - g2)])
    np.testing.assert_allclose(R[:, 2], way, atol=1e-12)
    elbow = np.array([0.05 + 0.25 * math.sin(g1), 0.0, 0.05 + 0.25 * math.cos(g1)])
    np.testing.assert_allclose(tip, elbow + 0.20 * way, atol=1e-12)


# --- the sweep ---


def test_sweep_passes_through_the_robot_itself() -> None:
    bare = strip_robot(ROBOT)
    sweep = compute_tilt_sweep(bare)
    at = 20
    own = compute_capability(bare, directions_deg=[0.0, 90.0, 180.0, 270.0])
    np.testing.assert_allclose(sweep.lateral_force[at], own.lateral_force, atol=1e-9)
    np.testing.assert_allclose(sweep.hover_tilt[at], own.hover_tilt, atol=1e-9)
    assert sweep.hover_power[at] == pytest.approx(own.hover_power)
    assert sweep.payload[at] == pytest.approx(own.payload)
    # parallel rotors make no lateral force and hover cheapest
    np.testing.assert_allclose(sweep.lateral_force[0], 0.0, atol=1e-9)
    assert np.all(np.diff(sweep.hover_power) > 0) and np.all(np.diff(sweep.payload) < 0)
    # each rotor's vertical share is cos^2: power grows with its -3/2 power
    avionics = ROBOT.battery.avionics_power_w
    ratio = (sweep.hover_power[30] - avionics) / (sweep.hover_power[0] - avionics)
    assert ratio == pytest.approx(math.cos(math.radians(30)) ** -3, rel=1e-9)


def test_a_sweep_has_no_values_where_rotors_cannot_control() -> None:
    """Without tilts all rotors of this robot turn the same way: yaw cannot be controlled."""
    sweep = compute_tilt_sweep(load_robot("omnicopter")[0])
    assert np.isnan(sweep.lateral_force[0]).all() and np.isfinite(sweep.lateral_force[30:]).any()


def test_a_preload_is_part_of_the_thrusts_of_a_docked_robot() -> None:
    gear, omni = load_robot("f550-bridge")[0], load_robot("omnicopter")[0]
    layout = build_docked(gear.model_copy(update={"rotors": omni.rotors})).layout
    assert np.min(layout.t_min) >= 0.0 and not np.any(layout.preload)
    assert np.max(layout.t_max) == pytest.approx(
        omni.rotors.thrust_fraction * omni.rotors.thrust_max_n
    )


def test_sweep_needs_a_tilt() -> None:
    with pytest.raises(InputError, match="parallel rotors"):
        tilt_rotors(load_robot("hexarotor")[0], 0.1)


# --- the command line ---


def call(*args: str) -> Any:
    return CliRunner().invoke(main, ["capability", *args])


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("f550-bridge", "--slope", "5"), "--slope applies to --docked only"),
        (("f550-bridge", "--wind-toward", "5"), "--wind-toward applies to --wind only"),
        (("f550-bridge", "--docked", "--slope", "95"), "below 90"),
        (("f550-bridge", "--docked", "--slope", "nan"), "--slope nan"),
        (("f550-bridge", "--docked", "--wind", "-1"), "--wind -1"),
        (("f550-bridge", "--docked", "--wind-toward", "inf"), "finite angle"),
        (("f550-bridge", "--docked", "--contact", "here"), "two numbers X,Y"),
        (("f550-bridge", "--docked", "--contact", "1,nan"), "two numbers X,Y"),
        (("f550-bridge", "--docked", "--contact", "0.5,0"), "does not reach"),
        (("f550-bridge", "--docked", "--posture", "folded"), "exclude each other"),
        (("f550-bridge", "--docked", "--sweep", "tilt"), "exclude each other"),
        (("f550-bridge", "--docked", "--bare"), "no docking gear"),
        (("hexarotor", "--docked"), "no docking gear"),
        (("hexarotor", "--sweep", "tilt"), "parallel rotors"),
        (("f550-bridge", "--sweep", "spin"), "tilt"),
        (("f550-bridge", "--sweep", "tilt", "--wind", "2"), "--wind and --sweep exclude"),
        (("f550-bridge", "--sweep", "tilt", "--posture", "worst"), "extended, folded"),
    ],
)
def test_bad_input(args: tuple[str, ...], said: str, tmp_path: Path) -> None:
    result = call(*args, "--out", str(tmp_path / "x.png"))
    assert result.exit_code == 2
    assert said in result.output + result.stderr and "Traceback" not in result.output
    assert not (tmp_path / "x.png").exists()


def test_a_wind_leaves_less_tilt(tmp_path: Path) -> None:
    """From anywhere it is the least of all directions; beyond what can be held there is none."""
    found = {}
    for args in (["--wind", "2"], ["--wind", "2", "--wind-toward", "90"], ["--wind", "20"]):
        result = call("f550-bridge", *args, "--json")
        assert result.exit_code == 0, result.output
        found[" ".join(args)] = json.loads(result.output)
    worst, side, storm = found.values()
    assert worst["hover_tilt_in_wind_deg"] <= side["hover_tilt_in_wind_deg"]
    assert side["hover_tilt_in_wind_deg"] < min(side["hover_tilt_deg"].values())
    assert storm["hover_tilt_in_wind_deg"] is None
    told = call("f550-bridge", "--wind", "2", "--out", str(tmp_path / "x.png"))
    assert f"{worst['hover_tilt_in_wind_deg']:.1f} deg" in told.output


def test_docked_json_and_picture(tmp_path: Path) -> None:
    picture = tmp_path / "docked.png"
    args = ("--slope", "5", "--slope-toward", "90", "--contact", "0.2,0", "--json")
    result = call("f550-bridge", "--docked", *args, "--out", str(picture))
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    direct = compute_docked_press(
        DOCKED, STANCE, slope=math.radians(5), slope_toward=math.radians(90)
    )
    assert found["force_n"] == pytest.approx(direct.force, abs=1e-3)
    assert found["condition"]["slope_toward_deg"] == pytest.approx(90)
    assert found["worst_force_n"][0][0] == pytest.approx(LEVEL.force, abs=1e-3)
    assert found["resolution"]["smallest_force_n"] == pytest.approx(0.277, abs=0.005)
    assert picture.stat().st_size > 20_000


def test_sweep_json(tmp_path: Path) -> None:
    result = call(
        "f550-bridge", "--bare", "--sweep", "tilt", "--json", "--out", str(tmp_path / "s.svg")
    )
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["tilt_deg"][20] == 20.0 and found["mass_kg"] == pytest.approx(2.0)
    assert found["lateral_force_n"]["0"][20] / 9.81e-3 == pytest.approx(415, rel=0.01)
    assert (tmp_path / "s.svg").is_file()
