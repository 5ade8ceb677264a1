"""Frames for replay and live view: what the page moves and plots, one row of float32 per instant.

A frame holds, in this order: position and quaternion (wxyz) of each part relative to its parent (7
each); origin and vector (m, N) of each force arrow in W (6 each); the trace's point in W and its
quality (4); a sample of the inspection map: s, c (m) and value (3); and the value of each channel.
NaN marks missing values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.description.robot.limbs import SIDES
from skywright.description.robot.spec import Robot
from skywright.description.world.surface import build_cylinder, unroll_points
from skywright.inspection.contact_quality import GAP_LIMIT, TILT_LIMIT
from skywright.models.compliant_arms import is_compliant
from skywright.recordings.columns import has_columns
from skywright.reports.scene3d import Scene3d
from skywright.reports.trace3d import judge_trace

Rows = NDArray[Any]
NEAR = 0.02  # m; beyond it gap and tilt are not shown
NO_FORCE = 0.02
"""N; smaller forces have no arrow."""


class Channel(NamedTuple):
    """A quantity over time."""

    name: str
    unit: str
    limit: float | None  # acceptable up to this value; None: no limit
    digits: int  # after the point
    plotted: bool
    read: Callable[[Rows], Array]  # from samples (n,) to values (n,)


class Arrow(NamedTuple):
    """A drawn force."""

    name: str
    demanded: bool  # else measured or estimated
    read: Callable[[Rows], tuple[Array, Array]]  # to origins (n, 3) m and forces (n, 3) N in W


class FrameBuilder:
    """Builds frames from samples of one robot in one world."""

    def __init__(
        self, scene: Scene3d, columns: frozenset[str], judged: tuple[str, ...],
        gap_limit: float | None = None, *, forces: bool = True,
    ) -> None:  # fmt: skip
        """`columns` are those of the samples; `judged` are phases in which contact quality counts.

        `gap_limit` (m): largest gap that counts as contact, by default GAP_LIMIT. Without `forces`,
        forces, thrusts and power are omitted.
        """
        self.scene, self.judged = scene, judged
        self.gap_limit = GAP_LIMIT if gap_limit is None else gap_limit
        robot, world = scene.robot, scene.world
        self.channels = list_channels(robot, columns, self.gap_limit, contact=bool(judged))
        self.arrows = list_arrows(robot, columns)
        if not forces:
            self.channels = [c for c in self.channels if c.unit not in ("N", "%", "W")]
            self.arrows = []
        self.has_arm = robot.arm is not None
        self.pipe = world.pipe if "ec" in columns and judged else None
        self._cylinder = build_cylinder(self.pipe) if self.pipe is not None else None

    @property
    def size(self) -> int:
        """Number of values in a frame."""
        parts = len(self.scene.drawing.parts)
        return 7 * parts + 6 * len(self.arrows) + 4 + 3 + len(self.channels)

    @property
    def layout(self) -> dict[str, Any]:
        """Description of a frame for the page, as plain JSON."""
        return {
            "parts": len(self.scene.drawing.parts),
            "arrows": [{"name": a.name, "demanded": a.demanded} for a in self.arrows],
            "channels": [
                {"name": c.name, "unit": c.unit, "limit": c.limit, "digits": c.digits,
                 "plotted": c.plotted}
                for c in self.channels
            ],
            "size": self.size,
            "map": self._describe_map(),
        }  # fmt: skip

    def build(self, rows: Rows, judged: Mask, signal: Array | None = None) -> NDArray[np.float32]:
        """Return frames (n, size) of samples (n,).

        `judged` (n,): where contact quality counts; `signal` (n,): the map's value, NaN away from
        the surface.
        """
        n = len(rows)
        columns: list[Array] = []
        for position, quaternion in self.scene.compute_poses(rows):
            columns += [position, quaternion]
        if self.arrows:
            origins, forces = zip(*(arrow.read(rows) for arrow in self.arrows), strict=True)
            force = np.array(forces)
            force[np.einsum("kni,kni->kn", force, force) < NO_FORCE**2] = np.nan
            columns += [x for pair in zip(origins, force, strict=True) for x in pair]
        points, quality = judge_trace(rows, judged, self.has_arm, self.gap_limit)
        columns += [points, quality[:, None], self._map(rows, signal)]
        columns += [channel.read(rows).reshape(n, 1) for channel in self.channels]
        return np.concatenate(columns, axis=1).astype("<f4")

    def _map(self, rows: Rows, signal: Array | None) -> Array:
        out = np.full((len(rows), 3), np.nan)
        if self._cylinder is not None and signal is not None:
            s, c, _ = unroll_points(self._cylinder, rows["p_WT"])
            out[:, 0], out[:, 1], out[:, 2] = s, c, signal
            out[~np.isfinite(signal)] = np.nan
        return out

    def _describe_map(self) -> dict[str, Any] | None:
        if self._cylinder is None:
            return None
        return {
            "title": "unrolled pipe, along (right) and around (up)",
            "value": "weld signal of the probe",
        }


def list_channels(
    robot: Robot, columns: frozenset[str], gap_limit: float = GAP_LIMIT, *, contact: bool = False
) -> list[Channel]:
    """Return the channels of a robot; with `contact`, those of a probe on a pipe."""
    out: list[Channel] = []

    def add(
        name: str, unit: str, read: Callable[[Rows], Array], limit: float | None = None,
        digits: int = 1, plotted: bool = True,
    ) -> None:  # fmt: skip
        out.append(Channel(name, unit, limit, digits, plotted, read))

    if contact:
        add("push on the pipe", "N", lambda r: _near(r, r["f_normal"]), digits=2)
        add("air gap", "mm", lambda r: _near(r, 1e3 * np.maximum(r["gap"], 0.0)), 1e3 * gap_limit,
            digits=2)  # fmt: skip
        add("probe tilt", "°", lambda r: _near(r, np.degrees(r["tilt"])), math.degrees(TILT_LIMIT))
        add("tip off its path", "mm", _read_aside)
    else:
        if "force_meas" in columns:
            add("push measured", "N", lambda r: np.asarray(r["force_meas"], float), digits=2)
            add("push demanded", "N", lambda r: np.asarray(r["ref_force"], float), digits=2)
        add("off the path", "m", _read_off, digits=2)
        if robot.arm is not None and is_compliant(robot):
            for side in SIDES[: robot.arm.sides]:
                add(f"{side} hand force, with load", "N", _norm(f"{side}_f_W"))
        add("platform tilt", "°", _read_lean)
        add("speed", "m/s", _norm("v_WB"), digits=2)
    most = robot.rotors.thrust_max_n
    add("busiest rotor", "%", lambda r: 100.0 * r["rotor_thrust"].max(axis=1) / most, 100.0,
        digits=0)  # fmt: skip
    add("height", "m", lambda r: np.asarray(r["p_WB"][:, 2]), digits=2)
    add("position uncertainty", "mm", lambda r: 1e3 * np.asarray(r["pose_std"]), plotted=False)
    add("power", "W", lambda r: np.asarray(r["power"], float), digits=0, plotted=False)
    return [c for c in out if c.name not in _LACKING or _LACKING[c.name] in columns]


_LACKING = {"position uncertainty": "pose_std", "power": "power"}
"""Channels whose columns old recordings may lack."""


def list_arrows(robot: Robot, columns: frozenset[str]) -> list[Arrow]:
    """Return the drawn forces, demanded and measured."""
    out: list[Arrow] = []
    if robot.arm is not None and is_compliant(robot):
        for side in SIDES[: robot.arm.sides]:
            place = f"{side}_p_WH"
            name = f"{side} hand, without load"  # the force without the known weight
            out.append(Arrow(name, False, _at(place, f"{side}_est_f_W")))
            out.append(Arrow(name, True, _at(place, f"{side}_ref_f_W")))
    elif "f_contact" in columns and robot.arm is not None:
        out.append(Arrow("tip", False, _at("p_WT", "f_contact")))
        if "ref_force" in columns:
            out.append(Arrow("tip", True, _read_demand))
    if "est_f_ext_W" in columns:
        out.append(Arrow("platform, felt", False, _at("p_WB", "est_f_ext_W")))
    return [a for a in out if _names(a) <= columns]


def _names(arrow: Arrow) -> frozenset[str]:
    return getattr(arrow.read, "needs", frozenset())


def _at(place: str, force: str) -> Callable[[Rows], tuple[Array, Array]]:
    def read(rows: Rows) -> tuple[Array, Array]:
        return np.asarray(rows[place], float), np.asarray(rows[force], float)

    read.needs = frozenset({place, force})  # type: ignore[attr-defined]
    return read


def _read_demand(rows: Rows) -> tuple[Array, Array]:
    """Return the desired contact force on the tip: along the tip's axis, outwards."""
    w, x, y, z = np.asarray(rows["q_WT"], float).T
    axis = np.stack(
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1
    )  # z of T in W
    return np.asarray(rows["p_WT"], float), -rows["ref_force"][:, None] * axis


