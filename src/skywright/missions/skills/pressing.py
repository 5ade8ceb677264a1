"""Touch with the probe, hold each force of a profile, measure and release."""

import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from skywright.core.arrays import Array, Table
from skywright.core.find import find, list_kinds
from skywright.description.mission.spec import Mission
from skywright.description.robot.limbs import list_limbs, list_way, takes_torque
from skywright.description.robot.spec import Robot
from skywright.description.world.structure import Structure, build_surface, find_place
from skywright.errors import InputError
from skywright.missions.skills.moves import build_move, set_rest
from skywright.models.rigid_body import find_tip
from skywright.run.records import Measurement
from skywright.run.supervisor import Supervisor
from skywright.vehicle.rest_to_rest import ROW_PERIOD

TIP_GAP = 0.008  # m, distance of the tip from the surface before the force loop takes over
GO_SPEED = 0.6  # m/s, of the platform on its way
TOUCH_S = 1.5  # s, typical time from the start of a touch to its contact
TOUCH_TIMEOUT_S = 15.0
FELT = 0.5  # fraction of the first force that counts as contact
STOP_NEAR = math.radians(1.0)  # distance of a joint from its stop: two errors of an encoder's zero
FORCE_OFF = 1.0  # N; a press in flight at a stop may be off by this or half its force
OFF_S = 1.0  # s, for which it may be off: three time constants of the force loop
SATURATED_S = 0.1  # s, if the rotors are at their limits as well
SERVO_LAG_S = 0.08  # s, two time constants of velocity servos
LAGS = 3.0  # lags for which the load of the feet continues to follow
RETREAT = 0.15  # m, away from the surface along the probe


class ArmStopped(Exception):
    """An arm at its joint stop no longer controls the force."""


class Profile(Protocol):
    """Durations of each force of a profile."""

    ramp_s: float
    settle_s: float
    hold_s: float


def check_can_press(robot: Robot, mission: Mission) -> None:
    """Raise InputError if the robot or the law cannot control the force of a probe with the arm.

    A press holds the platform (in flight, on its feet, on the bench) and sets a force in the block
    Press; no row of the reference lies inside the surface. A law that presses with the platform, by
    a tip reference behind the surface, would exert no force; nor would a tip that no driven joint
    moves.
    """
    missing = [
        f"[robot.{name}]" for name in ("probe", "force_sensor") if getattr(robot, name) is None
    ]
    if missing:
        raise InputError(
            f"robot {robot.name!r} has no force sensor in the slider of a probe: add "
            f"{' and '.join(missing)} (a sensor in [robot.sensors] does not replace it)"
        )
    limbs = list_limbs(robot)
    tip = find_tip(robot, limbs)
    if not any(limbs[i].servo >= 0 for i in list_way(limbs, tip)):
        raise InputError(
            f"robot {robot.name!r} carries its probe on {limbs[tip].name!r}, which no driven joint "
            f"moves: mission {mission.name!r} presses with the arm, so a link between the platform "
            "and the probe must have joint = 'hinge' or 'slide' and a servo"
        )
    law = mission.law.kind if mission.law is not None else robot.control.law
    if law is None or not find("law", law).cls.presses_with_arm:
        laws = {name: find("law", name).cls for name in list_kinds("law")}
        torque = takes_torque(robot)
        fit = [k for k, c in laws.items() if c.presses_with_arm and c.commands_torque == torque]
        raise InputError(
            f"mission {mission.name!r} presses with the arm while the platform keeps its place: "
            "it requires a law that controls the measured force with the joints of the arm; "
            f"mission.law is {law!r}, whose arm follows joint angles; valid: {', '.join(fit)}"
        )


