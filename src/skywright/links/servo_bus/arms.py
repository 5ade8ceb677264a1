"""Real servos for the arms of a flight: goals are sent at 50 Hz, shaft angles are read back.

The platform, the links and their springs are simulated. The simulated servos' shafts have the
angles of the real ones: the commands of the arms' law are sent to the bus (S_JOG with a play time
of two periods, so that the motion is continuous, Suarez 2020, V-C), and springs and links are
attached to the measured positions. The flight runs at the pace of the wall clock.

A worker thread owns the bus, so that a flight never waits for it. A servo that has been silent for
STALE_S keeps its last angle and is counted. A servo that is silent for LOST_S, or reports an error,
ends the flight.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.errors import InputError, SimulationError
from skywright.links.servo_bus.bus import ServoBus, ServoSilent, open_bus
from skywright.links.servo_bus.emulator import Emulator
from skywright.links.servo_bus.protocol import (
    Jog,
    describe_error,
    to_angle,
    to_counts,
    to_ticks,
)
from skywright.models.compliant_arms import is_compliant
from skywright.models.rigid_body import posture
from skywright.vehicle.arms.truth import ServoState
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, InOut, Recorded, words
from skywright.vehicle.plant import MISSION_TICK

Vector = NDArray[np.float64]

PERIOD_S = MISSION_TICK
"""s between goals."""
PLAY_S = 2.0 * PERIOD_S
STALE_S, LOST_S = 0.25, 1.0
BEHIND_S = 0.5  # s behind the wall clock beyond which the flight does not catch up
START_S = 2.0
"""Play time (s) of the motion to the flight's first goals."""
FAR_RAD = math.radians(30.0)
"""Largest distance of a shaft from the flight's first goal at which the start is accepted."""


class ServosFailed(SimulationError):
    """A servo does not answer or reports an error."""


class Driven(NamedTuple):
    """A servo and its joint."""

    servo: int  # id
    joint: int
    name: str


class Shaft(NamedTuple):
    """A reading of a servo."""

    angle: float  # rad
    error: int
    silent_s: float  # s from the answer to the last request: 0 if that was answered


def list_driven(robot: Robot) -> list[Driven]:
    """Return ids 1, 2, ... in the order of the robot's actuated joints.

    Raises InputError for a robot without position servos in its arms.
    """
    if not is_compliant(robot):
        raise InputError(
            f"--servos: robot {robot.name!r} has no arms with position servos; the servo bus "
            "drives arms with springs, such as those of 'bimanual'"
        )
    joints = [(j, limb.name) for j, limb in enumerate(list_joints(robot)) if limb.servo >= 0]
    return [Driven(k, j, name) for k, (j, name) in enumerate(joints, 1)]


