"""The tip's path coloured by contact quality, and the legend of the 3-D views."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import World
from skywright.inspection.contact_quality import GAP_LIMIT, TILT_LIMIT
from skywright.models.compliant_arms import is_compliant
from skywright.reports.scene3d import AREA, CCW, CW, ESTIMATE, PLAN, WELD, Colour
from skywright.run.kind import load_kind

FREE, GOOD, TILTED, LIFTED = range(4)
"""Qualities of the path: away from the surface, within limits, tilted, lifted."""
COLOURS: tuple[Colour, ...] = ((165, 172, 182), (0, 114, 178), (240, 200, 0), (213, 94, 0))
"""Colours of the qualities, colour-blind safe (Okabe and Ito's palette)."""


def list_judged(robot: Robot, world: World, kind: str) -> tuple[str, ...]:
    """Return the phases in which contact quality counts; none without a probe and a pipe."""
    has_both = world.pipe is not None and robot.probe is not None
    return load_kind(kind).figures().judged if has_both else ()


def judge_trace(
    shown: NDArray[Any], judged: Mask, arm: bool, gap_limit: float = GAP_LIMIT
) -> tuple[Array, Array]:
    """Return points (n, 3) of the tip's trace (the platform's without an `arm`) and qualities (n,).

    `judged` (n,): where contact quality counts; `gap_limit` (m): gap from which the tip is lifted.
    """
    quality = np.full(len(shown), float(FREE))
    if not arm:
        return np.array(shown["p_WB"]), quality
    gap = np.maximum(shown["gap"], shown["gap_max"])
    quality[judged] = GOOD
    quality[judged & (shown["tilt"] >= TILT_LIMIT)] = TILTED
    quality[judged & (gap >= gap_limit)] = LIFTED
    # offset the trace in contact by the size of the tip, so that the surface does not hide it
    lift = np.where(judged, 0.002, 0.0)[:, None] * shown["ref_normal_W"]
    return shown["p_WT"] + lift, quality


def build_legend(
    robot: Robot, world: World, found: bool, gap_limit: float = GAP_LIMIT, *, judged: bool
) -> list[list[str]]:
    """Return pairs of colour (#rrggbb) and meaning; `found`: an estimated weld line is drawn.

    `judged`: the path is coloured by contact quality.
    """
    what = "platform" if robot.arm is None else "left hand" if is_compliant(robot) else "tip"
    free, good, tilted, lifted = COLOURS
    entries = [(free, f"path of the {what}, in the air")]
    if judged:
        limits = f"{1e3 * gap_limit:g} mm, {math.degrees(TILT_LIMIT):g}°"
        entries += [
            (good, f"contact within limits ({limits})"),
            (tilted, f"probe tilted beyond {math.degrees(TILT_LIMIT):g}°"),
            (lifted, f"air gap beyond {1e3 * gap_limit:g} mm"),
            (PLAN, "planned path"),
        ]
    if world.list_welds():
        entries.append((WELD, "true weld"))
        if found:
            entries.append((ESTIMATE, "detected weld"))
    if get_structures(world).area is not None:
        entries.append((AREA, "limits of the area"))
    entries += [(CCW, "propeller, counter-clockwise"), (CW, "propeller, clockwise")]
    return [["#{:02x}{:02x}{:02x}".format(*colour), text] for colour, text in entries]
