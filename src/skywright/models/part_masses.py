"""Masses and inertias of a robot's parts, for model, scene and exported files."""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_x, rot_y
from skywright.description.robot.arm import Hand, Link
from skywright.description.robot.docking import Docking
from skywright.description.robot.inertia import build_inertia
from skywright.description.robot.limbs import end_of
from skywright.description.robot.spec import Platform, Probe

SLIDER_INERTIA = 1e-6
"""kg m^2 of the probe's sprung part about its own centre: MuJoCo requires a value above zero."""


class ProbeParts(NamedTuple):
    """Distribution of the probe's mass along its axis (from the link's end to the tip)."""

    holder_mass: float
    holder_length: float
    slider_mass: float
    slider_com: float


def build_probe_parts(probe: Probe) -> ProbeParts:
    """Holder: a rod up to the spring; slider: the sprung part, its com near the tip."""
    slider_length = min(0.05, 0.5 * probe.length_m)
    return ProbeParts(
        probe.mass_kg - probe.slider_mass_kg,
        probe.length_m - slider_length,
        probe.slider_mass_kg,
        probe.length_m - 0.5 * slider_length,
    )


def rod_inertia(mass: float, length: float, radius: float) -> Array:
    """Return the (3, 3) inertia of a solid cylinder along x about its centre."""
    axial = 0.5 * mass * radius**2
    across = mass * (length**2 / 12 + radius**2 / 4)
    return np.diag([axial, across, across])


def build_docking_parts(docking: Docking) -> tuple[float, Array, Array]:
    """Return mass (kg), centre of mass (3,) m in B and inertia (3, 3) kg m^2 about it.

    The gear is thin legs from the hub to the feet and a ring through the feet, half of the mass
    each.
    """
    m, h, r = docking.mass_kg, docking.height_m, docking.radius_m
    com = np.array([0.0, 0.0, 0.75 * h])  # ring at h, legs' middle at h / 2
    ring = 0.5 * m * r**2 * np.diag([0.5, 0.5, 1.0])
    legs = 0.5 * m * np.diag([r**2 / 6 + h**2 / 3, r**2 / 6 + h**2 / 3, r**2 / 3])
    origin = ring + legs + 0.5 * m * h**2 * np.diag([1.0, 1.0, 0.0])
    return m, com, origin - m * com[2] ** 2 * np.diag([1.0, 1.0, 0.0])


def link_direction(link: Link) -> Array:
    """Return the unit vector (3,) along the link, in its frame."""
    end = np.array(end_of(link))
    return end / np.linalg.norm(end)


def link_inertia(link: Link) -> Array:
    """Return the (3, 3) inertia of a link about its centre, in its frame.

    It is the file's, or by default that of a solid cylinder.
    """
    xx, yy, zz = link.inertia_xx_kgm2, link.inertia_yy_kgm2, link.inertia_zz_kgm2
    if xx is not None and yy is not None and zz is not None:
        return build_inertia(
            xx, yy, zz, link.inertia_xy_kgm2, link.inertia_xz_kgm2, link.inertia_yz_kgm2
        )
    rod = np.diag(rod_inertia(link.mass_kg, link.length_m, link.radius_m))
    return np.diag(rod if link.along == "x" else rod[::-1])


def tip_rotation(link: Link, pitch_deg: float = 0.0) -> Array:
    """Return R_LT (3, 3): z_T is the link's direction turned by `pitch_deg` about y; y_T is y."""
    z = rot_y(math.radians(pitch_deg)) @ link_direction(link)
    y = np.array([0.0, 1.0, 0.0])
    return np.column_stack([np.cross(y, z), y, z])


def link_com(link: Link) -> Array:
    """Return the centre of mass (3,) m in the link's frame."""
    if link.has_com_vector:
        return np.array([link.com_x_m or 0.0, link.com_y_m or 0.0, link.com_z_m or 0.0])
    along = link.com_m if link.com_m is not None else 0.5 * link.length_m
    return along * link_direction(link)


def set_inertia(body: Any, inertia: Array) -> None:
    """Set the inertia (3, 3) kg m^2 of a body of an MjSpec about its centre of mass."""
    off = (inertia[0, 1], inertia[0, 2], inertia[1, 2])
    if any(off):
        body.fullinertia = [*np.diag(inertia), *off]
    else:
        body.inertia = np.diag(inertia)
    body.explicitinertial = True


def platform_inertia(platform: Platform) -> Array:
    """Return the platform's (3, 3) inertia about its centre of mass, in the axes of B."""
    return build_inertia(*platform.inertia_terms)


def build_hand_body(hand: Hand) -> tuple[Array, Array]:
    """Return centre of mass (3,) m and inertia (3, 3) kg m^2 about it, both in frame H.

    The hand is a solid ball at the tip, or a gripper with open fingers.
    """
    if hand.kind != "gripper":
        return np.zeros(3), 0.4 * hand.mass_kg * hand.radius_m**2 * np.eye(3)
    inertia = np.zeros((3, 3))
    for finger in place_fingers(hand):
        _, y, z = finger.p + finger.R @ finger.com
        inertia += finger.R @ finger_inertia(hand) @ finger.R.T
        inertia += 0.5 * hand.mass_kg * y**2 * np.diag([1.0, 0.0, 1.0])
    return np.array([0.0, 0.0, z]), inertia


class Finger(NamedTuple):
    """The body of a gripper's open finger in frame H; its z axis is along the finger."""

    sign: float  # 1: finger on the side of y, -1: on the side of -y
    p: Array  # (3,) m: the finger's centre, or the pivot of a rotating one
    R: Array  # (3, 3)
    com: Array  # (3,) m, in its frame


def place_fingers(hand: Hand) -> list[Finger]:
    """Return both fingers of a gripper."""
    centre, out = np.array([0.0, 0.0, 0.5 * hand.length_m]), []
    for sign in (1.0, -1.0):
        if hand.finger == "turn":
            p = np.array([0.0, sign * hand.pivot_m, -hand.length_m])
            out.append(Finger(sign, p, rot_x(-sign * math.radians(hand.open_deg)), centre))
        else:
            p = np.array([0.0, sign * (0.5 * hand.stroke_m + hand.radius_m), -centre[2]])
            out.append(Finger(sign, p, np.eye(3), np.zeros(3)))
    return out


def finger_inertia(hand: Hand) -> Array:
    """Return the (3, 3) inertia of one finger about its centre: a rod along z of its body."""
    rod = rod_inertia(0.5 * hand.mass_kg, hand.length_m, hand.radius_m)
    return np.diag(np.diag(rod)[::-1])
