"""The flight's end of the live link: one datagram per tick, and incoming commands.

A child process does everything else, including the encoding (links/broadcast/process.py). Sending
never blocks, and datagrams that the process does not read in time are dropped. While a client is
subscribed, the flight runs at the pace of the wall clock.
"""

from __future__ import annotations

import atexit
import json
import math
import pickle
import subprocess
import sys
import tempfile
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from skywright.core.interrupt import check_interrupt
from skywright.errors import InputError
from skywright.links.broadcast.commands import Args, MissionCommands, Told, VehicleCommands
from skywright.links.broadcast.options import Live
from skywright.links.broadcast.rows import Filler, Setup
from skywright.links.pair import build_pair, parse, read_number, receive, say, send
from skywright.models.deviation import build_socket_error
from skywright.models.rigid_body import joint_names
from skywright.models.urdf import build_urdf
from skywright.recordings.columns import Topic
from skywright.vehicle.commands import State
from skywright.vehicle.results import Handle, Result
from skywright.vehicle.telemetry import read_battery

if TYPE_CHECKING:
    from skywright.description.loader import Description
    from skywright.run.session import Vehicle
    from skywright.run.supervisor import Supervisor
    from skywright.vehicle.simulated import SimulatedVehicle

START_S = 30.0  # s, time limit for the process to open its sockets
HEAR_S = 0.005  # s of wall time between reads of incoming messages
CHARGE_S = 1.0  # s of mission time between readings of the battery
CHECK_S = 1.0  # s of wall time between checks that the process runs
LATE_S = 0.5  # s behind the wall clock beyond which the flight does not catch up
MOST = 64  # most commands in execution


class Commands(Protocol):
    """Interface of an executor of commands."""

    @property
    def state(self) -> State:
        """State of the vehicle."""

    def call(self, name: str, args: Args) -> Told:
        """Start a command; raises InputError for wrong arguments."""


