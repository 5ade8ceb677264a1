"""`skywright serve ROBOT --mavlink URL`: a simulated robot as a MAVLink vehicle."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from skywright.core.interrupt import check_interrupt
from skywright.core.threads import on_one_thread
from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.links.mavlink.endpoint import Endpoint, Url
from skywright.links.mavlink.parameters import Parameters, Settable
from skywright.links.mavlink.reports import Reports
from skywright.links.mavlink.robot import Robot
from skywright.links.mavlink.server import COMPONENT, SYSTEM, Server
from skywright.links.mavlink.setpoints import Scale
from skywright.links.mavlink.stream import load_dialect
from skywright.links.px4.parameters import TYPES, list_parameters
from skywright.links.sitl.earth import HOME
from skywright.links.sitl.pace import Pace
from skywright.models.capability import check_can_fly
from skywright.models.hover_tilt import compute_hover_tilt
from skywright.models.rigid_body import posture
from skywright.run.backends import build_vehicle
from skywright.run.parts import build_rules
from skywright.run.planning import MissionPlan
from skywright.run.session import Vehicle
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.vehicle.commands import State
from skywright.vehicle.motions import Arrival
from skywright.vehicle.simulated import SimulatedVehicle

LATE_S = 0.1  # least delay (s) behind the wall clock that is reported
ARRIVAL = Arrival(tolerance_m=0.15, dwell_s=0.2)
"""Criterion for the end of a take-off or of a motion to a waypoint, as usual for autopilots."""
CRUMBS = 2000  # number of points of the flown path that are kept for the return


class Served(NamedTuple):
    """Result of serving."""

    seconds: float  # simulated
    late_s: float  # largest delay behind the wall clock
    dropped: list[str]
    reason: str


class Service:
    """A robot that is simulated at the pace of the wall clock, with its MAVLink server."""

    def __init__(
        self, description: Description[Any], endpoints: Sequence[Endpoint],
        say: Callable[[str], None] = lambda _: None, speed: float = 1.0,
        clock: Callable[[], float] = time.monotonic, backend: SimulatedVehicle | None = None,
    ) -> None:  # fmt: skip
        """`say` receives one line per event; `speed` is a factor of real time, infinite: do not
        wait.

        `backend` is an already built back end of this description.

        Raises InputError if the robot cannot be simulated, or if PX4's parameters cannot represent
        it.
        """
        dialect = load_dialect()
        robot, world = description.robot, description.world
        check_can_fly(robot, world.gravity_mps2)
        self._say, self._speed, self._clock = say, speed, clock
        setup = Setup(description)
        backend = backend or build_vehicle(description, setup=setup)
        plan: MissionPlan[Any] = MissionPlan(True, None, 0.0, 0.0, 0.0, 0.0, {})
        self.supervisor: Supervisor[Any] = Supervisor(
            backend, description.mission, plan, robot.platform.gear_height_m,
            on_tick=lambda t, phase: self._tick_over(), rules=build_rules(description),
            surroundings=lambda: setup.clearance_aloft,
        )  # fmt: skip
        self.vehicle = Vehicle(backend, self.supervisor, ARRIVAL, description.mission.checklist)
        backend.on_samples = None  # the samples have no reader and are not kept
        fixed = [(p.name, p.value) for p in list_parameters(robot, world)]
        self.parameters = Parameters([*fixed, ("MAV_SYS_ID", SYSTEM)], list_settable(robot))
        lift = float(setup.rotors.axis[:, 2] @ setup.rotors.thrust_max)
        tilt = compute_hover_tilt(robot, posture(robot, "folded"), world.gravity_mps2)
        scale = Scale(lift, math.isfinite(tilt) and tilt > math.radians(1.0))
        self.robot = Robot(self.vehicle, self.parameters, self._tell)
        origin = world.origin or HOME
        reports = Reports(dialect, self.robot, origin, scale, TYPES.get(len(setup.rotors.spin), 2))
        self.server = Server(
            endpoints, dialect, self.robot, reports, self.parameters, scale, origin
        )
        self._pace = Pace(clock)
        self._start: tuple[float, float] | None = None
        self.late_s = 0.0
        self._late_told = -math.inf

    def _tell(self, text: str) -> None:
        self._say(f"t = {self.vehicle.t:.2f} s: {text}")
        self.server.say(text)

    def _tick_over(self) -> None:
        """Runs after each mission tick, also during a rule's response."""
        check_interrupt()
        if self.robot.flies_itself:
            self.server.poll()
            if self.robot.terminated:
                self.robot.terminated = False
                self.supervisor.faults.let_go("flight termination was commanded")
        self.server.report()
        crumbs = self.supervisor.trail.crumbs
        if len(crumbs) > CRUMBS:
            del crumbs[1:-1:2]
        t, now = self.vehicle.t, self._clock()
        if self._start is None or math.isinf(self._speed):
            self._start = (t, now)
        late = now - self._start[1] - (t - self._start[0]) / self._speed
        if late > LATE_S:
            self.late_s = max(self.late_s, late)
            if now - self._late_told > 10.0:
                self._late_told = now
                self._say(f"t = {t:.2f} s: {late:.2f} s behind the wall clock")
        self._pace.wait(t, self._speed)
        if late > 0.5:  # larger delays are not made up, as in Pace
            self._start = (t, self._clock())

    def tick(self) -> None:
        """Process messages, apply the mode, fly a mission tick, send reports."""
        self.server.poll()
        self.robot.step()
        self.vehicle.tick()

    @property
    def settled(self) -> bool:
        """Whether the robot's position estimate is valid."""
        return self.vehicle.state != State.UNINITIALIZED


def list_settable(robot: Any) -> list[Settable]:
    """Return the parameters that can be set."""
    return [
        Settable("MIS_TAKEOFF_ALT", 1.5, 0.2, 80.0),
        Settable("COM_OF_LOSS_T", 0.5, 0.1, 60.0),
        Settable("COM_DISARM_PRFLT", 10.0, -1.0, 3600.0),
    ]


@on_one_thread
def serve_robot(
    description: Description[Any], urls: Sequence[Url], *, speed: float = 1.0,
    duration_s: float = math.inf, say: Callable[[str], None] = lambda _: None,
) -> Served:  # fmt: skip
    """Serve until the duration (s, simulated) is over or the user ends it.

    Raises InputError if nothing was started, SimulationError if the physics diverges.
    """
    if not urls:
        raise InputError("--mavlink: an address is needed, such as udpin:14550")
    endpoints: list[Endpoint] = []
    service: Service | None = None
    reason = "the duration is over"
    try:
        for url in urls:
            endpoints.append(Endpoint(url, SYSTEM, COMPONENT))
            if not url.is_local:
                say(f"{url}: reachable from other computers; MAVLink does not authenticate senders")
        service = Service(description, endpoints, say, speed)
        say(f"{description.robot.name} in {description.world.name} on {', '.join(map(str, urls))}")
        while service.vehicle.t < duration_s - 1e-9:
            service.tick()
    except KeyboardInterrupt:
        reason = "ended by the user"
    finally:
        for endpoint in endpoints:
            endpoint.close()
    if service is None:
        return Served(0.0, 0.0, [], reason)
    return Served(service.vehicle.t, service.late_s, service.server.describe_dropped(), reason)