class BusServos(Component):
    """Replaces the angles of the simulated servos' shafts by those of the real ones."""

    slot, side = "actuate", "plant"

    class Me(Record):
        n: int
        first: int  # index of the first servo in MuJoCo's controls
        joint: Annotated[Integers, MAX_JOINTS]
        servo: Annotated[Integers, MAX_JOINTS]  # control index of each servo
        angle: Annotated[Array, MAX_JOINTS]  # rad, measured

    columns = (
        Recorded("servo_theta", ServoState, "now", "rad", "shafts of the real servos", per="joint"),
    )

    def __init__(
        self, name: str, exchange: Callable[[float, Any, Any], None],
        check: Callable[[dict[int, float]], None],
    ) -> None:  # fmt: skip
        """`exchange(t, me, state)` is called after each mission tick.

        `check(angles)` is called once, before the flight, with the initial joint angles (rad).
        """
        super().__init__(name)
        self._exchange, self._check = exchange, check
        self._me: Any = None
        self._state: Any = None

    def after_tick(self, t: float) -> None:
        """Exchange goals and shaft angles."""
        self._exchange(t, self._me, self._state)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the joints, and check that the servos are present; raises InputError."""
        state = context.records[ServoState, ""][0]
        self._me, self._state = me, state
        me.first = len(context.rotors.thrust_min)
        for j, limb in enumerate(list_joints(context.robot)):
            if limb.servo >= 0:
                me.joint[me.n], me.servo[me.n] = j, limb.servo
                me.angle[me.n] = state["now"][j]
                me.n += 1
        self._check({int(me.joint[k]): float(me.angle[k]) for k in range(me.n)})

    @staticmethod
    def step(me: Me, mj: MuJoCo, out: InOut[ServoState]) -> None:
        ctrl = words(mj.ctrl, mj.nu)
        for k in range(me.n):
            out.now[me.joint[k]] = me.angle[k]
            ctrl[me.first + me.servo[k]] = me.angle[k]


class ServoWorker(threading.Thread):
    """Owns the bus: sends the newest goals at 50 Hz and reads the positions in turn."""

    def __init__(self, bus: ServoBus, servos: Sequence[int]) -> None:
        super().__init__(daemon=True, name="servo bus")
        self._bus, self._servos = bus, list(servos)
        self._lock, self._ending = threading.Lock(), threading.Event()
        self._goals: dict[int, int] = {}
        self._shafts: dict[int, Shaft] = {}
        self.cycle_s = 0.0
        """Duration (s) of the last round of readings."""
        self.failure = ""

    def check(self, goals: dict[int, float], names: dict[int, str]) -> None:
        """Read all servos without motion. Raises InputError as start_up."""
        self._bus.acknowledge_reads_only()
        self._bus.clear_errors()
        self._read_all(goals, names)

    def start_up(self, goals: dict[int, float], names: dict[int, str]) -> None:
        """Read all servos, switch torque on, move to `goals` (rad) slowly, then start the thread.

        Raises InputError if one is absent, reports an error, or is far from its goal.
        """
        bus = self._bus
        self.check(goals, names)
        bus.set_torque(True)
        self.lead(goals)
        bus.jog_together(to_ticks(START_S), self._build_jogs())
        time.sleep(START_S)
        self._read_all(goals, names)
        self.start()

    def _read_all(self, goals: dict[int, float], names: dict[int, str]) -> None:
        bus = self._bus
        for servo in self._servos:
            try:
                counts, status = bus.read_position(servo)
            except ServoSilent:
                present = bus.find_servos(range(1, 33))
                raise InputError(
                    f"servo {servo} ({names[servo]}) does not answer; those that do: "
                    f"{', '.join(map(str, present)) or 'none'}"
                ) from None
            if status.error:
                raise InputError(f"servo {servo} ({names[servo]}): {status.says}")
            off = to_angle(counts) - goals[servo]
            if abs(off) > FAR_RAD:
                raise InputError(
                    f"servo {servo} ({names[servo]}) stands {math.degrees(off):+.0f} deg from "
                    "where the flight begins; bring it within "
                    f"{math.degrees(FAR_RAD):.0f} deg by hand"
                )
            self._shafts[servo] = Shaft(to_angle(counts), 0, 0.0)

    def lead(self, goals: dict[int, float]) -> None:
        """Set the newest goals (rad) by id."""
        with self._lock:
            self._goals = {servo: to_counts(angle) for servo, angle in goals.items()}

    def read(self) -> dict[int, Shaft]:
        """Return the newest readings by id."""
        with self._lock:
            return dict(self._shafts)

    def run(self) -> None:
        """Send and read until `stop`."""
        try:
            self._run()
        except Exception as error:  # the port has failed: reported at the next tick
            self.failure = f"{type(error).__name__}: {error}"

    def stop(self) -> None:
        """Stop the thread; the servos hold their positions with torque on."""
        self._ending.set()
        if self.is_alive():
            self.join(2.0)
        self._bus.close()

    def _build_jogs(self) -> list[Jog]:
        with self._lock:
            return [Jog(servo, counts) for servo, counts in sorted(self._goals.items())]

    def _run(self) -> None:
        due, turn, begin = time.monotonic(), 0, time.monotonic()
        answered = dict.fromkeys(self._servos, begin)
        while not self._ending.is_set():
            now = time.monotonic()
            if now >= due:
                self._bus.jog_together(to_ticks(PLAY_S), self._build_jogs())
                due = max(due + PERIOD_S, now)
            servo = self._servos[turn]
            try:
                counts, status = self._bus.read_position(servo)
                answered[servo] = time.monotonic()
                shaft = Shaft(to_angle(counts), status.error, 0.0)
            except ServoSilent:
                silent = time.monotonic() - answered[servo]
                shaft = self._shafts[servo]._replace(silent_s=silent)
            with self._lock:
                self._shafts[servo] = shaft
            turn = (turn + 1) % len(self._servos)
            if turn == 0:
                self.cycle_s, begin = time.monotonic() - begin, time.monotonic()


class ServoFlight:
    """Real servos in the place of a flight's simulated ones.

    arms = open_servos("serial:/dev/ttyUSB0", skywright.load_robot("bimanual"))
    uav = skywright.fly("bimanual", parts=arms.parts)
    ...
    arms.close()
    """

    def __init__(self, bus: ServoBus, robot: Robot) -> None:
        """Raises InputError for a robot without position servos."""
        self.driven = list_driven(robot)
        self._component = BusServos("servo bus", self._exchange, self._check)
        self._worker = ServoWorker(bus, [d.servo for d in self.driven])
        self._bus = bus
        self._anchor: float | None = None
        self.stale = 0
        """Number of readings that were too old at a tick."""
        self.cycle_max_s = 0.0

    @property
    def parts(self) -> list[Component]:
        """Components to add to the vehicle."""
        return [self._component]

    def on_plan(self, plan: Any, description: Any) -> None:
        """Nothing to do: the servos start with the flight."""

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        """Nothing to do: the component exchanges the data."""

    def _check(self, angles: dict[int, float]) -> None:
        """Raise InputError if a servo is absent, has an error or is far from its joint's angle."""
        if self._anchor is not None:  # rebuilt in flight: the servos are already active
            return
        try:
            self._worker.check(
                {d.servo: angles[d.joint] for d in self.driven},
                {d.servo: d.name for d in self.driven},
            )
        except OSError as error:
            raise InputError(f"--servos: the serial port has failed: {error}") from None

    def _exchange(self, t: float, me: Any, state: Any) -> None:
        """Set goals, read shafts, wait for the wall clock; raises ServosFailed."""
        goals = {d.servo: float(state["held"][d.joint]) for d in self.driven}
        if self._anchor is None:
            try:
                self._worker.start_up(goals, {d.servo: d.name for d in self.driven})
            except OSError as error:
                raise InputError(f"--servos: the serial port has failed: {error}") from None
            self._anchor = time.monotonic() - t
        self._worker.lead(goals)
        if self._worker.failure:
            raise ServosFailed(f"the servo bus has failed: {self._worker.failure}")
        shafts = self._worker.read()
        for k, d in enumerate(self.driven):
            shaft = shafts[d.servo]
            if shaft.error:
                raise ServosFailed(f"servo {d.servo} ({d.name}): {describe_error(shaft.error)}")
            self.stale += shaft.silent_s > STALE_S
            if shaft.silent_s > LOST_S:
                raise ServosFailed(
                    f"servo {d.servo} ({d.name}) has not answered for {shaft.silent_s:.1f} s"
                )
            me.angle[k] = shaft.angle
        self.cycle_max_s = max(self.cycle_max_s, self._worker.cycle_s)
        self._pace(t)

    def close(self) -> None:
        """Close the port; the servos hold their positions."""
        self._worker.stop()

    def describe(self) -> list[str]:
        """Return lines about the bus: its slowest round of readings and dropped data."""
        lines = [f"servo bus: a round of readings took at most {1e3 * self.cycle_max_s:.0f} ms"]
        if self.stale:
            lines.append(f"servo bus: {self.stale} readings older than {STALE_S:g} s")
        return lines + [f"servo bus: {line}" for line in self._bus.describe_refused()]

    def _pace(self, t: float) -> None:
        assert self._anchor is not None
        ahead = self._anchor + t - time.monotonic()
        if ahead > 0.0:
            time.sleep(min(ahead, 0.1))
        elif ahead < -BEHIND_S:
            self._anchor -= ahead


def open_servos(text: str, robot: Robot) -> ServoFlight:
    """Return the arms of the option `--servos serial:PORT[:BAUD]`; raises InputError."""
    list_driven(robot)
    return ServoFlight(open_bus(text), robot)


def build_emulator(robot: Robot) -> Emulator:
    """Return an emulator of a robot's servos in its folded posture."""
    driven, folded = list_driven(robot), posture(robot, "folded")
    emulator = Emulator([d.servo for d in driven])
    for d in driven:
        servo = emulator.servos[d.servo]
        servo.now = servo.goal = float(to_counts(float(folded[d.joint])))
    return emulator


def describe_servos(bus: ServoBus, ids: Iterable[int]) -> list[str]:
    """Return a line for each servo that answers: position, supply, torque, errors."""
    lines = []
    for servo in bus.find_servos(list(ids)):
        counts, status = bus.read_position(servo)
        volts, _ = bus.read_supply(servo)
        torque = "torque on" if status.torque else "torque off"
        lines.append(
            f"servo {servo}: {math.degrees(to_angle(counts)):+.1f} deg, {volts:.1f} V, {torque}"
            + (f", {status.says}" if status.error else "")
        )
    return lines
