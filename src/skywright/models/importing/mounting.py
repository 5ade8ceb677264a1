"""Mounts the arm of one file on the flying body of another."""

from __future__ import annotations

import mujoco
import numpy as np

from skywright.core.rotations import quat_from_rot, rot_x, rot_y, rot_z
from skywright.errors import InputError
from skywright.models.importing.opening import Opened
from skywright.models.importing.xml_input import read_numbers

ARM = "arm/"
"""Prefix of all names of the arm's file."""


def mount_arm(
    opened: Opened, base: mujoco.MjsBody, arm: Opened, first: mujoco.MjsBody, mount: str
) -> None:
    """Weld the body `first` of `arm` to the body `base` that flies, at `mount`.

    `mount` are X,Y,Z or X,Y,Z,ROLL,PITCH,YAW (m, deg) of `first` in `base`; the pose of `first` in
    its own file does not count. Raises InputError for other text.
    """
    where, parts = f"--mount {mount}", mount.split(",")
    if len(parts) not in (3, 6):
        raise InputError(f"{where}: valid: X,Y,Z or X,Y,Z,ROLL,PITCH,YAW (m, deg)")
    numbers = read_numbers(" ".join(parts), len(parts), where, [])
    turn = np.eye(3)
    if len(parts) == 6:
        roll, pitch, yaw = np.radians(numbers[3:])
        turn = rot_z(yaw) @ rot_y(pitch) @ rot_x(roll)
    first.pos, first.quat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    # euler, axisangle, xyaxes and zaxis take precedence over quat
    first.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    first.mocap = False
    frame = base.add_frame(pos=numbers[:3], quat=quat_from_rot(turn))
    for name in dir(arm.spec.option):  # solvers differ, but only kinematics and masses are used
        if not name.startswith("_"):
            setattr(arm.spec.option, name, getattr(opened.spec.option, name))
    frame.attach_body(first, ARM, "")
