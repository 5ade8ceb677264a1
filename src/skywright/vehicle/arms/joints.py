"""Joints with springs: angles of the output links from the servo shafts and the deflections.

Suarez 2020: a servo's shaft theta turns the output link q through a spring; theta - q is the
deflection (14). Without an encoder, the deflection is that under the arm's weight (hands.py).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_limbs, list_servos
from skywright.description.robot.spec import Robot
from skywright.models.arm_inverse_kinematics import build_arm_chain, has_arm_chain
from skywright.models.compliant_arms import count_command_ticks, is_compliant
from skywright.models.rigid_body import find_tip
from skywright.models.scene import home_pose
from skywright.models.spring_bench import Springs, believe_springs
from skywright.vehicle.arms.ports import ArmModel, Deflections, Joints
from skywright.vehicle.bus import Clock, Estimate
from skywright.vehicle.component import Component, Out
from skywright.vehicle.readings import Shafts

STOP_HARDENING = 10.0
"""Ratio of the stiffness of a stop to that of its spring, in the controllers' model."""
SWING_BANDWIDTH = 40.0  # rad/s, of the rate estimate of a passive joint


class ArmComponent(Component):
    """Base of the robot-side components of compliant arms."""

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for a robot with compliant arms."""
        if is_compliant(context.robot) and "step" in vars(cls):
            yield cls(re.sub(r"(?<!^)(?=[A-Z])", " ", cls.__name__).lower())


class JointEstimator(ArmComponent):
    """Fills the joint angles of Estimate (output links) every tick, and ArmModel at the start.

    The rate of a passive joint is a filtered difference of its encoder readings. The rates of servo
    joints are set to zero, because their readings are slow.
    """

    slot = "body"

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Fill ArmModel from the robot's description; the links start at the home angles."""
        context.records[ArmModel, ""][:] = build_arm_model(context.robot, context.springs)
        fill_home(context.records[Estimate, ""]["q"], context)

    @staticmethod
    def step(
        arm: Out[ArmModel],
        joints: Out[Joints],
        est: Out[Estimate],
        clock: Clock,
        shafts: Shafts,
        measured: Deflections,
    ) -> None:
        gain = 1.0 - math.exp(-SWING_BANDWIDTH * clock.dt)
        for j in range(MAX_JOINTS):
            if j == arm.swing:  # a first-order tracker: rate = bandwidth * lag
                est.qd[j] = (shafts.q[j] - est.q[j]) * gain / clock.dt
                est.q[j] += est.qd[j] * clock.dt
            else:
                if arm.sensed[j] > 0.0:
                    joints.deflection[j] = measured.deflection[j]
                est.q[j] = shafts.q[j] - joints.deflection[j]
                est.qd[j] = 0.0


def fill_home(joints: Any, context: Any) -> None:
    """Write the servos' home angles (..., MAX_JOINTS) rad, which they hold at the start."""
    q = home_pose(context.robot, context.world, 0.0, 0.0, 0.0)[2]
    joints[..., : len(q)] = q


def build_arm_model(robot: Robot, springs: Springs | None = None) -> NDArray[Any]:
    """Return the ArmModel, a (1,) array, of a robot with compliant arms.

    `springs` are the springs of the controllers' model, by default those of the robot file.
    """
    assert robot.arm is not None
    springs = springs or believe_springs(robot)
    out = np.zeros(1, ArmModel.dtype)
    arm = out[0]
    joints, limbs = list_joints(robot), list_limbs(robot)
    servo, hand = list_servos(robot)[0][1], robot.arm.hand
    arm["dt"] = count_command_ticks(robot) / robot.control.rate_hz
    arm["n_hands"], arm["swing"] = robot.arm.sides, -1
    arm["servo_tau"], arm["speed_max"] = servo.position_time_constant_s, servo.no_load_speed_rad_s
    arm["chain"] = int(has_arm_chain(robot))
    for side in range(robot.arm.sides):
        mine = [j for j, limb in enumerate(joints) if limb.side == side]
        arm["first"][side], arm["n"] = mine[0], len(mine)
        links = [joints[j].link for j in mine]
        arm["upper"] = max(link.length_m for link in links[:-1])
        arm["fore"] = links[-1].length_m + hand.length_m
        arm["p_BS"][side] = next(limb for limb in limbs if limb.side == side).offset
        if hand.kind == "ball" and hand.mass_kg > 0.0:
            arm["pad"][side] = hand.radius_m
        if robot.probe is not None and limbs[find_tip(robot, limbs)].side == side:
            arm["pad"][side] = 0.0
            arm["fore"] = links[-1].length_m + robot.probe.length_m
        if arm["chain"]:  # fixed links lengthen the arms, too
            chain = build_arm_chain(robot, side)
            arm["upper"], arm["fore"], arm["p_BS"][side] = chain.upper, chain.fore, chain.p_shoulder
    for j, limb in enumerate(joints):
        link = limb.link
        arm["q_min"][j], arm["q_max"][j] = link.reach
        if link.passive:
            arm["swing"] = j
            arm["sensed"][j] = 1.0
        if link.flex_stiffness_nm_per_rad is not None:
            arm["k"][j] = springs.stiffness[j]
            arm["d"][j] = link.flex_damping_nms_per_rad or 0.0
            arm["sensed"][j] = float(link.deflection_encoder)
            if limb.servo >= 0:
                drive = list_servos(robot)[limb.servo][1]
                arm["slack"][j] = springs.slack[j]
                arm["stall"][j] = drive.stall_torque_nm
            arm["linear"][j] = math.radians(link.flex_linear_deg or 0.0)
            stop = link.flex_beyond == "stop"
            arm["hardening"][j] = STOP_HARDENING if stop else springs.hardening[j]
    return out
