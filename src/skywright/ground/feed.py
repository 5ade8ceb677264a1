"""The simulation's end of the ground station: an observer of `run_mission`.

It sends one frame per mission tick, and none without watchers. While a page is watching, it paces
the flight (real time, faster, slower, paused). The operator's commands are checked here again,
because the station can stall, too.
"""

from __future__ import annotations

import json
import math
import socket
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.interrupt import check_interrupt
from skywright.ground.control import HOLD_S
from skywright.ground.disturb import DISTURBANCES
from skywright.ground.link import (
    ASKED,
    PAUSED,
    SILENT_S,
    SPEED_FASTEST,
    SPEEDS,
    STICK,
    pack_frame,
)
from skywright.ground.reserve import Reserve
from skywright.ground.steering import Steering
from skywright.ground.video import describe_video
from skywright.links.pair import parse, read_number, receive, say, send
from skywright.models.deviation import build_socket_error
from skywright.reports.frames import Channel, FrameBuilder
from skywright.reports.phases import explain_phase
from skywright.reports.replay import describe
from skywright.reports.scene3d import Scene3d
from skywright.reports.trace3d import list_judged
from skywright.reports.views3d import build_views
from skywright.run.backends import MAVLINK, PHYSICS, has_forces, split_backend
from skywright.run.hand_flight import MODES, Mode, find_tilt_in_place
from skywright.run.kind import load_kind
from skywright.run.operator import Sight
from skywright.vehicle.preflight import list_checks, read_charge

if TYPE_CHECKING:
    from skywright.description.loader import Description
    from skywright.run.faults._rule import Acted
    from skywright.run.planning import MissionPlan
    from skywright.run.supervisor import Supervisor
    from skywright.vehicle.simulated import SimulatedVehicle

FRAME_PERIOD = 0.018  # s of wall time between frames, slightly less than a tick in real time
RESERVE_PERIOD = 0.2  # s of wall time between measurements of the reserves
STATUS_PERIOD = 0.5  # s of wall time between status messages
RECENT = 500  # ticks over which the status reports the median
REST_S = 0.5  # s of mission time after the end of a request before the operator may rest
GRACE_S = 3.0  # s for which a flight without pages is still paced: one may be reloading
SCENE = "scene.json"


