"""The pipe as the touches of a scan's survey show it, in flight and from a recording.

All places are as the robot measures its tip: the markers' calibration error shifts map, touches and
scan alike and does not disturb the work. It counts where the pipe's place in W is told.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.spec import Pipe, Weld, World
from skywright.description.world.surface import (
    Cylinder,
    build_cylinder,
    build_weld_curve,
    roll_points,
    surface_point,
    unroll_points,
)
from skywright.inspection.touches import (
    FoundCylinder,
    MapError,
    compute_normal_std,
    fit_cylinder_touches,
)
from skywright.missions.scan.task import Scan
from skywright.missions.skills.survey import Touch
from skywright.run.setup import Setup

TOUCH_STD = 0.5e-3
"""m, of a touch beside the localisation's noise: the surface's roughness, the tip's last motion."""
LEAST_TOUCHES = 3
"""Fewer say too little: depth and both turns of the surface are three numbers."""
CLEAR = 0.02
"""m, from the nearest place that the pipe may have to the tip at its stand-off."""


class Surveyed(NamedTuple):
    """What a survey found; `reason` says why it cannot be worked with, or is ""."""

    found: FoundCylinder
    touches: list[Touch]
    reason: str

    @property
    def touched(self) -> list[int]:
        """Indices of the touches that were made, in the order of the fit's residuals."""
        return [i for i, touch in enumerate(self.touches) if not touch.reason]


def get_map_error(setup: Setup[Scan]) -> MapError:
    """Return the stated bounds of the map."""
    p = setup.description.plant
    return MapError(p.map_error_m, math.radians(p.map_error_deg), p.map_error_size_m)


def compute_reach(cylinder: Cylinder, error: MapError, point: Array) -> float:
    """How far (m) along its normal the true surface may be from the map at (s, phi)."""
    p, n = np.empty(3), np.empty(3)
    surface_point(cylinder, float(point[0]), float(point[1]), p, n)
    place = error.place * float(np.sum(np.abs(n)))
    return place + math.tan(error.turn) * abs(float(point[0])) * math.sqrt(2.0) + error.size


def fit_touches(setup: Setup[Scan], touches: Sequence[Touch]) -> Surveyed:
    """Fit the pipe to touches; the map is the prior."""
    known, probe, error = setup.cylinder, setup.robot.probe, get_map_error(setup)
    assert known is not None and probe is not None
    made = [t.centre(probe.tip_radius_m) for t in touches if not t.reason]
    mocap = setup.world.mocap
    # an even spread of +-b has the variance b^2 / 3
    seen = error._replace(place=math.hypot(error.place, math.sqrt(3.0) * mocap.calibration_m))
    found = fit_cylinder_touches(
        known, seen, np.array(made), probe.tip_radius_m,
        math.hypot(TOUCH_STD, mocap.position_noise_m),
    )  # fmt: skip
    reason = ""
    if len(made) < LEAST_TOUCHES:
        why = next((t.reason for t in touches if t.reason), "")
        reason = f"survey: {len(made)} of {len(touches)} touches were made ({why})"
    elif not found.fit.consistent:
        worst = 1e3 * float(np.max(np.abs(found.fit.residuals)))
        reason = (
            f"survey: the touches contradict each other or the map's bounds (up to {worst:.1f} mm "
            "off the nearest pipe)"
        )
    return Surveyed(found, list(touches), reason)


def move_pipe(pipe: Pipe, found: Cylinder) -> Pipe:
    """Return the pipe's table with the place, direction and size that were found."""
    axis, ahead = found.R_WP[:, 1], found.R_WP[:, 0]
    return pipe.model_copy(update={
        **{f"{name}_m": float(x) for name, x in zip("xyz", found.p_WP, strict=True)},
        "yaw_deg": math.degrees(math.atan2(ahead[1], ahead[0])),
        "inclination_deg": math.degrees(math.atan2(axis[2], found.R_WP[2, 2])),
        "diameter_m": 2.0 * found.radius,
    })  # fmt: skip


def carry_weld(world: World, found: Cylinder, near: Array) -> Weld | None:
    """Return the weld of the true `world` as it lies on the surface `found`.

    The weld itself is the datum: what touches cannot show, the pipe's place along its axis and its
    turn about it, shifts where the map counts from, not where the weld is. `near` (2,) m is the
    place (s, c) on `found` around which the line is carried over.
    """
    weld, pipe = world.weld, world.pipe
    if weld is None or pipe is None or not weld.present:
        return weld
    true = build_cylinder(pipe)
    p, _ = roll_points(found, np.array([near[0]]), np.array([near[1]]))
    s, c, _ = unroll_points(true, p)
    middle = build_weld_curve(weld, true.radius).touch(float(c[0]))
    ahead = middle.find_nearest(float(s[0]), float(c[0]))
    points, _ = roll_points(true, *middle.follow(ahead + np.array([-1e-4, 0.0, 1e-4])))
    s, c, _ = unroll_points(found, points)
    around = found.radius * np.unwrap(c / found.radius)
    angle = math.atan2(s[2] - s[0], around[2] - around[0])
    angle -= math.pi * round(angle / math.pi) if abs(angle) > math.pi / 2 else 0.0
    return weld.model_copy(update={
        "angle_deg": math.degrees(angle), "offset_m": float(s[1]),
        "around_deg": math.degrees(c[1] / found.radius),
    })  # fmt: skip


def judge_survey(setup: Setup[Scan], surveyed: Surveyed, corners: Array) -> dict[str, float]:
    """Compare what was found with the map and the truth, over the pattern (n, 2) of (s, phi)."""
    found, known, true = surveyed.found, setup.cylinder, setup.true.cylinder
    assert known is not None and true is not None
    cylinder, fit = found.cylinder, found.fit
    sigma = np.sqrt(np.diag(fit.covariance))
    sigma[2:4] = np.hypot(sigma[2:4], setup.world.mocap.calibration_m)
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
        "survey.surface_std_mm": 1e3 * math.hypot(across, setup.world.mocap.calibration_m),
        "survey.axis_error_deg": turn,
        "survey.map_error_mm": 1e3 * float(np.max(np.abs(off[1]))),
    }  # fmt: skip
