"""Pipe structures of a world: those of its file, or drawn from a seed.

A drawn scenario is a row of structures along x, each of one kind:

- window: pipes to fly over, another pipe above them; the robot must lift what it carries;
- underpass: a pipe to fly below, the arms folded up;
- portal: posts that leave a wide gap up to a shelf and a narrower one above it; a long bar fits
  only through the wide one, as in Caballero et al. 2018.

Every structure spans the area's width, so that no path leads around it, and holds at least one
passage of 1.05 to 1.3 times what the robot needs; `difficulty` decides where in that range. The
needs below belong to the robot ars-lrm with a bar of 2 m and a margin of 0.2 m; a test computes
them from the robot and holds the ratio.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skywright.core.streams import build_stream
from skywright.description.world.spec import Area, Passage, Tube, World

NEEDS_BAR = 2.4  # m, its length and two margins
NEEDS_PLATFORM = 1.6  # m, over the propeller tips, and two margins
NEEDS_ROBOT = 1.4  # m, height with the arms folded up, and two margins

GOAL_X = 9.0  # m, the structures stand between x = 0 and here
CEILING = 3.6  # m, of the area that drawn structures assume
SPAN = 1.6  # m, half length of the pipes across


class Structures(NamedTuple):
    """Pipes, and the gaps that lead through them."""

    tubes: dict[str, Tube]
    passages: dict[str, Passage]
    area: Area | None


def get_structures(world: World) -> Structures:
    """Return the structures of a world: its own, or those that its `scenario_seed` draws."""
    if world.scenario_seed is None:
        return Structures(world.tubes, world.passages, world.area)
    return draw_structures(world.scenario_seed, world.difficulty)


def draw_structures(seed: int, difficulty: float) -> Structures:
    """Draw a row of structures; `difficulty` from 0 to 1. The same arguments give the same row."""
    rng = build_stream(seed, "scenario")
    places = [2.4, 4.9, 7.4] if difficulty > 0.5 else [2.8, 6.2]
    kinds = list(rng.permutation(["window", "underpass", "portal"]))[: len(places)]
    if "portal" not in kinds:  # the bar must matter in three dimensions
        kinds[rng.integers(len(kinds))] = "portal"
    draw = {"window": _draw_window, "underpass": _draw_underpass, "portal": _draw_portal}
    tubes: dict[str, Tube] = {}
    passages: dict[str, Passage] = {}
    for i, (kind, place) in enumerate(zip(kinds, places, strict=True)):
        # the easy end of the range at difficulty 0, the hard one at 1
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
    # between the pipes there is room; above the upper one and below the lower ones there is not
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
    # a second pipe, higher, keeps the robot from diving in steeply; both block the way above
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
