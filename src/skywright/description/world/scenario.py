"""Pipe structures of a world: those of its file, or random ones from a seed.

A random scenario is a row of structures along x, each of one kind:

- window: pipes to fly over, with another pipe above them; the robot must lift its load;
- underpass: a pipe to fly below, with the arms folded up;
- portal: posts with a wide gap up to a shelf and a narrower one above it; a long bar fits only
  through the wide one, as in Caballero et al. 2018.

Every structure spans the area's width, so that no path leads around it, and has at least one
passage of 1.05 to 1.3 times the size that the robot requires; `difficulty` determines the ratio.
The sizes below belong to the robot ars-lrm with a bar of 2 m and a margin of 0.2 m; a test computes
them from the robot and checks the ratio.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.description.world.spec import Area, Passage, Tube, World

NEEDS_BAR = 2.4  # m, length of the bar and two margins
NEEDS_PLATFORM = 1.6  # m, over the propeller tips, and two margins
NEEDS_ROBOT = 1.4  # m, height with the arms folded up, and two margins

GOAL_X = 9.0  # m, the structures are between x = 0 and here
CEILING = 3.6  # m, height of the area of random structures
SPAN = 1.6  # m, half length of the horizontal pipes


class Structures(NamedTuple):
    """Pipes, and the passages between them."""

    tubes: dict[str, Tube]
    passages: dict[str, Passage]
    area: Area | None


def get_structures(world: World) -> Structures:
    """Return the structures of a world: its own, or the random ones of its `scenario_seed`."""
    if world.scenario_seed is None:
        return Structures(world.tubes, world.passages, world.area)
    return draw_structures(world.scenario_seed, world.difficulty)


def get_limits(world: World) -> Array | None:
    """Return the limits (3, 2) m of a world's area in W, of x, y and z; None without an area."""
    area = get_structures(world).area
    if area is None:
        return None
    return np.array([
        [area.x_min_m, area.x_max_m], [area.y_min_m, area.y_max_m], [-math.inf, area.z_max_m],
    ])  # fmt: skip


def draw_structures(seed: int, difficulty: float) -> Structures:
    """Draw a row of random structures; `difficulty` from 0 to 1. Repeatable for equal arguments."""
    rng = build_stream(seed, "scenario")
    places = [2.4, 4.9, 7.4] if difficulty > 0.5 else [2.8, 6.2]
    kinds = list(rng.permutation(["window", "underpass", "portal"]))[: len(places)]
    if "portal" not in kinds:  # the bar must restrict the path in three dimensions
        kinds[rng.integers(len(kinds))] = "portal"
    draw = {"window": _draw_window, "underpass": _draw_underpass, "portal": _draw_portal}
    tubes: dict[str, Tube] = {}
    passages: dict[str, Passage] = {}
    for i, (kind, place) in enumerate(zip(kinds, places, strict=True)):
        # the largest ratios at difficulty 0, the smallest at 1
        ratio = 1.05 + 0.2 * (1.0 - difficulty) + rng.uniform(0.0, 0.04)
        name = f"{kind} {i + 1}"
        x = place + rng.uniform(-0.2, 0.2)
        more, gaps = draw[kind](rng, name, x, ratio)
        tubes |= more
        passages |= gaps
    area = Area(x_min_m=-1.5, x_max_m=GOAL_X + 1.5, y_min_m=-3.0, y_max_m=3.0, z_max_m=CEILING)
    return Structures(tubes, passages, area)


def build_tube(a: tuple[float, float, float], b: tuple[float, float, float], d: float) -> Tube:
    """Return the tube of diameter `d` (m) from a to b (m)."""
    a, b = tuple(float(round(v, 4)) for v in a), tuple(float(round(v, 4)) for v in b)  # type: ignore[assignment]
    return Tube(
        x_m=a[0], y_m=a[1], z_m=a[2], to_x_m=b[0], to_y_m=b[1], to_z_m=b[2],
        diameter_m=round(float(d), 4),
    )  # fmt: skip


def _across(x: float, z: float, d: float) -> Tube:
    return build_tube((x, -SPAN, z), (x, SPAN, z), d)


def _posts(name: str, x: float, y: float, low: float, high: float) -> dict[str, Tube]:
    return {
        f"{name} {side}": build_tube((x, sign * y, low), (x, sign * y, high), 0.1)
        for side, sign in (("left", 1.0), ("right", -1.0))
    }


def _draw_window(
    rng: np.random.Generator, name: str, x: float, ratio: float
) -> tuple[dict[str, Tube], dict[str, Passage]]:
    d = rng.uniform(0.1, 0.25)
    # the gap between the pipes is wide enough; those above and below them are not
    top = rng.uniform(0.8, 1.1)  # of the lower pipes
    upper = top + ratio * NEEDS_ROBOT + d / 2
    tubes = {
        f"{name} lower": _across(x, top - d / 2, d),
        f"{name} second": _across(x + rng.uniform(0.3, 0.5), top - d / 2 - 0.1, d),
        f"{name} upper": _across(x, upper, d),
        **_posts(f"{name} post", x, SPAN, 0.0, upper),
    }
    gap = Passage(between=[f"{name} lower", f"{name} upper"], needs="robot")
    return tubes, {f"{name} gap": gap}


def _draw_underpass(
    rng: np.random.Generator, name: str, x: float, ratio: float
) -> tuple[dict[str, Tube], dict[str, Passage]]:
    d = rng.uniform(0.15, 0.3)
    z = ratio * NEEDS_ROBOT + d / 2
    tubes = {f"{name} pipe": _across(x, z, d), **_posts(f"{name} post", x, SPAN, 0.0, z)}
    shift = rng.uniform(0.25, 0.5)
    # a second, higher pipe prevents a steep descent; both block the path above
    tubes[f"{name} second"] = _across(x + shift, z + 0.75, d)
    gap = Passage(between=["ground", f"{name} pipe"], needs="robot")
    return tubes, {f"{name} gap": gap}


def _draw_portal(
    rng: np.random.Generator, name: str, x: float, ratio: float
) -> tuple[dict[str, Tube], dict[str, Passage]]:
    wide = ratio * NEEDS_BAR / 2 + 0.05
    narrow = min(ratio, 1.15) * NEEDS_PLATFORM / 2 + 0.05  # always too narrow for the bar
    shelf = rng.uniform(1.1, 1.6)
    tubes = {
        **_posts(f"{name} low post", x, wide, 0.0, shelf),
        **_posts(f"{name} high post", x, narrow, shelf, CEILING + 0.2),
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        tubes[f"{name} shelf {side}"] = build_tube(
            (x, sign * wide, shelf), (x, sign * narrow, shelf), 0.1
        )
        tubes[f"{name} wing {side}"] = build_tube(
            (x, sign * wide, shelf), (x, sign * 3.0, shelf), 0.1
        )
    return tubes, {
        f"{name} wide gap": Passage(
            between=[f"{name} low post left", f"{name} low post right"], needs="bar"
        ),
        f"{name} narrow gap": Passage(
            between=[f"{name} high post left", f"{name} high post right"], needs="platform"
        ),
    }
