"""References generated tick by tick: streams of poses and velocities, and a pilot's stick.

A drive is stepped before each mission tick (20 ms) and returns two rows: the reference now and at
the end of the tick. Commands expire: a command older than its limit counts as "stay". Speeds and
accelerations stay within the limits of the back end.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import exp_so3, log_so3, rot_z
from skywright.core.types import TASK_JOINTS
from skywright.vehicle.arms_interface import find_led_joints
from skywright.vehicle.hand_stream import HandStream, Told
from skywright.vehicle.interface import Backend, Table, fill_tips
from skywright.vehicle.moves import (
    TILT_RATE,
    TURN_ACCELERATION,
    find_heading_rate,
    find_tilt,
    level,
)

Array = NDArray[np.float64]

TICK = 0.02  # s, of a mission tick
LEASH = 0.3  # m, largest distance of a reference from a robot that cannot follow
TURN_MAX = 0.8  # rad/s
APPROACH = 2.0  # 1/s, speed towards a pose per distance
CLIMB_ACCELERATION = 2.0  # m/s^2
DOWN_M, DOWN_S = 0.08, 0.3  # height above the reference (m) and time (s) of a touch-down
LIGHT = 0.9  # thrust over weight below which a robot at rest stands on the ground
ASKED = 0.03  # m/s, least commanded descent for a touch-down; speed of a robot at rest


class Stick(NamedTuple):
    """A pilot's stick: tilt of the platform, turn, and climb or thrust."""

    roll: float = 0.0  # rad, about x of B: positive moves to the right
    pitch: float = 0.0  # rad, about y of B: positive moves ahead
    yaw_rate: float = 0.0  # rad/s, counter-clockwise from above
    climb: float = 0.0  # m/s, used if `thrust` is None
    thrust: float | None = None  # thrust over weight, replaces `climb`


LET_GO = Stick()
"""A released stick: level, at the present height."""


class Drive:
    """Base class: a reference that starts at the present one and is updated each tick.

    A tilt of the present one changes to that of `lean` at TILT_RATE.
    """

    stale_s = 0.5

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        row = backend.reference
        self.p, self.v = np.array(row["p_WB"]), np.array(row["v_WB"])
        self.yaw = math.atan2(row["R_WB"][1, 0], row["R_WB"][0, 0])
        self.rate = find_heading_rate(row)
        self._tilt = find_tilt(row["R_WB"])
        self.heard = backend.t  # s, time of the last command
        self._held_up = 0.0  # s
        self._q: Array | None = None  # rad, reference of a stream of joint angles
        self._q_to: Array | None = None
        self._q_heard = 0.0
        self._hands = HandStream(backend)

    def adopt(self, other: Drive) -> None:
        """Continue with the joints and hands of another drive."""
        self._q, self._q_to, self._q_heard = other._q, other._q_to, other._q_heard
        self._hands = other._hands

    def tell_hand(self, hand: int, told: Told) -> None:
        """Set the reference of a hand; this ends a stream of joint angles."""
        self._q = self._q_to = None
        self._hands.tell(hand, told)

    def tell_joints(self, q: Array) -> None:
        """Move the joints to q (n_joints,) rad within their speed limit; if stale, hold them."""
        if self._q is None:
            self._q = find_led_joints(self.backend)
            self._hands = HandStream(self.backend)
        self._q_to, self._q_heard = q, self.backend.t

    def _step_joints(self, table: Table) -> None:
        """Fill the joints of two rows."""
        self._hands.fill(table)
        if self._q is None or self._q_to is None:
            return
        table["task"] = TASK_JOINTS
        n, most = self.backend.n_joints, self.backend.limits.joint_speed * TICK
        way = np.zeros(n)
        if self.backend.t - self._q_heard <= self.stale_s + 1e-9:
            way = np.clip(self._q_to - self._q[:n], -most, most)
        table["q"] = self._q
        self._q[:n] += way
        table["q"][1], table["qd"][:, :n] = self._q, way / TICK

    @property
    def age(self) -> float:
        """Time (s) since the last command."""
        return self.backend.t - self.heard

    @property
    def is_stale(self) -> bool:
        """Whether the last command has expired."""
        return self.age > self.stale_s + 1e-9

    @property
    def has_touched_down(self) -> bool:
        """Whether the robot was commanded to descend and has touched down."""
        return self._held_up >= DOWN_S - 1e-9

    def step(self) -> Table:
        """Return the references now and at the end of the tick, (2,) REFERENCE rows."""
        a, turn = self.lead(), self.turn()  # first: `lead` may set p and v to the estimate
        p, v, R = self.p.copy(), self.v.copy(), self.attitude()
        change = float(
            np.clip(turn - self.rate, -TURN_ACCELERATION * TICK, TURN_ACCELERATION * TICK)
        )
        self.rate += change
        self.yaw += self.rate * TICK
        self._tilt += np.clip(self.lean() - self._tilt, -TILT_RATE * TICK, TILT_RATE * TICK)
        self.p = p + TICK * v + 0.5 * TICK**2 * a
        self.v = v + TICK * a
        est = self.backend.estimate
        ahead = self.p - est["p_WB"]
        far = float(np.linalg.norm(ahead))
        if far > LEASH:
            self.p = est["p_WB"] + ahead * (LEASH / far)
        sinks = self.v[2] < -ASKED and est["v_WB"][2] > 0.3 * self.v[2]
        above = float(est["p_WB"][2] - self.p[2])
        self._held_up = self._held_up + TICK if sinks and above > DOWN_M else 0.0
        return self._build(p, v, a, R)

    def lead(self) -> Array:
        """Return the acceleration (3,) m/s^2 of this tick; p and v may be set first."""
        raise NotImplementedError

    def turn(self) -> float:
        """Return the commanded rate of the heading (rad/s)."""
        return 0.0

    def lean(self) -> Array:
        """Return the commanded tilt (3,) rad, a rotation vector in B; level by default."""
        return np.zeros(3)

    def attitude(self) -> Array:
        """Return the present attitude (3, 3) of the reference."""
        return tilt_heading(self.yaw, *self._tilt)

    def _cut(self, v: Array) -> Array:
        """Return the velocity v (3,) m/s, no faster than the limit of the vehicle."""
        size, limit = float(np.linalg.norm(v)), self.backend.limits.speed
        return v if size <= limit else v * (limit / size)

    def _towards(self, v: Array) -> Array:
        """Return the acceleration towards the velocity v, within the limit."""
        a = (v - self.v) / TICK
        size, limit = float(np.linalg.norm(a)), self.backend.limits.acceleration
        return a if size <= limit else a * (limit / size)

    def _build(self, p: Array, v: Array, a: Array, R: Array) -> Table:
        R_end, turned = self.attitude(), np.empty(3)
        log_so3(R.T @ R_end, turned)
        row = np.array(self.backend.reference)
        for name in ("t", "qd", "w_WB_B", "wd_WB_B", "track_tip", "dead_zone"):
            row[name] = 0.0
        row["R_WS"], row["active"] = np.eye(3), 1.0
        table = np.repeat(row[None], 2)
        table["t"][1] = TICK
        table["p_WB"], table["v_WB"] = [p, self.p], [v, self.v]
        table["a_WB"], table["w_WB_B"] = a, turned / TICK
        table["R_WB"] = [R, R_end]
        self._step_joints(table)
        fill_tips(self.backend, table)
        return table


