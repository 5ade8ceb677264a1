"""Resolution of a robot's press force: one count of a servo through the spring of the probe.

An arm that presses through a spring sets its force by moving the spring's end, so one count of a
servo changes the force by (spring stiffness) x (lever of the tip) x (angle of a count). Only a
softer spring or a finer servo reduces the step; the control law cannot.
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.arm import Servo
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import build_body_model, compute_kinematics, posture


class ForceResolution(NamedTuple):
    """Steps of the force at the tip. n servos."""

    servos: tuple[str, ...]
    angles: Array  # (n,) rad, one count of each servo
    steps: Array  # (n,) N, change of the force by one count of each servo
    sensor_step: float  # N, one count of the force sensor at a light press; NaN without a sensor

    @property
    def smallest(self) -> float:
        """Smallest force change (N) that is always available: the step of the coarsest servo."""
        return float(np.max(self.steps))

    @property
    def rms(self) -> float:
        """Error of a held force (N rms) if each servo stops at the nearest count."""
        return float(np.sqrt(np.sum(self.steps**2) / 12.0))


def map_to_servos(robot: Robot, joint_torque: Array) -> Array:
    """Return the servo torques (n,) that produce the joint torques: through the belt, J_AM^T."""
    assert robot.arm is not None
    if robot.arm.belt is not None:
        return np.asarray(np.array(robot.arm.belt).T @ joint_torque)
    driven = [i for i, limb in enumerate(list_joints(robot)) if limb.servo >= 0]
    return np.asarray(joint_torque[driven])


def compute_servo_count(servo: Servo) -> float:
    """Return the angle (rad) of one count of the command, or of the encoder if commands are
    continuous."""
    if servo.resolution_deg > 0.0:
        return math.radians(servo.resolution_deg)
    return 2.0 * math.pi / servo.encoder_counts


def compute_force_resolution(robot: Robot, q: Array | None = None) -> ForceResolution | None:
    """Compute the force steps along the probe's axis at joints `q` (rad; default: working posture).

    The platform is assumed fixed (docked). None for a robot without a sprung probe or servos.
    """
    if robot.arm is None or robot.probe is None or not robot.arm.servos:
        return None
    model = build_body_model(robot)
    at = posture(robot, "working") if q is None else np.asarray(q, dtype=np.float64)
    k = compute_kinematics(model, at)
    lever = k["R_BT"][:, 2] @ k["J_BT"][:, : len(at)]
    names = tuple(name for name, _ in list_servos(robot))
    angles = np.array([compute_servo_count(servo) for _, servo in list_servos(robot)])
    steps = robot.probe.spring_n_per_m * np.abs(map_to_servos(robot, lever)) * angles
    sensor = robot.force_sensor
    return ForceResolution(
        names, angles, steps,
        math.nan if sensor is None else -sensor.soft_slope_n_per_count,
    )  # fmt: skip