class Presser:
    """Moves of platform, arm and force; each starts at the present reference."""

    def __init__(self, supervisor: Supervisor, profile: Profile) -> None:
        self.s, self.profile = supervisor, profile
        vehicle = supervisor.vehicle
        self.model, self.n = vehicle.model, vehicle.n_joints
        assert vehicle.world.structure is not None
        self.structure: Structure = vehicle.world.structure
        self._stopped = math.inf  # s, mission time since which an arm at its stop has no control

    def go(
        self, phase: str | None, *, p: Array | None = None, R: Array | None = None,
        q: Array | None = None, speed: float = GO_SPEED, least: float = 0.0, lag: float = 0.0,
        **fields: Any,
    ) -> None:  # fmt: skip
        """Move to a pose, change other fields of the reference, and wait for the end of the move.

        The load of the feet follows with a first-order `lag` (s).
        """
        start = set_rest(self.s.vehicle.reference)
        end = np.array(start)
        if p is not None:
            end["p_WB"] = p
        if R is not None:
            end["R_WB"] = R
        if q is not None:
            end["q"][: self.n] = q
        for name, value in fields.items():
            end[name] = value
        table = build_move(self.model, self.n, start, end, speed=speed, least=least)
        if lag > 0.0:
            table = lag_feet(table, lag)
        if phase is not None:
            self.s.begin(phase)
        self.s.body.track(table)
        self.s.until_arrived()

    def press(
        self,
        spot: str,
        how: str,
        forces: list[float],
        prefix: str,
        load: Callable[[float], dict[str, Any]] | None = None,
        then: Callable[[], None] | None = None,
    ) -> str:
        """Touch, hold each force, call `then`, release; returns the reason of a failure, or "".

        `load` returns the fields of the reference that belong to a force (load of the docking
        feet). In flight the robot retreats from the surface if the arm reaches a stop.
        """
        s = self.s
        reason = self._touch(spot, forces[0], prefix, load)
        s.watch = self._watch_stops if how == "flying" else None
        try:
            for force in forces if not reason else ():
                self.set_force(f"{prefix}press to {force:g} N", force, self.profile.ramp_s, load)
                s.wait(self.profile.settle_s)
                s.begin(f"{prefix}hold {force:g} N")
                self.measure_force(spot, force, how)
            if not reason and then is not None:
                then()
        except ArmStopped as stopped:
            s.watch = None
            self._retreat(prefix)
            return f"{spot}: {stopped}"
        finally:
            s.watch, self._stopped = None, math.inf
        self.set_force(f"{prefix}release", 0.0, self.profile.ramp_s, load)
        self.go(None, press=0.0)
        return reason

    def _touch(
        self, spot: str, force: float, prefix: str, load: Callable[[float], dict[str, Any]] | None
    ) -> str:
        """Move the tip until it measures half of the force (N); returns why it failed, or "".

        In flight, an arm at its stop waits until the platform has followed.
        """
        s = self.s
        self.set_force(f"{prefix}touch", force, 0.02, load)
        end = s.vehicle.t + TOUCH_TIMEOUT_S
        while s.vehicle.force < FELT * force:
            s.tick()
            if s.vehicle.t > end:
                return f"{spot}: the tip measured no contact within {TOUCH_TIMEOUT_S:g} s"
        return ""

    def _watch_stops(self) -> None:
        """Raise ArmStopped if a joint is at its stop and the force is off or the rotors saturate.

        If the rotors are at their limits as well, nothing controls the press: it is aborted at
        once.
        """
        vehicle, body = self.s.vehicle, self.model[0]
        q, n = vehicle.estimate["q"], self.n
        rooms = np.minimum(q[:n] - body["q_min"][:n], body["q_max"][:n] - q[:n])
        asked = float(vehicle.reference["force"])
        off = abs(vehicle.force - asked) > max(FORCE_OFF, 0.5 * asked)
        if np.min(rooms) > STOP_NEAR or not (off or vehicle.saturated):
            self._stopped = math.inf
            return
        self._stopped = min(self._stopped, vehicle.t)
        if vehicle.t - self._stopped >= (SATURATED_S if vehicle.saturated else OFF_S):
            raise ArmStopped(
                f"the press was aborted at t = {vehicle.t:.1f} s: joint "
                f"{int(np.argmin(rooms)) + 1} of the arm is at its "
                f"stop{(' and the rotors are at their limits' if vehicle.saturated else '')}, "
                f"the tip presses with {vehicle.force:.1f} N instead of {asked:.1f} N"
            )

    def _retreat(self, prefix: str) -> None:
        """Retreat along the probe with the arm's present posture: its own path back may be blocked.

        Joints leave their stops first. A servo commanded to stay at a stop may push against it, by
        the error of its encoder's zero, with its stall torque.
        """
        vehicle, row = self.s.vehicle, set_rest(self.s.vehicle.reference)
        away = np.array(row["p_WB"]) - RETREAT * vehicle.estimate["R_WT"][:, 2]
        # the force moved the arm away from the reference's joints: begin at the estimate
        body, q = self.model[0], vehicle.estimate["q"][: self.n]
        low, high = body["q_min"][: self.n] + STOP_NEAR, body["q_max"][: self.n] - STOP_NEAR
        row["q"][: self.n] = np.clip(q, low, high)
        self.s.body.track(row[None])
        self.go(f"{prefix}retreat", p=away, speed=0.4, press=0.0, force=0.0)

    def set_force(
        self, phase: str, force: float, seconds: float,
        load: Callable[[float], dict[str, Any]] | None = None,
    ) -> None:  # fmt: skip
        """Ramp the force to a value (N) in `seconds`.

        The force loop responds with a lag. If the load of the feet led the press, the rotors would
        have to supply the difference: 3 N and 0.4 N m when 7 N are released in 1.5 s.
        """
        fields, lag = {} if load is None else load(force), 0.0
        if load is not None and seconds > 0.1:
            lag = compute_feet_lag(self.s.vehicle.robot)
        self.go(phase, least=seconds, lag=lag, press=1.0, force=force, **fields)

    def measure_force(self, spot: str, force: float, how: str) -> None:
        """Hold the force and report its measurement."""
        s = self.s
        start, read, tips = s.vehicle.t, [], []
        for _ in s.orders.passes(self.profile.hold_s):
            read.append(s.vehicle.force)
            tips.append(np.array(s.vehicle.estimate["p_WT"]))
        tip = np.mean(tips, axis=0)
        x, y, off = (float(v) for v in find_place(build_surface(self.structure), tip))
        s.report(
            Measurement(
                spot=spot, how=how, x_m=x, y_m=y, off_m=off,
                p_W=(float(tip[0]), float(tip[1]), float(tip[2])), start_s=start,
                end_s=s.vehicle.t, force_des_n=force, force_n=float(np.mean(read)),
                force_std_n=float(np.std(read)), pose_std_m=s.vehicle.pose_std,
                wander_m=float(np.max(np.linalg.norm(np.array(tips) - tip, axis=1))),
            )
        )  # fmt: skip


