"""The plant's arm: links and servos with their deviations from the robot file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.description.robot.arm import Servo
from skywright.description.robot.limbs import Limb, list_limbs, list_servos
from skywright.description.robot.spec import Robot

if TYPE_CHECKING:
    from skywright.models.arm_body import Deviation


def list_true_limbs(robot: Robot, deviation: Deviation) -> list[Limb]:
    """Return all links, parents first, with their true springs."""
    limbs, j = [], 0
    for limb in list_limbs(robot):
        link = limb.link
        if link.joint != "fixed":
            if link.flex_stiffness_nm_per_rad is not None and len(deviation.spring_factor):
                hard = max(link.flex_hardening * deviation.hardening_factor, 1.0)
                k = link.flex_stiffness_nm_per_rad * float(deviation.spring_factor[j])
                link = link.model_copy(
                    update={"flex_stiffness_nm_per_rad": k, "flex_hardening": hard}
                )
            j += 1
        limbs.append(limb._replace(link=link))
    return limbs


def list_true_servos(robot: Robot, deviation: Deviation) -> list[tuple[str, Servo]]:
    """Return (name, servo) of every servo, with its true play and lag."""
    lag = deviation.servo_lag_factor
    return [
        (
            name,
            servo.model_copy(
                update={
                    "backlash_deg": servo.backlash_deg * deviation.backlash_factor,
                    "velocity_time_constant_s": servo.velocity_time_constant_s * lag,
                    "position_time_constant_s": servo.position_time_constant_s * lag,
                }
            ),
        )
        for name, servo in list_servos(robot)
    ]
