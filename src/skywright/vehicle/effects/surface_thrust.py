"""Thrust near surfaces: the ground below a rotor, the inspected structure above it.

Ground: T / T_inf = 1 / (1 - (R / 4 z)^2), z the height of the rotor (Cheeseman and Bennett 1955),
no nearer than half a radius. Ceiling: T / T_inf = 1 / (1 - (R / (z + c2 R))^2 / c1), z the distance
from the rotor to the surface: the form that the group of Sanchez-Cuevas 2020 fits to benches in
earlier work; its constants could not be had, c1 = 7 and c2 = 0.1 are ours (a rotor of 0.12 m gains
16 % at one radius, 1 % at the docking gear's 0.45 m). A sloped surface acts with the cosine of its
slope. Each rotor for itself: no fountain, no neighbours.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Array, Record
from skywright.core.scratch import local
from skywright.core.types import MAX_ROTORS
from skywright.models.structure_distance import (
    StructureShape,
    fill_structure,
    is_below,
    measure_surface,
)
from skywright.vehicle.bus import Truth
from skywright.vehicle.component import Component, Effect, Out, helper
from skywright.vehicle.plant import RotorGain

CEILING_C1, CEILING_C2 = 7.0, 0.1
NEAREST = 0.5  # radii
FARTHEST = 8.0  # radii, beyond which a surface is not felt


class SurfaceThrust(Effect):
    """Fills RotorGain."""

    slot = "actuate"

    class Me(Record):
        structure: StructureShape
        disc: float  # m, radius of a rotor
        n: int
        rotor_p: Annotated[Array, MAX_ROTORS, 3]  # m
        rotor_axis: Annotated[Array, MAX_ROTORS, 3]

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Take the structure and the rotors."""
        rotors = context.rotors
        fill_structure(me.structure, context.world.structure, context.true.surface)
        me.n, me.disc = len(rotors.thrust_min), context.robot.rotors.propeller_radius_m
        me.rotor_p[: me.n], me.rotor_axis[: me.n] = rotors.position, rotors.axis

    @staticmethod
    def step(me: Me, truth: Truth, out: Out[RotorGain]) -> None:
        hub, normal, R_WB = local(3), local(3), truth.R_WB
        for k in range(me.n):
            up = 0.0
            for i in range(3):
                hub[i] = truth.p_WB[i]
                for j in range(3):
                    hub[i] += R_WB[i, j] * me.rotor_p[k, j]
            gain = compute_ground_gain(hub[2], me.disc) if hub[2] < FARTHEST * me.disc else 1.0
            z = measure_surface(me.structure, hub, normal)
            if 0.0 < z < FARTHEST * me.disc and is_below(me.structure, hub):
                for i in range(3):
                    for j in range(3):
                        up -= normal[i] * R_WB[i, j] * me.rotor_axis[k, j]
                if up > 0.0:
                    gain *= 1.0 + up * (compute_ceiling_gain(z, me.disc) - 1.0)
            out.gain[k] = gain

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds with a structure."""
        if context.world.structure is not None:
            yield cls("surface thrust")


@helper
def compute_ground_gain(z: float, radius: float) -> float:
    """T / T_inf of a rotor at the height z (m) over ground (Cheeseman and Bennett 1955)."""
    near = max(z, NEAREST * radius)
    return 1.0 / (1.0 - (radius / (4.0 * near)) ** 2)


@helper
def compute_ceiling_gain(z: float, radius: float) -> float:
    """T / T_inf of a rotor z (m) below a ceiling."""
    near = max(z, NEAREST * radius) + CEILING_C2 * radius
    return 1.0 / (1.0 - (radius / near) ** 2 / CEILING_C1)
