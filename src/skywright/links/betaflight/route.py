"""The route of a flight under Betaflight: take-off, the planned waypoints, landing."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InfeasibleError, InputError
from skywright.links.betaflight.outer_loop import Target
from skywright.run.planning import plan_mission
from skywright.run.setup import Setup
from skywright.vehicle.rest_to_rest import ROW_PERIOD, duration, quintic

Array = NDArray[np.float64]

CLIMB, CLIMB_ACCELERATION = 0.5, 0.5  # m/s and m/s^2, of take-off
SINK = 0.25  # m/s, of landing
SETTLE_S = 5.0  # s of hover after take-off
BELOW_M = 0.3  # m below the start: end of the landing reference


class Leg(NamedTuple):
    """A part of a route; n rows."""

    name: str
    t: Array  # (n,) s, from 0
    p: Array  # (n, 3) m
    v: Array
    a: Array
    yaw: Array  # (n,) rad
    yaw_rate: Array


class Route:
    """Legs in order; the last one is the landing."""

    def __init__(self, legs: list[Leg]) -> None:
        self.legs = legs
        self._starts = np.concatenate([[0.0], np.cumsum([leg.t[-1] for leg in legs])])

    @property
    def duration(self) -> float:
        """Time (s) of all legs."""
        return float(self._starts[-1])

    def find_leg(self, t: float) -> int:
        """Return the index of the leg at `t` (s)."""
        return min(int(np.searchsorted(self._starts, t, "right")) - 1, len(self.legs) - 1)

    def read(self, t: float) -> Target:
        """Return the target at `t` (s) after the start; after the end, the last row."""
        i = self.find_leg(t)
        leg, at = self.legs[i], t - self._starts[i]
        k = min(int(np.searchsorted(leg.t, at, "right")) - 1, len(leg.t) - 1)
        n = min(k + 1, len(leg.t) - 1)
        step = leg.t[n] - leg.t[k]
        u = 0.0 if step <= 0.0 else min((at - leg.t[k]) / step, 1.0)

        def mix(x: Array) -> Any:
            return (1.0 - u) * x[k] + u * x[n]

        turn = math.remainder(float(leg.yaw[n] - leg.yaw[k]), 2.0 * math.pi)
        return Target(
            mix(leg.p), mix(leg.v), mix(leg.a), float(leg.yaw[k]) + u * turn,
            float(mix(leg.yaw_rate)),
        )  # fmt: skip


def build_rest(name: str, p: Array, yaw: float, seconds: float) -> Leg:
    """Hold a pose."""
    return _build(name, np.array([0.0, seconds]), np.repeat(p[None], 2, axis=0), yaw)


def build_line(name: str, start: Array, end: Array, yaw: float, speed: float, a: float) -> Leg:
    """Move straight from rest to rest within a speed (m/s) and an acceleration (m/s^2)."""
    way = end - start
    total = duration(float(np.linalg.norm(way)), speed, a)
    t = np.linspace(0.0, total, max(math.ceil(total / ROW_PERIOD), 1) + 1)
    s, ds, dds = quintic(t / total)
    leg = _build(name, t, start + s[:, None] * way, yaw)
    v, acceleration = ds[:, None] * way / total, dds[:, None] * way / total**2
    return leg._replace(v=v, a=acceleration)


def _build(name: str, t: Array, p: Array, yaw: float) -> Leg:
    zeros = np.zeros_like(p)
    return Leg(name, t, p, zeros, zeros, np.full(len(t), yaw), np.zeros(len(t)))


def plan_route(setup: Setup[Any], start: Array) -> Route:
    """Take off from `start` (3,) m, fly the mission's waypoints, land.

    Raises InputError for a mission of another kind, InfeasibleError if there is no plan.
    """
    mission = setup.description.mission
    if mission.kind != "waypoints":
        raise InputError(
            f"mission {mission.name!r} is of the kind {mission.kind!r}; Betaflight has no lateral "
            "axis and no position loop: it flies missions of the kind 'waypoints'"
        )
    plan = plan_mission(setup.description, setup)
    if not plan.feasible:
        raise InfeasibleError(f"no plan: {plan.blocked_by}", str(plan.blocked_by))
    hover, yaw = setup.hover[:3], float(setup.hover[3])
    legs = [
        build_line("take-off", start, hover, yaw, CLIMB, CLIMB_ACCELERATION),
        build_rest("hover", hover, yaw, SETTLE_S),
    ]
    for name, rows in plan.segments.items():
        R = rows["R_WB"]
        legs.append(
            Leg(
                name,
                np.array(rows["t"]),
                np.array(rows["p_WB"]),
                np.array(rows["v_WB"]),
                np.array(rows["a_WB"]),
                np.arctan2(R[:, 1, 0], R[:, 0, 0]),
                np.array(rows["w_WB_B"])[:, 2],
            )
        )  # fmt: skip
    return add_landing(Route(legs), float(start[2]))


def add_landing(route: Route, ground: float) -> Route:
    """Return the route with a landing to below the height `ground` (m) of the start."""
    last = route.legs[-1]
    down = np.array([last.p[-1, 0], last.p[-1, 1], ground - BELOW_M])
    way = float(last.p[-1, 2] - down[2])
    t = np.array([0.0, way / SINK])
    land = _build("land", t, np.array([last.p[-1], down]), float(last.yaw[-1]))
    return Route([*route.legs, land._replace(v=np.tile([0.0, 0.0, -SINK], (2, 1)))])
