"""Fit of a structure (deck, wall, pillar, tunnel) to the touches of a survey.

Quantities that touches do not determine keep their values on the map, which refer to the
localisation: the position along a plane, along the axis of a pillar or tunnel, and around it.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.structure import (
    CYLINDER,
    PLANE,
    Structure,
    Surface,
    build_surface,
    find_place,
    locate_point,
)
from skywright.description.world.surface import Cylinder
from skywright.inspection.touches import (
    FoundCylinder,
    FoundPlane,
    MapError,
    compute_normal_std,
    fit_cylinder_touches,
    fit_plane_touches,
)
from skywright.missions.skills.datum import DATUM_MEASURES, SeenMark, get_datum, register_surface
from skywright.missions.skills.survey import Touch
from skywright.missions.skills.surveyed import (
    TOUCH_MEASURES,
    Ball,
    explain_touches,
    get_map_error,
)
from skywright.run.kind import Measures
from skywright.run.setup import Setup

STRUCTURE_MEASURES: Measures = {
    **TOUCH_MEASURES,
    **DATUM_MEASURES,
    "survey.map_normal_error_deg": ("deg", "angle between the mapped normal and the true normal"),
    "survey.normal_error_deg": ("deg", "angle between the fitted normal and the true normal"),
    "survey.normal_std_deg": (
        "deg",
        "standard deviation of the fitted normal, as stated by the fit",
    ),
}
"""Metrics of `judge_structure`, at the mission's first spot."""


class FoundStructure(NamedTuple):
    """Result of a survey; `reason` states why the result is not usable, or is ""."""

    structure: Structure
    found: FoundPlane | FoundCylinder
    touches: list[Touch]
    reason: str
    mark: SeenMark | None = None


def compute_structure_reach(structure: Structure, error: MapError, place: Array) -> float:
    """Return the largest distance (m) along the map's normal of the true surface at a place.

    `place` (2,) m is in S.
    """
    surface = build_surface(structure)
    normal = locate_point(surface, place)[1][:, 2]
    turn, far = math.tan(error.turn), math.hypot(*place)
    reach = error.place * float(np.sum(np.abs(normal))) + turn * far * math.sqrt(2.0)
    if surface.shape == PLANE:
        return reach
    # a tip touches a laterally shifted curved surface where it slopes
    aside, off = error.place + turn * surface.radius, abs(float(place[1 - surface.along]))
    return reach + error.size + (off + 0.5 * aside) * aside / surface.radius


def build_axis(surface: Surface, half_length: float) -> Cylinder:
    """Return the cylinder of a curved surface: y along its axis, z along the normal z_S."""
    R, out = surface.R_WS, _get_side(surface)
    axis = R[:, surface.along]
    frame = np.ascontiguousarray(np.column_stack([np.cross(axis, R[:, 2]), axis, R[:, 2]]))
    return Cylinder(
        surface.p_WS - out * surface.radius * R[:, 2], frame, surface.radius, half_length
    )


def fit_structure(
    setup: Setup[Any], touches: Sequence[Touch], ball: Ball, mark: SeenMark | None = None
) -> FoundStructure:
    """Fit the world's structure to touches, with the map as the prior; a `mark` determines S."""
    structure, surface, error = setup.world.structure, setup.surface, get_map_error(setup)
    assert structure is not None and surface is not None
    made = np.array([t.centre(ball.radius) for t in touches if not t.reason]).reshape(-1, 3)
    # a uniform distribution over +-b has the variance b^2 / 3; a rotation about S shifts the axis
    aside = surface.radius * error.turn
    seen = error._replace(place=math.hypot(error.place, math.sqrt(3.0) * ball.bias, aside))
    found: FoundPlane | FoundCylinder
    if surface.shape == PLANE:
        found = fit_plane_touches(surface.p_WS, surface.R_WS, seen, made, ball.radius, ball.std)
        moved = move_structure(structure, found.p_WS, found.R_WS[:, 2], found.R_WS[:, 0])
    else:
        side, known = _get_side(surface), build_axis(surface, structure.length_m)
        found = fit_cylinder_touches(known, seen, made, side * ball.radius, ball.std)
        p, n = _find_foot(found.cylinder, surface)
        moved = move_structure(structure, p, n, found.cylinder.R_WP[:, 1])
        moved = moved.model_copy(update={"radius_m": found.cylinder.radius})
    datum = get_datum(setup)
    if mark is not None and datum is not None:
        p, n = register_surface(build_surface(moved), datum, mark)
        along = build_surface(moved).R_WS[:, 0]
        moved = move_structure(moved, p, n, along)
    what = {"plane": "plane", "cylinder": "pillar", "arch": "arch"}[structure.shape]
    reason = explain_touches(touches, found.fit, what)
    return FoundStructure(moved, found, list(touches), reason, mark)


