"""The compiled scenes of the built-in robots, as numbers, and the file that keeps them.

`python tests/compiled_robots.py` writes the file again: do so only with a change that is meant to
change a built-in robot.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_from_quat
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.models.arm_body import Deviation
from skywright.models.rigid_body import build_body_model
from skywright.models.rotors import build_rotors
from skywright.models.scene import build_scene

STORED = Path(__file__).parent / "data" / "compiled-robots.npz"
ROBOTS = (
    "ars-lrm", "bimanual", "bimanual-longreach", "f550-bridge", "f550-bridge-torque", "f550-scan",
    "hexarotor", "othex", "othex-force",
)  # fmt: skip
FIELDS = (
    "body_parentid", "body_pos", "body_mass", "body_ipos", "jnt_type", "jnt_axis", "jnt_range",
    "jnt_stiffness", "jnt_solref", "dof_armature", "dof_damping", "dof_frictionloss", "geom_type",
    "geom_size", "geom_pos", "geom_contype", "geom_conaffinity", "site_pos", "actuator_gear",
    "actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "tendon_stiffness",
    "tendon_range", "wrap_prm",
)  # fmt: skip


def collect(name: str) -> dict[str, NDArray[Any]]:
    """Return the numbers of a robot's nominal scene, plant, rotors and rigid-body record."""
    robot, world = load_robot(name)[0], load_world("open")[0]
    out = {}
    for which, deviation in (("nominal", None), ("plant", Deviation())):
        model = build_scene(robot, world, deviation).model
        for field in FIELDS:
            out[f"{which}.{field}"] = np.array(getattr(model, field))
        # the axes of principal inertia are free to swap: what they make is compared
        turn = np.array([rot_from_quat(q) for q in model.body_iquat])
        out[f"{which}.inertia"] = np.einsum("nij,nj,nkj->nik", turn, model.body_inertia, turn)
        out[f"{which}.body_rot"] = np.array([rot_from_quat(q) for q in model.body_quat])
        out[f"{which}.geom_rot"] = np.array([rot_from_quat(q) for q in model.geom_quat])
    for field, value in build_rotors(robot.rotors)._asdict().items():
        out[f"rotors.{field}"] = np.asarray(value)
    record = build_body_model(robot)[0]
    for field in ("parent", "joint", "offset", "mass", "com", "inertia", "tip_offset", "tip_rot",
                  "hand_offset", "hand_rot", "q_min", "q_max", "mass0", "com0", "inertia0",
                  "motor_speed_max"):  # fmt: skip
        out[f"body.{field}"] = np.array(record[field])
    return {f"{name}/{key}": value for key, value in out.items() if np.size(value)}


def main() -> None:
    """Write the file."""
    everything: dict[str, Any] = {}
    for name in ROBOTS:
        everything |= collect(name)
    np.savez_compressed(STORED, **everything)
    print(f"{STORED}: {os.path.getsize(STORED)} bytes")


if __name__ == "__main__":
    main()