def _near(rows: Rows, values: Array) -> Array:
    return np.where(rows["gap"] < NEAR, values, np.nan)


def _norm(name: str) -> Callable[[Rows], Array]:
    return lambda rows: np.asarray(np.linalg.norm(rows[name], axis=1))


def _read_off(rows: Rows) -> Array:
    return np.asarray(np.linalg.norm(rows["p_WB"] - rows["ref_p_WB"], axis=1))


def _read_aside(rows: Rows) -> Array:
    """Return the distance (mm) of the tip from its path along the surface while it presses."""
    normal = rows["ref_normal_W"]
    pushing = np.linalg.norm(normal, axis=1) > 0.5
    wrong = rows["p_WT"] - rows["ref_p_WT"]
    along = np.sum(wrong * normal, axis=1)[:, None] * normal
    return np.where(pushing, 1e3 * np.linalg.norm(wrong - along, axis=1), np.nan)


def _read_lean(rows: Rows) -> Array:
    q = rows["q_WB"]
    level = np.clip(np.hypot(q[:, 0], q[:, 3]), 0.0, 1.0)
    return np.asarray(np.degrees(2.0 * np.arccos(level)))


def list_columns(rows: Rows) -> frozenset[str]:
    """Return the names of the columns of samples."""
    assert has_columns(rows, "t")
    return frozenset(rows.dtype.names or ())
