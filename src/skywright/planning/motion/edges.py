"""Certified check that a straight motion in configuration space keeps every margin.

An interval of the edge is accepted for a pair of shapes if its distance at the middle exceeds the
margin by more than the pair can approach within the interval. Two bounds are used: the speed of the
fastest point of the shape (cheap), and the speed of the shape's ends along the normal of the plane
that separates it from the obstacle (tight: sliding along an obstacle is not penalised). Both
include the second-order term A h^2 / 2 with A >= |acceleration| of any point: a vector rotated by k
rotations of rates w_i has |d2/ds2| <= (sum |w_i|)^2 times its length. Intervals that are not
accepted are bisected; one shorter than `SHORTEST` counts as blocked. A free edge is therefore free,
and a blocked one is blocked or within a fraction of a millimetre of it.
"""

import math

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import cross, mat_mat, mat_vec
from skywright.core.user_code import njit
from skywright.models.kinematic_tree import BOX
from skywright.planning.motion.distance import box_box, segment_box, segment_segment
from skywright.planning.motion.kinematics import compute_pose
from skywright.planning.motion.pairs import PAIR_LIMIT, PAIR_SELF, PAIR_WORLD
from skywright.planning.motion.space import JOINT0, YAW, ScratchRecord, SpaceRecord

SHORTEST = 2.0**-13
"""Half length of the shortest interval of an edge that is still bisected."""


@helper
def place_shapes(space: SpaceRecord, c: Array, d: Array, k: ScratchRecord) -> None:
    """Place all shapes at coordinates c, with velocities for c' = d."""
    pose, s = k, space
    compute_pose(space, c, d, pose)
    r, x = k.r3, k.x3
    for i in range(s.ns):
        b = s.s_body[i]
        R, w = pose.R[b], pose.w[b]
        mat_vec(R, s.s_p0[i], r)
        cross(w, r, x)
        for j in range(3):
            k.p0[i, j] = pose.p[b, j] + r[j]
            k.v0[i, j] = pose.v[b, j] + x[j]
        mat_vec(R, s.s_p1[i], r)
        cross(w, r, x)
        for j in range(3):
            k.p1[i, j] = pose.p[b, j] + r[j]
            k.v1[i, j] = pose.v[b, j] + x[j]
            k.mid[i, j] = 0.5 * (k.p0[i, j] + k.p1[i, j])
            k.vm[i, j] = 0.5 * (k.v0[i, j] + k.v1[i, j])
        if s.s_kind[i] == BOX:
            mat_mat(R, s.s_rot[i], k.box[i])


@helper
def _bound_motion(space: SpaceRecord, d: Array, k: ScratchRecord) -> None:
    """Fill `omega` and `acc` for an edge of direction d; `place_shapes` has filled `du`."""
    t, du = space, k.du
    yaw = abs(du[YAW])
    first = turn = largest = 0.0  # of the passive joint: |phi'|, and the terms of |phi''|
    if space.passive >= 0:
        for b in range(space.passive + 1, t.nb):
            j = t.joint[b]
            if j >= 0:
                rate = abs(du[JOINT0 + j])
                first += rate * space.moment[b]
                turn += rate
        first /= space.moment_min
        largest = turn * first + first * first  # |C''| / |C| + (|C'| / |C|)^2
    for s in range(space.ns):
        omega, extra = yaw, 0.0
        for b in range(1, t.nb):
            if space.chain[s, b] == 1:
                if b == space.passive:
                    omega += first
                    extra = largest
                elif t.joint[b] >= 0:
                    omega += abs(du[JOINT0 + t.joint[b]])
        k.omega[s] = omega
        k.acc[s] = space.reach[s] * (omega * omega + extra)


@helper
def _core_gap(space: SpaceRecord, k: ScratchRecord, a: int, b: int) -> float:
    """Return the distance from the middle of shape a to the core of obstacle b."""
    w = space
    px, py, pz = k.mid[a, 0], k.mid[a, 1], k.mid[a, 2]
    if w.w_kind[b] == BOX:
        out = 0.0
        x, y, z = px - w.w_p0[b, 0], py - w.w_p0[b, 1], pz - w.w_p0[b, 2]
        for i in range(3):
            e = (
                abs(w.w_rot[b, 0, i] * x + w.w_rot[b, 1, i] * y + w.w_rot[b, 2, i] * z)
                - w.w_half[b, i]
            )
            if e > 0.0:
                out += e * e
        return math.sqrt(out)
    ux, uy, uz = (
        w.w_p1[b, 0] - w.w_p0[b, 0],
        w.w_p1[b, 1] - w.w_p0[b, 1],
        w.w_p1[b, 2] - w.w_p0[b, 2],
    )
    x, y, z = px - w.w_p0[b, 0], py - w.w_p0[b, 1], pz - w.w_p0[b, 2]
    square = ux * ux + uy * uy + uz * uz
    t = 0.0
    if square > 1e-18:
        t = min(max((ux * x + uy * y + uz * z) / square, 0.0), 1.0)
    x, y, z = x - t * ux, y - t * uy, z - t * uz
    return math.sqrt(x * x + y * y + z * z)


