"""Fit of a pipe to the touches of a survey, in flight and from a recording.

All positions are those of the tip as the robot measures it. The calibration error of the markers
shifts map, touches and work alike and does not affect the work. It matters only where the pipe's
position in W is reported.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.description.world.spec import Pipe
from skywright.description.world.surface import (
    Cylinder,
    roll_points,
    surface_point,
    unroll_points,
)
from skywright.inspection.touches import (
    FoundCylinder,
    MapError,
    TouchFit,
    compute_normal_std,
    fit_cylinder_touches,
)
from skywright.missions.skills.datum import SeenMark, get_datum, register_cylinder
from skywright.missions.skills.survey import PHASE, Touch
from skywright.run.kind import Measures
from skywright.run.setup import Setup
from skywright.run.where import Where

TIP_STD = 0.5e-3
"""m, deviation of a touch in addition to the localisation's noise: roughness of the surface,
residual motion of the tip."""
LEAST_TOUCHES = 3
"""Depth and both rotations of the surface are three unknowns."""
CLEAR = 0.02
"""m, from the nearest position that the pipe may have to the tip at its stand-off."""


TOUCH_MEASURES: Measures = {
    "survey.touches": ("", "number of completed touches of the survey"),
    "survey.missed": ("", "number of touches without contact, or whose contact did not last"),
    "survey.left_out": ("", "number of touches excluded as outliers, at most one"),
    "survey.map_error_mm": (
        "mm",
        "largest distance of the mapped surface from the true surface at the touch points",
    ),
    "survey.surface_error_mm": (
        "mm",
        "largest distance of the fitted surface from the true surface at the touch points",
    ),
    "survey.surface_std_mm": (
        "mm",
        "standard deviation of the fitted surface, as stated by the fit, including errors "
        "common to all touches",
    ),
}
"""Metrics of any survey."""
SURVEY_WHERE = {"survey.": Where((PHASE,))}
SURVEY_MEASURES: Measures = {
    **TOUCH_MEASURES,
    "survey.turn_up_deg": ("deg", "rotation of the fitted pipe relative to the map, +y end up"),
    "survey.turn_aside_deg": (
        "deg",
        "rotation of the fitted pipe relative to the map, about the pipe's z",
    ),
    "survey.ahead_mm": (
        "mm",
        "displacement of the fitted pipe relative to the map, along the pipe's x",
    ),
    "survey.up_mm": (
        "mm",
        "displacement of the fitted pipe relative to the map, along the pipe's z",
    ),
    "survey.radius_mm": ("mm", "radius of the fitted pipe minus that of the map"),
    "survey.turn_up_std_deg": (
        "deg",
        "standard deviation of survey.turn_up_deg, as stated by the fit",
    ),
    "survey.turn_aside_std_deg": ("deg", "standard deviation of survey.turn_aside_deg"),
    "survey.ahead_std_mm": (
        "mm",
        "standard deviation of survey.ahead_mm, including errors common to all touches",
    ),
    "survey.up_std_mm": (
        "mm",
        "standard deviation of survey.up_mm, including errors common to all touches",
    ),
    "survey.radius_std_mm": ("mm", "standard deviation of survey.radius_mm"),
    "survey.axis_error_deg": ("deg", "angle between the fitted axis and the true axis"),
}
"""Metrics of `judge_survey`."""


class Ball(NamedTuple):
    """The sphere that touches, and the accuracy of its measured position."""

    radius: float  # m
    bias: float  # m, deviation common to all touches, each axis
    std: float  # m, of each touch


class Surveyed(NamedTuple):
    """Result of a survey; `reason` states why the result is not usable, or is ""."""

    found: FoundCylinder  # registered by the datum, if one was measured
    touches: list[Touch]
    reason: str
    mark: SeenMark | None = None

    @property
    def touched(self) -> list[int]:
        """Return the indices of the successful touches, in the order of the fit's residuals."""
        return [i for i, touch in enumerate(self.touches) if not touch.reason]


def get_map_error(setup: Setup[Any]) -> MapError:
    """Return the stated bounds of the map's error."""
    p = setup.description.plant
    return MapError(p.map_error_m, math.radians(p.map_error_deg), p.map_error_size_m)


def is_surveyed(setup: Setup[Any]) -> bool:
    """Return whether the surface is surveyed: `task.survey`, by default if the map has an error."""
    told: bool | None = setup.task.survey
    return max(get_map_error(setup)) > 0.0 if told is None else told


def get_tip(setup: Setup[Any]) -> Ball:
    """Return the probe's tip, localised by its markers."""
    probe, mocap = setup.robot.probe, setup.world.mocap
    assert probe is not None
    std = math.hypot(TIP_STD, mocap.position_noise_m)
    return Ball(probe.tip_radius_m, mocap.calibration_m, std)


def compute_reach(cylinder: Cylinder, error: MapError, point: Array) -> float:
    """Return the largest distance (m) along the normal of the true surface from the map.

    The place is (s, phi).
    """
    p, n = np.empty(3), np.empty(3)
    surface_point(cylinder, float(point[0]), float(point[1]), p, n)
    place = error.place * float(np.sum(np.abs(n)))
    return place + math.tan(error.turn) * abs(float(point[0])) * math.sqrt(2.0) + error.size


