"""Control of a MAVLink vehicle's platform by set-points: common code of these back ends.

At each mission tick (20 ms) the references of the mission become a set-point, and the estimate is
the autopilot's. Mission time or the reference pauses while the motors start and stop, and while the
link is silent; the set-point is then the position of the reference, at rest.

W is aligned with the vehicle's local frame at the start, while the vehicle stands on the ground. In
x and y, GPS_GLOBAL_ORIGIN is used if the world has an origin; otherwise, and always in z, the robot
is at the mission's start. An altitude is no reference for z: that of GPS_GLOBAL_ORIGIN is above sea
level, that of the world above the ellipsoid, and satellites measure it to a few metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError
from skywright.links.mavlink import modes
from skywright.links.mavlink.body_force import BodyForce
from skywright.links.mavlink.frames import move_point
from skywright.links.mavlink.heard import PX4, Heard
from skywright.links.mavlink.link import Target, VehicleLink
from skywright.links.mavlink.orders import arm, choose_mode, land_and_disarm
from skywright.links.px4.parameters import build_airframe
from skywright.models.vectors import compute_cross
from skywright.vehicle.ended import VehicleEnded
from skywright.vehicle.geodesy import Geodetic, to_local
from skywright.vehicle.interface import Ticked
from skywright.vehicle.simulated import SimulatedVehicle

Array = NDArray[np.float64]

CONNECT_S = 30.0  # s, time limit for the first message of a vehicle, and for its position
SILENT_S = 1.0  # s without a message after which mission time pauses
BEAT_S = 3.0  # s without a heartbeat, likewise
DEAF_S = 0.4  # s without an answer after which a change to Hold is attributed to the autopilot
LOST_S = 10.0  # s after which the flight is aborted
OWN_S = 2.0  # s after a silence, likewise
LAND_S = 60.0  # s, time limit for landing
LOW = 0.1  # m above the ground: a reference that ends below is tracked by position only
LIFT, LIFT_S = 0.25, 15.0
"""m, height of the autopilot's lift-off before the reference continues, and its time limit (s)."""
APART = 5.0  # m, largest distance between the vehicle and the mission's start