class Feed:
    """Publishes a flight to the station, and receives commands."""

    def __init__(
        self, end: socket.socket, folder: Path, *, wait_s: float = 0.0, stay_s: float = 0.0,
        backend: str = PHYSICS,
    ) -> None:  # fmt: skip
        """`end` is this side's socket; the scene is written to `folder`; `backend` flies.

        The flight waits up to `wait_s` (s of wall time) for the first page, and keeps its last
        picture for `stay_s` (s).
        """
        self.end, self.folder, self.backend = end, folder, backend
        self.wait_s, self.stay_s = wait_s, stay_s
        self.watchers, self.speed, self.paused = 0, 1.0, False
        self.steering = Steering()
        self._asked, self._worked = "", 0.0  # and mission time of the operator's last work
        self.dropped = 0  # number of invalid messages
        self.costs = deque[float](maxlen=RECENT)  # s of the last ticks, for the status
        self._heard = self._left = -math.inf  # wall time: last message, last watcher
        self._seq, self._late = 0, 0.0
        self._phases: list[tuple[str, float]] = []
        self._next_frame = self._next_status = 0.0
        self._anchor: tuple[float, float, float] | None = None  # wall time, mission time, speed
        self._builder: FrameBuilder | None = None
        self._row: NDArray[np.float32] = np.zeros(0, np.float32)
        self._t = 0.0
        self._supervisor: Supervisor[Any] | None = None
        self._next_reserve = -math.inf
        self._left_n: list[float | None] = []
        self._clearance, self._nearest = math.nan, ""
        self._alarms: list[dict[str, Any]] = []

    # --- Observer ------------------------------------------------------------------------------

    def on_plan(self, plan: MissionPlan[Any], description: Description) -> None:
        """Store the data of the scene; frames begin with the first tick."""
        self._plan, self._d = plan, description
        self._flies = load_kind(description.mission.kind).flies

    def on_supervisor(self, supervisor: Supervisor[Any]) -> None:
        """Store the recipient of orders; a page's stick is a velocity until a mode is chosen."""
        self._supervisor = supervisor
        supervisor.choose_mode(Mode.POSITION)

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Publish the tick, read the operator's input, and pace the flight."""
        began = time.perf_counter()
        if self._builder is None:
            self._begin(vehicle)
        self._t = t
        if not self._phases or self._phases[-1][0] != phase:
            self._phases.append((phase, t))
            self._next_status = 0.0
        self.poll()
        self.steering.carry_out(t, vehicle, self._supervisor)
        self._pass_order(vehicle)
        if self.watchers and self.watched and began >= self._next_frame:
            self._next_frame = began + FRAME_PERIOD
            self._send_frame(t, phase, vehicle)
        if began >= self._next_status:
            self._tell()
        self.costs.append(time.perf_counter() - began)
        self._pace(t)

    def on_acted(self, acted: Acted) -> None:
        """Store the message of a rule."""
        self._alarms.append({"t": acted.t_s, "text": acted.says, "rule": acted.rule})
        self._next_status = 0.0

    def close(self) -> None:
        """Report the end of the flight; keep the last picture for a moment."""
        self._tell(over=True)
        end = time.perf_counter() + self.stay_s
        while self._heard > 0.0 and self.watched and time.perf_counter() < end:
            self.poll()
            time.sleep(0.05)

    # --- reception ---------------------------------------------------------------------------

    @property
    def watched(self) -> bool:
        """Whether a page watches, or did within GRACE_S."""
        now = time.perf_counter()
        if now - self._heard > SILENT_S:  # the station has disconnected
            return False
        return self.watchers > 0 or now - self._left < GRACE_S

    def poll(self) -> None:
        """Process the station's messages."""
        for data in receive(self.end):
            message = parse(data)
            if message is None or not self._hear(message):
                self.dropped += 1
            self._heard = time.perf_counter()
        if self.paused and not (self.watched and self.paced):
            self.paused = False

    @property
    def paced(self) -> bool:
        """Whether the flight can be paused or change its speed: not with a real vehicle."""
        return split_backend(self.backend)[0] != MAVLINK

    def _hear(self, message: dict[str, Any]) -> bool:
        """Execute a message; return whether it is valid."""
        kind = message["k"]
        if kind == "watch":
            count = read_number(message.get("n"), 0, 1000)
            if count is None:
                return False
            if self.watchers and not count:
                self._left = time.perf_counter()
            self.watchers = int(count)
        elif kind == "pause":
            self.paused = message.get("on") is True
        elif kind == "speed":
            speed = read_number(message.get("x"), 0.0, SPEEDS[1])
            if speed is None or 0.0 < speed < SPEEDS[0]:
                return False
            self.speed = math.inf if speed == SPEED_FASTEST else speed
        elif self.steering.hear(message):
            if kind == "stick":  # frames report it
                return True
            self.paused &= kind != "order"
        else:
            return False
        self._next_status = 0.0
        return True

    # --- execution ---------------------------------------------------------------------------

    def _pass_order(self, vehicle: SimulatedVehicle) -> None:
        """Pass an order to the rules that answer it; on the ground it ends the run."""
        if not self.steering.order:
            return
        if not self._flies or not any(p in ("take_off", "release") for p, _ in self._phases):
            raise KeyboardInterrupt  # it is on the ground: there is no response to fly
        vehicle.order = self.steering.order

    def _pace(self, t: float) -> None:
        """Sleep until the wall clock has caught up; do not wait without watchers."""
        while self.paused and self.watched:
            check_interrupt()
            self._anchor = None
            self.wait_a_moment()
        if math.isinf(self.speed) or not self.watched or not self.paced:
            self._anchor, self._late = None, 0.0
            return
        now = time.perf_counter()
        if self._anchor is None or self._anchor[2] != self.speed:
            self._anchor = (now, t, self.speed)
        start, t_start, speed = self._anchor
        ahead = start + (t - t_start) / speed - now
        self._late = max(-1e3 * ahead, 0.0)
        if ahead > 0.0:
            time.sleep(min(ahead, 0.5))
        elif ahead < -0.5:  # the computer is slower than that: no physics step is skipped
            self._anchor = (now, t, speed)

    def wait_a_moment(self) -> None:
        """Pause for a moment, receiving and sending."""
        self.poll()
        if time.perf_counter() >= self._next_status:
            self._tell()
            if self._row.size:
                self._send_row(self._t)
        time.sleep(0.02)

    # --- sending -----------------------------------------------------------------------------

    def ask(self, what: str) -> None:
        """Set a request to the operator; "" ends it."""
        self._asked, self._worked = what, self._t

    @property
    def asked(self) -> str:
        """The current request to the operator, or "" while the robot works autonomously."""
        return self._asked if self._t - self._worked < REST_S else ""

    def tell_sight(self, t: float, sight: Sight) -> None:
        """Send the operator's view of the work, `t` (s) after the work began."""
        self._worked = self._t
        if self.watched and np.isfinite(sight.off).all() and math.isfinite(sight.force):
            say(
                self.end, "sight", t=round(t, 3), off=[round(float(x), 5) for x in sight.off],
                done=bool(sight.done), towards=list(sight.towards),
                force=round(float(sight.force), 3), asked=float(sight.asked),
                hold_s=float(sight.hold_s),
            )  # fmt: skip

    def _begin(self, vehicle: SimulatedVehicle) -> None:
        """Write the scene and wait for the first page."""
        d, plan = self._d, self._plan
        scene = Scene3d(d.robot, d.true_world, build_socket_error(d.plant))
        columns = frozenset(c.name for c in vehicle.recorded.columns)
        self._judged = list_judged(d.robot, d.world, d.mission.kind)
        forces = has_forces(self.backend)
        self._builder = FrameBuilder(
            scene, columns, self._judged, d.mission.task.get_gap_limit(), forces=forces
        )
        self._reserve = Reserve(d)
        if self._reserve.measures_clearance:
            self._builder.channels.append(
                Channel("clearance", "m", None, 2, True, lambda rows: np.array([self._clearance]))
            )
        if not math.isnan(read_charge(vehicle)):
            usable = 100.0 * d.robot.battery.usable_fraction
            self._builder.channels.append(Channel(
                "battery used", "%", usable, 1, True,
                lambda rows: np.array([100.0 * (1.0 - read_charge(vehicle))]),
            ))  # fmt: skip
        start = np.array([d.mission.start_x_m, d.mission.start_y_m, 0.0])
        planned = [table["p_WB"][::25] for table in plan.segments.values() if len(table)]
        views = build_views(
            d.robot, d.true_world, np.concatenate([start[None], *planned]), scene.drawing.world
        )
        data = describe(d, scene, self._builder, views, plan.way)
        names = {c.name for c in vehicle.assembly.components}
        data |= {
            "mode": "live",
            "backend": self.backend,
            "paced": self.paced,
            "duration": float(plan.duration_s),
            "operated": load_kind(d.mission.kind).operated,
            "disturbances": [
                {"name": x.name, "label": x.label} for x in DISTURBANCES.values() if x.name in names
            ]
            if "dynamics" in vehicle.offers
            else [],
            "flies": self._flies,
            "checklist": list_checks(d.mission.checklist) if self._flies else [],
            "modes": self._list_modes(),
            "video": describe_video(d.world.radio),
        }
        fresh = self.folder / f"{SCENE}.new"
        fresh.write_text(json.dumps(data, allow_nan=False), encoding="utf-8")
        fresh.replace(self.folder / SCENE)
        self._tell()
        end = time.perf_counter() + self.wait_s
        while not self.watchers and time.perf_counter() < end:
            check_interrupt()
            self.wait_a_moment()

    def _list_modes(self) -> list[dict[str, str]]:
        """Return the modes of the stick for this robot."""
        s = self._supervisor
        if s is None or not self._flies:
            return []
        can_tilt = find_tilt_in_place(s) > 0.0
        return [
            {"name": str(mode), "what": what}
            for mode, what in MODES.items()
            if mode != Mode.ANGLE or can_tilt
        ]

    def _send_frame(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        assert self._builder is not None
        row = vehicle.last_sample
        if not np.isfinite(row["p_WB"]).all():
            return
        judged = np.array([phase in self._judged])
        self._measure_reserve(row)
        self._row = self._builder.build(row, judged, self._read_signal(vehicle, row))[0]
        self._send_row(t)

    def _measure_reserve(self, row: Any) -> None:
        """Measure the robot's reserves, every RESERVE_PERIOD."""
        now = time.perf_counter()
        if now < self._next_reserve:
            return
        self._next_reserve = now + RESERVE_PERIOD
        self._left_n = self._reserve.measure_force(row["rotor_thrust"][0])
        found = self._reserve.measure_clearance(row[0])
        self._clearance, self._nearest = (math.nan, "") if found is None else found

    def _send_row(self, t: float) -> None:
        self._seq += 1
        flags = PAUSED * self.paused + STICK * self.steering.moves + ASKED * bool(self.asked)
        send(self.end, pack_frame(
            self._seq, t, time.time(), len(self._phases) - 1, flags, self._late, self._row
        ))  # fmt: skip

    def _read_signal(self, vehicle: SimulatedVehicle, row: Any) -> NDArray[np.float64] | None:
        """Return the weld component of the probe's signal, NaN without contact."""
        assert self._builder is not None
        if self._builder.pipe is None:
            return None
        if not vehicle.in_contact():
            return np.array([np.nan])
        probe = vehicle.read_memory("eddy current")
        off = row["ec"][0] - probe["null"]
        along = probe["lift_axis"]
        return np.array([abs(float(along[0] * off[1] - along[1] * off[0]))])

    def _tell(self, over: bool = False) -> None:
        """Send all data that frames do not contain."""
        self._next_status = time.perf_counter() + STATUS_PERIOD
        kind = self._d.mission.kind
        steering = self.steering.tell(self._supervisor)
        age = steering["age_s"]
        say(
            self.end, "status", over=over, t=self._t, paused=self.paused,
            speed=SPEED_FASTEST if math.isinf(self.speed) else self.speed,
            scene=self._builder is not None,
            phases=[[name, start] for name, start in self._phases[-40:]],
            first=max(len(self._phases) - 40, 0),
            what=explain_phase(kind, self._phases[-1][0]) if self._phases else "",
            asked=self.asked, alarms=self._alarms[-10:],
            holding=bool(self.asked) and (age is None or age > HOLD_S),
            left_n=self._left_n, nearest=self._nearest,
            cost_ms=round(1e3 * float(np.median(self.costs)), 3) if self.costs else None,
            dropped=self.dropped + self.steering.stick.dropped, **steering,
        )  # fmt: skip
