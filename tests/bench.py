"""A robot with compliant arms whose platform is clamped in the air, for tests of the arms."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import mujoco
import numpy as np

from skywright.description.loader import load_description
from skywright.run.backends import build_vehicle
from skywright.vehicle.arms.ports import HandState
from skywright.vehicle.arms.truth import ServoState
from skywright.vehicle.arms.view import ArmsMemory
from skywright.vehicle.arms_interface import Arms
from skywright.vehicle.bus import Estimate, ServoDrive, ShaftCommand
from skywright.vehicle.readings import Shafts

L_POSE = np.array([0.0, 0.0, 0.0, -math.pi / 2])
HEIGHT = 1.5  # m, of the platform's origin


def set_joints(vehicle, q):
    """Let servos and controller of compliant arms take it that the joints stand at q (n,) rad."""
    get = vehicle.assembly.get
    state = get(ServoState)
    for field in (
        get(ShaftCommand)["theta"], get(ArmsMemory, "arms_law")["theta_ref"], state["held"],
        get(HandState)["q_goal"], get(Estimate)["q"], get(Shafts)["q"], state["now"],
        get(ServoDrive)["motor"],
    ):  # fmt: skip
        field[: len(q)] = q


class Bench:
    """Platform at (0, 0, HEIGHT), level, clamped; `sets` as on the command line."""

    def __init__(
        self, robot="bimanual", sets=(), q=None, estimator="truth", seed=1, boxes=(), more=""
    ):
        """`boxes`: (centre, edges) of things that do not move, each 3 numbers (m); `more`: TOML."""
        world = Path(tempfile.mkdtemp()) / "world.toml"
        world.write_text(
            '[world]\nname = "bench"\n'
            + f'[world.things.bench]\nkind = "bench"\nz_m = {HEIGHT}\n'
            + "".join(
                f'[world.things.box{i}]\nkind = "box"\n'
                + "".join(f"{a}_m = {p}\n" for a, p in zip("xyz", at, strict=True))
                + "".join(f"size_{a}_m = {p}\n" for a, p in zip("xyz", edges, strict=True))
                for i, (at, edges) in enumerate(boxes)
            )
            + more
        )
        d = load_description(
            "waypoints",
            robot=robot,
            world=world,
            seed=seed,
            sets=[f"mission.estimator={estimator}", *sets],
        )
        self.rows = []
        self.v = build_vehicle(d, self.rows.append)
        model, data = self.v.scene.model, self.v.sim.data
        self.arms = Arms(self.v)
        n = self.v.n_joints
        q = np.tile(L_POSE, 2) if q is None else np.asarray(q)
        full = np.concatenate([np.zeros(n - len(q)), q])
        data.qpos[self.v.scene.places.joint_qpos] = full
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        data.act[:] = data.actuator_length[model.nu - model.na :]
        set_joints(self.v, full)
        row = self.v.reference
        row["p_WB"], row["q"][:n] = [0.0, 0.0, HEIGHT], full
        self.v.track(np.array([row]))
        damping = model.dof_damping.copy()
        for i in range(model.njnt):  # settle on the springs at once
            if model.joint(i).name.endswith("flex"):
                model.dof_damping[model.jnt_dofadr[i]] *= 20.0
        self.wait(1.5)
        model.dof_damping[:] = damping

    def wait(self, seconds):
        """Run; returns the samples of this time."""
        self.v.flush()
        self.rows.clear()
        for _ in range(round(seconds / 0.02)):
            self.v.tick()
        self.v.flush()
        return np.concatenate(self.rows)
