"""What a mission may command over any back end: Uav, WholeBody, Probe (and arms_interface.Arms).

A back end (physics simulation here; kinematic animation and autopilots later) tracks tables of
REFERENCE rows and says which of the four it offers. The four classes turn commands into tables.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Record
from skywright.core.types import REFERENCE
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.rotors import RotorSet
from skywright.vehicle.link_arc import LinkArc, plan_landing, plan_take_off
from skywright.vehicle.rest_to_rest import ROW_PERIOD, build_straight, duration
from skywright.vehicle.ticker import StepFailed

Array = NDArray[np.float64]
Table = NDArray[Any]
R = TypeVar("R", bound=Record)


class Limits(NamedTuple):
    """What the commands may ask for."""

    speed: float  # m/s
    acceleration: float  # m/s^2
    joint_speed: float  # rad/s


class Ticked(NamedTuple):
    """What one mission tick reported."""

    t: float
    fired: int  # bits of vehicle.tick
    arrived: bool  # the tracked table has ended


class Backend(Protocol):
    """What the mission needs of a vehicle."""

    offers: frozenset[str]
    limits: Limits
    n_joints: int
    rotors: RotorSet  # as believed
    model: Any  # BodyModel of the robot as believed
    world: World
    arc: LinkArc | None  # of a link that lies on the ground at the start

    @property
    def t(self) -> float:
        """Mission time (s)."""

    @property
    def reference(self) -> Any:
        """The REFERENCE row that is tracked now."""

    @property
    def reference_now(self) -> Any:
        """The same, read field by field where it stands: `reference_now["p_WB"]`."""

    @property
    def estimate(self) -> Any:
        """The ESTIMATE now."""

    def read(self, record: type[R], name: str = "") -> R:
        """A copy of a record as it is now, such as `read(Hands).p_WH`.

        `name` is that of the component that fills it, where several do. Raises InputError where
        nothing in the vehicle fills it.
        """

    def look(self, record: type[R]) -> R:
        """A record itself, which is not to be written to; raises as `read` does."""

    @property
    def localised(self) -> bool:
        """Whether the estimate is one: false until the estimator has begun."""

    @property
    def fix_age(self) -> float:
        """Time (s) since the robot was last localised from outside."""

    @property
    def force(self) -> float:
        """Force (N) that the probe's sensor reads now; 0 without one."""

    @property
    def saturated(self) -> bool:
        """Whether the rotors could not make what was commanded at the last control tick."""

    @property
    def pose_std(self) -> float:
        """Standard deviation (m) of the platform's place as the estimator says; NaN unknown."""

    def track(self, table: Table) -> None:
        """Follow `table` from now on; its last row holds."""

    def tick(self, guards: int = 0) -> Ticked:
        """Run one mission tick (20 ms) or less when a guard in `guards` fires.

        Raises StepFailed where a step of the robot's computer does.
        """

    def in_contact(self) -> bool:
        """Whether the probe's instrument says contact."""

    def calibrate_probe(self, null: Array, axis: Array) -> None:
        """Judge contact by how far the signal is from `null` (2,), in units, along `axis` (2,)."""

    def push(self, body: str, f_W: Array) -> None:
        """Disturb a body of the robot with a force (3,) N (a simulation can)."""

    def move_bench(self, p_W: Array, yaw: float = 0.0) -> None:
        """Move the fixture that clamps the platform (a simulation of a world with a bench can)."""

    def give_up_rotor(self, i: int) -> bool:
        """Fly on without rotor `i` (from 0); False where the others cannot hold the robot."""

    def stop_computer(self, failed: StepFailed) -> None:
        """Run what failed no more, and command nothing from now on."""

    def release(self) -> None:
        """Let go a robot that is held in the air (a simulation of a world with a bench can)."""

    def survey(self, name: str) -> tuple[Array, Array]:
        """Where motion capture says that a tracked thing is, or "pipe": (p_WO, R_WO), a mean."""

    def zero_gauges(self) -> None:
        """Count the wrench on the platform from now on (a simulation of a world with pads can)."""

    def set_stick(self, stick: Array, button: bool) -> None:
        """Operator's input (3,), each from -1 to 1, and button that a recording notes from now."""

    def tip_of(self, row: Any) -> tuple[Array, Array]:
        """Nominal (p_WT, R_WT) of a row's platform pose and joints."""


def require(backend: Backend, needs: frozenset[str], mission: str) -> None:
    """Raise InputError when a back end does not offer what a mission needs."""
    missing = sorted(needs - backend.offers)
    if missing:
        raise InputError(
            f"mission {mission!r} requires {', '.join(missing)}; the vehicle offers "
            f"{', '.join(sorted(backend.offers)) or 'nothing'}"
        )


