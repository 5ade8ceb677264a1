"""Keys of a robot's arms: `[robot.arm]`, its links, its servos and its hands.

A link's frame is at its joint, with x along the link. Every number has its unit in the key.
"""

from __future__ import annotations

import math
import re
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from skywright.core.spec import Length, NonNegative, Offset, Positive, Spec
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.bar import Bar
from skywright.description.robot.inertia import MOMENTS, PRODUCTS, check_inertia


class Link(Spec):
    """One arm link, moved by one joint at its origin; x is along the link.

    The joint is at (`x_m`, `y_m`, `z_m`) in the parent's frame; by default at the end of the parent
    link (its `length_m` along x), or at the mount for the first link. At zero the link's frame is
    the parent's, rotated by Rz(yaw) Ry(pitch) Rx(roll), the convention of URDF; by default both
    have the same axes. A slide has its limits and postures in `_m` keys, and needs the limits.
    """

    parent: str | None = None  # link name, or "platform"; default: the link before it
    x_m: Offset | None = None
    y_m: Offset | None = None
    z_m: Offset | None = None
    roll_deg: float = 0.0  # of the link's frame in the parent's, with the joint at zero
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    side: Literal["both", "left", "right"] = "both"  # with sides = 2: on which arms it is
    joint: Literal["hinge", "slide", "fixed"] = "hinge"
    axis: Literal["x", "y", "z"] = "y"
    along: Literal["x", "-z"] = "x"  # the link's direction in its frame: forward, or down
    passive: bool = False  # no servo: the joint moves freely
    damping_nms_per_rad: NonNegative = 0.0  # of a passive joint's bearing
    friction_nm: NonNegative = 0.0
    length_m: Length
    mass_kg: Positive
    com_m: Offset | None = None  # along the link; default: the middle
    com_x_m: Offset | None = None  # or the centre of mass in the link's frame
    com_y_m: Offset | None = None
    com_z_m: Offset | None = None
    inertia_xx_kgm2: Positive | None = None  # about it; default: of a solid cylinder
    inertia_yy_kgm2: Positive | None = None
    inertia_zz_kgm2: Positive | None = None
    inertia_xy_kgm2: float = 0.0  # product of inertia: the tensor's entry, -sum m x y
    inertia_xz_kgm2: float = 0.0
    inertia_yz_kgm2: float = 0.0
    radius_m: Length = 0.015  # collision capsule
    joint_min_deg: float = -180.0
    joint_max_deg: float = 180.0
    folded_deg: float = 0.0  # in free flight and on the ground
    working_deg: float = 0.0  # initial posture of a task
    # of a slide, with the three keys below: instead of the angles
    joint_min_m: Offset | None = None
    joint_max_m: Offset | None = None
    folded_m: Offset = 0.0
    working_m: Offset = 0.0
    flex_stiffness_nm_per_rad: Positive | None = None  # structural, in series with the joint
    flex_damping_ratio: NonNegative = 0.03
    flex_damping_nms_per_rad: NonNegative | None = None  # instead of the ratio
    flex_linear_deg: Positive | None = None  # deflection up to which the spring is linear
    flex_beyond: Literal["stop", "hardening"] = "stop"  # behaviour beyond that deflection
    # ratio of the stiffness beyond that deflection to the stiffness within
    flex_hardening: float = Field(default=4.0, ge=1.0)
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
        low, high = self.joint_min_m, self.joint_max_m
        if (low is None) != (high is None):
            raise ValueError("give both joint_min_m and joint_max_m, or neither")
        if low is None or high is None:
            if self.joint == "slide":
                raise ValueError("joint = 'slide' needs joint_min_m and joint_max_m")
            if self.folded_m or self.working_m:
                raise ValueError("folded_m and working_m need joint_min_m and joint_max_m")
            return self
        if self.joint != "slide":
            raise ValueError(f"joint_min_m is of a slide; this joint is a {self.joint}")
        for name in ("joint_min", "joint_max", "folded", "working"):
            given, default = getattr(self, f"{name}_deg"), Link.model_fields[f"{name}_deg"].default
            if given != default:
                raise ValueError(
                    f"{name}_deg = {given:g} has no effect on a slide: use {name}_m, and leave "
                    f"{name}_deg at {default:g}"
                )
        if high <= low:
            raise ValueError("joint_max_m must exceed joint_min_m")
        for name in ("folded_m", "working_m"):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} lies outside joint_min_m..joint_max_m")
        return self

    @model_validator(mode="after")
    def _mass_is_a_body_s(self) -> Link:
        if self.com_m is not None and self.has_com_vector:
            raise ValueError("give com_m, or com_x_m, com_y_m and com_z_m, not both")
        moments = [getattr(self, name) for name in MOMENTS]
        if any(x is None for x in moments):
            if any(x is not None for x in moments) or any(getattr(self, n) for n in PRODUCTS):
                raise ValueError(f"give {', '.join(MOMENTS)} together, or none of the inertia keys")
            return self
        check_inertia(*moments, *(getattr(self, name) for name in PRODUCTS))
        return self

    @property
    def has_com_vector(self) -> bool:
        """Whether the centre of mass is given by its three coordinates."""
        return any(x is not None for x in (self.com_x_m, self.com_y_m, self.com_z_m))

    @property
    def is_turned(self) -> bool:
        """Whether the link's frame is rotated relative to the parent's with the joint at zero."""
        return bool(self.roll_deg or self.pitch_deg or self.yaw_deg)

    @property
    def reach(self) -> tuple[float, float]:
        """Least and largest value of the joint (rad; of a slide m)."""
        if self.joint_min_m is not None and self.joint_max_m is not None:
            return self.joint_min_m, self.joint_max_m
        return math.radians(self.joint_min_deg), math.radians(self.joint_max_deg)

    def rest(self, which: str) -> float:
        """Return the joint's value (rad; of a slide m) in the posture `folded` or `working`."""
        if self.joint_min_m is not None:
            return float(getattr(self, f"{which}_m"))
        return math.radians(getattr(self, f"{which}_deg"))

    def describe(self, value: float) -> str:
        """Return a value of the joint (rad; of a slide m) as text."""
        return f"{value:g} m" if self.joint == "slide" else f"{math.degrees(value):g} deg"


