"""The tip's path coloured by contact quality, and the legend of the 3-D views."""

import math
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import World
from skywright.inspection.contact_quality import GAP_LIMIT, TILT_LIMIT
from skywright.models.compliant_arms import is_compliant
from skywright.reports.scene3d import AREA, CCW, CW, ESTIMATE, PLAN, WELD, Colour

FREE: Colour = (120, 130, 145)
"""The path away from the surface."""
GOOD: Colour = (34, 160, 80)
TILTED: Colour = (255, 165, 0)
LIFTED: Colour = (220, 40, 40)

JUDGED = ("settle", "scan")
"""Phases in which contact quality counts, see `list_judged`."""


def list_judged(robot: Robot, world: World) -> tuple[str, ...]:
    """Return the phases in which contact quality counts: none without a probe and a pipe."""
    return JUDGED if world.pipe is not None and robot.probe is not None else ()


def build_trace(shown: NDArray[Any], judged: Mask, arm: bool) -> tuple[Array, NDArray[np.uint8]]:
    """Points (n, 3) of the tip's trace (the platform's without an `arm`) and colours (n, 3).

    `judged` (n,): where contact quality counts.
    """
    colours = np.tile(np.array(FREE, np.uint8), (len(shown), 1))
    if not arm:
        return np.array(shown["p_WB"]), colours
    gap = np.maximum(shown["gap"], shown["gap_max"])
    colours[judged] = GOOD
    colours[judged & (shown["tilt"] >= TILT_LIMIT)] = TILTED
    colours[judged & (gap >= GAP_LIMIT)] = LIFTED
    # in contact the trace is lifted off the surface by the tip's own size, or it would hide in it
    lift = np.where(judged, 0.002, 0.0)[:, None] * shown["ref_normal_W"]
    return shown["p_WT"] + lift, colours


def draw_trace(
    server: viser.ViserServer, name: str, points: Array, colours: NDArray[np.uint8]
) -> None:
    """Draw a piece of the tip's path: points (n, 3) in W with colours (n, 3)."""
    segments = np.stack([points[:-1], points[1:]], axis=1)
    # viser takes line colours as linear light
    linear = np.round(255.0 * (colours / 255.0) ** 2.2).astype(np.uint8)
    contact = bool(np.any(colours != np.array(FREE, np.uint8)))
    server.scene.add_line_segments(
        name, segments, np.stack([linear[:-1], linear[1:]], axis=1),
        thickness=5.0 if contact else 1.5, thickness_units="screen",
    )  # fmt: skip


def build_legend(robot: Robot, world: World, found: bool) -> list[list[str]]:
    """Pairs of colour (#rrggbb) and meaning; `found`: an estimated weld line is drawn."""
    what = "platform" if robot.arm is None else "left hand" if is_compliant(robot) else "tip"
    entries = [(FREE, f"path of the {what}, in the air")]
    if list_judged(robot, world):
        limits = f"{1e3 * GAP_LIMIT:g} mm, {math.degrees(TILT_LIMIT):g}°"
        entries += [
            (GOOD, f"contact within limits ({limits})"),
            (TILTED, f"probe tilted beyond {math.degrees(TILT_LIMIT):g}°"),
            (LIFTED, f"air gap beyond {1e3 * GAP_LIMIT:g} mm"),
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