def compute_feet_lag(robot: Robot) -> float:
    """Return the lag (s) with which the load of the feet follows the press."""
    return 1.0 / robot.control.arm_bandwidth_rad_s + SERVO_LAG_S


def compute_press_s(profile: Profile, forces: int, hold: float, lag: float = 0.0) -> float:
    """Return the duration (s) of `Presser.press`, with measurements of `hold` (s) each.

    `lag` (s) is that of the feet, 0 in flight.
    """
    ramp = profile.ramp_s + LAGS * lag
    return TOUCH_S + forces * (ramp + profile.settle_s + hold) + ramp


def lag_feet(table: Table, lag: float) -> Table:
    """Return a table of the reference whose load of the feet follows with a first-order lag (s)."""
    more = math.ceil(LAGS * lag / ROW_PERIOD)
    out = np.concatenate([table, np.repeat(table[-1:], more)])
    out["t"][len(table) :] = table["t"][-1] + ROW_PERIOD * np.arange(1, more + 1)
    for name in ("f_feet_B", "t_feet_B"):
        asked, now = np.array(out[name]), np.array(out[name][0])
        for i, step in enumerate(np.diff(out["t"], prepend=0.0)):
            now = now + (1.0 - math.exp(-step / lag)) * (asked[i] - now)
            out[name][i] = now
        out[name][-1] = asked[-1]
    return out
