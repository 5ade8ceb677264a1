"""MuJoCo model and data of the plant, with the arrays that compiled code reads and writes."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.models.scene import Scene, set_pose

Array = NDArray[np.float64]


def _ignore_warning(text: str) -> None:
    """Ignore MuJoCo's warnings, which it would write to MUJOCO_LOG.TXT; the state is checked."""


mujoco.set_mju_user_warning(_ignore_warning)


class Simulation:
    """Owns the plant's MjData; the arrays are views, valid as long as this object lives."""

    def __init__(self, scene: Scene, home: tuple[Array, Array, Array]) -> None:
        """`home` is (p_WB, q_WB, q), the robot's initial pose at rest."""
        self.scene = scene
        # no automatic reset: a diverged state must remain detectable
        scene.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.data = mujoco.MjData(scene.model)
        set_pose(scene, self.data, *home)
        self.data.act[:] = 0.0
        mujoco.mj_forward(scene.model, self.data)
        # servos start at rest: their integrated command equals the motor's angle
        address = scene.model.actuator_actadr
        self.data.act[address[address >= 0]] = self.data.actuator_length[address >= 0]
        d = self.data
        self.qpos, self.qvel, self.ctrl, self.act = d.qpos, d.qvel, d.ctrl, d.act
        self.sensordata, self.xfrc = d.sensordata, d.xfrc_applied
        self.site_xpos, self.site_xmat = d.site_xpos, d.site_xmat
        self.body_xpos, self.body_xmat = d.xpos, d.xmat
        self.pair_friction = scene.model.pair_friction  # of explicit contact pairs, (n, 5)
        self.model_address, self.data_address = scene.model._address, d._address

    def step(self, n: int) -> None:
        """Advance by `n` time steps."""
        mujoco.mj_step(self.scene.model, self.data, n)

    def write_model(self, file: Path) -> None:
        """Write the compiled model as MuJoCo's binary file (MJB)."""
        mujoco.mj_saveModel(self.scene.model, str(file))

    @property
    def arrays(self) -> dict[str, Array]:
        """MuJoCo's arrays by their names in vehicle.bus.MuJoCo; their addresses are constant."""
        d = self.data
        return {
            "qpos": d.qpos, "qvel": d.qvel, "sensordata": d.sensordata, "site_xpos": d.site_xpos,
            "site_xmat": d.site_xmat, "body_xpos": d.xpos, "body_xmat": d.xmat,
            "xfrc": d.xfrc_applied, "ctrl": d.ctrl, "act": d.act,
            "actuator_force": d.actuator_force, "pair_friction": self.scene.model.pair_friction,
        }  # fmt: skip

    def save(self) -> tuple[mujoco.MjData, Array]:
        """Return a copy of all data; a forward pass would not restore the derived quantities."""
        model = self.scene.model
        copy = mujoco.MjData(model)
        mujoco.mj_copyData(copy, model, self.data)
        return copy, model.pair_friction.copy()

    def restore(self, saved: tuple[mujoco.MjData, Array]) -> None:
        """Restore the state that `save` returned."""
        mujoco.mj_copyData(self.data, self.scene.model, saved[0])
        self.scene.model.pair_friction[:] = saved[1]


class Snapshot:
    """A saved physics state of a simulation, which `restore` sets again."""

    def __init__(self, sim: Simulation) -> None:
        model, data = sim.scene.model, sim.data
        self._spec = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        self._state = np.empty(mujoco.mj_stateSize(model, self._spec))
        mujoco.mj_getState(model, data, self._state, self._spec)

    def restore(self, sim: Simulation) -> None:
        """Restore the state and recompute the quantities derived from it."""
        mujoco.mj_setState(sim.scene.model, sim.data, self._state, self._spec)
        mujoco.mj_forward(sim.scene.model, sim.data)
