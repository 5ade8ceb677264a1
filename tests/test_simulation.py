"""The plant's MuJoCo model and data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.models.scene import build_scene
from skywright.vehicle.simulation import Simulation


def test_a_plant_that_diverges_shows_it_and_writes_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo by itself resets the state and appends to MUJOCO_LOG.TXT where the user works."""
    monkeypatch.chdir(tmp_path)
    robot, world = load_robot("f550-bridge")[0], load_world("bridge")[0]
    scene = build_scene(robot, world)
    home = (np.array([0.0, 0.0, 1.5]), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(2))
    simulation = Simulation(scene, home)
    simulation.qvel[2] = np.nan
    simulation.step(3)
    assert np.isnan(simulation.qvel).any()
    assert not list(tmp_path.iterdir())
