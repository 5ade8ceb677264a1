"""Clearance between robot and world, computed with the MuJoCo model of the simulation.

`mj_kinematics` and `mj_geomDistance` are called from compiled code; bounding volumes cull the
pairs, so that one query of the whole robot takes a few microseconds. Distances are exact to the
tolerance of MuJoCo's convex solver (below a micrometre between the primitives used here; a test
compares with closed forms).

This module loads the shared library, because cached machine code that runs before the library is
loaded would crash the process.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
import mujoco
import numpy as np
from numba import types

from skywright.core.arrays import Array, Ints
from skywright.core.compiled import helper
from skywright.core.rotations import rot_to_quat
from skywright.core.user_code import njit
from skywright.models.airframe import pick_airframe_geoms
from skywright.models.scene import Scene

PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)

FAR = 2.0
"""m; beyond this a distance is reported as this value."""


def _library_path() -> Path:
    """Path of the MuJoCo library that the Python package has loaded."""
    folder = Path(mujoco.__file__).parent
    found = [
        p for p in sorted(folder.iterdir())
        if "mujoco" in p.name and (".so" in p.suffixes or p.suffix in (".dylib", ".dll"))
        and not p.name.startswith("_")
    ]  # fmt: skip
    if not found:
        raise ImportError(f"no MuJoCo library beside {mujoco.__file__}")
    return found[0]


llvmlite.binding.load_library_permanently(str(_library_path()))

_kinematics: Any = types.ExternalFunction("mj_kinematics", types.void(types.intp, types.intp))
_geom_distance: Any = types.ExternalFunction(
    "mj_geomDistance",
    types.float64(types.intp, types.intp, types.int32, types.int32, types.float64, types.intp),
)


class ClearanceCore(NamedTuple):
    """Data of the compiled query. The arrays are views into an MjData that belongs to it alone."""

    model_address: int
    data_address: int
    qpos: Array  # view
    geom_xpos: Array  # (ngeom, 3) view
    geom_xmat: Array  # (ngeom, 9) view
    joint_qpos: Ints  # (n_joints,)
    geom_type: Ints  # (ngeom,)
    geom_size: Array  # (ngeom, 3)
    rbound: Array  # (ngeom,)
    pairs: Ints  # (n, 2) robot geom, world geom; then arm geom, platform geom
    n_world: int  # pairs with the world
    probe: Array  # (n,) 1 if the pair is probe and pipe


class ClearanceQuery(NamedTuple):
    """Distances of a robot to a world; `core` goes into compiled code."""

    core: ClearanceCore
    names: tuple[str, ...]  # of all geoms, by id
    model: mujoco.MjModel  # keeps the model alive
    data: mujoco.MjData


class Clearance(NamedTuple):
    """The smallest distance and its two geoms."""

    distance: float  # m, at most FAR; negative when they overlap
    robot_geom: int
    other_geom: int


def build_clearance(
    scene: Scene, *, with_ground: bool = True, in_air: bool = False, folded: Array | None = None
) -> ClearanceQuery:
    """Build the query on a nominal scene (no flexibility: the joints are at the planned angles).

    Pairs are every robot geom with every world geom, except landing gear with ground unless
    `in_air`, or any geom with the ground without `with_ground`. A separate set of pairs has the
    arm's moving links with propellers and gear. Gear that a link intersects at `folded` (n_joints,)
    rad is excluded: its shape is generic, and the arm is mounted inside it.
    """
    model, index = scene.model, scene.places
    data = mujoco.MjData(model)
    names = tuple(model.geom(i).name for i in range(model.ngeom))
    feet, probe = set(index.feet_geoms.tolist()), set(index.probe_geoms.tolist())
    world: list[tuple[int, int]] = []
    for r in index.robot_geoms.tolist():
        for w in index.world_geoms.tolist():
            if names[w] == "ground" and ((r in feet and not in_air) or not with_ground):
                continue
            world.append((r, w))
    robot = index.robot_geoms.tolist()
    moving = [r for r in robot if _joints_between(model, r, index.platform_body) > 0]
    propellers = pick_airframe_geoms(model, "propeller")
    own = [(r, other) for r in moving for other in sorted({*propellers, *feet})]
    if folded is not None:
        data.qpos[index.joint_qpos] = folded
        mujoco.mj_kinematics(model, data)
        own = [
            (r, other)
            for r, other in own
            if other in propellers or mujoco.mj_geomDistance(model, data, r, other, 0.1, None) > 0.0
        ]
    pairs = world + own
    core = ClearanceCore(
        model_address=int(model._address),
        data_address=int(data._address),
        qpos=data.qpos,
        geom_xpos=data.geom_xpos,
        geom_xmat=data.geom_xmat,
        joint_qpos=np.ascontiguousarray(index.joint_qpos),
        geom_type=model.geom_type.astype(np.int64),
        geom_size=np.ascontiguousarray(model.geom_size),
        rbound=np.ascontiguousarray(model.geom_rbound),
        pairs=np.array(pairs, dtype=np.int64).reshape(-1, 2),
        n_world=len(world),
        probe=np.array([float(r in probe and names[w] == "pipe") for r, w in pairs]),
    )
    return ClearanceQuery(core, names, model, data)


def _joints_between(model: mujoco.MjModel, geom: int, platform: int) -> int:
    """Number of joints from the platform to the body of `geom`."""
    body, count = int(model.geom_bodyid[geom]), 0
    while body not in (0, platform):
        count += int(model.body_jntnum[body])
        body = int(model.body_parentid[body])
    return count


@helper
def _lower_bound(c: ClearanceCore, a: int, b: int) -> float:
    """Lower bound of the distance: the robot geom's bounding sphere to a volume around `b`."""
    kind = c.geom_type[b]
    dx = c.geom_xpos[a, 0] - c.geom_xpos[b, 0]
    dy = c.geom_xpos[a, 1] - c.geom_xpos[b, 1]
    dz = c.geom_xpos[a, 2] - c.geom_xpos[b, 2]
    m = c.geom_xmat[b]
    z = m[2] * dx + m[5] * dy + m[8] * dz  # along the z axis of `b`
    if kind == PLANE:
        return z - c.rbound[a]
    if kind == SPHERE:
        return math.sqrt(dx * dx + dy * dy + dz * dz) - c.rbound[a] - c.rbound[b]
    x = m[0] * dx + m[3] * dy + m[6] * dz
    y = m[1] * dx + m[4] * dy + m[7] * dz
    if kind == BOX:
        ex = max(abs(x) - c.geom_size[b, 0], 0.0)
        ey = max(abs(y) - c.geom_size[b, 1], 0.0)
        ez = max(abs(z) - c.geom_size[b, 2], 0.0)
        return math.sqrt(ex * ex + ey * ey + ez * ez) - c.rbound[a]
    # cylinder or capsule: inside the capsule of its radius and half length
    ez = max(abs(z) - c.geom_size[b, 1], 0.0)
    return math.sqrt(x * x + y * y + ez * ez) - c.geom_size[b, 0] - c.rbound[a]