@helper
def _nearest(
    space: SpaceRecord, k: ScratchRecord, a: int, b: int, other_is_robot: bool
) -> tuple[float, float]:
    """Return the distance between the cores of shapes a and b, and the parameter on a.

    Fills k.normal from b to a.
    """
    s = space
    if other_is_robot:
        if s.s_kind[a] == BOX:
            return box_box(k.p0[a], k.box[a], s.s_half[a], k.p0[b], k.box[b], s.s_half[b], k.normal)
        if s.s_kind[b] == BOX:
            return segment_box(k.p0[a], k.p1[a], k.p0[b], k.box[b], s.s_half[b], k.normal)
        return segment_segment(k.p0[a], k.p1[a], k.p0[b], k.p1[b], k.normal)
    w = space
    if s.s_kind[a] == BOX:
        if w.w_kind[b] == BOX:
            return box_box(
                k.p0[a], k.box[a], s.s_half[a], w.w_p0[b], w.w_rot[b], w.w_half[b], k.normal
            )
        d, _ = segment_box(w.w_p0[b], w.w_p1[b], k.p0[a], k.box[a], s.s_half[a], k.normal)
        for i in range(3):
            k.normal[i] = -k.normal[i]
        return d, 0.0
    if w.w_kind[b] == BOX:
        return segment_box(k.p0[a], k.p1[a], w.w_p0[b], w.w_rot[b], w.w_half[b], k.normal)
    return segment_segment(k.p0[a], k.p1[a], w.w_p0[b], w.w_p1[b], k.normal)


@helper
def _box_extent(space: SpaceRecord, k: ScratchRecord, a: int, axis: int) -> float:
    h = space.s_half[a]
    r = k.box[a, axis]
    return abs(r[0]) * h[0] + abs(r[1]) * h[1] + abs(r[2]) * h[2]


@helper
def pair_distance(space: SpaceRecord, k: ScratchRecord, i: int) -> float:
    """Return the distance (m) between the surfaces of pair i; negative if they overlap."""
    a, b, kind = space.pairs[i, 0], space.pairs[i, 1], space.pairs[i, 2]
    s = space
    if kind == PAIR_LIMIT:
        axis, high = b // 2, b % 2 == 1
        extent = _box_extent(space, k, a, axis) if s.s_kind[a] == BOX else s.s_radius[a]
        limit = space.area[axis, 1] if high else space.area[axis, 0]
        sign = -1.0 if high else 1.0
        return min(sign * (k.p0[a, axis] - limit), sign * (k.p1[a, axis] - limit)) - extent
    d, _ = _nearest(space, k, a, b, kind == PAIR_SELF)
    return d - s.s_radius[a] - (s.s_radius[b] if kind == PAIR_SELF else space.w_radius[b])


