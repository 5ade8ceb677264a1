"""Movable things, the bench that clamps a platform, tape, and robots in long reach."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skywright.core.record import Array, View
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.compliant_arms import compute_gravity_torque, find_swing
from skywright.models.drawing import build_drawing, compute_part_poses, list_object_poses
from skywright.models.rigid_body import build_body_model, posture
from skywright.run.run import build_vehicle
from skywright.vehicle.arms.truth import HandTruth, TapePull
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.effects.tape import Tape
from skywright.vehicle.simulated import SimulatedVehicle

BENCH = {
    "world.bench": {"z_m": 1.3},
    "world.objects": {
        "box": {"size_x_m": 0.1, "size_y_m": 0.2, "size_z_m": 0.1, "mass_kg": 0.3,
                "x_m": 0.6, "y_m": 0.0, "z_m": 0.06},
        "plug": {"shape": "cylinder", "size_x_m": 0.04, "size_z_m": 0.1, "mass_kg": 0.2,
                 "x_m": 0.6, "y_m": 0.5, "z_m": 0.8, "held_n": 2.0},
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def bench() -> tuple[SimulatedVehicle, list[np.ndarray]]:
    """The dual arm on a bench, a box on the ground and a plug in the air, one second on."""
    blocks: list[np.ndarray] = []
    vehicle = build_vehicle(
        load_description("waypoints", robot="bimanual", sets=BENCH), blocks.append
    )
    for _ in range(50):
        vehicle.tick()
    return vehicle, blocks


def test_things_fall_and_plugs_stay(
    bench: tuple[SimulatedVehicle, list[np.ndarray]],
) -> None:
    vehicle, blocks = bench
    vehicle.flush()
    last = np.concatenate(blocks)[-1]
    np.testing.assert_allclose(last["object0_p_WO"], [0.6, 0.0, 0.05], atol=1e-3)
    np.testing.assert_allclose(last["object1_p_WO"], [0.6, 0.5, 0.8], atol=1e-3)
    np.testing.assert_allclose(last["p_WB"], [0.0, 0.0, 1.3], atol=1e-3)
    drawing = build_drawing(vehicle.robot, vehicle.world)
    one = last[None] if last.ndim == 0 else last
    poses = compute_part_poses(
        drawing, one["p_WB"], one["q_WB"], one["q"], one["spring"], list_object_poses(one)
    )
    names = [part.name for part in drawing.parts]
    np.testing.assert_allclose(poses[names.index("object box")][0][0], last["object0_p_WO"])


def test_a_pulled_plug_comes_free(bench: tuple[SimulatedVehicle, list[np.ndarray]]) -> None:
    """Contact with more than `held_n` frees it: the box, laid on it, weighs 2.9 N."""
    vehicle, _ = bench
    data, model = vehicle.sim.data, vehicle.scene.model
    at = int(model.joint("object box").qposadr[0])
    data.qpos[at : at + 3] = [0.6, 0.5, 0.91]
    for _ in range(40):
        vehicle.tick()
    plug = int(model.joint("object plug").qposadr[0])
    assert data.qpos[plug + 2] < 0.7


def test_the_bench_moves_the_platform(
    bench: tuple[SimulatedVehicle, list[np.ndarray]],
) -> None:
    vehicle, _ = bench
    vehicle.move_bench(np.array([0.02, 0.0, 1.3]), 0.1)
    for _ in range(50):
        vehicle.tick()
    np.testing.assert_allclose(vehicle.sim.qpos[:3], [0.02, 0.0, 1.3], atol=1e-3)
    assert 2.0 * math.asin(vehicle.sim.qpos[6]) == pytest.approx(0.1, abs=1e-3)


def test_wrong_things_are_told() -> None:
    for key, value, found in (
        ("world.objects", {"b": {"size_x_m": 1.0, "size_z_m": 1.0, "mass_kg": 1.0, "x_m": 0.0,
                                 "y_m": 0.0, "z_m": 1.0}}, "size_y_m"),
        ("world.objects", {str(i): {"shape": "cylinder", "size_x_m": 1.0, "size_z_m": 1.0,
                                    "mass_kg": 1.0, "x_m": 0.0, "y_m": 0.0, "z_m": 1.0}
                           for i in range(5)}, "objects"),
        ("world.bench", {"z_m": -1.0}, "z_m"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=found):
            load_description("waypoints", sets={key: value})
    vehicle = build_vehicle(load_description("waypoints"))
    with pytest.raises(InputError, match="no bench"):
        vehicle.move_bench(np.zeros(3))
    with pytest.raises(InputError, match="no body 'wing'"):
        vehicle.push("wing", np.zeros(3))


def test_the_passive_link_rests_where_gravity_has_no_lever() -> None:
    robot, _ = load_robot("bimanual-longreach")
    model = build_body_model(robot)
    q = find_swing(model, posture(robot, "working"))
    assert abs(compute_gravity_torque(model, q)[0]) < 1e-9
    assert 0.0 < math.degrees(q[0]) < 10.0  # forearms forward: the link swings back


@pytest.mark.parametrize(("seconds", "parted"), [(5.0, 1), (0.1, 2)])
def test_tape_holds_what_was_pressed_on(seconds: float, parted: int) -> None:
    """Pressed for long the holder lets go first; hardly pressed, the bond."""
    tape, hands, clock, mj, out = (
        View(np.zeros(1, r.dtype)[0]) for r in (Tape.Me, HandTruth, Clock, MuJoCo, TapePull)
    )
    xfrc = np.zeros((1, 6))
    tape.strength, tape.press, tape.release, tape.stiffness = 5.0, 4.0, 1.0, 1000.0
    clock.dt, mj.xfrc, mj.nbody = 0.002, xfrc.ctypes.data, 1
    p, up = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])

    def step(place: Array, force: Array) -> None:
        xfrc[:], hands.p_WH[0], hands.f_WH[0] = 0.0, place, force
        Tape.step(tape, clock, hands, mj, out)

    for _ in range(round(seconds / 0.002)):
        step(p, 2.0 * up)
    bond = 5.0 * (1.0 - math.exp(-2.0 * seconds / 4.0))
    assert tape.bond == pytest.approx(bond, rel=1e-6)
    pulls = []
    for i in range(40):
        step(p - 1e-4 * i * up, -out.pull * up)
        pulls.append(float(xfrc[0, 2]))
    assert tape.parted == parted
    assert max(pulls) == pytest.approx(min(bond, 1.0), abs=0.11)  # a step of 0.1 mm is 0.1 N
    assert pulls[-1] == 0.0