class Uav:
    """The platform: take off, go to, hold, land."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def _move(self, p: Array, yaw_change: float, least: float = 0.0) -> None:
        b, limits = self.backend, self.backend.limits
        start = np.array(b.reference)
        delta = np.asarray(p, dtype=float) - start["p_WB"]
        total = max(
            duration(float(np.linalg.norm(delta)), limits.speed, limits.acceleration),
            duration(abs(yaw_change), 0.8, 1.0),
            least,
        )
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
        fill_tips(b, table)
        b.track(table)

    def take_off(self, height: float) -> None:
        """Rise to `height` (m) above the ground: straight up, or first along the link's arc.

        Raises InputError for a height at which a swinging link would not hang free.
        """
        arc = self.arc
        if arc is None:
            p = self.backend.reference["p_WB"].copy()
            p[2] = height
            self._move(p, 0.0, least=2.0)
            return
        if height < arc.top:
            raise InputError(
                f"take-off to {height:g} m is too low: the link hangs freely only above "
                f"{arc.top:.2f} m"
            )
        self._follow_arc(arc, up=True, height=height)

    def go_to(self, p: Array, yaw: float) -> None:
        """Fly straight to p (3,) in W with heading `yaw` (rad), the short way round."""
        R = self.backend.reference["R_WB"]
        now = math.atan2(R[1, 0], R[0, 0])
        self._move(p, (yaw - now + math.pi) % (2 * math.pi) - math.pi)

    def hold(self) -> None:
        """Stay at the reference."""
        self._move(self.backend.reference["p_WB"].copy(), 0.0)

    def land(self, ground_height: float, here: bool = False) -> None:
        """Sink to the height of the platform's origin on the ground, a little into it.

        With a swinging link: forward, down until its end touches, then backward along its arc to
        where it began; `here` leaves the way forward out, where room there is not known.
        """
        if self.arc is not None:
            self._follow_arc(self.arc, up=False, height=0.0, here=here)
            return
        p = self.backend.reference["p_WB"].copy()
        p[2] = ground_height - 0.05
        distance = self.backend.reference["p_WB"][2] - p[2]
        self._move(p, 0.0, least=distance / 0.15)

    @property
    def arc(self) -> LinkArc | None:
        """The arc of a link that lies on the ground, None without one."""
        return self.backend.arc

    def _follow_arc(self, arc: LinkArc, up: bool, height: float, here: bool = False) -> None:
        """Track arc and vertical as one table; see `vehicle.link_arc`."""
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
        b.track(table)

    def motors(self, on: bool) -> None:
        """Switch the rotors on at the present reference, or off."""
        row = np.array(self.backend.reference)
        row["t"], row["active"] = 0.0, float(on)
        row["v_WB"] = row["a_WB"] = row["w_WB_B"] = row["wd_WB_B"] = row["qd"] = 0.0
        self.backend.track(row[None])


class WholeBody:
    """Platform and arm together: track a tip and posture reference."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def track(self, table: Table) -> None:
        """Follow a plan segment (rows of REFERENCE, own time from 0)."""
        if table.dtype != REFERENCE or table.ndim != 1 or len(table) == 0:
            raise InputError(f"a plan segment is a 1-D array of REFERENCE rows, got {table.dtype}")
        self.backend.track(table)

    def hold(self) -> None:
        """Stay at the reference, tip loop and dead zone unchanged."""
        row = np.array(self.backend.reference)
        row["t"] = 0.0
        for field in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT"):
            row[field] = 0.0
        self.backend.track(row[None])


class Probe:
    """The probe's state as its instrument reports it."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def in_contact(self) -> bool:
        """Whether the lift-off signal is under its threshold."""
        return self.backend.in_contact()

    def calibrate(self, contact: complex, axis: complex) -> None:
        """Judge contact from now on by the signal in `contact` and its `axis` towards air."""
        self.backend.calibrate_probe(
            np.array([contact.real, contact.imag]), np.array([axis.real, axis.imag])
        )


def fill_tips(backend: Backend, table: Table) -> None:
    """Fill the nominal tip poses of a generated table, differentiated for the velocity."""
    for row in table:
        row["p_WT"], row["R_WT"] = backend.tip_of(row)
    table["v_WT"] = 0.0
    if len(table) > 1:
        table["v_WT"] = np.gradient(table["p_WT"], ROW_PERIOD, axis=0)
