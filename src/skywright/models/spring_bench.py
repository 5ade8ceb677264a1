"""Calibration of the springs of compliant joints and of the probe's force sensor with known loads.

It simulates a laboratory calibration before a flight, with the joint clamped on a bench. Weights at
a lever turn the joint's output link both ways, through its linear range and half of it beyond, and
a dial reads the deflection. Weights on the probe's tip compress its spring, and the sensor reads
them. The springs are those of the plant's scene, so their errors, play and hardening are in the
readings.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.spec import Robot
from skywright.models.compliant_arms import is_compliant
from skywright.models.force_sensor import build_force_sensor, measure_travel
from skywright.models.scene import Scene
from skywright.models.springs import spring_deflection

LOAD_ERROR = 0.004
"""1 sigma of a known load, relative: a lever of 25 cm is known to 1 mm, a weight to 1 g."""
DIAL = math.radians(0.05)
"""rad, 1 sigma of a deflection reading: 0.2 mm at that lever."""
TURN = 1.0
"""rad, end of the computed curves of joints' springs."""
BEYOND = 1.5
"""Largest deflection on the bench, over the linear range."""
LOADS = np.array([0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0])


class Springs(NamedTuple):
    """Spring parameters for controllers; arrays have one number per joint."""

    stiffness: Array  # N m/rad; 0: none
    hardening: Array  # stiffness beyond the linear range over that within
    slack: Array  # rad, half of the gear's play
    sensor: float = 1.0  # true force over the force of the sensor's data sheet


def find_springs(robot: Robot, plant: Scene | None, seed: int) -> Springs:
    """Return the bench's springs of `plant`, or without a plant those of the robot file."""
    return believe_springs(robot) if plant is None else calibrate_springs(robot, plant, seed)


def believe_springs(robot: Robot) -> Springs:
    """Return the springs of the robot file."""
    joints, servos = list_joints(robot), list_servos(robot)
    play = [servos[x.servo][1].backlash_deg if x.servo >= 0 else 0.0 for x in joints]
    return Springs(
        np.array([x.link.flex_stiffness_nm_per_rad or 0.0 for x in joints]),
        np.array([x.link.flex_hardening for x in joints]),
        np.radians(0.5 * np.array(play)),
    )


def calibrate_springs(robot: Robot, plant: Scene, seed: int) -> Springs:
    """Return the springs that the bench measures; `plant` has the true ones.

    Springs without a stated linear range (structural ones, from which no law computes a force) keep
    the file's values.
    """
    rng = build_stream(seed, "springs")
    springs = believe_springs(robot)
    if is_compliant(robot):
        soft = [(j, x) for j, x in enumerate(list_joints(robot)) if x.link.flex_linear_deg]
        curves = _find_curves(plant, [f"{limb.name} flex" for _, limb in soft], -TURN, TURN)
        for j, limb in soft:
            assert limb.link.flex_linear_deg is not None
            linear = math.radians(limb.link.flex_linear_deg)
            stall = list_servos(robot)[limb.servo][1].stall_torque_nm
            hardens = limb.link.flex_beyond == "hardening"
            end = BEYOND * linear + springs.slack[j]
            loads, seen = _load_joint(curves[f"{limb.name} flex"], end, stall, rng)
            k, hard, slack = _fit(loads, seen, linear, hardens, springs, j)
            springs.stiffness[j], springs.hardening[j], springs.slack[j] = k, hard, slack
    return springs._replace(sensor=_load_sensor(robot, plant, rng))


def _load_joint(
    curve: tuple[Array, Array], end: float, stall: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return the nominal torques (N m) of the bench, and the deflections (rad) that it reads.

    Weights are added until the dial reads `end` (rad) or the servo would stall.
    """
    deflection, torque = curve
    most = min(float(np.interp(end, deflection, torque)), stall)
    loads = most * np.concatenate([-LOADS[::-1], LOADS])
    true = np.interp(loads * (1.0 + LOAD_ERROR * rng.standard_normal()), torque, deflection)
    return loads, true + DIAL * rng.standard_normal(len(loads))


def _find_curves(
    plant: Scene, names: list[str], low: float, high: float
) -> dict[str, tuple[Array, Array]]:
    """Return each joint's deflections and its springs' torques (or forces) there."""
    model, data = plant.model, mujoco.MjData(plant.model)
    joints = [model.joint(name) for name in names]
    at = [int(joint.qposadr[0]) for joint in joints]
    dof = [int(joint.dofadr[0]) for joint in joints]
    deflection = np.linspace(low, high, 801)
    torque = np.empty((len(deflection), len(names)))
    for i, x in enumerate(deflection):
        data.qpos[at] = -x
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        torque[i] = data.qfrc_passive[dof]
    return {name: (deflection, torque[:, k]) for k, name in enumerate(names)}


def _fit(
    loads: Array, seen: Array, linear: float, hardens: bool, springs: Springs, j: int
) -> tuple[float, float, float]:
    """Return stiffness, hardening and slack of the best fit to the readings."""
    from scipy.optimize import least_squares

    k0, slack0 = float(springs.stiffness[j]), float(springs.slack[j])
    hard0 = float(springs.hardening[j])
    within = np.abs(loads) < 0.8 * k0 * linear  # stop: no information on the spring
    tau, delta = (loads, seen) if hardens else (loads[within], seen[within])

    def residual(x: Array) -> Array:
        k, hard, slack = k0 * x[0], max(hard0 * x[1], 1.0), slack0 * x[2]
        model = [math.copysign(slack, t) + spring_deflection(k, linear, hard, t) for t in tau]
        # parameters without information (a hardening not reached, no play) keep the file's value
        prior = np.array([0.0, x[1] - 1.0, x[2] - 1.0]) / np.array([1.0, 0.5, 0.3])
        return np.concatenate([(np.array(model) - delta) / DIAL, prior])

    x = least_squares(residual, np.ones(3), bounds=([0.05] * 3, [20.0] * 3)).x
    return k0 * x[0], max(hard0 * x[1], 1.0) if hardens else hard0, slack0 * x[2]


def _load_sensor(robot: Robot, plant: Scene, rng: np.random.Generator) -> float:
    """Return the ratio of true to data-sheet force, from known weights; 1 without a sensor."""
    probe, sensor = robot.probe, robot.force_sensor
    if probe is None or sensor is None:
        return 1.0
    converter = build_force_sensor(sensor, probe.spring_preload_n)[0]
    travel, force = _find_curves(plant, ["spring"], 0.0, probe.spring_travel_m)["spring"]
    weights = LOADS * 0.9 * (force[-1] - force[0]) + force[0]
    true = np.interp(weights * (1.0 + LOAD_ERROR * rng.standard_normal()), force, travel)
    read = np.array([measure_travel(converter, x, rng.standard_normal()) for x in true])
    return float(weights @ read / (read @ read))
