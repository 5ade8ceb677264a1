"""Thrust near surfaces: floors below a rotor, the inspected structure above it.

Floor: T / T_inf = 1 / (1 - (R / 4 z)^2), z the height of the rotor (Cheeseman and Bennett 1955), at
least half a radius. Floors are the ground and the upper faces of fixed boxes and upright cylinders
(benches, decks, blocks); of several floors the one with the largest effect counts. The part of a
disc that lies beside a floor gains no thrust.

Ceiling: T / T_inf = 1 / (1 - (R / (z + c2 R))^2 / c1), z the distance from the rotor to the
surface: the form that the group of Sanchez-Cuevas 2020 fitted to bench tests in earlier work. Its
constants are not published; c1 = 7 and c2 = 0.1 are assumed (a rotor of 0.12 m gains 16 % at one
radius, 1 % at the docking gear's 0.45 m). The gain is scaled with the cosine of the slope. Each
rotor is treated alone, without fountain flow or neighbours.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Array, Record
from skywright.core.rotations import quat_to_rot
from skywright.core.scratch import local
from skywright.core.types import MAX_ROTORS
from skywright.models.fixed_body import FIXED
from skywright.models.structure_distance import (
    StructureShape,
    fill_structure,
    is_below,
    measure_surface,
)
from skywright.vehicle.bus import Truth
from skywright.vehicle.component import Component, Effect, Out, helper, table
from skywright.vehicle.plant import RotorGain

CEILING_C1, CEILING_C2 = 7.0, 0.1
NEAREST = 0.5  # radii
FLOOR = 15
"""Size of the row of a floor."""
STEEPEST = 0.7  # cosine of the largest slope of a floor
FARTHEST = 8.0  # radii, distance beyond which a surface has no effect


class SurfaceThrust(Effect):
    """Fills RotorGain."""

    slot = "actuate"

    class Me(Record):
        floors: int  # address of (n_floors, FLOOR)
        n_floors: int
        has_structure: int
        structure: StructureShape
        disc: float  # m, radius of a rotor
        n: int
        rotor_p: Annotated[Array, MAX_ROTORS, 3]  # m
        rotor_axis: Annotated[Array, MAX_ROTORS, 3]

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read floors, structure and rotors."""
        rotors, structure = context.rotors, context.world.structure
        floors = find_floors(context.scene.model)
        me.floors, me.n_floors = context.keep(floors), len(floors)
        me.has_structure = structure is not None
        if structure is not None:
            fill_structure(me.structure, structure, context.true.surface)
        me.n, me.disc = len(rotors.thrust_min), context.robot.rotors.propeller_radius_m
        me.rotor_p[: me.n], me.rotor_axis[: me.n] = rotors.position, rotors.axis

    @staticmethod
    def step(me: Me, truth: Truth, out: Out[RotorGain]) -> None:
        hub, normal, R_WB = local(3), local(3), truth.R_WB
        floors = table(me.floors, me.n_floors, FLOOR)
        for k in range(me.n):
            up = 0.0
            for i in range(3):
                hub[i] = truth.p_WB[i]
                for j in range(3):
                    hub[i] += R_WB[i, j] * me.rotor_p[k, j]
            gain = 1.0
            for i in range(me.n_floors):
                gain = max(gain, compute_floor_gain(floors[i], hub, me.disc))
            z = measure_surface(me.structure, hub, normal) if me.has_structure else -1.0
            if 0.0 < z < FARTHEST * me.disc and is_below(me.structure, hub):
                for i in range(3):
                    for j in range(3):
                        up -= normal[i] * R_WB[i, j] * me.rotor_axis[k, j]
                if up > 0.0:
                    gain *= 1.0 + up * (compute_ceiling_gain(z, me.disc) - 1.0)
            out.gain[k] = gain

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has this effect: every world has a ground."""
        yield cls("surface thrust")


def find_floors(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Return the floors (n, FLOOR) of a scene: upward faces of fixed bodies with contacts.

    A row contains the centre of the face (3) m in W, its axes (9) as the columns of a row-major
    matrix, the third outward, its half sizes along the first two (m), and 1 for a round face.
    """
    rows = []
    bodies = [0, *(b for b in range(model.nbody) if model.body(b).name.startswith(FIXED))]
    fixed = np.isin(model.geom_bodyid, bodies)  # those with the frame of W
    still = np.flatnonzero(fixed & (model.geom_contype != 0))
    for g in still:
        kind, size = model.geom_type[g], model.geom_size[g]
        R = np.empty((3, 3))
        quat_to_rot(model.geom_quat[g], R)
        up, half = 2, [math.inf, math.inf]
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            up = int(np.argmax(np.abs(R[2])))
            half = [size[(up + 1) % 3], size[(up + 2) % 3]]
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            half = [size[0], size[0]]
        elif kind != mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        sign = 1.0 if kind == mujoco.mjtGeom.mjGEOM_PLANE else math.copysign(1.0, R[2, up])
        if sign * R[2, up] < STEEPEST:
            continue
        face = np.column_stack([sign * R[:, (up + 1) % 3], R[:, (up + 2) % 3], sign * R[:, up]])
        thick = 0.0 if kind == mujoco.mjtGeom.mjGEOM_PLANE else size[up]
        if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            thick = size[1]
        p, is_round = model.geom_pos[g] + thick * face[:, 2], kind == mujoco.mjtGeom.mjGEOM_CYLINDER
        rows.append([*p, *face.ravel(), *half, float(is_round)])
    return np.ascontiguousarray(np.array(rows).reshape(-1, FLOOR))


@helper
def compute_floor_gain(floor: Array, hub: Array, radius: float) -> float:
    """Return T / T_inf of a rotor at `hub` (3,) m in W above a floor, a row of `find_floors`."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(3):
        d = hub[i] - floor[i]
        x += floor[3 + 3 * i] * d
        y += floor[4 + 3 * i] * d
        z += floor[5 + 3 * i] * d
    if z <= 0.0 or z >= FARTHEST * radius:
        return 1.0
    if floor[14] > 0.5:
        share = min(max(0.5 + 0.5 * (floor[12] - math.hypot(x, y)) / radius, 0.0), 1.0)
    else:
        share = min(max(0.5 + 0.5 * (floor[12] - abs(x)) / radius, 0.0), 1.0)
        share *= min(max(0.5 + 0.5 * (floor[13] - abs(y)) / radius, 0.0), 1.0)
    return 1.0 + share * (compute_ground_gain(z, radius) - 1.0)


@helper
def compute_ground_gain(z: float, radius: float) -> float:
    """Return T / T_inf of a rotor at a height z (m) above ground (Cheeseman and Bennett 1955)."""
    near = max(z, NEAREST * radius)
    return 1.0 / (1.0 - (radius / (4.0 * near)) ** 2)


@helper
def compute_ceiling_gain(z: float, radius: float) -> float:
    """Return T / T_inf of a rotor at a distance z (m) below a ceiling."""
    near = max(z, NEAREST * radius) + CEILING_C2 * radius
    return 1.0 / (1.0 - (radius / near) ** 2 / CEILING_C1)
