"""Widths of the passages of a world, and the widths that a robot requires.

A passage names two tubes (or the ground or the ceiling); its opening is their distance. The robot
requires its smallest height over all arm postures, the width of its platform, or the length of its
bar, plus the margin on both sides.
"""

from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.user_code import njit
from skywright.description.world.scenario import Structures, get_structures
from skywright.description.world.spec import Tube, World
from skywright.models.kinematic_tree import BOX
from skywright.planning.motion.connect import draw_coordinates
from skywright.planning.motion.distance import segment_segment
from skywright.planning.motion.edges import place_shapes, state_clearance
from skywright.planning.motion.pairs import PAIR_SELF
from skywright.planning.motion.rng import State, build_state
from skywright.planning.motion.space import ScratchRecord, Space, SpaceRecord, build_scratch


class PassageWidth(NamedTuple):
    """A passage and the width that the robot requires."""

    name: str
    opening: float  # m
    needs: float  # m, margins included
    what: str  # "robot", "platform" or "bar"

    @property
    def ratio(self) -> float:
        """Opening over required width; below 1 the robot does not fit."""
        return self.opening / self.needs


def list_passages(world: World, space: Space, bar: float, margin: float) -> list[PassageWidth]:
    """Return the passages of a world, the narrowest for this robot first.

    `bar` (m) is the length of the carried bar (0: none), `margin` (m) applies on each side.
    """
    structures = get_structures(world)
    width = _platform_width(space)
    sizes = {"bar": max(bar, width), "platform": width, "robot": compute_least_height(space)}
    out = [
        PassageWidth(
            name, _opening(structures, *passage.between),
            sizes[passage.needs] + 2.0 * margin, passage.needs,
        )
        for name, passage in structures.passages.items()
    ]  # fmt: skip
    return sorted(out, key=lambda p: p.ratio)


def compute_least_height(space: Space, draws: int = 200_000) -> float:
    """Return the smallest height (m) of robot and load over sampled arm postures."""
    rng = np.random.default_rng(0)
    return float(_least_height(space, build_scratch(space), build_state(rng), draws))


@njit(cache=True, error_model="numpy")
def _least_height(space: Space, scratch: Space, state: State, draws: int) -> float:
    s, k = space[0], scratch[0]
    c, best = np.empty(s.n), 1e18
    for _ in range(draws):
        draw_coordinates(s, state, c)
        for i in range(s.n):
            k.d[i] = 0.0
        place_shapes(s, c, k.d, k)
        low, high = 1e18, -1e18
        for i in range(s.ns):
            r = s.s_radius[i]
            if s.s_kind[i] == BOX:
                r = abs(k.box[i, 2, 0]) * s.s_half[i, 0] + abs(k.box[i, 2, 1]) * s.s_half[i, 1]
                r += abs(k.box[i, 2, 2]) * s.s_half[i, 2]
            low = min(low, min(k.p0[i, 2], k.p1[i, 2]) - r)
            high = max(high, max(k.p0[i, 2], k.p1[i, 2]) + r)
        if high - low < best and _keeps_apart(s, c, k):
            best = high - low
    return best


@helper
def _keeps_apart(s: SpaceRecord, c: Array, k: ScratchRecord) -> bool:
    from_self = state_clearance(s, c, k, PAIR_SELF)
    return from_self[0] >= 0.0


def _platform_width(space: Space) -> float:
    return 2.0 * float(space[0]["s_half"][0, 1])


def _opening(structures: Structures, a: str, b: str) -> float:
    tubes = structures.tubes
    if {a, b} == {"ground", "ceiling"}:
        assert structures.area is not None
        return structures.area.z_max_m
    if "ground" in (a, b):
        tube = tubes[b if a == "ground" else a]
        return min(tube.z_m, tube.to_z_m) - tube.diameter_m / 2
    if "ceiling" in (a, b):
        tube = tubes[b if a == "ceiling" else a]
        assert structures.area is not None
        return structures.area.z_max_m - max(tube.z_m, tube.to_z_m) - tube.diameter_m / 2
    distance, _ = segment_segment(*_ends(tubes[a]), *_ends(tubes[b]), np.zeros(3))
    return float(distance) - (tubes[a].diameter_m + tubes[b].diameter_m) / 2


def _ends(tube: Tube) -> tuple[Array, Array]:
    return (
        np.array([tube.x_m, tube.y_m, tube.z_m]),
        np.array([tube.to_x_m, tube.to_y_m, tube.to_z_m]),
    )
