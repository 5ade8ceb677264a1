"""Several copies of one robot in one MuJoCo model, to measure the cost of many robots in a world.

The vehicle layer simulates one robot per world; `skywright bench robots` measures the cost of more.
The copies collide with the world but not with each other, and docking feet keep MuJoCo's default
stiffness.
"""

from typing import Any, NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.arm_body import Deviation
from skywright.models.scene import build_spec

SPACING = 3.0  # m, between neighbours, along +y


class Crowd(NamedTuple):
    """A compiled model of several robots and its data."""

    model: mujoco.MjModel
    data: mujoco.MjData
    n_robots: int


def build_crowd(robot: Robot, world: World, deviation: Deviation, n_robots: int) -> Crowd:
    """Compile `n_robots` copies of the plant into one world; the first is the original."""
    assert n_robots >= 1
    spec = build_spec(robot, world, deviation)
    for i in range(1, n_robots):
        copy = build_spec(robot, world, deviation)
        frame = spec.worldbody.add_frame(pos=[0.0, i * SPACING, 0.0])
        frame.attach_body(copy.body("platform"), _get_prefix(i), "")
    model = spec.compile()
    return Crowd(model, mujoco.MjData(model), n_robots)


def set_crowd(crowd: Crowd, qpos: Array, qvel: Array, act: Array) -> None:
    """Set every copy to the state of one robot, each at its position."""
    mujoco.mj_resetData(crowd.model, crowd.data)
    places = np.tile(qpos, (crowd.n_robots, 1))
    places[:, 1] += SPACING * np.arange(crowd.n_robots)
    crowd.data.qpos[:] = places.ravel()
    crowd.data.qvel[:] = np.tile(qvel, crowd.n_robots)
    crowd.data.act[:] = np.tile(act, crowd.n_robots)
    mujoco.mj_forward(crowd.model, crowd.data)


def step_crowd(crowd: Crowd, controls: Any, forces: Any, n_steps: int) -> None:
    """Step with controls (t, nu) and body forces (t, nbody, 6) of all robots, one row per tick."""
    model, data = crowd.model, crowd.data
    ctrl, xfrc = data.ctrl, data.xfrc_applied
    for control, force in zip(controls, forces, strict=True):
        ctrl[:] = control
        xfrc[:] = force
        mujoco.mj_step(model, data, n_steps)


def repeat_controls(crowd: Crowd, controls: Array, forces: Array) -> tuple[Array, Array]:
    """Repeat the inputs of one robot for every copy: controls (t, nu) and forces (t, nbody, 6)."""
    model = crowd.model
    everywhere = np.zeros((len(forces), model.nbody, 6))
    first = _list_bodies(model, "platform")
    for i in range(crowd.n_robots):
        mine = _list_bodies(model, f"{_get_prefix(i)}platform")
        everywhere[:, mine] = forces[:, first]
    return np.tile(controls, (1, crowd.n_robots)), everywhere


def _get_prefix(i: int) -> str:
    """Return the prefix of all names of robot `i`, counted from 0."""
    return f"robot{i} " if i else ""


def _list_bodies(model: mujoco.MjModel, root: str) -> Ints:
    return np.flatnonzero(model.body_rootid == model.body(root).id)