class VelocityDrive(Drive):
    """Follows a velocity (m/s in W) and a rate of the heading (rad/s); if stale, it brakes.

    For robots with lateral thrust it also follows a tilt, which changes at TILT_RATE.
    """

    def __init__(self, backend: Backend) -> None:
        super().__init__(backend)
        self._v, self._rate = np.zeros(3), 0.0
        self._tilt_to = np.zeros(3)  # rad

    def tell(self, v: Array, yaw_rate: float, roll: float = 0.0, pitch: float = 0.0) -> None:
        """Set a new reference, clipped to the limits of the vehicle."""
        self._v, self.heard = self._cut(v), self.backend.t
        self._tilt_to = np.array([roll, pitch, 0.0])
        self._rate = float(np.clip(yaw_rate, -TURN_MAX, TURN_MAX))

    def lead(self) -> Array:
        """Accelerate towards the commanded velocity; if stale, brake."""
        return self._towards(np.zeros(3) if self.is_stale else self._v)

    def turn(self) -> float:
        """Return the commanded rate; zero if stale."""
        return 0.0 if self.is_stale else self._rate

    def lean(self) -> Array:
        """Return the commanded tilt; level if stale."""
        return np.zeros(3) if self.is_stale else self._tilt_to


class PoseDrive(Drive):
    """Follows positions (m in W) and headings (rad); if stale, it stays at the last one."""

    def __init__(self, backend: Backend) -> None:
        super().__init__(backend)
        self._p, self._yaw = self.p.copy(), self.yaw
        self._v, self._rate = np.zeros(3), 0.0

    def tell(self, p: Array, yaw: float, v: Array, yaw_rate: float) -> None:
        """Set a new reference, which moves at v (3,) m/s and `yaw_rate` (rad/s)."""
        self._p, self._yaw, self.heard = p, yaw, self.backend.t
        self._v, self._rate = self._cut(v), float(np.clip(yaw_rate, -TURN_MAX, TURN_MAX))

    def lead(self) -> Array:
        """Accelerate towards the pose, at a speed that allows braking at the goal."""
        way, limits = self._p - self.p, self.backend.limits
        v = np.zeros(3) if self.is_stale else self._v
        far = float(np.linalg.norm(way))
        if far < 1e-9:
            return self._towards(v)
        speed = min(limits.speed, APPROACH * far, math.sqrt(limits.acceleration * far))
        return self._towards(self._cut(v + way * (speed / far)))

    def turn(self) -> float:
        """Return the rate towards the heading, in the shorter direction."""
        off = (self._yaw - self.yaw + math.pi) % (2.0 * math.pi) - math.pi
        size = min(TURN_MAX, APPROACH * abs(off), math.sqrt(TURN_ACCELERATION * abs(off)))
        rate = math.copysign(size, off) + (0.0 if self.is_stale else self._rate)
        return min(max(rate, -TURN_MAX), TURN_MAX)


