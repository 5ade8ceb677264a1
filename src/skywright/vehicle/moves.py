"""Motions of the platform as tables of references: take off, go to, hold, land.

Missions, scripts and operators fly the same tables: missions call these functions, and
`vehicle.uav.Uav` adds states, refusals and arrival.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import exp_so3, log_so3, rot_z
from skywright.errors import InputError
from skywright.vehicle.interface import Backend, Limits, fill_tips
from skywright.vehicle.link_arc import LinkArc, plan_landing, plan_take_off
from skywright.vehicle.rest_to_rest import ROW_PERIOD, build_straight, duration

Array = NDArray[np.float64]

TURN_SPEED, TURN_ACCELERATION = 0.8, 1.0
"""rad/s, rad/s^2, of the heading."""
TILT_RATE = 0.3
"""rad/s, of a tilt in place."""
LEVEL_S = 1.0
"""s, longest time in which a motion ends a tilt, which the rotors might not hold."""
CLIMB_S = 2.0
"""s, least duration of a take-off."""
DESCENT_SPEED = 0.15
"""m/s, mean speed of a landing."""
PRESS = 0.05
"""m, goal of a landing below the ground."""


class Brake:
    """Braking of an interrupted motion: velocity and tilt decrease to zero during the new one."""

    def __init__(self, start: Any, acceleration: float) -> None:
        """`start` is the present REFERENCE row; `acceleration` in m/s^2."""
        self.v, self.rate = np.array(start["v_WB"]), find_heading_rate(start)
        self.tilt = find_tilt(start["R_WB"])
        self.t = float(np.linalg.norm(self.v)) / acceleration  # s
        self.t_turn = abs(self.rate) / TURN_ACCELERATION
        self.way, self.turn = 0.5 * self.v * self.t, 0.5 * self.rate * self.t_turn  # m, rad
        self.t_tilt = min(float(np.linalg.norm(self.tilt)) / TILT_RATE, LEVEL_S)
        self.seconds = max(self.t, self.t_turn, self.t_tilt)

    def add(self, table: NDArray[Any]) -> None:
        """Add the braking to the rows of the following motion, which begins at rest."""
        way, v, a = _slow_down(table["t"], self.t)
        table["p_WB"] += way[:, None] * self.v
        table["v_WB"] += v[:, None] * self.v
        table["a_WB"] += a[:, None] * self.v
        angle, rate, change = _slow_down(table["t"], self.t_turn)
        for row, turned in zip(table, angle * self.rate, strict=True):
            row["R_WB"] = rot_z(float(turned)) @ row["R_WB"]
        table["w_WB_B"][:, 2] += rate * self.rate
        table["wd_WB_B"][:, 2] += change * self.rate
        if self.t_tilt > 1e-6:
            self._add_tilt(table)

    def _add_tilt(self, table: NDArray[Any]) -> None:
        E = np.empty((3, 3))
        for row, left in zip(table, np.maximum(1.0 - table["t"] / self.t_tilt, 0.0), strict=True):
            exp_so3(left * self.tilt, E)
            row["R_WB"] = row["R_WB"] @ E
            for name in ("w_WB_B", "wd_WB_B"):  # given along the vertical
                row[name] = E.T @ row[name]
            if left > 0.0:
                row["w_WB_B"] -= self.tilt / self.t_tilt


def _slow_down(t: Array, total: float) -> tuple[Array, Array, Array]:
    """Return distance, speed and acceleration of a braking from 1 m/s to rest in `total` s."""
    if total <= 0.0:
        return np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    u = np.minimum(t, total)
    return u - 0.5 * u**2 / total, 1.0 - u / total, np.where(t < total, -1.0 / total, 0.0)


def level(R: Array) -> Array:
    """Return the level attitude (3, 3) with the heading of R."""
    return rot_z(math.atan2(R[1, 0], R[0, 0]))


def find_tilt(R: Array) -> Array:
    """Return the rotation vector (3,) rad from the level attitude to R; it is nearly horizontal."""
    tilt = np.empty(3)
    log_so3(level(R).T @ R, tilt)
    return tilt


def find_heading_rate(row: Any) -> float:
    """Return the rate (rad/s) about the vertical of a REFERENCE row, which may be tilted."""
    return float((row["R_WB"] @ row["w_WB_B"])[2])


def compute_move_s(distance: float, turn: float, limits: Limits, least: float = 0.0) -> float:
    """Return the duration (s) of a motion by `distance` (m) and `turn` (rad), at least `least`."""
    return max(
        duration(abs(distance), limits.speed, limits.acceleration),
        duration(abs(turn), TURN_SPEED, TURN_ACCELERATION),
        least,
    )


def compute_take_off_s(climb: float, height: float, limits: Limits, arc: LinkArc | None) -> float:
    """Return the duration (s) of `Moves.take_off` by `climb` (m), to `height` (m)."""
    if arc is None:
        return compute_move_s(climb, 0.0, limits, CLIMB_S)
    path = plan_take_off(arc, height, limits.speed, limits.acceleration, ROW_PERIOD)
    return ROW_PERIOD * (len(path.forward) - 1)


def compute_landing_s(climb: float, height: float, limits: Limits, arc: LinkArc | None) -> float:
    """Return the duration (s) of `Moves.land` from `height` (m), `climb` (m) above the ground."""
    if arc is None:
        distance = climb + PRESS
        return compute_move_s(distance, 0.0, limits, distance / DESCENT_SPEED)
    path = plan_landing(arc, height, limits.speed, limits.acceleration, ROW_PERIOD)
    return ROW_PERIOD * (len(path.forward) - 1)


class Moves:
    """Motions of the platform; each starts at the present reference."""

    def __init__(self, backend: Backend, blend: bool = False) -> None:
        """`blend`: a motion that interrupts another one starts at its velocity and brakes it."""
        self.backend, self.blend = backend, blend
        self.goal: Any = None
        """The last row of the last motion."""
        self.ends = 0.0
        """Mission time (s) at which the reference of the last motion ends."""

    def _move(self, p: Array, yaw_change: float, least: float = 0.0) -> None:
        b, limits = self.backend, self.backend.limits
        start = np.array(b.reference)
        delta = np.asarray(p, dtype=float) - start["p_WB"]
        brake = Brake(start, limits.acceleration) if self.blend else None
        if brake is not None:
            start["R_WB"] = level(start["R_WB"])
            delta, yaw_change = delta - brake.way, yaw_change - brake.turn
            least = max(least, brake.seconds)
        total = compute_move_s(float(np.linalg.norm(delta)), yaw_change, limits, least)
        table, _, s, ds, dds = build_straight(start, start, delta, total)
        yaw = s * yaw_change
        c, sn, z, o = np.cos(yaw), np.sin(yaw), np.zeros(len(s)), np.ones(len(s))
        turn = np.stack([c, -sn, z, sn, c, z, z, z, o], axis=1).reshape(-1, 3, 3)
        table["R_WB"] = turn @ start["R_WB"]
        table["w_WB_B"] = 0.0
        table["wd_WB_B"] = 0.0
        table["w_WB_B"][:, 2] = ds * yaw_change
        table["wd_WB_B"][:, 2] = dds * yaw_change
        table["qd"] = 0.0
        table["track_tip"] = 0.0
        table["dead_zone"] = 0.0
        table["R_WS"] = np.eye(3)
        table["active"] = 1.0
        if brake is not None:
            brake.add(table)
        fill_tips(b, table)
        self._track(table)

    def take_off(self, height: float) -> None:
        """Climb to `height` (m) above the ground: straight up, or first along the link's arc.

        Raises InputError for a height at which a swinging link would not hang freely.
        """
        arc = self.arc
        if arc is None:
            p = self.backend.reference["p_WB"].copy()
            p[2] = height
            self._move(p, 0.0, least=CLIMB_S)
            return
        if height < arc.top:
            raise InputError(
                f"take-off to {height:g} m is too low: the link hangs freely only above "
                f"{arc.top:.2f} m"
            )
        self._follow_arc(arc, up=True, height=height)

    def go_to(self, p: Array, yaw: float) -> None:
        """Fly straight to p (3,) in W and turn to heading `yaw` (rad) in the shorter direction."""
        R = self.backend.reference["R_WB"]
        now = math.atan2(R[1, 0], R[0, 0])
        self._move(p, (yaw - now + math.pi) % (2 * math.pi) - math.pi)

    def hold(self) -> None:
        """Stop at the reference."""
        self._move(self.backend.reference["p_WB"].copy(), 0.0)

    def land(self, ground_height: float, here: bool = False) -> None:
        """Descend to the height of the platform's origin on the ground, and slightly below.

        With a swinging link: forward, down until its end touches the ground, then backward along
        its arc to the start. `here` omits the forward motion if the space ahead has not been
        checked.
        """
        if self.arc is not None:
            self._follow_arc(self.arc, up=False, height=0.0, here=here)
            return
        p = self.backend.reference["p_WB"].copy()
        p[2] = ground_height - PRESS
        distance = self.backend.reference["p_WB"][2] - p[2]
        self._move(p, 0.0, least=distance / DESCENT_SPEED)

    @property
    def arc(self) -> LinkArc | None:
        """Arc of a swinging link, None for a robot without one."""
        return self.backend.arc

    def _follow_arc(self, arc: LinkArc, up: bool, height: float, here: bool = False) -> None:
        """Track arc and vertical motion as one table; see `vehicle.link_arc`."""
        b, limits = self.backend, self.backend.limits
        start = np.array(b.reference)
        speed, acceleration = limits.speed, limits.acceleration
        path = plan_take_off(arc, height, speed, acceleration, ROW_PERIOD) if up else plan_landing(
            arc, float(start["p_WB"][2]), speed, acceleration, ROW_PERIOD, here
        )  # fmt: skip
        ahead = start["R_WB"][:2, 0] / np.linalg.norm(start["R_WB"][:2, 0])
        table = np.repeat(start[None], len(path.forward), axis=0)
        table["t"] = ROW_PERIOD * np.arange(len(table))
        for name in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd"):
            table[name] = 0.0
        table["p_WB"][:, :2] += (path.forward - path.forward[0])[:, None] * ahead
        table["p_WB"][:, 2] = path.height
        table["q"][:, arc.swing] = path.swing
        for position, velocity in (("p_WB", "v_WB"), ("v_WB", "a_WB")):
            table[velocity] = np.gradient(table[position], ROW_PERIOD, axis=0)
        table["qd"][:, arc.swing] = np.gradient(path.swing, ROW_PERIOD)
        table["track_tip"], table["dead_zone"] = 0.0, 0.0
        table["R_WS"], table["active"] = np.eye(3), 1.0
        fill_tips(b, table)
        self._track(table)

    def _track(self, table: NDArray[Any]) -> None:
        self.goal, self.ends = table[-1], self.backend.t + float(table[-1]["t"])
        self.backend.track(table)

    def motors(self, on: bool) -> None:
        """Switch the rotors on at the present reference, or off."""
        row = np.array(self.backend.reference)
        row["t"], row["active"] = 0.0, float(on)
        row["v_WB"] = row["a_WB"] = row["w_WB_B"] = row["wd_WB_B"] = row["qd"] = 0.0
        self._track(row[None])
