"""A gripper in the scene: two fingers, one motor, and the friction of the pads.

The hand's body has frame H (z out of the robot, y along the fingers' travel). In the plant the
joint positions are the closing travel of each finger; the motor acts on both, and an equality
constraint between them models the screw that keeps them synchronous. Rotating fingers have a lever:
the motor's force is the pads' force while the fingers are parallel.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import quat_from_rot
from skywright.description.robot.arm import Hand
from skywright.models.part_masses import finger_inertia, place_fingers, set_inertia

MOTOR_TIME = 0.005
"""s for the unloaded motor to reach its speed, as for small gear motors. Its inertia reflected
through the screw, some kg per finger, resists side loads."""
IN_STEP = (0.004, 1.0)
"""solref of the constraint between the fingers: two steps of 2 ms."""
END_STOP = (0.008, 1.0)
LIMITED = mujoco.mjtLimited.mjLIMITED_TRUE


def add_fingers(
    body: mujoco.MjsBody, hand: Hand, mass_factor: float, plant: bool, touch: dict[str, Any]
) -> None:
    """Add fingers to a hand's body, which is in frame H; `touch` is the contact of its pads."""
    reflected = 2.0 * MOTOR_TIME * hand.grip_force_n / hand.grip_speed_mps * lever(hand) ** 2
    for k, placed in enumerate(place_fingers(hand)):
        name = f"{body.name} finger{k}"
        finger = body.add_body(name=name, pos=placed.p, quat=quat_from_rot(placed.R))
        finger.mass, finger.ipos = 0.5 * hand.mass_kg * mass_factor, placed.com
        set_inertia(finger, finger_inertia(hand) * mass_factor)
        if hand.finger == "turn":
            _add_round_pad(finger, hand, touch)
            motion = {"type": mujoco.mjtJoint.mjJNT_HINGE, "axis": [placed.sign, 0.0, 0.0]}
            far = math.radians(hand.open_deg - hand.closed_deg)
        else:
            finger.add_geom(
                name=f"{name} pad", type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[hand.radius_m, hand.radius_m, 0.5 * hand.length_m], **touch,
            )  # fmt: skip
            motion = {"type": mujoco.mjtJoint.mjJNT_SLIDE, "axis": [0.0, -placed.sign, 0.0]}
            far = 0.5 * hand.stroke_m
        if plant:
            finger.add_joint(
                name=name, limited=LIMITED, range=[0.0, far], armature=reflected,
                solref_limit=END_STOP, **motion,
            )  # fmt: skip


def lever(hand: Hand) -> float:
    """Return the ratio of a pad's travel to that of its finger's joint: m/rad, or 1."""
    return hand.length_m if hand.finger == "turn" else 1.0


def _add_round_pad(finger: mujoco.MjsBody, hand: Hand, touch: dict[str, Any]) -> None:
    """Add a pad that stays parallel to a flat side at every angle of the finger, and the finger's
    rod."""
    r, along = hand.radius_m, hand.length_m
    for part, size, ends in (
        ("pad", r, [-r, 0.0, along, r, 0.0, along]),
        ("rod", 0.5 * r, [0.0, 0.0, 0.0, 0.0, 0.0, along]),
    ):
        finger.add_geom(
            name=f"{finger.name} {part}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[size, 0, 0],
            fromto=ends, **touch,
        )  # fmt: skip


def add_grip_motor(spec: mujoco.MjSpec, name: str, hand: Hand) -> None:
    """Add the motor of the gripper `name` to the plant, behind the arms' servos."""
    fingers = [f"{name} finger{k}" for k in range(2)]
    step = spec.add_equality(
        name=f"{name} screw", type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=fingers[0], name2=fingers[1], solref=IN_STEP,
    )  # fmt: skip
    step.data = np.eye(12)[1]  # both close equally far
    tendon = spec.add_tendon(name=f"{name} grip")
    for finger in fingers:
        tendon.wrap_joint(finger, lever(hand))
    slope = hand.grip_force_n / hand.grip_speed_mps
    spec.add_actuator(
        name=f"{name} grip", target=f"{name} grip", trntype=mujoco.mjtTrn.mjTRN_TENDON,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED, gainprm=[1.0] + [0.0] * 9,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE, biasprm=[0.0, 0.0, -slope] + [0.0] * 7,
    )  # fmt: skip


def find_grippers(model: mujoco.MjModel, n_hands: int) -> dict[int, tuple[int, Array]]:
    """Return (actuator, qpos of both fingers) of each hand with a gripper, in a plant."""
    out = {}
    for h in range(n_hands):
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, f"hand{h} grip")
        if motor >= 0:
            fingers = [model.joint(f"hand{h} finger{k}").qposadr[0] for k in range(2)]
            out[h] = motor, np.array(fingers)
    return out
