"""Result of a comparison of two robots: plain values for tables, figures and `--json`."""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.models.reach import ReachMap


class Way(NamedTuple):
    """Planned path of sensor-install and its distances to the pipe."""

    distance: Array  # (n,) m, along the path
    propellers: Array  # (n,) m, minimum distance to the pipe; negative: penetration
    gear: Array  # (n,) m
    blocked_by: str  # why there is no plan, else ""
    q: Array  # (n_joints,) rad, arms at the contact
    p_contact: Array  # (3,) m, platform at the contact


class TorqueMap(NamedTuple):
    """Torque on the platform per newton at the left hand, over the direction of the force."""

    azimuth: Array  # (n,) rad, from ahead to the left
    elevation: Array  # (m,) rad, up
    torque: Array  # (m, n, 3) m, about x, y, z of B; NaN: a passive link has no equilibrium
    swing: Array  # (m, n) rad, rotation of a passive link; NaN likewise
    force: float  # N, at which the map was computed


class Collision(NamedTuple):
    """One flight of the mission impact."""

    what: str  # impacting part: hand, hand with stiff joints, passive link
    metrics: dict[str, float]
    reason: str  # why there are no metrics


class Install(NamedTuple):
    """Result of the flown mission sensor-install."""

    metrics: dict[str, float]
    propellers: float  # m, minimum distance to the pipe from take-off to landing; NaN: not flown
    gear: float  # m
    reason: str  # what went wrong, else ""


class Hover(NamedTuple):
    """Flights that hold the tip at a point in gusty wind."""

    wind: Array  # (n,) m/s
    tip: Array  # (n, seeds) m, rms distance of the tip from its reference; NaN: control was lost
    platform: Array  # (n, seeds) m


class Side(NamedTuple):
    """All results of one of the two robots."""

    name: str
    robot: Robot
    values: dict[str, float]  # by row; NaN: not measured
    notes: dict[str, str]  # why a value is missing, or a remark
    way: Way | None
    reach: ReachMap | None
    reaction: TorqueMap | None
    collisions: list[Collision]
    hover: Hover | None
    install: Install | None = None


class Row(NamedTuple):
    """One value of both robots."""

    name: str
    title: str
    unit: str
    values: tuple[float, float]
    notes: tuple[str, str]
    better: str  # "low", "high" or "" (neither)
    group: str

    @property
    def winner(self) -> int | None:
        """Index of the robot whose value is better by more than 2 %, else None."""
        a, b = self.values
        if not self.better or not (math.isfinite(a) and math.isfinite(b)):
            return None
        if abs(a - b) <= 0.02 * max(abs(a), abs(b)):
            return None
        return int((a > b) == (self.better == "low"))

    def write(self, i: int) -> str:
        """Format a robot's value without its unit; a missing value is a dash."""
        v = self.values[i]
        if math.isnan(v):
            return "–"
        if math.isinf(v):
            return "∞"
        if self.name.endswith("_share"):
            return f"{100.0 * v:.0f} %"
        if abs(v) < 1.0:
            return f"{round(v, 3) + 0.0:g}"
        return f"{v:.3g}" if abs(v) < 1000.0 else f"{v:.0f}"


class Statement(NamedTuple):
    """A trade-off of the paper's table 3 and whether the values support it."""

    about: str  # standard, long reach
    text: str
    verdict: str  # holds, partly, does not hold, not measured, does not apply
    why: str
    rows: tuple[str, ...]


class Comparison(NamedTuple):
    """Comparison of two robots."""

    sides: tuple[Side, Side]
    rows: list[Row]
    statements: list[Statement]
    world: str
    fixed: tuple[str, ...]
    seeds: int

    def to_json(self) -> dict[str, Any]:
        """Return the object of `--json`; missing numbers are null."""
        return {
            "robots": [s.name for s in self.sides],
            "world": self.world,
            "set": list(self.fixed),
            "rows": [
                {
                    "name": r.name, "title": r.title, "unit": r.unit, "group": r.group,
                    "better": r.better, "values": [_plain(v) for v in r.values],
                    "notes": list(r.notes),
                }
                for r in self.rows
            ],
            "statements": [{**s._asdict(), "rows": list(s.rows)} for s in self.statements],
            "maps": {s.name: _list_maps(s) for s in self.sides},
        }  # fmt: skip


def _plain(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def _list_maps(side: Side) -> dict[str, Any]:
    out: dict[str, Any] = {}
    if side.reach is not None:
        m = side.reach
        out["reach"] = {
            "ahead_m": m.x.round(6).tolist(), "up_m": m.z.round(6).tolist(),
            "reached": m.reached.tolist(), "pipe_radius_m": m.radius,
            "surface_angle_deg": np.degrees(m.angle).round(6).tolist(),
            "surface_touched": m.touched.tolist(),
        }  # fmt: skip
    if side.reaction is not None:
        t = side.reaction
        rows = [[[_plain(v) for v in cell] for cell in row] for row in t.torque]
        out["reaction"] = {
            "azimuth_deg": np.degrees(t.azimuth).round(6).tolist(),
            "elevation_deg": np.degrees(t.elevation).round(6).tolist(),
            "torque_per_force_m": rows, "force_n": t.force,
            "swing_deg": [[_plain(v) for v in row] for row in np.degrees(t.swing)],
        }  # fmt: skip
    if side.way is not None:
        w = side.way
        out["way"] = {
            "distance_m": w.distance.tolist(), "propellers_m": w.propellers.tolist(),
            "gear_m": w.gear.tolist(), "blocked_by": w.blocked_by or None,
        }  # fmt: skip
    if side.hover is not None:
        h = side.hover
        out["hover"] = {
            "wind_mps": h.wind.tolist(),
            "tip_rms_m": [[_plain(v) for v in row] for row in h.tip],
            "platform_rms_m": [[_plain(v) for v in row] for row in h.platform],
        }
    return out
