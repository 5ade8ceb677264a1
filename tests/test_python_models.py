"""Robot, model and plan of the Python API: capability, MJCF, a motion among own shapes."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest

import skywright
from skywright.errors import InfeasibleError, InputError
from skywright.models import as_mujoco
from skywright.models.rigid_body import build_body_model, compute_body, posture


@pytest.mark.parametrize("nominal", [False, True])
def test_the_model_as_text_is_the_model_that_flies(nominal):
    text = skywright.build_mjcf("othex", "pipe", nominal=nominal)
    read, built = mujoco.MjModel.from_xml_string(text), skywright.build_model(
        "othex", "pipe", nominal=nominal
    )  # fmt: skip
    names = ("nq", "nv", "nu", "ngeom", "npair", "nsensor")
    assert [getattr(read, n) for n in names] == [getattr(built, n) for n in names]
    robot = skywright.load_robot("othex")
    mass = compute_body(build_body_model(robot, 9.81), posture(robot, "folded"))[0]
    assert sum(read.body_mass) == pytest.approx(mass, rel=1e-9)
    np.testing.assert_allclose(
        read.body_inertia, built.body_inertia, rtol=1e-5, atol=1e-12
    )  # six digits
    assert (built.geom_contype.any() or built.npair > 0) is not nominal


def test_the_text_has_the_stiffness_of_docking_feet():
    """The feet's stiffness follows from the compiled model: every array must be in the text."""
    built = skywright.build_model("f550-bridge")
    read = mujoco.MjModel.from_xml_string(skywright.build_mjcf("f550-bridge"))
    assert built.geom_solref.min() < -1000.0
    for name in (n for n in dir(built) if not n.startswith("_")):
        values = getattr(built, name)
        if isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
            np.testing.assert_allclose(
                getattr(read, name), values, rtol=1e-4, atol=1e-8, err_msg=name
            )


def test_sizes_that_mujoco_refuses_are_wrong_input(monkeypatch):
    def build_wrong(*_):
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(name="dot", size=[0.0, 0.0, 0.0])
        return spec

    monkeypatch.setattr(as_mujoco, "build_spec", build_wrong)
    with pytest.raises(InputError, match=r"robot 'othex' in world 'open': .*size"):
        skywright.build_mjcf("othex")


BOX = skywright.Box(centre=(2.0, 0.0, 1.0), size=(0.2, 2.0, 2.0))


def distance_to_box(p):
    return np.linalg.norm(np.maximum(np.abs(p - [2.0, 0.0, 1.0]) - [0.1, 1.0, 1.0], 0.0))


def test_a_motion_goes_around_ones_own_shapes():
    ends = ((0.0, 0.0, 1.0, 0.0), (4.0, 0.0, 1.0, 1.0))
    free = skywright.plan_motion("hexarotor", *ends)
    assert len(free.p_WB) == 2 and free.yaw[-1] == pytest.approx(1.0)
    way = skywright.plan_motion("hexarotor", *ends, [BOX], margin=0.2)
    assert len(way.p_WB) > 2 and way.clearance >= 0.2
    points = np.concatenate([np.linspace(a, b, 50) for a, b in zip(way.p_WB, way.p_WB[1:])])  # noqa: B905
    assert min(map(distance_to_box, points)) >= 0.2
    again = skywright.plan_motion("hexarotor", *ends, [BOX], margin=0.2)
    np.testing.assert_array_equal(way.p_WB, again.p_WB)


def test_a_motion_into_a_shape_is_refused_with_its_name():
    with pytest.raises(InfeasibleError, match="shape 0") as caught:
        skywright.plan_motion("hexarotor", (0.0, 0.0, 1.0, 0.0), (2.0, 0.0, 1.0, 0.0), [BOX])
    assert caught.value.blocked_by.startswith("goal")
    assert caught.value.blocked_by.endswith("overlap; required distance: 0.1 m")


