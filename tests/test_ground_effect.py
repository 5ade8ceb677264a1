"""Rotors gain thrust over any floor: ground, bench, block; not beside one, nor over a slope."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from plant_parts import build_context, build_plant
from skywright.vehicle.effects.surface_thrust import (
    compute_floor_gain,
    compute_ground_gain,
    find_floors,
)
from skywright.vehicle.plant import RotorGain

RADIUS = 0.19


def build_floors(tmp_path: Path, things: str):
    world = tmp_path / "world.toml"
    world.write_text(f'[world]\nname = "floors"\n{things}')
    context = build_context("waypoints", [f"mission.world={world}"])
    return context, find_floors(context.scene.model)


def gain_at(floors: np.ndarray, p: list[float]) -> float:
    return max(compute_floor_gain(row, np.array(p), RADIUS) for row in floors)


def test_every_floor_acts_by_the_height_over_it(tmp_path: Path) -> None:
    block = '[world.things.block]\nkind = "box"\nx_m = 3.0\ny_m = 0.0\nz_m = 0.5\n' + "".join(
        f"size_{a}_m = {n}\n" for a, n in (("x", 2.0), ("y", 1.2), ("z", 1.0))
    )
    _, floors = build_floors(tmp_path, block)
    assert len(floors) == 2  # ground and block
    for z in (0.12, 0.25, 0.5):
        over = compute_ground_gain(z, RADIUS)
        assert over > 1.0
        assert gain_at(floors, [0.0, 0.0, z]) == pytest.approx(over)
        assert gain_at(floors, [3.0, 0.1, 1.0 + z]) == pytest.approx(over)
        half = gain_at(floors, [4.0, 0.0, 1.0 + z])  # hub over the edge: half of the disc
        assert half - 1.0 == pytest.approx(0.5 * (over - 1.0), rel=1e-6)
        assert gain_at(floors, [4.0 + RADIUS, 0.0, 1.0 + z]) < over
    assert gain_at(floors, [4.3, 0.0, 1.9]) == 1.0
    assert gain_at(floors, [3.0, 0.0, 3.5]) == 1.0


def test_a_plant_over_a_block_feels_it(tmp_path: Path) -> None:
    block = '[world.things.block]\nkind = "box"\nx_m = 3.0\ny_m = 0.0\nz_m = 0.5\n' + "".join(
        f"size_{a}_m = {n}\n" for a, n in (("x", 2.0), ("y", 2.0), ("z", 1.0))
    )
    context, _ = build_floors(tmp_path, block)
    plant = build_plant(context)
    data = plant.sim.data
    for height, expected in ((1.2, compute_ground_gain(0.2, RADIUS)), (3.5, 1.0)):
        data.qpos[:7] = [3.0, 0.0, height, 1.0, 0.0, 0.0, 0.0]
        mujoco.mj_forward(context.scene.model, data)
        plant.run(1)
        gain = plant.read(RotorGain).gain[: len(context.rotors.spin)]
        np.testing.assert_allclose(gain, expected, rtol=2e-3)