@helper
def _closest(
    c: ClearanceCore, first: int, last: int, probe_slack: float, far: float
) -> tuple[float, int]:
    """Return (distance m, pair) over pairs first..last-1 at the current kinematics."""
    n = last - first
    bound = np.empty(n)
    for i in range(n):
        k = first + i
        bound[i] = _lower_bound(c, c.pairs[k, 0], c.pairs[k, 1]) + probe_slack * c.probe[k]
    best, which = far, -1
    while n > 0:
        i = 0
        for j in range(1, n):
            if bound[j] < bound[i]:
                i = j
        if bound[i] >= best:
            break
        k = first + i
        slack = probe_slack * c.probe[k]
        d = slack + _geom_distance(
            c.model_address, c.data_address,
            np.int32(c.pairs[k, 0]), np.int32(c.pairs[k, 1]), best - slack + 1e-3, 0,
        )  # fmt: skip
        bound[i] = 1e18
        if d < best:
            best, which = d, k
    return best, which


@njit(cache=True, error_model="numpy")
def query_clearance(
    c: ClearanceCore, p_WB: Array, R_WB: Array, q: Array, probe_slack: float, far: float
) -> tuple[float, int]:
    """Return (distance to the world m, pair) at a pose; distances of `far` and more are not
    resolved.

    `probe_slack` (m) is added to the distances between probe and pipe: 0 in free flight, FAR while
    the probe touches.
    """
    for i in range(3):
        c.qpos[i] = p_WB[i]
    rot_to_quat(R_WB, c.qpos[3:7])
    for j in range(c.joint_qpos.shape[0]):
        c.qpos[c.joint_qpos[j]] = q[j]
    _kinematics(c.model_address, c.data_address)
    return _closest(c, 0, c.n_world, probe_slack, far)