class Offboard(SimulatedVehicle):
    """A back end (vehicle.interface.Backend) with a platform that a MAVLink vehicle flies."""

    def __init__(self, link: VehicleLink, *args: Any, **kwargs: Any) -> None:
        """Take a link and the arguments of the other base class; call `_meet` afterwards."""
        self.link, self.clock = link, link.clock
        super().__init__(*args, **kwargs)
        self.piloted = False
        """Whether a pilot flies: the mode is not Offboard, and this program did not change it."""
        self.stopped = ""
        """Why the motors are off although the mission has not stopped them, or ""."""
        self._says: Callable[[str], None] = lambda _: None
        self._armed = self._offboard = False
        self._shift, self._p_BC = np.zeros(3), np.zeros(3)
        self._quiet_until = -math.inf
        self._restarts = 0
        self._floor = self.robot.platform.gear_height_m
        self._force: BodyForce | None = None
        self._due = 0.0
        self._low_z: float | None = None
        """m, in the vehicle's frame: lowest set-point in the air, except for landing."""
        self._again_s = 0.0
        """s for which a refused start is repeated: an autopilot refuses while it boots."""

    # --- connection to the vehicle -------------------------------------------------------------

    def _meet(self, force: bool) -> None:
        """Wait for a vehicle and its position, and align its frame with W.

        With `force` body forces are sent instead of positions. Raises InputError if no vehicle is
        found, or if it cannot fly this robot.
        """
        link, url = self.link, self.link.endpoint.url
        if not link.wait(lambda h: h.system and link.age(h.beat) < 2.0, CONNECT_S):
            others = ", ".join(
                f"MAV_AUTOPILOT {autopilot} (system {system}, component {component})"
                for (system, component), autopilot in link.heard.others.items()
            )
            what = "PX4" if others else "MAVLink vehicle"
            heard = f"; heard: {others}; valid: MAV_AUTOPILOT {PX4} (PX4)" if others else ""
            raise InputError(
                f"no {what} was heard on {url} within {CONNECT_S:g} s{heard}{self._explain()}"
            )
        placed = link.wait(lambda h: self._is_placed(h) and h.flags is not None, CONNECT_S)
        if not placed:
            raise InputError(
                f"the vehicle on {url} reports no local position within {CONNECT_S:g} s: "
                "LOCAL_POSITION_NED, ATTITUDE_QUATERNION and ESTIMATOR_STATUS are needed"
            )
        link.wait(lambda h: h.has_version, 5.0)
        if link.heard.armed:
            raise InputError("the vehicle is armed: a mission begins on the ground, motors off")
        if not link.heard.simulated:  # an autopilot reports the position of its centre of mass
            self._p_BC = build_airframe(self.robot, self.world).p_BC
        self._align()
        self._force = BodyForce(self, link) if force else None
        self._due = self._now()

    def _align(self) -> None:
        h, origin = self.link.heard, self.world.origin
        self._restarts = h.restarts
        start = np.array(self.reference_now["p_WB"])
        here = h.p - h.R_WB @ self._p_BC
        self._shift = start - here
        if origin is not None:
            if not self.link.wait(lambda h: h.origin is not None, 5.0) or h.origin is None:
                raise InputError(
                    "the world has an origin and the vehicle reports none (GPS_GLOBAL_ORIGIN)"
                )
            self._shift[:2] = to_local(origin, Geodetic(*h.origin))[:2]
            away = float(np.linalg.norm((here + self._shift - start)[:2]))
            if away > APART:
                raise InputError(
                    f"the vehicle stands {away:.1f} m from the mission's start (mission.start_x_m, "
                    f"start_y_m); valid: up to {APART:g} m"
                )

    def _is_placed(self, h: Heard) -> bool:
        age = self.link.age
        return age(h.place) < 0.5 and age(h.turn) < 0.5 and h.has_place

    # --- interface of the mission --------------------------------------------------------------

    def take_control(self) -> str:
        """Change to Offboard, also from a pilot; return why this failed, or ""."""
        self.link.lead(self._hold_here())
        self.link.wait(lambda h: False, 0.3)  # the stream must start before the change of mode
        says = choose_mode(self.link, modes.OFFBOARD)
        if not says:
            self.piloted, self._offboard = False, True
        return says

    def give_control(self) -> str:
        """Give the platform to the pilot, in Position mode; return why this failed, or ""."""
        if self.piloted:
            return ""
        says = choose_mode(self.link, modes.POSITION)
        if not says:
            self.piloted, self._offboard = True, False
        return says

    def tick(self, guards: int = 0) -> Ticked:
        """Fly a mission tick; start and stop the motors before it. Raises VehicleEnded."""
        wanted = bool(self.reference_now["active"] > 0.5)
        if wanted and not self._armed:
            self._start()
        elif self._armed and not wanted:
            self._stop()
        self._wait_for_link()
        ticked = self._fly_tick(guards)
        self._lead()
        self._watch()
        self._pace()
        return ticked

    def _fly_tick(self, guards: int) -> Ticked:
        """Fly the simulated part of the vehicle for a mission tick."""
        return super().tick(guards)

    # --- commands to the vehicle ---------------------------------------------------------------

    def _lead(self) -> None:
        """Renew the set-point."""
        if not self._armed:
            return
        if self.piloted:
            self.link.lead(self._hold_here())
            return
        down = float(self.tracking[0][-1]["p_WB"][2]) < self._floor + LOW
        if not down and self._low_z is None and not self.link.heard.simulated:
            self._lift()
        target = self._aim()
        if not down and self._low_z is not None and target.p[2] < self._low_z:
            target.p[2], target.v[2], target.a[2], down = self._low_z, 0.0, 0.0, True
        f_B = None if self._force is None or down else self._force.compute()
        a, R = target.a + self._feed_forward(), self._choose_attitude(target.R_WB)
        self.link.lead(target._replace(a=a, R_WB=R, f_B=f_B))

    def _aim(self) -> Target:
        """Return the reference as the set-point of the point that the autopilot controls."""
        row, r = self.reference_now, self._p_BC
        R, w, wd = (np.array(row[name]) for name in ("R_WB", "w_WB_B", "wd_WB_B"))
        p, v = move_point(np.array(row["p_WB"]), np.array(row["v_WB"]), R, w, r)
        a = row["a_WB"] + R @ (compute_cross(wd, r) + compute_cross(w, compute_cross(w, r)))
        return Target(p - self._shift, v, a, R, float(w[2]))

    def _lift(self) -> None:
        """Lift off; the reference pauses while the autopilot increases its thrust."""
        target = self._hold_here()
        start = float(target.p[2])
        self._low_z = start + LIFT
        self.link.lead(target._replace(p=np.array([*target.p[:2], self._low_z])))
        if not self.link.wait(lambda h: h.p[2] > start + 0.5 * LIFT, LIFT_S):
            self._abandon(f"no take-off: it is still on the ground after {LIFT_S:g} s")
        self._due = self._now()

    def _choose_attitude(self, planned: Array) -> Array:
        """Return the attitude set-point of the vehicle."""
        return planned

    def _feed_forward(self) -> Array:
        """Return the acceleration (3,) m/s^2 that compensates planned contact forces."""
        return np.zeros(3)

    def _hold_here(self) -> Target:
        """Return the current pose as a set-point."""
        with self.link.lock:
            h = self.link.heard
            return Target(h.p.copy(), np.zeros(3), np.zeros(3), h.R_WB.copy(), 0.0)

    def _start(self) -> None:
        """Change to Offboard and start the motors; mission time pauses."""
        end = self.clock.now() + self._again_s
        while says := self._try_to_start():
            if self.clock.now() >= end:
                break
        if says:
            self._abandon(f"no take-off: {says}")
        self._armed = self._offboard = True
        self._due = self._now()

    def _try_to_start(self) -> str:
        """Change to Offboard and arm; return why this failed, or ""."""
        self.link.lead(self._hold_here())
        self.link.wait(lambda h: False, 0.6)
        return choose_mode(self.link, modes.OFFBOARD) or arm(self.link)

    def _stop(self) -> None:
        """Let the autopilot land and stop its motors; mission time pauses."""
        h = self.link.heard
        says = "" if not h.armed else choose_mode(self.link, modes.LAND)
        end = self.clock.now() + LAND_S
        while not says and h.armed:
            self._wait_for_link()
            self.link.wait(lambda h: not h.armed or h.mode != modes.LAND, SILENT_S)
            if not h.armed:
                break
            if h.mode == modes.OFFBOARD:  # a pilot gave control back
                self.piloted = False
                says = choose_mode(self.link, modes.LAND)
                end = self.clock.now() + LAND_S
            elif h.mode != modes.LAND:
                self._tell_pilot()
                self.link.wait(lambda h: h.mode in (modes.OFFBOARD, modes.LAND), SILENT_S)
                end = self.clock.now() + LAND_S
            elif self.clock.now() > end:
                says = f"the vehicle is still armed {LAND_S:g} s after the command to land"
        self.link.wait(lambda h: h.place > h.beat, SILENT_S)  # its clock is sent with its position
        if h.restarts != self._restarts:
            says = "the autopilot restarted while it landed"
        self.piloted, self._low_z = False, None
        if says:
            self._abandon(says)
        self._armed = self._offboard = False
        self.link.lead(None)
        self._due = self._now()

    def _tell_pilot(self) -> None:
        """Report once that a pilot flies."""
        if not self.piloted:
            self._says(f"t = {self.t:.2f} s: the mode is {self.link.heard.mode}: the pilot flies")
        self.piloted = True

    def _abandon(self, says: str) -> None:
        """Land the vehicle, stop its motors and end the mission."""
        done = land_and_disarm(self.link)
        self._give_up(f"{says}; {done}" if done else says)

    def _give_up(self, says: str) -> None:
        """Stop commanding and end the mission."""
        row = np.array(self.reference)
        row["t"], row["active"] = 0.0, 0.0
        self._armed = self._offboard = False
        self.link.lead(None)
        self.track(row[None])
        raise VehicleEnded(says)

    # --- monitoring --------------------------------------------------------------------------

    def _explain(self) -> str:
        """Return an error of this side of the link, to be appended to a message."""
        return f" ({self.link.failure})" if self.link.failure else ""

    def _is_silent(self) -> bool:
        h, age = self.link.heard, self.link.age
        silent = age(h.message) > SILENT_S or age(h.beat) > BEAT_S
        return silent or age(h.answer) > SILENT_S  # the vehicle receives nothing

    def _wait_for_link(self) -> None:
        """Pause while no message arrives; abort after LOST_S."""
        if not self._is_silent():
            return
        since = self.clock.now()
        self._says(f"t = {self.t:.2f} s: the vehicle is silent; mission time stands still")
        if self._armed and not self.piloted:
            still = np.zeros(3)
            self.link.lead(self._aim()._replace(v=still, a=still, rate=0.0))
        if not self.link.wait(lambda h: not self._is_silent(), LOST_S - SILENT_S):
            what = "its own rule for a lost link acts" if self._armed else "it stands"
            self._give_up(f"the vehicle has been silent for {LOST_S:g} s: {what}{self._explain()}")
        silent = self.clock.now() - since
        self._says(f"t = {self.t:.2f} s: the vehicle is heard again after {silent:.1f} s")
        self._quiet_until = self.clock.now() + OWN_S
        self._due = self._now()

    def _watch(self) -> None:
        """Check for changes that the vehicle or a pilot has made."""
        h = self.link.heard
        if h.restarts != self._restarts:
            self._restarts = h.restarts
            if self._armed:
                self._give_up("the autopilot restarted in flight")
            self._align()
        if not self._armed:
            return
        if not h.armed:
            self._armed = self._offboard = False
            if self.piloted:
                self.stopped, self.piloted = "the pilot landed", False
                row = np.array(self.reference)
                row["t"], row["active"] = 0.0, 0.0
                self.track(row[None])
                return
            self._give_up("the vehicle stopped its motors by itself")
        if h.mode == modes.OFFBOARD:
            self.piloted = False
        elif not self.piloted:
            deaf = self.link.age(h.answer) > DEAF_S
            quiet = deaf or self.clock.now() < self._quiet_until
            own = quiet and h.mode not in modes.BY_STICK
            if own and deaf:
                return  # the vehicle receives nothing: the link counts as silent
            if own and not self.take_control():
                self._says(f"t = {self.t:.2f} s: Offboard again after the silence")
                self._due = self._now()
                return
            self._tell_pilot()

    def _now(self) -> float:
        """Return the time (s) that paces the mission."""
        return self.clock.now()

    def _pace(self) -> None:
        """Wait until the tick is over by that time."""

    def close(self) -> None:
        """End the stream: a vehicle that follows it is commanded to hold."""
        h = self.link.heard
        if h.armed and h.mode == modes.OFFBOARD and not self._is_silent():
            says = choose_mode(self.link, modes.HOLD)
            self._says(says or "the vehicle is armed and holds: land it with its own controls")
        self.link.close()

    def on_say(self, say: Callable[[str], None]) -> None:
        """Report events to `say`, one line each."""
        self._says = say
