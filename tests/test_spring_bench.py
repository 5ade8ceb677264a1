"""Springs that the robot file does not know exactly, and what a bench with known loads finds."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.description.robot.limbs import list_joints
from skywright.models.scene import Scene, build_scene
from skywright.models.spring_bench import Springs, believe_springs, calibrate_springs
from skywright.run.setup import Setup
from skywright.vehicle.arms.joints import build_arm_model


def build(mission: str, **plant: float) -> tuple[Setup[Any], Scene]:
    sets = [f"plant.{key}={value}" for key, value in plant.items() if key != "seed"]
    sets.append(f"mission.seed={plant.get('seed', 1):g}")
    setup: Setup[Any] = Setup(load_description(mission, sets=sets))
    return setup, build_scene(setup.robot, setup.true.world, setup.deviation)


def find_torque(scene: Scene, joint: str, deflection: float) -> float:
    """Torque of a joint's springs in MuJoCo's model, by its own balance of forces."""
    data = mujoco.MjData(scene.model)
    data.qpos[int(scene.model.joint(joint).qposadr[0])] = -deflection
    mujoco.mj_forward(scene.model, data)
    return float(data.qfrc_passive[int(scene.model.joint(joint).dofadr[0])])


def test_each_spring_of_the_plant_is_off_by_its_own_factor() -> None:
    setup, scene = build("sensor-install", hardening_error=-0.5, backlash_error=0.5)
    factors = setup.deviation.spring_factor
    assert len(np.unique(np.round(factors, 6))) == len(factors)  # left and right differ too
    for j, limb in enumerate(list_joints(setup.robot)):
        link = limb.link
        if link.flex_stiffness_nm_per_rad is None:
            continue
        k, linear = link.flex_stiffness_nm_per_rad * factors[j], math.radians(10.0)
        slack = 0.5 * math.radians(0.3 * 1.5)
        within = find_torque(scene, f"{limb.name} flex", 0.1 + slack)
        beyond = find_torque(scene, f"{limb.name} flex", linear + 0.1 + slack)
        assert within == pytest.approx(k * 0.1, rel=1e-6)
        hard = max(link.flex_hardening * 0.5, 1.0)
        assert beyond == pytest.approx(k * (linear + hard * 0.1), rel=1e-6)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("hardening", [0.1, -0.5])
def test_the_bench_finds_the_true_springs(seed: int, hardening: float) -> None:
    setup, scene = build("sensor-install", seed=seed, spring_spread=0.2, hardening_error=hardening)
    found = calibrate_springs(setup.robot, scene, seed)
    file, true = believe_springs(setup.robot), setup.deviation
    soft = [j for j, x in enumerate(list_joints(setup.robot)) if x.link.flex_linear_deg is not None]
    assert len(soft) == 8
    off = found.stiffness[soft] / (file.stiffness[soft] * true.spring_factor[soft]) - 1.0
    assert np.max(np.abs(off)) < 0.03
    assert np.sqrt(np.mean(off**2)) < 0.012
    assert found.hardening[soft] == pytest.approx(3.0 * (1.0 + hardening), rel=0.1)
    assert np.max(np.abs(file.stiffness[soft] / found.stiffness[soft] - 1.0)) > 0.05


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_known_weights_scale_the_force_sensor(seed: int) -> None:
    setup, scene = build("bridge-contact", seed=seed, spring_spread=0.2)
    found = calibrate_springs(setup.robot, scene, seed)
    assert found.sensor == pytest.approx(setup.deviation.probe_spring_factor, rel=0.02)


def test_without_a_bench_the_file_is_believed() -> None:
    setup, _ = build("sensor-install")
    model = build_arm_model(setup.robot)
    joints = list_joints(setup.robot)
    for j, limb in enumerate(joints):
        assert model["k"][0][j] == (limb.link.flex_stiffness_nm_per_rad or 0.0)
    springs = believe_springs(setup.robot)
    assert isinstance(springs, Springs) and springs.sensor == 1.0
    ones = build_arm_model(setup.robot, springs._replace(stiffness=2.0 * springs.stiffness))
    assert ones["k"][0][: len(joints)] == pytest.approx(2.0 * springs.stiffness)


def test_the_same_seed_calibrates_alike_and_exact_springs_are_found_exactly() -> None:
    setup, scene = build("sensor-install", spring_spread=0.0, hardening_error=0.0)
    first, second = (calibrate_springs(setup.robot, scene, 1) for _ in range(2))
    assert np.array_equal(first.stiffness, second.stiffness)
    assert not np.array_equal(first.stiffness, calibrate_springs(setup.robot, scene, 2).stiffness)
    assert setup.deviation.spring_factor == pytest.approx(np.ones(9))