@helper
def _speed(v: Array) -> float:
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@helper
def _check_pair(space: SpaceRecord, k: ScratchRecord, i: int, h: float) -> int:
    """Return 1: free over the whole interval; 0: undecided; -1: blocked at its middle."""
    a, b, kind = space.pairs[i, 0], space.pairs[i, 1], space.pairs[i, 2]
    s, m = space, space.margin[i]
    curve = 0.5 * k.acc[a] * h * h
    if kind == PAIR_LIMIT:
        axis, high = b // 2, b % 2 == 1
        extent = _box_extent(space, k, a, axis) if s.s_kind[a] == BOX else s.s_radius[a]
        limit = space.area[axis, 1] if high else space.area[axis, 0]
        sign = -1.0 if high else 1.0
        g0, g1 = sign * (k.p0[a, axis] - limit) - extent, sign * (k.p1[a, axis] - limit) - extent
        if g0 < m or g1 < m:
            return -1
        # a box rotates: its extent grows by at most omega times its radius
        turn = k.omega[a] * space.bound[a] if s.s_kind[a] == BOX else 0.0
        low0 = g0 - (abs(k.v0[a, axis]) + turn) * h - curve
        low1 = g1 - (abs(k.v1[a, axis]) + turn) * h - curve
        return 1 if low0 >= m and low1 >= m else 0
    if kind == PAIR_WORLD:
        r = space.w_radius[b]
        gap = _core_gap(space, k, a, b) - r - space.bound[a]
        if gap - (_speed(k.vm[a]) + k.omega[a] * space.bound[a]) * h - curve >= m:
            return 1
        d, t = _nearest(space, k, a, b, False)
        r += s.s_radius[a]
        if d - r < m or d == 0.0:
            return -1
        n = k.normal
        if s.s_kind[a] == BOX:
            rate = abs(n[0] * k.vm[a, 0] + n[1] * k.vm[a, 1] + n[2] * k.vm[a, 2])
            rate += k.omega[a] * space.bound[a]
            return 1 if d - r - rate * h - curve >= m else 0
        # separating plane: both ends stay beyond it
        lift = (
            n[0] * (k.p1[a, 0] - k.p0[a, 0])
            + n[1] * (k.p1[a, 1] - k.p0[a, 1])
            + n[2] * (k.p1[a, 2] - k.p0[a, 2])
        )
        g0, g1 = d - t * lift, d + (1.0 - t) * lift
        rate0 = abs(n[0] * k.v0[a, 0] + n[1] * k.v0[a, 1] + n[2] * k.v0[a, 2])
        rate1 = abs(n[0] * k.v1[a, 0] + n[1] * k.v1[a, 1] + n[2] * k.v1[a, 2])
        if g0 - r - rate0 * h - curve >= m and g1 - r - rate1 * h - curve >= m:
            return 1
        return 0
    # two parts of the robot: speeds relative to the platform
    x, y, z = k.mid[a, 0] - k.mid[b, 0], k.mid[a, 1] - k.mid[b, 1], k.mid[a, 2] - k.mid[b, 2]
    gap = math.sqrt(x * x + y * y + z * z) - space.bound[a] - space.bound[b]
    v = k.v[0]
    rate = 0.0
    for shape in (a, b):
        x, y, z = k.vm[shape, 0] - v[0], k.vm[shape, 1] - v[1], k.vm[shape, 2] - v[2]
        rate += math.sqrt(x * x + y * y + z * z) + k.omega[shape] * space.bound[shape]
    curve += 0.5 * k.acc[b] * h * h
    if gap - rate * h - curve >= m:
        return 1
    d, _ = _nearest(space, k, a, b, True)
    d -= s.s_radius[a] + s.s_radius[b]
    if d < m:
        return -1
    return 1 if d - rate * h - curve >= m else 0


@njit(cache=True, error_model="numpy")
def is_state_free(space: SpaceRecord, c: Array, k: ScratchRecord) -> bool:
    """Return whether all margins hold at coordinates c; otherwise `k.blocked` is the pair."""
    k.d[:] = 0.0
    place_shapes(space, c, k.d, k)
    return is_placed_free(space, k)


@helper
def is_placed_free(space: SpaceRecord, k: ScratchRecord) -> bool:
    """Return whether all margins hold for the placed shapes; otherwise `k.blocked` is the pair."""
    for a in range(space.ns):
        k.omega[a] = k.acc[a] = 0.0
    for i in range(space.n_pairs):
        if _check_pair(space, k, i, 0.0) < 0:
            k.blocked = i
            return False
    return True


@helper
def is_edge_free(space: SpaceRecord, a: Array, b: Array, k: ScratchRecord) -> bool:
    """Return whether the straight motion from a to b keeps all margins; certified (see module)."""
    n = space.n
    for j in range(n):
        k.d[j] = b[j] - a[j]
    active, stack = k.active, k.stack
    stack[0, 0], stack[0, 1], stack[0, 2] = 0.5, 0.5, float(space.n_pairs)
    depth, first = 1, True
    while depth > 0:
        depth -= 1
        middle, h, count = stack[depth, 0], stack[depth, 1], int(stack[depth, 2])
        for j in range(n):
            k.c[j] = a[j] + middle * k.d[j]
        place_shapes(space, k.c, k.d, k)
        if first:
            _bound_motion(space, k.d, k)
            first = False
        left = 0
        for i in range(count):
            pair = active[i]
            found = _check_pair(space, k, pair, h)
            if found < 0:
                k.blocked = pair
                return False
            if found == 0:
                active[i], active[left] = active[left], pair
                left += 1
        if left > 0:
            if h < SHORTEST:
                k.blocked = active[0]
                return False
            for sign in (1.0, -1.0):
                stack[depth, 0] = middle + 0.5 * sign * h
                stack[depth, 1], stack[depth, 2] = 0.5 * h, float(left)
                depth += 1
    return True


@njit(cache=True, error_model="numpy")
def state_clearance(
    space: SpaceRecord, c: Array, k: ScratchRecord, kind: int = -1
) -> tuple[float, int]:
    """Return (smallest clearance above the margins m, its pair) at coordinates c; of one `kind`."""
    k.d[:] = 0.0
    place_shapes(space, c, k.d, k)
    best, which = 1e18, -1
    for i in range(space.n_pairs):
        if kind >= 0 and space.pairs[i, 2] != kind:
            continue
        d = pair_distance(space, k, i) - space.margin[i]
        if d < best:
            best, which = d, i
    return best, which