class LiveFlight:
    """An observer of a flight that publishes it and executes incoming commands."""

    def __init__(self, options: Live, description: Description) -> None:
        """Open the sockets; raises InputError if that fails."""
        self.options, self._d = options, description
        self._commands: Commands | None = None
        self._under_way = deque[tuple[int, Handle]](maxlen=MOST)
        self._filler: Filler | None = None
        self._anchor: float | None = None
        self._charge, self._next_charge = math.nan, -math.inf
        self._phase, self.watched, self._opened, self._closed = "", False, False, False
        self.sent = self.dropped = self.refused = 0
        """Numbers of sent rows, dropped rows, and refused commands."""
        self.cost_s = 0.0  # s, all ticks so far
        self._next_hear = self._next_check = -math.inf  # of time.perf_counter
        self._ended = False  # the process, before the flight
        self._folder = tempfile.TemporaryDirectory(prefix="skywright-")
        self._end, theirs = build_pair()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "skywright.links.broadcast.process", str(theirs.fileno()),
             json.dumps(options._asdict())],
            stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], start_new_session=True,
        )  # fmt: skip
        theirs.close()
        self._await("opened")

    # --- Observer ------------------------------------------------------------------------------

    def on_plan(self, plan: Any, description: Description) -> None:
        """Nothing to do: topics depend on the vehicle."""

    def on_supervisor(self, supervisor: Supervisor[Any]) -> None:
        """Store the supervisor, which executes the commands."""
        self._commands = MissionCommands(supervisor)

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Publish a tick, accept commands, and wait for the wall clock while a client is
        subscribed."""
        if self._ended:
            return
        if self._filler is None:
            self._begin(vehicle)
        began = time.perf_counter()
        if began >= self._next_hear:  # a flight faster than real time reads as often as others
            self._next_hear = began + HEAR_S
            self._hear()
            self._answer()
        if began >= self._next_check:
            self._next_check = began + CHECK_S
            if self._process.poll() is not None:
                self._report_end()
                return
        self._tell(t, phase, vehicle)
        self.cost_s += time.perf_counter() - began
        self._pace(t)

    def close(self) -> None:
        """End the process."""
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        if self._process.poll() is None:
            say(self._end, "over")
        self._end.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()

    # --- a vehicle under a script ------------------------------------------------------------

    def attach(self, vehicle: Vehicle) -> None:
        """Publish a vehicle under a script, and accept commands to it."""
        self._commands = VehicleCommands(vehicle, tuple(joint_names(self._d.robot)))
        backend: Any = vehicle.backend
        vehicle.after_tick.append(lambda: self.on_tick(backend.t, str(vehicle.mode), backend))
        self._begin(backend)
        vehicle.closing.append(self.close)
        atexit.register(self.close)

    # --- publication -------------------------------------------------------------------------

    def _begin(self, vehicle: SimulatedVehicle) -> None:
        """Send the columns of the rows, and wait until the topics are declared."""
        d, recorded = self._d, vehicle.recorded
        self._filler = Filler(recorded.columns)
        setup = Setup(
            d.mission.name, d.robot, d.true_world, np.asarray(build_socket_error(d.plant)),
            tuple(recorded.columns), tuple(map(_copy, recorded.topics)),
            tuple(joint_names(d.robot)), build_urdf(d.robot),
        )  # fmt: skip
        file = Path(self._folder.name) / "setup.pickle"
        file.write_bytes(pickle.dumps(setup))
        say(self._end, "setup", file=str(file))
        self._await("declared")
        until = time.monotonic() + self.options.wait_s
        while not self.watched and time.monotonic() < until:
            check_interrupt()
            time.sleep(0.02)
            self._hear()

    def _tell(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        assert self._filler is not None
        if t >= self._next_charge:
            self._next_charge = t + CHARGE_S
            self._charge = read_battery(vehicle)
        if phase != self._phase:
            self._phase = phase
            say(self._end, "phase", name=phase)
        if not self.watched:
            return
        state = State.UNINITIALIZED if self._commands is None else self._commands.state
        if send(self._end, self._filler.fill(vehicle.last_sample, state, self._charge)):
            self.sent += 1
        else:
            self.dropped += 1

    def _pace(self, t: float) -> None:
        if not self.watched:
            self._anchor = None
            return
        now = time.monotonic()
        if self._anchor is None:
            self._anchor = now - t
        ahead = self._anchor + t - now
        if ahead > 0.0:
            time.sleep(min(ahead, 0.1))
        elif ahead < -LATE_S:
            self._anchor = now - t

    def _report_end(self) -> None:
        """Go on without the process; print its exit status."""
        self._ended, self.watched = True, False
        self._under_way.clear()
        print(
            "skywright: the process that publishes the flight has ended (exit status "
            f"{self._process.returncode}); the flight continues without ROS 2 and Foxglove",
            file=sys.stderr, flush=True,
        )  # fmt: skip

    # --- reception ---------------------------------------------------------------------------

    def _hear(self) -> None:
        for data in receive(self._end):
            message = parse(data)
            if message is None:
                continue
            if message["k"] == "watch":
                self.watched = message.get("on") is True
            elif message["k"] == "call":
                self._take(message)
            else:
                self._note(message)

    def _note(self, message: dict[str, Any]) -> None:
        self._opened |= message["k"] in ("opened", "declared")
        if message["k"] == "failed":
            raise InputError(str(message.get("says")))

    def _take(self, message: dict[str, Any]) -> None:
        """Execute a command; `id` is 0 for a stream, which gets no answer."""
        number = int(read_number(message.get("id"), 0, 2**53) or 0)
        at, args = read_number(message.get("at"), 0.0, 1e12), message.get("args")
        if at is None or not isinstance(args, dict) or self._commands is None:
            return
        try:
            told = self._commands.call(str(message.get("name")), args)
        except InputError as error:
            told = Told(Result(False, str(error)))
        except Exception as error:  # no invalid message may end the flight
            told = Told(Result(False, f"{type(error).__name__}: {error}"))
        if told.handle is not None and args.get("blocking") is True and number:
            self._under_way.append((number, told.handle))
            return
        result = Result(True, "accepted") if told.result is None else told.result
        self.refused += not result.ok
        if number:
            self._reply(number, result)

    def _answer(self) -> None:
        """Answer the calls that have ended."""
        for _ in range(len(self._under_way)):
            number, handle = self._under_way.popleft()
            if handle.result is None:
                self._under_way.append((number, handle))
            else:
                self._reply(number, handle.result)

    def _reply(self, number: int, result: Result) -> None:
        say(self._end, "reply", id=number, ok=result.ok, says=result.reason)

    def _await(self, what: str) -> None:
        """Wait for a message of the process; raises InputError with its error, or if it ended."""
        self._opened, until = False, time.monotonic() + START_S
        while not self._opened:
            check_interrupt()
            try:
                self._hear()
            except InputError:
                self.close()
                raise
            if self._process.poll() is not None and not self._opened:
                self.close()
                raise InputError("the process that publishes the flight has ended")
            if time.monotonic() > until:
                self.close()
                raise InputError(f"the process that publishes the flight is silent ({what})")
            time.sleep(0.01)


def _copy(topic: Topic) -> Topic:
    """Return a topic whose mappings can be sent to another process."""
    return topic._replace(
        fields=dict(topic.fields), texts=dict(topic.texts), lengths=dict(topic.lengths),
        types=dict(topic.types), numbers=dict(topic.numbers),
    )  # fmt: skip
