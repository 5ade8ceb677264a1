"""What a robot file may say of its arms: `[robot.arm]`, its links, its servos and its hands.

A link's frame sits at its joint, with x along the link. Every number has its unit in the key.
"""

from __future__ import annotations

import re
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from skywright.core.spec import Length, NonNegative, Offset, Positive, Spec
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.bar import Bar


class Link(Spec):
    """One arm link, moved by one joint at its origin; x runs along the link.

    The joint sits at (`x_m`, `y_m`, `z_m`) in the parent's frame; without them at the end of the
    parent link (its `length_m` along x), or at the mount for the first. Hinge angle zero means x
    parallel to the parent's x.
    """

    parent: str | None = None  # link name, or "platform"; default: the link before it
    x_m: Offset | None = None
    y_m: Offset | None = None
    z_m: Offset | None = None
    joint: Literal["hinge", "slide", "fixed"] = "hinge"
    axis: Literal["x", "y", "z"] = "y"
    along: Literal["x", "-z"] = "x"  # the link's direction in its frame: forward, or hanging
    passive: bool = False  # no servo: swings freely
    damping_nms_per_rad: NonNegative = 0.0  # of a passive joint's bearing
    friction_nm: NonNegative = 0.0
    length_m: Length
    mass_kg: Positive
    com_m: Offset | None = None  # along the link; default: the middle
    radius_m: Length = 0.015  # collision capsule
    joint_min_deg: float = -180.0
    joint_max_deg: float = 180.0
    folded_deg: float = 0.0  # in free flight and on the ground
    working_deg: float = 0.0  # posture that a task starts from
    flex_stiffness_nm_per_rad: Positive | None = None  # structural, in series with the joint
    flex_damping_ratio: NonNegative = 0.03
    flex_damping_nms_per_rad: NonNegative | None = None  # in place of the ratio
    flex_linear_deg: Positive | None = None  # deflection up to which the spring is linear
    flex_beyond: Literal["stop", "hardening"] = "stop"  # what happens beyond
    flex_hardening: float = Field(default=4.0, ge=1.0)  # stiffness beyond, over that within
    deflection_encoder: bool = False  # the controller measures shaft minus output link
    lateral_stiffness_nm_per_rad: Positive | None = None  # bending out of the joint's plane
    lateral_damping_ratio: NonNegative = 0.05

    @model_validator(mode="after")
    def _moves_as_it_says(self) -> Link:
        if self.passive and self.joint == "fixed":
            raise ValueError("passive = true requires a movable joint: joint = 'hinge' or 'slide'")
        if self.flex_linear_deg is not None and self.flex_stiffness_nm_per_rad is None:
            raise ValueError("flex_linear_deg needs flex_stiffness_nm_per_rad")
        if self.deflection_encoder and self.flex_stiffness_nm_per_rad is None:
            raise ValueError("deflection_encoder needs flex_stiffness_nm_per_rad")
        return self

    @model_validator(mode="after")
    def _limits_ordered(self) -> Link:
        if self.joint_max_deg <= self.joint_min_deg:
            raise ValueError("joint_max_deg must exceed joint_min_deg")
        for name in ("folded_deg", "working_deg"):
            if not self.joint_min_deg <= getattr(self, name) <= self.joint_max_deg:
                raise ValueError(f"{name} lies outside joint_min_deg..joint_max_deg")
        return self


class Servo(Spec):
    """A servo motor of the arm: it takes a velocity, an angle (most smart servos) or a torque."""

    mode: Literal["velocity", "position", "torque"] = "velocity"
    stall_torque_nm: Positive
    no_load_speed_rad_s: Positive
    velocity_time_constant_s: Positive = 0.03  # mode "torque": of the law's loop around it
    position_time_constant_s: float = Field(default=0.05, ge=0.005, le=2)  # T_s: Suarez 2020 (17)
    command_period_s: float = Field(default=0.02, ge=0.001, le=1)  # mode "position"; and readings
    resolution_deg: float = Field(default=0.0, ge=0, le=30)  # of a commanded angle
    backlash_deg: float = Field(default=0.0, ge=0, le=30)  # of the gear, seen at the output
    armature_kgm2: Positive = 0.005  # rotor inertia through the gear
    friction_nm: NonNegative = 0.0  # dry friction of the gear, seen at the output
    encoder_counts: int = Field(default=4096, ge=16, le=2**24)


