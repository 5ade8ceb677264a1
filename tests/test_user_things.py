"""Things from a user's file: a hand wheel, and files that are wrong."""

from __future__ import annotations

import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from skywright.description.dump import dump_description
from skywright.description.loader import Description, load_description
from skywright.description.world.things import locate_thing
from skywright.errors import InputError
from skywright.models.arm_body import Deviation
from skywright.models.scene import build_scene
from skywright.run.backends import build_vehicle
from skywright.run.check import check_file

WHEEL = Path(__file__).parent.parent / "examples" / "hand_wheel.py"
WORLD = """
[world]
name = "valve"

[world.things.wheel]
kind = "hand_wheel.py:HandWheel"
x_m = 1.5
y_m = 0.0
z_m = 1.2
diameter_m = { value = 0.4, source = "assumed", range = [0.2, 0.6] }
"""


@pytest.fixture
def world(tmp_path: Path) -> Path:
    shutil.copy(WHEEL, tmp_path)
    file = tmp_path / "world.toml"
    file.write_text(WORLD)
    return file


def load(world: Path, *sets: str) -> Description:
    return load_description("waypoints", robot="hexarotor", world=world, sets=sets)


def test_a_wheel_turns_by_the_torque_on_its_knob_and_stops(world: Path) -> None:
    """It breaks loose above the friction of its stem and stops after its turns."""
    d = load(world, "world.things.wheel.friction_nm=0.4", "world.things.wheel.turns=0.25")
    scene = build_scene(d.robot, d.world, Deviation())
    model, data = scene.model, mujoco.MjData(scene.model)
    joint, body = model.joint("wheel rim"), model.body("wheel rim").id
    mujoco.mj_forward(model, data)
    # closed, the knob stands straight up, 4 cm before the wheel
    knob = model.geom("wheel knob").id
    np.testing.assert_allclose(
        data.geom_xpos[knob], locate_thing(d.world.things, "wheel").p + [-0.04, 0.0, 0.2], atol=1e-9
    )
    ways = []
    for torque in (0.1, 0.45):
        data.xfrc_applied[body, 3] = -torque  # the hinge's axis is W's -x
        mujoco.mj_step(model, data, 1500)
        ways.append(float(data.qpos[joint.qposadr[0]]))
    assert abs(ways[0]) < 0.02 and 0.1 < ways[1] < 0.5 * np.pi + 0.05
    mujoco.mj_step(model, data, 6000)
    assert float(data.qpos[joint.qposadr[0]]) == pytest.approx(0.5 * np.pi, abs=0.05)
    data.xfrc_applied[body, 3] = 0.0


def test_a_run_directory_repeats_it_and_check_knows_its_keys(world: Path, tmp_path: Path) -> None:
    d = load(world, "world.things.wheel.mass_kg=0.7")
    again = tmp_path / "again.toml"
    again.write_text(dump_description(d))
    assert load_description(again).world == d.world
    report = check_file(str(world))
    assert report.valid and any("world.things.wheel.diameter_m" in n for n in report.notes)
    world.write_text(WORLD + "diameter_mm = 3\n")
    report = check_file(str(world))
    assert not report.valid and "the key is diameter_m (in metres)" in report.problems[0]
    with pytest.raises(InputError, match=r"unknown key world.things.wheel.mas"):
        load(world, "world.things.wheel.mas=1")


def test_its_wheel_keeps_its_mass_whatever_its_name(world: Path) -> None:
    """Fixed parts of the plant weigh nothing: bodies `fixed NAME`."""
    world.write_text(WORLD.replace("things.wheel", "things.fixed"))
    d = load(world)
    model = build_scene(d.robot, d.world, Deviation()).model
    assert model.body("fixed rim").mass[0] > 0.1 and model.body("fixed fixed").mass[0] == 0.0


def test_a_robot_flies_beside_it(world: Path) -> None:
    """Blown against by nothing, it stays; the robot hits it and that counts as a collision."""
    vehicle = build_vehicle(load(world))
    for _ in range(50):
        vehicle.tick()
    assert vehicle.t == pytest.approx(1.0)
    at = int(vehicle.scene.model.joint("wheel rim").qposadr[0])
    assert abs(float(vehicle.sim.qpos[at])) < 0.02


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (
            "import nothing_of_that_name\n",
            r"importing .*hand_wheel.py failed.*nothing_of_that_name",
        ),
        ("class HandWheel:\n    pass\n", "a thing is needed; HandWheel"),
        ("x = 1\n", "has no class 'HandWheel'"),
        ("class HandWheel(:\n", "SyntaxError.*line 1"),
    ],
)
def test_a_wrong_file_is_told(world: Path, text: str, found: str) -> None:
    (world.parent / "hand_wheel.py").write_text(text)
    with pytest.raises(InputError, match=found):
        load(world)


BASE = """
from skywright.description.world.thing import Part, Placed, Solid


class HandWheel(Placed):
    diameter_m: float = 0.3

    @property
    def movable(self):
        return True

    def list_parts(self):
        return [Part([Solid("sphere", [RADIUS])])]
"""


@pytest.mark.parametrize(
    ("radius", "found"),
    [
        ("0.1", "is movable and requires a mass"),
        ("float('nan')", "has non-finite values"),
        ("1 / 0", r"ZeroDivisionError.*line 13 of hand_wheel.py"),
    ],
)
def test_a_thing_that_cannot_be_built_is_told(world: Path, radius: str, found: str) -> None:
    (world.parent / "hand_wheel.py").write_text(BASE.replace("RADIUS", radius))
    with pytest.raises(InputError, match=found):
        load(world)
