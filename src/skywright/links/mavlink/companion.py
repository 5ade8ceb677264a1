"""The back end `mavlink:URL`: the platform is a MAVLink vehicle, the arms are simulated.

Mission time is the vehicle's clock, so that a simulated vehicle may be slower or faster than real
time. It pauses while the motors are started and stopped, and while the link is silent. The recorded
truth is the estimate, because there is no other measurement.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from skywright.errors import InputError
from skywright.links.mavlink.check import find_refusal
from skywright.links.mavlink.endpoint import Endpoint, Url, parse_url
from skywright.links.mavlink.frames import move_point
from skywright.links.mavlink.link import Clock, VehicleLink
from skywright.links.mavlink.offboard import SILENT_S, Offboard
from skywright.links.mavlink.stream import load_dialect
from skywright.vehicle.interface import Ticked
from skywright.vehicle.kinematic import KinematicVehicle
from skywright.vehicle.plant import MISSION_TICK

COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
AHEAD_S = 0.3  # s for which a position is extrapolated with its velocity
EARLY_S = 1e-3  # s by which a tick may end early


class MavlinkVehicle(Offboard, KinematicVehicle):
    """A back end (vehicle.interface.Backend) that a MAVLink vehicle flies."""

    def __init__(self, link: VehicleLink, force: bool, *args: Any, **kwargs: Any) -> None:
        """Take a link, whether body forces are sent instead of positions, and the arguments of
        SimulatedVehicle.

        Raises InputError if no vehicle is found, or if it cannot fly this robot.
        """
        super().__init__(link, *args, **kwargs)
        self.late_s = 0.0
        self._meet(force)
        if self._force is not None:
            self.run_also(self._force.rows)

    @property
    def localised(self) -> bool:
        """Whether the autopilot reports its position."""
        return bool(self._state["ready"] > 0.0)

    def _fly_tick(self, guards: int) -> Ticked:
        return KinematicVehicle.tick(self, guards)

    def _move(self) -> None:
        """Set the pose to the vehicle's report; the joints follow their reference."""
        with self.link.lock:
            h = self.link.heard
            age = max(self.link.age(h.place), 0.0)
            p, v, R, w = h.p, h.v, h.R_WB, h.w_B
            ahead = h.pace * min(age, AHEAD_S)
            placed, std, charge = self._is_placed(h), h.std, h.charge
        known = float(self._state["heard"])
        p, v = move_point(p, v, R, w, -self._p_BC)  # from the centre of mass to the origin of B
        self._show(p + v * ahead + self._shift, v, R, w)
        self._state["heard"] = self.t - h.pace * age if placed else known
        self._state["pose_std"] = std
        if self._gauge is not None:
            self._gauge["charge"] = charge

    def _now(self) -> float:
        """Return the vehicle's time (s), extrapolated from its last position report."""
        with self.link.lock:
            h = self.link.heard
            return 1e-3 * h.place_ms + h.pace * min(self.link.age(h.place), AHEAD_S)

    def _pace(self) -> None:
        """Wait until the tick is over by the vehicle's clock; `_wait_for_link` handles silence."""
        self._due = min(self._due + MISSION_TICK, self._now() + SILENT_S)  # it may have restarted
        end = self.clock.now() + SILENT_S
        while (left := self._due - self._now()) > EARLY_S and self.clock.now() < end:
            self.clock.sleep(min(left / self.link.heard.pace, MISSION_TICK))
        self.late_s = max(self.late_s, -left)
        if -left > 0.5:  # larger delays are not made up
            self._due += -left


def connect(url: Url, clock: Clock | None) -> VehicleLink:
    """Open a link to a vehicle."""
    return VehicleLink(Endpoint(url, 1, COMPONENT), clock)


def check_backend(address: str, setup: Any) -> None:
    """Raise InputError if a mission cannot fly over MAVLink."""
    says = find_refusal(setup)
    if says:
        raise InputError(f"backend mavlink: {says}")


def open_backend(
    text: str, clock: Clock | None = None,
    connect: Callable[[Url, Clock | None], VehicleLink] = connect,
) -> Callable[..., MavlinkVehicle]:  # fmt: skip
    """Return a function that builds the back end of `URL`, or `URL?force`; raises InputError."""
    url, _, option = text.partition("?")
    if option not in ("", "force"):
        raise InputError(f"backend mavlink: ?{option} is unknown; valid: ?force")
    parsed = parse_url(url, "--backend mavlink")
    load_dialect()  # fails early if pymavlink is not installed

    def build(setup: Any, *args: Any, **kwargs: Any) -> MavlinkVehicle:
        check_backend(url, setup)
        link = connect(parsed, clock)
        try:
            return MavlinkVehicle(link, option == "force", setup, *args, **kwargs)
        except BaseException:
            link.close()
            raise

    return build
