"""Movable things, the bench that clamps a platform, tape, and robots in long reach."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from skywright.core.record import Array, View
from skywright.core.rotations import rot_z
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.world.things import find_carrier, locate_thing
from skywright.errors import InputError
from skywright.models.arm_body import Deviation
from skywright.models.compliant_arms import compute_gravity_torque, find_swing
from skywright.models.drawing import build_drawing, compute_part_poses, list_object_poses
from skywright.models.rigid_body import build_body_model, posture
from skywright.models.scene import build_scene
from skywright.run.backends import build_vehicle
from skywright.vehicle.arms.truth import HandTruth, TapePull
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.devices import Bench, Helper
from skywright.vehicle.effects.tape import Tape
from skywright.vehicle.simulated import SimulatedVehicle

BOX = {"kind": "box", "size_x_m": 0.1, "size_y_m": 0.2, "size_z_m": 0.1,
       "x_m": 0.6, "y_m": 0.0, "z_m": 0.06}  # fmt: skip
PLUG = {"kind": "cylinder", "moves": True, "diameter_m": 0.04, "length_m": 0.1, "mass_kg": 0.2,
        "x_m": 0.6, "y_m": 0.5, "z_m": 0.8, "held_n": 2.0}  # fmt: skip
BENCH = {
    "world.things": {
        "bench": {"kind": "bench", "z_m": 1.3},
        "box": {**BOX, "moves": True, "mass_kg": 0.3},
        "plug": PLUG,
    },
}


@pytest.fixture(scope="module")
def built() -> tuple[SimulatedVehicle, list[np.ndarray], Any]:
    """The dual arm on a bench, a box on the ground and a plug in the air, and their state."""
    blocks: list[np.ndarray] = []
    vehicle = build_vehicle(
        load_description("waypoints", robot="bimanual", sets=BENCH), blocks.append
    )
    for _ in range(50):
        vehicle.tick()
    return vehicle, blocks, vehicle.save()


@pytest.fixture
def bench(
    built: tuple[SimulatedVehicle, list[np.ndarray], Any],
) -> tuple[SimulatedVehicle, list[np.ndarray]]:
    """One second on."""
    vehicle, blocks, state = built
    vehicle.restore(state)
    return vehicle, blocks


def test_a_bench_named_like_a_part_of_the_robot_is_refused() -> None:
    d = load_description("bimanual-bench", sets=["world.things.gear.kind=bench"])
    with pytest.raises(InputError, match=r"world\.things\.gear: .* has the name of another part"):
        build_scene(d.robot, d.world, Deviation())


@pytest.mark.parametrize("name", ["ground", "pipe", "tip"])
@pytest.mark.parametrize("plant", [None, Deviation()])
def test_a_thing_named_like_another_part_is_refused(name: str, plant: Deviation | None) -> None:
    d = load_description(
        "pipe-weld-scan", sets=[f"world.things.{name}.{k}={v}" for k, v in BOX.items()]
    )
    with pytest.raises(
        InputError, match=rf"world\.things\.{name}: {name!r} .* has the name of another part"
    ):
        build_scene(d.robot, d.world, plant)


def test_things_fall_and_plugs_stay(
    bench: tuple[SimulatedVehicle, list[np.ndarray]],
) -> None:
    vehicle, blocks = bench
    vehicle.tick()
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
    vehicle.devices.bench.move(np.array([0.02, 0.0, 1.3]), 0.1)
    for _ in range(50):
        vehicle.tick()
    np.testing.assert_allclose(vehicle.sim.qpos[:3], [0.02, 0.0, 1.3], atol=1e-3)
    assert 2.0 * math.asin(vehicle.sim.qpos[6]) == pytest.approx(0.1, abs=1e-3)


WRONG = [
    ({"b": {"kind": "box", "size_x_m": 1.0}}, "size_y_m"),
    ({"b": {"kind": "box", "size_x_m": 1.0, "size_y_m": 1.0, "size_z_m": 1.0}}, "lacks x_m"),
    ({str(i): PLUG for i in range(5)}, "at most 4 movable things"),
    ({"b": {"kind": "bench", "z_m": -1.0}}, "z_m"),
    ({"b": {"kind": "bench", "yaw_deg": 30.0}}, "yaw_deg is 30; valid: 0"),
    ({"b": {"kind": "bench", "on": "c"}, "c": BOX}, "on is 'c'; valid for a bench: a position"),
    ({"b": {**BOX, "moves": True}}, "requires mass_kg"),
    ({"b": {**BOX, "z_m": math.nan}}, "finite"),
    ({"b": {**BOX, "mas_kg": 1.0}}, "unknown key world.things.b.mas_kg; valid: .*mass_kg"),
    ({"b": {**BOX, "kind": "bxo"}}, "thing 'bxo' is unknown; valid: .*box"),
    ({"b": {k: v for k, v in BOX.items() if k != "kind"}}, "is not a thing; valid: .*box"),
    ({"b": {**BOX, "on": "c"}}, "things.b.on = 'c' is not a thing of this world"),
    ({"b": {**BOX, "on": "b"}}, "things.b stands on itself: b on b"),
    ({"b": {**BOX, "on": "c"}, "c": {**BOX, "on": "b"}}, "on itself: b on c on b"),
    ({"b": {**BOX, "on": "c.side"}, "c": BOX}, "no frame 'side'; valid: origin, top, front"),
    ({"b": {**BOX, "on": "t"}, "t": {"kind": "tape"}}, "a tape has no pose"),
]


@pytest.mark.parametrize(("things", "found"), WRONG)
def test_wrong_things_are_refused(things: dict[str, object], found: str) -> None:
    with pytest.raises(InputError, match=found):
        load_description("waypoints", sets={"world.things": things})


def test_what_a_world_lacks_is_told() -> None:
    vehicle = build_vehicle(load_description("waypoints"))
    with pytest.raises(InputError, match="no bench"):
        vehicle.devices.bench.move(np.zeros(3))
    with pytest.raises(InputError, match="unknown body 'wing'"):
        vehicle.devices.helper.push("wing", np.zeros(3))
    with pytest.raises(InputError, match="has no 'socket' that can be surveyed"):
        vehicle.devices.surveyor.survey("socket")
    with pytest.raises(InputError, match="has no force plates"):
        vehicle.devices.gauges.zero()


def test_a_thing_stands_where_what_it_is_on_stands() -> None:
    """A turned table, a crate on it, a marker on the crate: worked out by hand."""
    things = {
        "table": {**BOX, "yaw_deg": 90.0, "z_m": 0.5},
        "crate": {**BOX, "on": "table", "x_m": 0.1, "y_m": 0.0, "z_m": 0.0, "yaw_deg": 30.0,
                  "moves": True, "mass_kg": 0.1},
        "marker": {"kind": "marker", "on": "crate.front", "z_m": 0.01},
    }  # fmt: skip
    world = load_description("waypoints", sets={"world.things": things}).world
    p, R = locate_thing(world.things, "crate")
    np.testing.assert_allclose(p, [0.6, 0.1, 0.6], atol=1e-12)
    np.testing.assert_allclose(R, rot_z(math.radians(120.0)), atol=1e-12)
    front = p - 0.06 * R[:, 0]
    np.testing.assert_allclose(locate_thing(world.things, "marker").p, front, atol=1e-12)
    inside = locate_thing(world.things, "marker", "crate")
    np.testing.assert_allclose(inside.p, [-0.06, 0.0, 0.0], atol=1e-12)
    assert find_carrier(world.things, "marker") == "crate"
    assert list(world.drop_things("crate").things) == ["table"]


@pytest.mark.parametrize(("pitch", "bottle", "box"), [
    (0.0, 0.15, 0.15), (90.0, 0.03, 0.05), (-90.0, 0.03, 0.05), (180.0, 0.15, 0.15),
    (30.0, 0.15 * math.cos(math.pi / 6) + 0.015, 0.15 * math.cos(math.pi / 6) + 0.025),
])  # fmt: skip
def test_what_is_pitched_touches_its_support(pitch: float, bottle: float, box: float) -> None:
    """Bottle and box of 0.3 m, 0.06 m and 0.1 m wide: half the height over the table's top."""
    on = {"on": "table", "pitch_deg": pitch, "yaw_deg": 20.0, "moves": True, "mass_kg": 0.1}
    things = {
        "table": {**BOX, "z_m": 0.75},
        "bottle": {"kind": "cylinder", "diameter_m": 0.06, "length_m": 0.3, **on},
        "box": {**BOX, "z_m": 0.0, "size_z_m": 0.3, **on},
    }
    world = load_description("waypoints", sets={"world.things": things}).world
    heights = [locate_thing(world.things, name).p[2] - 0.8 for name in ("bottle", "box")]
    np.testing.assert_allclose(heights, [bottle, box], atol=1e-12)