class Servo(Spec):
    """A servo motor of the arm, commanded by a velocity, an angle (most smart servos) or a torque.

    On a slide, N replaces N m, m replaces rad, and kg replaces kg m^2 in all keys.
    """

    side: Literal["both", "left", "right"] = "both"  # with sides = 2: on which arms it is
    mode: Literal["velocity", "position", "torque"] = "velocity"
    stall_torque_nm: Positive
    no_load_speed_rad_s: Positive
    velocity_time_constant_s: Positive = 0.03  # mode "torque": of the law's joint loop
    position_time_constant_s: float = Field(default=0.05, ge=0.005, le=2)  # T_s: Suarez 2020 (17)
    command_period_s: float = Field(default=0.02, ge=0.001, le=1)  # mode "position"; and readings
    resolution_deg: float = Field(default=0.0, ge=0, le=30)  # of a commanded angle
    backlash_deg: float = Field(default=0.0, ge=0, le=30)  # of the gear, at the output
    armature_kgm2: Positive = 0.005  # rotor inertia through the gear
    friction_nm: NonNegative = 0.0  # dry friction of the gear, at the output
    encoder_counts: int = Field(default=4096, ge=16, le=2**24)


class Hand(Spec):
    """The end of an arm without a probe: a ball (or pad) at the tip, a hook, or a gripper.

    A gripper's two fingers extend from the link's end to the tip and move symmetrically along y of
    the link. Its motor's force decreases linearly with its speed: `grip_force_n` at stall, zero at
    `grip_speed_mps`. Rotating fingers have their pivots beside the link's end and round pads
    `length_m` from them; force and speed are those of the pads while the fingers are parallel.
    """

    kind: Literal["ball", "hook", "gripper"] = "ball"
    length_m: float = Field(default=0.0, ge=0, le=100)  # from the link's end to the tip
    mass_kg: NonNegative = 0.0  # of a gripper: both fingers
    radius_m: Length = 0.012  # of the ball; of a gripper half the width of a finger, or of its pad
    hook_length_m: Length = 0.05  # of the hook's cross bar, forward
    friction: NonNegative = 0.5
    # motion of a gripper's fingers: translation or rotation
    finger: Literal["slide", "turn"] = "slide"
    # of a gripper with sliding fingers: distance between the open fingers
    stroke_m: Length = 0.06
    pivot_m: NonNegative = 0.03  # of rotating fingers: from the link's axis to each pivot
    # angle of an open finger from the link's axis, outward
    open_deg: float = Field(default=30.0, ge=-80, le=80)
    # angle of a closed finger from the link's axis, outward
    closed_deg: float = Field(default=-30.0, ge=-80, le=80)
    # rate at which the distance of the pads changes without a load
    grip_speed_mps: Positive = 0.1
    grip_force_n: Positive = 20.0  # of each finger

    @model_validator(mode="after")
    def _fingers_are_bodies(self) -> Hand:
        if self.kind == "gripper" and not (self.length_m > 0.0 and self.mass_kg > 0.0):
            raise ValueError("a gripper has fingers: length_m and mass_kg must be above 0")
        if self.kind == "gripper" and self.finger == "turn":
            if 2.0 * self.pivot_m <= self.radius_m:
                raise ValueError(
                    f"pivot_m is {self.pivot_m:g}; fingers of radius_m = {self.radius_m:g} need "
                    f"more than {0.5 * self.radius_m:g}"
                )
            if self.open_deg <= self.closed_deg or self.opening(math.radians(self.open_deg)) <= 0:
                raise ValueError(
                    f"open_deg is {self.open_deg:g}, closed_deg {self.closed_deg:g}: the pads do "
                    "not part; open_deg must be above closed_deg, and pivot_m + length_m "
                    "sin(open_deg) above radius_m"
                )
        return self

    def opening(self, angle: float) -> float:
        """Return the distance (m) of the pads of rotating fingers at `angle` (rad) outward."""
        return 2.0 * (self.pivot_m + self.length_m * math.sin(angle) - self.radius_m)

    @property
    def opening_max_m(self) -> float:
        """Distance of a gripper's pads when its fingers are open."""
        turns = self.finger == "turn"
        return self.opening(math.radians(self.open_deg)) if turns else self.stroke_m

    @property
    def opening_min_m(self) -> float:
        """Distance of a gripper's pads when its fingers have closed without an object."""
        turns = self.finger == "turn"
        return max(self.opening(math.radians(self.closed_deg)), 0.0) if turns else 0.0