def compute_aside(cylinder: Cylinder, error: MapError, point: Array) -> float:
    """Return the largest shift (m) along the true surface of the place (s, phi) from the map's."""
    lever = abs(float(point[0])) + cylinder.radius
    return math.sqrt(2.0) * (error.place + math.tan(error.turn) * lever)


def fit_touches(
    setup: Setup[Any], touches: Sequence[Touch], ball: Ball, mark: SeenMark | None = None
) -> Surveyed:
    """Fit the pipe to touches, with the map as the prior; a `mark` sets the origin of s and phi."""
    known, error = setup.cylinder, get_map_error(setup)
    assert known is not None
    made = [t.centre(ball.radius) for t in touches if not t.reason]
    # a uniform distribution over +-b has the variance b^2 / 3
    seen = error._replace(place=math.hypot(error.place, math.sqrt(3.0) * ball.bias))
    found = fit_cylinder_touches(known, seen, np.array(made), ball.radius, ball.std)
    datum = get_datum(setup)
    if mark is not None and datum is not None:
        found = found._replace(cylinder=register_cylinder(found.cylinder, datum, mark))
    return Surveyed(found, list(touches), explain_touches(touches, found.fit, "pipe"), mark)


def explain_touches(touches: Sequence[Touch], fit: TouchFit, what: str) -> str:
    """Return why a fit of `what` to touches is not usable, or ""."""
    made = sum(not t.reason for t in touches)
    if made < LEAST_TOUCHES:
        why = next((t.reason for t in touches if t.reason), "")
        return f"survey: only {made} of {len(touches)} touches succeeded ({why})"
    if fit.consistent:
        return ""
    worst = 1e3 * float(np.max(np.abs(fit.residuals)))
    return (
        "survey: the touches are inconsistent with each other or with the bounds of the "
        f"map (up to {worst:.1f} mm off the nearest {what})"
    )


def move_pipe(pipe: Pipe, found: Cylinder) -> Pipe:
    """Return the pipe's table with the fitted position, direction and size."""
    axis, level = found.R_WP[:, 1], math.hypot(found.R_WP[0, 1], found.R_WP[1, 1])
    # the heading of an upright pipe is the rotation about its axis; its roll is kept
    ahead = found.R_WP @ rot_y(math.radians(-pipe.roll_deg))[:, 0]
    yaw = math.atan2(-axis[0], axis[1]) if level > 1e-3 else math.atan2(ahead[1], ahead[0])
    inclination = math.atan2(axis[2], level)
    rolled = (rot_z(yaw) @ rot_x(inclination)).T @ found.R_WP
    return pipe.model_copy(update={
        **{f"{name}_m": float(x) for name, x in zip("xyz", found.p_WP, strict=True)},
        "yaw_deg": math.degrees(yaw),
        "inclination_deg": math.degrees(inclination),
        "roll_deg": math.degrees(math.atan2(rolled[0, 2], rolled[0, 0])),
        "diameter_m": 2.0 * found.radius,
    })  # fmt: skip


def judge_survey(
    setup: Setup[Any], surveyed: Surveyed, corners: Array, ball: Ball
) -> dict[str, float]:
    """Compare the fitted pipe with the map and the truth, over the pattern (n, 2) of (s, phi)."""
    found, known, true = surveyed.found, setup.cylinder, setup.true.cylinder
    assert known is not None and true is not None
    cylinder, fit = found.cylinder, found.fit
    sigma = np.sqrt(np.diag(fit.covariance))
    sigma[2:4] = np.hypot(sigma[2:4], ball.bias)
    s, phi = corners.mean(axis=0)
    off = [
        unroll_points(true, roll_points(x, corners[:, 0], x.radius * corners[:, 1])[0])[2]
        for x in (cylinder, known)
    ]
    turn = math.degrees(math.acos(min(abs(float(cylinder.R_WP[:, 1] @ true.R_WP[:, 1])), 1.0)))
    across = compute_normal_std(found, float(phi), float(s))
    names = ("turn_up_deg", "turn_aside_deg", "ahead_mm", "up_mm", "radius_mm")
    scale = np.array([math.degrees(1.0), math.degrees(1.0), 1e3, 1e3, 1e3])
    out = {f"survey.{name}": float(x) for name, x in zip(names, scale * fit.x, strict=True)}
    out |= {
        f"survey.{name.rsplit('_', 1)[0]}_std_{name.rsplit('_', 1)[1]}": float(x)
        for name, x in zip(names, scale * sigma, strict=True)
    }
    return out | {
        "survey.touches": float(len(surveyed.touched)),
        "survey.missed": float(len(surveyed.touches) - len(surveyed.touched)),
        "survey.left_out": float(np.count_nonzero(~fit.used)),
        "survey.surface_error_mm": 1e3 * float(np.max(np.abs(off[0]))),
        "survey.surface_std_mm": 1e3 * math.hypot(across, ball.bias),
        "survey.axis_error_deg": turn,
        "survey.map_error_mm": 1e3 * float(np.max(np.abs(off[1]))),
    }  # fmt: skip