def test_motion_capture_surveys_what_is_tracked() -> None:
    """A thing that lies still, one that was moved, and one on it; all to the noise's size."""
    things = {
        "post": {**BOX, "y_m": 2.0, "tracked": True},
        "crate": {**BOX, "y_m": 3.0, "moves": True, "mass_kg": 0.3, "tracked": True},
        "plate": {**BOX, "on": "crate", "x_m": 0.0, "y_m": 0.0, "z_m": 0.0, "tracked": True},
        "wall": {**BOX, "y_m": 4.0},
    }
    sets = {"world.things": things, "plant.socket_x_error_m": 0.03}
    vehicle = build_vehicle(load_description("waypoints", sets=sets))
    at = int(vehicle.scene.model.joint("object crate").qposadr[0])
    vehicle.sim.data.qpos[at : at + 3] = [0.6, 5.0, 0.05]
    vehicle.tick()
    np.testing.assert_allclose(
        vehicle.devices.surveyor.survey("post")[0], [0.63, 2.0, 0.06], atol=0.01
    )
    np.testing.assert_allclose(
        vehicle.devices.surveyor.survey("crate")[0], [0.6, 5.0, 0.05], atol=0.01
    )
    np.testing.assert_allclose(
        vehicle.devices.surveyor.survey("plate")[0], [0.6, 5.0, 0.15], atol=0.01
    )
    with pytest.raises(InputError, match=r"does not track 'wall'.*tracked = true"):
        vehicle.devices.surveyor.survey("wall")


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


@pytest.mark.parametrize("wrong", [[math.nan, 0.0, 0.0], [0.0, 0.0], "up", [math.inf, 0.0, 0.0]])
def test_devices_take_finite_vectors_only(wrong: Any) -> None:
    nobody: Any = None  # is not asked: the numbers are read first
    with pytest.raises(InputError, match=r"push: f_W = .*valid: three finite numbers"):
        Helper(nobody).push("platform", wrong)
    with pytest.raises(InputError, match=r"move: p_W = .*valid: three finite numbers"):
        Bench(nobody).move(wrong)
    with pytest.raises(InputError, match="move: yaw = nan"):
        Bench(nobody).move(np.zeros(3), math.nan)
