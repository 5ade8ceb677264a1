"""Pairs of shapes that can collide; only these are checked."""

import numpy as np

from skywright.core.arrays import Array
from skywright.models.kinematic_tree import BOX, HINGE, Shapes, Tree

Y = 1  # of (x, y, z)

PAIR_WORLD, PAIR_SELF, PAIR_LIMIT = range(3)
"""A pair with an obstacle, with another part of the robot, or with a plane of the area (other = 2
axis + side)."""


def list_ancestors(tree: Tree, body: int) -> list[int]:
    """Return the bodies from `body` up to the platform, which is excluded."""
    out = []
    while body > 0:
        out.append(body)
        body = int(tree.parent[body])
    return out


def list_pairs(tree: Tree, s: Shapes, world: Shapes, box: Array) -> list[tuple[int, int, int]]:
    """Return the pairs that can collide: with obstacles, limits, and parts two joints apart.

    Parts on two branches of the tree, such as two arms, are one pair if both can move.
    """
    pairs = []
    for a in range(len(s.body)):
        pairs += [(a, b, PAIR_WORLD) for b in range(len(world.body))]
        for axis in range(3):
            pairs += [
                (a, 2 * axis + side, PAIR_LIMIT) for side in (0, 1) if np.isfinite(box[axis, side])
            ]
    for a in range(len(s.body)):
        above = list_ancestors(tree, int(s.body[a]))
        for b in range(len(s.body)):
            if a == b:
                continue
            # b is nearer the root of the same chain, with at least two joints in between
            of_chain = int(s.body[b]) in [0, *above] and int(s.body[b]) != int(s.body[a])
            if of_chain and s.kind[a] != BOX:
                between = [x for x in above if x not in list_ancestors(tree, int(s.body[b]))]
                if len(between) >= 2:
                    pairs.append((a, b, PAIR_SELF))
            elif a < b and _move_apart(tree, int(s.body[a]), int(s.body[b])):
                # the nearest points of a segment and a box are computed from the segment
                pairs.append((b, a, PAIR_SELF) if s.kind[a] == BOX else (a, b, PAIR_SELF))
    return pairs


def _move_apart(tree: Tree, a: int, b: int) -> bool:
    """Return whether two bodies are on two branches, each with a joint below the branching."""
    over_a, over_b = list_ancestors(tree, a), list_ancestors(tree, b)
    own_a = [x for x in over_a if x not in over_b]
    own_b = [x for x in over_b if x not in over_a]
    return all(any(tree.joint[x] >= 0 for x in own) for own in (own_a, own_b))


def drop_beside(
    tree: Tree,
    s: Shapes,
    world: Shapes,
    box: Array,
    pairs: list[tuple[int, int, int]],
    y: float,
    margin: float,
    margin_self: float,
) -> list[tuple[int, int, int]]:
    """Drop pairs that stay apart in y because no shape moves in y.

    This holds if all joints rotate about y (or slide normal to it) and the platform keeps `y` (m)
    and the yaw 0.
    """
    rots, places = [np.eye(3)], [np.array([0.0, y, 0.0])]
    for b in range(1, len(tree.parent)):
        up = int(tree.parent[b])
        places.append(places[up] + rots[up] @ tree.pos[b])
        rots.append(rots[up] @ tree.rot[b])
        along = abs((rots[b] @ tree.axis[b])[1])
        if tree.joint[b] >= 0 and abs(along - (1.0 if tree.kind[b] == HINGE else 0.0)) > 1e-9:
            return pairs

    def reach(shapes: Shapes, i: int, p: Array, rot: Array) -> tuple[float, float]:
        ends = [(p + rot @ shapes.p0[i])[1], (p + rot @ shapes.p1[i])[1]]
        more = shapes.radius[i] + np.abs((rot @ shapes.rot[i])[1]) @ shapes.half[i]
        return min(ends) - more, max(ends) + more

    own = [reach(s, i, places[int(b)], rots[int(b)]) for i, b in enumerate(s.body)]
    other = [reach(world, i, np.zeros(3), np.eye(3)) for i in range(len(world.body))]

    def meets(pair: tuple[int, int, int]) -> bool:
        a, b, kind = pair
        low, high = own[a]
        if kind == PAIR_LIMIT and b // 2 == Y:
            return bool(low - box[Y, 0] < margin or box[Y, 1] - high < margin)
        if kind == PAIR_WORLD:
            return max(low - other[b][1], other[b][0] - high) < margin
        if kind == PAIR_SELF:
            return max(low - own[b][1], own[b][0] - high) < margin_self
        return True

    return [pair for pair in pairs if meets(pair)]