@njit(cache=True, error_model="numpy")
def query_self(c: ClearanceCore, far: float) -> tuple[float, int]:
    """Return (distance m, pair) from the arm to propellers or gear, at the last query's pose."""
    return _closest(c, c.n_world, c.pairs.shape[0], 0.0, far)


def compute_clearance(
    query: ClearanceQuery, p_WB: Array, R_WB: Array, q: Array, exclude_probe: bool = False
) -> Clearance:
    """Return the smallest distance between robot and world.

    p_WB (3,) m, R_WB (3, 3), q (n_joints,) rad. `exclude_probe` excludes the pair of probe and
    pipe, as needed during contact.
    """
    distance, pair = query_clearance(
        query.core, np.asarray(p_WB, dtype=float), np.ascontiguousarray(R_WB, dtype=float),
        np.asarray(q, dtype=float), FAR if exclude_probe else 0.0, FAR,
    )  # fmt: skip
    if pair < 0:
        return Clearance(FAR, -1, -1)
    return Clearance(distance, *(int(g) for g in query.core.pairs[pair]))


def leave_out(query: ClearanceQuery, name: str) -> ClearanceCore:
    """Return the core in which `probe_slack` applies to the world's geom `name` and all of the
    robot."""
    names = [query.names[other] for _, other in query.core.pairs]
    return query.core._replace(probe=np.array([float(n == name) for n in names]))


def compute_self_clearance(query: ClearanceQuery, q: Array) -> Clearance:
    """Return the smallest distance between the arm's moving links and propellers or gear."""
    query_clearance(query.core, np.zeros(3), np.eye(3), np.asarray(q, dtype=float), 0.0, 0.0)
    distance, pair = query_self(query.core, FAR)
    if pair < 0:
        return Clearance(FAR, -1, -1)
    return Clearance(distance, *(int(g) for g in query.core.pairs[pair]))


def describe_pair(query: ClearanceQuery, pair: int) -> str:
    """Return "propeller1 and pipe" of a pair index."""
    if pair < 0:
        return "nothing"
    a, b = query.core.pairs[pair]
    return f"{query.names[a]} and {query.names[b]}"


def compute_area_clearance(query: ClearanceQuery, scene: Scene, limits: Array) -> float:
    """Return the distance (m) of the robot to the planes `limits` (3, 2) m, at the last query.

    Exact for spheres, capsules and cylinders, whose extent along an axis has a closed form.
    """
    geoms, c = scene.places.robot_geoms, query.core
    z = c.geom_xmat[geoms].reshape(-1, 3, 3)[:, :, 2]
    kind, size = c.geom_type[geoms], c.geom_size[geoms]
    half = np.where((kind == SPHERE)[:, None], 0.0, np.abs(z) * size[:, 1:2])
    flat = (kind == CYLINDER)[:, None]
    half = half + size[:, :1] * np.where(flat, np.sqrt(np.maximum(1.0 - z * z, 0.0)), 1.0)
    p = c.geom_xpos[geoms]
    return float(min(np.min(p - half - limits[:, 0]), np.min(limits[:, 1] - p - half)))
