"""How finely a robot can press: one count of a servo, through the spring that carries the force.

An arm that presses through a spring sets its force by moving the spring's end, so one count of a
servo changes the force by (spring stiffness) x (lever of the tip) x (angle of a count). A softer
spring or a finer servo makes the step smaller; no control law does.
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
    """What the force at the tip comes in. n servos."""

    servos: tuple[str, ...]
    angles: Array  # (n,) rad, one count of each servo
    steps: Array  # (n,) N, change of the force by one count of each servo
    sensor_step: float  # N, one count of the force sensor at a light press; NaN without one

    @property
    def smallest(self) -> float:
        """Smallest change of force (N) that can be relied on: the coarsest servo's step."""
        return float(np.max(self.steps))

    @property
    def rms(self) -> float:
        """Error of a held force (N rms) when each servo stops at the nearest count."""
        return float(np.sqrt(np.sum(self.steps**2) / 12.0))


def map_to_servos(robot: Robot, joint_torque: Array) -> Array:
    """Return the servos' torques (n,) that make the joints' torques: through the belt, J_AM^T."""
    assert robot.arm is not None
    if robot.arm.belt is not None:
        return np.asarray(np.array(robot.arm.belt).T @ joint_torque)
    driven = [i for i, limb in enumerate(list_joints(robot)) if limb.servo >= 0]
    return np.asarray(joint_torque[driven])


def compute_servo_count(servo: Servo) -> float:
    """Return the angle (rad) of one count: of its command where it takes one, else its encoder."""
    if servo.resolution_deg > 0.0:
        return math.radians(servo.resolution_deg)
    return 2.0 * math.pi / servo.encoder_counts


def compute_force_resolution(robot: Robot, q: Array | None = None) -> ForceResolution | None:
    """Compute the steps of force along the probe's axis at joints `q` (rad; default: at work).

    The platform is taken as fixed (docked). None for a robot without a sprung probe or servos.
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
