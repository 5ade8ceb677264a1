"""Stations of a mission: places of contact and the robot's poses in front of them."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import exp_so3, log_so3, rot_z
from skywright.description.loader import Description
from skywright.description.world.structure import build_surface, locate_point
from skywright.description.world.wind import compute_direction, compute_speed
from skywright.models.contact_stance import ContactStance
from skywright.models.hover_tilt import compute_hover_tilt


class Station(NamedTuple):
    """One place of contact and the poses before it."""

    name: str
    place: Array  # (2,) m in S
    p_contact: Array  # (3,) m in W
    R_WS: Array  # (3, 3) frame of the surface there, z outward
    yaw: float
    R_level: Array  # (3, 3)
    R_dock: Array  # (3, 3) docked or pressing attitude
    tilt_limit: float  # rad, computed hover limit in the wind there
    R_approach: Array  # (3, 3) the part of it that hover allows
    p_dock: Array  # (3,) m, platform with its feet on the deck (NaN without docking)
    p_press: Array  # (3,) m, platform with its tip on the surface, flying (NaN without)

    @property
    def normal(self) -> Array:
        """Outward normal (3,) there."""
        return self.R_WS[:, 2]


def build_station(
    d: Description, place: Array, name: str, dock_tip: Array, free: ContactStance | None,
    q_hover: Array, slides: bool,
) -> Station:  # fmt: skip
    """Return the poses at a place: z_B against a surface that faces down, x_B against a wall."""
    structure = d.world.structure
    assert structure is not None
    p, R = locate_point(build_surface(structure), place)
    normal = np.array(R[:, 2])
    if structure.facing == "down":
        # the arm's plane lies across a slide (missions/skills/sliding.py)
        z, x = -normal, np.array(R[:, 1 if slides else 0])
        yaw = math.atan2(x[1], x[0])
        R_dock = np.ascontiguousarray(np.column_stack([x, np.cross(z, x), z]))
    else:
        yaw = math.atan2(-normal[1], -normal[0])
        R_dock = rot_z(yaw)
    R_level = rot_z(yaw)
    turn, part = np.empty(3), np.empty((3, 3))
    log_so3(np.ascontiguousarray(R_level.T @ R_dock), turn)
    angle = float(np.linalg.norm(turn))
    wind = compute_speed(d.world.wind) * compute_direction(d.world.wind)
    tilt_limit = compute_hover_tilt(
        d.robot, q_hover, d.world.gravity_mps2, wind=R_level.T @ wind,
        air_density=d.world.air_density_kg_m3,
    )  # fmt: skip
    scale = 1.0 if angle < 1e-9 else min(1.0, d.mission.task.tilt_fraction * tilt_limit / angle)
    exp_so3(scale * turn, part)
    p_press = np.full(3, math.nan) if free is None else p - R_dock @ free.tip
    return Station(
        name, place, p, R, yaw, R_level, R_dock, tilt_limit, R_level @ part,
        p - R_dock @ dock_tip, p_press,
    )  # fmt: skip