TAKEN = re.compile(
    r"world|platform|gear|docking|pendulum|holder|slider|spring|free|tip|bar|map|(left_|right_)?contact|(hand|rotor|object)\s?\d*"
)
"""Reserved names of parts and joints: links must have other names."""


class Arm(Spec):
    """Links in order (a chain unless `parent` is set) and the servos that drive them.

    `belt` is J_AM of Tognon 2018: joint speeds = J_AM * motor speeds (default: identity). With
    `sides = 2` the links describe the left arm; the right one is its mirror image, and the two
    shoulders are `separation_m` apart, and farther by `mount_y_m` on each side. A link or servo
    with `side = "left"` or `"right"` belongs to that arm only and is not mirrored, so the two arms
    may differ.
    """

    inline_tables: ClassVar[tuple[str, ...]] = ("links", "servos")

    # origin of the first joint; a pendulum carries the arm at the end of its link: x and z must be
    # 0
    mount_x_m: Offset = 0.0
    mount_y_m: Offset = 0.0
    mount_z_m: Offset = 0.0
    sides: Literal[1, 2] = 1
    encoders: Literal["both", "left"] = "both"  # arms that have the links' deflection encoders
    separation_m: Length = 0.3
    drag_coefficient: float = Field(default=0.0, ge=0, le=10)  # of the links, as cylinders; 0: none
    links: dict[str, Link]
    servos: dict[str, Servo]
    belt: list[list[float]] | None = None
    hand: Hand = Hand()
    bar: Bar | None = None  # bar that both hands hold

    @model_validator(mode="before")
    @classmethod
    def _split(cls, data: object) -> object:
        """Distinguish `[robot.arm.link1]` and `[robot.arm.motor1]` by their keys."""
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
        if not self.links:  # a mission that sets a key of the arm, with a robot without arm
            raise ValueError("[robot.arm] has no links; add [robot.arm.NAME] tables")
        sides = {n: x.side for n, x in self.links.items()}
        sides |= {n: x.side for n, x in self.servos.items()}
        alone = [name for name, side in sides.items() if side != "both"]
        if alone and self.sides == 1:
            raise ValueError(f"{alone[0]}.side needs two arms: sides = 2")
        moving = [n for n, link in self.links.items() if link.joint != "fixed"]
        joints = sum(link.joint != "fixed" for links in self.chains for link in links.values())
        if joints > MAX_JOINTS:
            raise ValueError(f"{joints} joints; at most {MAX_JOINTS} are supported")
        driven = [n for n in moving if not self.links[n].passive]
        for side, links in zip(("left", "right"), self.chains, strict=False):
            if not links:
                raise ValueError(f"sides = 2, but no link is on the {side} arm")
            n = sum(link.joint != "fixed" and not link.passive for link in links.values())
            servos = sum(servo.side in ("both", side) for servo in self.servos.values())
            if servos != n:
                raise ValueError(
                    f"{servos} servos for {n} driven joints{f' ({side})' if alone else ''}: give "
                    "one servo table per driven joint"
                )
        if len({servo.mode for servo in self.servos.values()}) > 1:
            raise ValueError("servos have different modes: all servos must have the same mode")
        if self.belt is not None and (self.sides == 2 or len(driven) < len(moving)):
            raise ValueError("a belt needs a single arm (sides = 1) without passive joints")
        for name in self.links:
            if TAKEN.fullmatch(name):
                raise ValueError(f"a link cannot be named {name!r}: this name is reserved")
        for links in self.chains:
            before = ["platform"]  # parents precede their children, so there are no cycles
            for name, link in links.items():
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

    @property
    def chains(self) -> list[dict[str, Link]]:
        """Links of each arm by name; the left or only arm first."""
        sides = ("left", "right")[: self.sides]
        return [{n: x for n, x in self.links.items() if x.side in ("both", s)} for s in sides]