def move_structure(structure: Structure, p_WS: Array, normal: Array, along: Array) -> Structure:
    """Return its table with S at p_WS (3,) m, z_S = `normal` (3,), x_S `along` if it faces down.

    A surface that faces to the side has a level x_S, and its axis cannot lean across x_S: the map's
    error has no such part (description/map_error.py).
    """
    new = {f"{name}_m": float(x) for name, x in zip("xyz", p_WS, strict=True)}
    if structure.facing == "side":
        new["yaw_deg"] = math.degrees(math.atan2(-normal[1], -normal[0]))
        new["slope_deg"] = math.degrees(math.atan2(-normal[2], math.hypot(normal[0], normal[1])))
    else:
        heading = along - along[2] / normal[2] * normal  # level; its component normal to z_S is x_S
        new["yaw_deg"] = math.degrees(math.atan2(heading[1], heading[0]))
        new["slope_deg"] = math.degrees(math.acos(min(max(-float(normal[2]), -1.0), 1.0)))
        new["slope_toward_deg"] = math.degrees(math.atan2(normal[1], normal[0]))
    return structure.model_copy(update=new)


def judge_structure(
    setup: Setup[Any], found: FoundStructure, place: Array, ball: Ball
) -> dict[str, float]:
    """Compare the fitted structure with map and truth at `place` (2,) m in S."""
    true, known = setup.true.surface, setup.surface
    assert true is not None and known is not None
    fit, here = found.found.fit, build_surface(found.structure)
    off, turn = [], []
    for surface in (here, known):
        p, R = locate_point(surface, place)
        there = find_place(true, p)
        off.append(1e3 * abs(float(there[2])))
        n = locate_point(true, there[:2])[1][:, 2]
        turn.append(math.degrees(math.acos(min(float(R[:, 2] @ n), 1.0))))
    std, normal_std = _compute_std(found.found, known, place)
    return {
        "survey.touches": float(len(fit.used)),
        "survey.missed": float(len(found.touches) - len(fit.used)),
        "survey.left_out": float(np.count_nonzero(~fit.used)),
        "survey.map_error_mm": off[1],
        "survey.surface_error_mm": off[0],
        "survey.surface_std_mm": 1e3 * math.hypot(std, ball.bias),
        "survey.map_normal_error_deg": turn[1],
        "survey.normal_error_deg": turn[0],
        "survey.normal_std_deg": math.degrees(normal_std),
    }


def _compute_std(
    found: FoundPlane | FoundCylinder, known: Surface, place: Array
) -> tuple[float, float]:
    """Return the standard deviations of the surface (m), across it, and of its normal (rad)."""
    P = found.fit.covariance
    if isinstance(found, FoundPlane):
        gradient = np.array([float(place[1]), -float(place[0]), 1.0])
        return math.sqrt(float(gradient @ P @ gradient)), math.sqrt(P[0, 0] + P[1, 1])
    side = _get_side(known)
    phi = 0.5 * math.pi * side
    std = compute_normal_std(found, phi, float(place[known.along]))
    return std, math.sqrt(P[0, 0] + P[2, 2] / known.radius**2)


def _find_foot(cylinder: Cylinder, surface: Surface) -> tuple[Array, Array]:
    """Return the point of a cylinder nearest to the map's S, (3,) m, and its normal there."""
    axis = cylinder.R_WP[:, 1]
    d = surface.p_WS - cylinder.p_WP
    d = d - (d @ axis) * axis
    out = d / np.linalg.norm(d)
    along = float((surface.p_WS - cylinder.p_WP) @ axis)
    return cylinder.p_WP + along * axis + cylinder.radius * out, _get_side(surface) * out


def _get_side(surface: Surface) -> float:
    """Return 1 if the robot is outside of a curved surface, -1 if it is inside."""
    return 1.0 if surface.shape == CYLINDER else -1.0
