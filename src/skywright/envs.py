"""Gymnasium environments for learning contact tasks: `pip install "skywright[envs]"`.

    from skywright.envs import WeldPress

    env = WeldPress(vary=["world.wind.mean_mps=uniform(0.5, 2)"], conditions=8)
    seen, info = env.reset(seed=1)
    seen, reward, terminated, truncated, info = env.step(env.action_space.sample())

Importing this module also registers them: `gymnasium.make("skywright/WeldPress-v0")`.
See docs/howto/learn-a-policy.md.
"""

from __future__ import annotations

from skywright.errors import InputError

try:
    import gymnasium as _gymnasium  # noqa: F401
except ImportError:
    raise InputError('skywright.envs requires Gymnasium: pip install "skywright[envs]"') from None

from skywright.analysis.envs.env import ContactEnv
from skywright.analysis.envs.peg_in_hole import PegInHole
from skywright.analysis.envs.registry import make, register
from skywright.analysis.envs.sensor_install import SensorInstall
from skywright.analysis.envs.vector import VectorEnv
from skywright.analysis.envs.wall_slide import WallSlide
from skywright.analysis.envs.weld_press import WeldPress

__all__ = [
    "ContactEnv", "PegInHole", "SensorInstall", "VectorEnv", "WallSlide", "WeldPress", "make",
]  # fmt: skip

register()
