"""The tip relative to the surface to touch: gap, tilt, normal and unrolled coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from skywright.core.record import Mat3, Record, Vec3
from skywright.core.scratch import local
from skywright.models.structure_distance import StructureShape, fill_structure, measure_surface
from skywright.vehicle.bus import Truth
from skywright.vehicle.component import Component, InOut, Out, Recorded, helper
from skywright.vehicle.plant import SAMPLE_RATE, Surface

NONE, PIPE, STRUCTURE = range(3)
NOWHERE = 1e3
"""m, gap without a surface."""


class SurfaceObserver(Component):
    """Fills Surface."""

    side = "plant"
    slots = {"step": "observe", "reset": "peaks"}

    class Me(Record):
        kind: int
        tip_radius: float  # m
        p_WP: Vec3  # of a pipe
        R_WP: Mat3
        radius: float
        structure: StructureShape

    columns = (
        Recorded("gap", Surface, "gap", "m", "tip to surface; negative is penetration"),
        Recorded("gap_max", Surface, "gap_max", "m", "worst gap since the last sample"),
        Recorded("tilt", Surface, "tilt", "rad", "probe axis to the inward normal of the surface"),
    )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the pipe or structure of the world that the tip can touch."""
        probe, world = context.robot.probe, context.world
        me.tip_radius = 0.0 if probe is None else probe.tip_radius_m
        if world.pipe is not None and probe is not None:
            cylinder = context.true.cylinder
            me.kind, me.radius = PIPE, cylinder.radius
            me.p_WP[:], me.R_WP[:] = cylinder.p_WP, cylinder.R_WP
        if world.structure is not None and context.scene.places.tip_site >= 0:
            me.kind = STRUCTURE
            fill_structure(me.structure, world.structure, context.true.surface)

    def get_period(self, step: str, context: Any) -> float:
        """Peaks are reset once per sample."""
        return 1.0 / SAMPLE_RATE if step == "reset" else 0.0

    @staticmethod
    def step(me: Me, truth: Truth, surface: Out[Surface]) -> None:
        surface.gap = NOWHERE
        centre = local(3)
        for i in range(3):
            centre[i] = truth.p_WT[i] - me.tip_radius * truth.R_WT[i, 2]
        if me.kind == PIPE:
            measure_pipe(me, centre, surface)
        elif me.kind == STRUCTURE:
            surface.gap = measure_surface(me.structure, centre, surface.normal) - me.tip_radius
        if me.kind != NONE:
            c = 0.0
            for i in range(3):
                c -= surface.normal[i] * truth.R_WT[i, 2]
            surface.tilt = math.acos(min(max(c, -1.0), 1.0))
        surface.gap_max = max(surface.gap_max, surface.gap)

    @staticmethod
    def reset(me: Me, surface: InOut[Surface]) -> None:
        surface.gap_max = surface.gap

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has it."""
        yield cls("surface")


@helper
def measure_pipe(me: Any, centre: Any, surface: Any) -> None:
    """Fill gap, normal and unrolled coordinates of the tip's sphere at a pipe."""
    x = y = z = 0.0
    for i in range(3):
        d = centre[i] - me.p_WP[i]
        x += me.R_WP[i, 0] * d
        y += me.R_WP[i, 1] * d
        z += me.R_WP[i, 2] * d
    rho = math.sqrt(x * x + z * z)
    surface.s, surface.phi = y, math.atan2(z, -x)
    surface.c = me.radius * surface.phi
    surface.gap = rho - me.radius - me.tip_radius
    for i in range(3):
        surface.normal[i] = (me.R_WP[i, 0] * x + me.R_WP[i, 2] * z) / max(rho, 1e-9)
