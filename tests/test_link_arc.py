"""Take-off and landing on the end of a link that lies on the ground, flown."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.models.allocation import allocate
from skywright.models.floating import compute_floating
from skywright.models.rigid_body import posture
from skywright.run.backends import build_vehicle
from skywright.run.setup import Setup
from skywright.vehicle.moves import Moves
from skywright.vehicle.simulated import SimulatedVehicle

LONG = "bimanual-longreach"


class Flown(NamedTuple):
    """Truth against the reference, a row each 20 ms."""

    off: Any  # (n, 3) m, of the platform from its reference
    lean: Any  # (n,) deg, of its vertical axis
    touches: Any  # (n,) whether something touches the ground


def build_link(length: float) -> list[str]:
    """A link of another length (m), stowed so that its end lies as high as the built-in one's."""
    down = math.degrees(math.asin(0.105 / length))
    return [
        f"robot.pendulum.length_m={length}", f"robot.pendulum.com_m={0.785 * length:.4f}",
        f"robot.pendulum.folded_deg={down - 90.0:.3f}",
        f"robot.arm.shoulder_pitch.folded_deg={-down:.3f}", "mission.timestep_ms=2",
    ]  # fmt: skip


def fly(v: SimulatedVehicle, seconds: float) -> Flown:
    off, lean, touches = [], [], []
    for _ in range(round(seconds / 0.02)):
        assert v.tick().fired == 0
        q, up = v.sim.qpos, np.zeros(9)
        mujoco.mju_quat2Mat(up, q[3:7])
        off.append(q[:3] - v.reference["p_WB"])
        lean.append(math.degrees(math.acos(min(up[8], 1.0))))
        touches.append(v.sim.data.ncon > 0)
    return Flown(np.array(off), np.array(lean), np.array(touches))


def take_off(sets: list[str], seed: int = 1) -> tuple[SimulatedVehicle, Moves, Flown]:
    v = build_vehicle(load_description("waypoints", robot=LONG, sets=sets, seed=seed))
    moves = Moves(v)
    fly(v, 3.0)
    moves.motors(True)
    fly(v, 0.5)
    moves.take_off(2.1)
    return v, moves, fly(v, moves.ends - v.t + 1.0)


def test_the_damping_counts_the_turn_of_a_link_on_the_ground_once() -> None:
    """The reference tells it; the ground's torque, which turns the link, must not tell it again.

    Told twice, the platform ran ahead by k_swing psi' / (k_x k_v): 0.28 m here, 0.55 m at 1.0 m.
    """
    for length, most in ((0.5, 0.05), (0.8, 0.06), (1.0, 0.09)):
        flown = take_off(build_link(length))[2]
        lifts = len(flown.touches) - int(np.argmax(flown.touches[::-1]))
        assert 100 < lifts < len(flown.touches) - 100
        assert np.max(np.abs(flown.off[:lifts, 0])) < most, length


@pytest.mark.parametrize(
    ("length", "wind", "seed"), [(0.4, (3, 180), 1), (0.8, (4, 90), 3), (1.0, (3, 180), 2),
                                 (1.0, (4, 90), 1), (1.1, (0, 0), 2)],
)  # fmt: skip
def test_every_link_is_laid_down_with_a_platform_that_stays_upright(
    length: float, wind: tuple[int, int], seed: int
) -> None:
    """Yaw beyond the rotors' torque costs neither thrust nor pitch: see the test below."""
    sets = build_link(length)
    if wind[0]:
        sets += ["world.wind.kind=steady", f"world.wind.mean_mps={wind[0]}",
                 f"world.wind.toward_deg={wind[1]}"]  # fmt: skip
    v, moves, up = take_off(sets, seed)
    moves.land(v.robot.platform.gear_height_m)
    down = fly(v, moves.ends - v.t)
    moves.motors(False)
    rest = fly(v, 1.0)
    assert np.max(up.lean) < 20.0 and np.max(down.lean) < 17.0
    assert np.max(np.abs(down.off[:, 2])) < 0.2  # the landing aims 5 cm below the ground
    assert rest.lean[-1] < 2.0 and np.linalg.norm(v.sim.data.qvel[:3]) < 0.01


def test_force_is_given_up_at_the_point_about_which_a_swinging_link_leaves_the_platform() -> None:
    setup = Setup(load_description("waypoints", robot=LONG, sets=build_link(1.0)))
    body, w = compute_floating(setup.model, posture(setup.robot, "landed"), 0)
    assert body["p_BC"][0] > 0.2  # all together, the link ahead of the platform
    p = np.array([-w["A"][1, 2], w["A"][0, 2], -w["A"][0, 1]])
    assert np.linalg.norm(p[:2]) < 0.02
    a, f, t = setup.allocator, np.array([0.0, 0.0, 58.0]), np.array([-1.5, -2.0, -9.0])
    for point, keeps in ((p, True), (np.array(body["p_BC"]), False)):
        thrust = np.zeros(len(a.t_min))
        allocate(a.B, a.P, a.t_min, a.t_max, a.full, f, t, np.array([0.0, 0.0, 1.0]), point, thrust)
        made = a.B @ thrust
        assert keeps == np.allclose(made[2:5], [58.0, -1.5, -2.0], atol=1e-6)


@pytest.mark.parametrize(
    ("length", "says"), [
        (0.3, "a link that swings at 5.38 rad/s asks for 2.12: lengthen it"),
        (1.2, "a link that swings at 3.19 rad/s settles in 1.80 s at best: shorten it"),
    ],
)  # fmt: skip
def test_a_link_that_the_loops_cannot_calm_is_refused_with_its_limit(
    length: float, says: str
) -> None:
    """Before take-off: the law is built for the plan."""
    with pytest.raises(InputError, match=re.escape(says)):
        build_vehicle(load_description("waypoints", robot=LONG, sets=build_link(length)))
