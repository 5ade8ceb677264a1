"""Bodies of the plant for static geometry: pipe, structure, tubes and things on the ground."""

import mujoco
import numpy as np

FIXED = "fixed "
"""Names of these bodies begin with it."""


def add_fixed(spec: mujoco.MjSpec, name: str, plant: bool) -> mujoco.MjsBody:
    """Return the body for static geometry, in the frame of W.

    In the plant it is a separate body: MuJoCo skips a body as a whole while it is far from the
    robot, but compares every geometry of W with every geometry of the robot in each step. In the
    nominal scene, where every body except W moves, it is W.
    """
    return spec.worldbody.add_body(name=FIXED + name) if plant else spec.worldbody


def list_moving(model: mujoco.MjModel) -> list[str]:
    """Return the names of the bodies that forces can move; MuJoCo's mocap bodies are not."""
    moving = (model.body_weldid != 0) & (model.body_mocapid < 0)
    return [model.body(i).name for i in np.flatnonzero(moving)]