def test_of_several_shapes_the_one_that_the_robot_is_in_overlaps():
    """The start is 5 cm from shape 0 and inside shape 1."""
    ends = ((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 9.0, 0.0))
    below = skywright.Box((0.0, 0.0, 0.1), (9.0, 9.0, 0.2))
    with pytest.raises(InfeasibleError) as caught:
        skywright.plan_motion("hexarotor", *ends, [below], margin=1.0)
    gap = float(re.search(r"shape 0 \(box\) are (\S+) m apart", caught.value.blocked_by)[1])
    near = below._replace(centre=(0.0, 0.0, 0.1 + gap - 0.05))
    with pytest.raises(InfeasibleError, match=r"start: .* shape 0 \(box\) are 0\.05\d m apart"):
        skywright.plan_motion("hexarotor", *ends, [near])
    around = skywright.Sphere((0.0, 0.0, 1.0), 0.02)
    with pytest.raises(InfeasibleError, match=r"start: .* shape 1 \(sphere\) overlap"):
        skywright.plan_motion("hexarotor", *ends, [near, around])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"shapes": [skywright.Sphere((0.0, 0.0, 1.0), -1.0)]}, "shape 0: Sphere"),
        ({"shapes": [skywright.Box((0.0, 0.0), (1.0, 1.0, 1.0))]}, "shape 0: Box"),
        ({"shapes": [skywright.Box((9.0, 0.0, 1.0), (1.0, 1.0, 1.0), -np.eye(3))]}, "a rotation"),
        ({"shapes": [skywright.Box((9.0, 0.0, 1.0), (1.0, 1.0, 1.0), None)]}, "Box.R_W = None; "),
        ({"shapes": [skywright.Box((9.0, 0.0, 1.0), (1.0, -2.0, 1.0))]}, r"Box.size = \(1.0, -2.0"),
        ({"shapes": [skywright.Box((9.0, 0.0, 1.0), (1.0, 0.0, 1.0))]}, r"Box.size = \(1.0, 0.0"),
        ({"shapes": [skywright.Cylinder((9.0, 0, 1), (9, 0, 1), 0.1)]}, "Cylinder.end = .*start"),
        ({"shapes": [skywright.Cylinder((9.0, 0, 1), (9, 0, 2), 0.0)]}, "Cylinder.radius = 0.0"),
        ({"shapes": BOX}, "shapes: one Box; valid: a list"),
        ({"shapes": [skywright.Sphere((9.0, 0.0, 1.0), 0.1)] * 200}, "200 shapes"),
        ({"goal": (1.0, 2.0, 3.0)}, "goal: .* four numbers"),
        ({"goal": (np.nan, 0.0, 1.0, 0.0)}, "goal: .* finite"),
        ({"goal": skywright.Configuration(np.ones(3), 0.0, np.zeros(5))}, "q has 5 angles"),
        ({"margin": 0.0}, "margin 0"),
        ({"margin": "1"}, "margin '1'"),
        ({"seed": -1}, "seed -1"),
        ({"seed": 1.5}, "seed 1.5"),
        ({"shapes": None}, "shapes: None"),
        ({"start": "home"}, "start: 'home'; .* four numbers"),
        ({"start": ["0", "0", "1", "0"]}, "start: .* four numbers"),
        ({"goal": [[1.0], [1.0, 2.0]]}, "goal: .* four numbers"),
        ({"goal": skywright.Configuration(np.ones(3), 0.0, "abc")}, "q = 'abc'; valid: 0 angles"),
        ({"goal": skywright.Configuration("abc", 0.0, [])}, "goal: .* three numbers"),
        ({"goal": skywright.Configuration(np.ones(3), "east", [])}, "goal: .* yaw a number"),
        ({"goal": (1e12, 0.0, 1.0, 0.0)}, "goal: .* within 1000 m"),
        ({"robot": "othexx"}, "othex"),
    ],
)
def test_a_scene_that_is_none_is_refused(change, words):
    case = {"robot": "hexarotor", "start": (0.0, 0.0, 1.0, 0.0), "goal": (1.0, 0.0, 1.0, 0.0)}
    with pytest.raises(InputError, match=words):
        skywright.plan_motion(**{**case, **change})


@pytest.mark.parametrize(
    ("load", "given", "first"),
    [
        ("load_robot", ["othex"], {}),
        ("load", ["waypoints"], {}),
        ("fly", [], {"robot": "othex"}),
        ("campaign", ["waypoints", 2, {}], {}),
    ],
)
def test_a_wrong_key_names_the_argument_that_holds_it(load, given, first):
    give = getattr(skywright, load)
    with pytest.raises(InputError, match=r"^sets: unknown key robot\.battery\.mass_kg; valid: "):
        give(*given, **first, sets={"robot.battery.mass_kg": 1})
    with pytest.raises(InputError, match=r"^(--set|sets): unknown key robot\.battery\.mass_kg"):
        give(*given, **first, sets=["robot.battery.mass_kg=1"])  # as on the command line


def test_the_wind_limit_of_a_coplanar_robot_is_that_of_the_best_tilt():
    can = skywright.compute_capability("hexarotor")
    np.testing.assert_allclose(can.lateral_force, 0.0, atol=1e-9)
    np.testing.assert_array_equal(can.wind_limit, can.wind_limit_tilted)
    assert can.wind_limit.min() > 5.0
    tilted = skywright.compute_capability("othex")
    assert np.all(tilted.wind_limit_tilted > tilted.wind_limit)


def test_a_capability_takes_a_name_or_a_robot():
    heavy = skywright.load_robot("hexarotor", sets=["robot.platform.mass_kg=8"])
    light = skywright.compute_capability("hexarotor")
    assert skywright.compute_capability(heavy).payload < light.payload


@pytest.mark.parametrize("posture", [["a", "b"], [[0.0], [0.0, 1.0]], None])
def test_a_posture_that_is_none_is_refused(posture):
    with pytest.raises(InputError, match=r"posture .*; valid: .* 2 angles"):
        skywright.compute_capability("othex", posture=posture)