class StickDrive(Drive):
    """Attitude mode: the stick tilts the platform; its position is not controlled.

    Position and velocity of the reference follow the estimate, so that the position loops add
    nothing to the commanded acceleration g tan(tilt): laws of coplanar rotors tilt by this angle,
    laws of tilted ones take the attitude and the force. The loops' integrals (wind, trim) stay in
    effect.
    """

    def __init__(self, backend: Backend) -> None:
        super().__init__(backend)
        self.stick = LET_GO
        row, est = backend.reference, backend.estimate
        self.v[2] = 0.0 if row["active"] > 0.5 else est["v_WB"][2]
        self._gravity = float(backend.world.gravity_mps2)
        self._tilt_max = math.radians(backend.robot.control.tilt_max_deg)
        self._floor = float(est["p_WB"][2])  # m, height at the start of the drive
        self._flew, self._stands = False, 0.0

    def tell(self, stick: Stick) -> None:
        """Set the stick, its tilt clipped to the limit of the robot."""
        size = math.hypot(stick.roll, stick.pitch)
        cut = 1.0 if size <= self._tilt_max else self._tilt_max / size
        climb = float(np.clip(stick.climb, -self.backend.limits.speed, self.backend.limits.speed))
        self.stick = stick._replace(roll=cut * stick.roll, pitch=cut * stick.pitch, climb=climb)
        self.heard = self.backend.t

    @property
    def has_touched_down(self) -> bool:
        """As in Drive, or at rest with little thrust, after the robot has left the ground."""
        stands = self._stands >= DOWN_S - 1e-9 or super().has_touched_down
        return self._flew and stands

    def lead(self) -> Array:
        """Follow the estimate, and return the acceleration of the tilt."""
        stick = LET_GO if self.is_stale else self.stick
        est = self.backend.estimate
        self._flew = self._flew or float(est["p_WB"][2]) > self._floor + 0.15
        low = stick.thrust is not None and stick.thrust < LIGHT and abs(est["v_WB"][2]) < ASKED
        self._stands = self._stands + TICK if low else 0.0
        self.p[:2], self.v[:2] = est["p_WB"][:2], est["v_WB"][:2]
        z = self.attitude()[:, 2]
        a = self._gravity * z / z[2]
        if stick.thrust is None:
            change = (stick.climb - self.v[2]) / TICK
            a[2] = float(np.clip(change, -CLIMB_ACCELERATION, CLIMB_ACCELERATION))
        else:
            self.p[2], self.v[2] = est["p_WB"][2], est["v_WB"][2]
            a[2] = (stick.thrust - 1.0) * self._gravity
        return np.asarray(a)

    def turn(self) -> float:
        """Return the rate of the stick; zero if stale."""
        return 0.0 if self.is_stale else float(np.clip(self.stick.yaw_rate, -TURN_MAX, TURN_MAX))

    def attitude(self) -> Array:
        """Return the heading, then tilted by the stick; level if stale."""
        stick = LET_GO if self.is_stale else self.stick
        return tilt_heading(self.yaw, stick.roll, stick.pitch)


def tilt_heading(yaw: float, roll: float, pitch: float, twist: float = 0.0) -> Array:
    """Return the attitude (3, 3) of a heading, then turned about (roll, pitch, twist) (rad)."""
    R = np.empty((3, 3))
    exp_so3(np.array([roll, pitch, twist]), R)
    return np.asarray(rot_z(yaw) @ R)


def build_row_here(backend: Backend) -> Any:
    """Return a level REFERENCE row at the estimated position and velocity."""
    row, est = np.array(backend.reference), backend.estimate
    for name in ("t", "a_WB", "w_WB_B", "wd_WB_B", "qd", "track_tip", "dead_zone"):
        row[name] = 0.0
    row["p_WB"], row["v_WB"], row["R_WB"] = est["p_WB"], est["v_WB"], level(est["R_WB"])
    row["R_WS"], row["active"] = np.eye(3), 1.0
    return row