class Hand(Spec):
    """What an arm without a probe ends in: a ball (or pad) at the tip, or a hook."""

    kind: Literal["ball", "hook"] = "ball"
    length_m: float = Field(default=0.0, ge=0, le=100)  # from the link's end to the tip
    mass_kg: NonNegative = 0.0
    radius_m: Length = 0.012  # of the ball
    hook_length_m: Length = 0.05  # of the hook's cross bar, forward
    friction: NonNegative = 0.5


TAKEN = re.compile(
    r"platform|gear|docking|pendulum|holder|slider|spring|free|tip|bar|map|(left_|right_)?contact|(hand|rotor|object)\s?\d*"
)
"""Parts and joints that are there anyway: links have other names."""


class Arm(Spec):
    """Links in order (a chain unless `parent` says otherwise) and the servos that drive them.

    `belt` is J_AM of Tognon 2018: joint speeds = J_AM * motor speeds (identity when absent).
    With `sides = 2` the links describe the left arm; the right one is its mirror image, and the
    two shoulders are `separation_m` apart.
    """

    inline_tables: ClassVar[tuple[str, ...]] = ("links", "servos")

    mount_x_m: Offset = 0.0
    mount_y_m: Offset = 0.0
    mount_z_m: Offset = 0.0
    sides: Literal[1, 2] = 1
    encoders: Literal["both", "left"] = "both"  # which arms have the links' deflection encoders
    separation_m: Length = 0.3
    drag_coefficient: float = Field(default=0.0, ge=0, le=10)  # of the links, as cylinders; 0: none
    links: dict[str, Link]
    servos: dict[str, Servo]
    belt: list[list[float]] | None = None
    hand: Hand = Hand()
    bar: Bar | None = None  # what both hands hold

    @model_validator(mode="before")
    @classmethod
    def _split(cls, data: object) -> object:
        """`[robot.arm.link1]` and `[robot.arm.motor1]` are told apart by their keys."""
        if not isinstance(data, dict) or "links" in data:
            return data
        out: dict[str, object] = {"links": {}, "servos": {}}
        for key, value in data.items():
            if isinstance(value, dict) and key not in cls.model_fields:
                names = set(value)
                servo = len(names & set(Servo.model_fields)) > len(names & set(Link.model_fields))
                out["servos" if servo else "links"][key] = value  # type: ignore[index]
            else:
                out[key] = value
        return out

    @model_validator(mode="after")
    def _consistent(self) -> Arm:
        if not self.links:  # a mission that sets a key of the arm, flown by a robot without
            raise ValueError("[robot.arm] has no links; add [robot.arm.NAME] tables")
        moving = [n for n, link in self.links.items() if link.joint != "fixed"]
        joints = self.sides * len(moving)
        if joints > MAX_JOINTS:
            raise ValueError(f"{joints} joints; at most {MAX_JOINTS} are supported")
        driven = [n for n in moving if not self.links[n].passive]
        if len(self.servos) != len(driven):
            raise ValueError(
                f"{len(self.servos)} servos for {len(driven)} driven joints: give one "
                "servo table per driven joint"
            )
        if len({servo.mode for servo in self.servos.values()}) > 1:
            raise ValueError("servos have different modes: all servos must have the same mode")
        if self.belt is not None and (self.sides == 2 or len(driven) < len(moving)):
            raise ValueError("a belt needs a single arm (sides = 1) without passive joints")
        for name in self.links:
            if TAKEN.fullmatch(name):
                raise ValueError(f"a link cannot be named {name!r}: this name is reserved")
        before = ["platform"]  # a parent comes first, so there are no cycles
        for name, link in self.links.items():
            if link.parent is not None and link.parent not in before:
                raise ValueError(
                    f"{name}.parent is {link.parent!r}; valid are the links before it: "
                    f"{', '.join(before)}"
                )
            before.append(name)
        if self.bar is not None and (self.sides == 1 or self.hand.mass_kg == 0.0):
            raise ValueError("a bar needs two hands: sides = 2 and hand.mass_kg above 0")
        if self.belt is not None:
            n = len(moving)
            if len(self.belt) != n or any(len(row) != n for row in self.belt):
                raise ValueError(f"belt must be a {n} x {n} matrix")
            if n and abs(float(np.linalg.det(np.array(self.belt)))) < 1e-6:
                raise ValueError("belt must be invertible: each joint requires its own motor")
        return self
