"""Real servos for the arms of a flight: goals are sent at 50 Hz, shaft angles are read back.

The platform, the links and their springs are simulated. The simulated servos' shafts have the
angles of the real ones: the commands of the arms' law are sent to the bus (S_JOG with a play time
of two periods, so that the motion is continuous, Suarez 2020, V-C), and springs and links are
attached to the measured positions. The flight runs at the pace of the wall clock.

A worker thread (worker.py) owns the bus, so that a flight never waits for it. A servo that has been
silent for STALE_S keeps its last angle and is counted. A servo that is silent for LOST_S, reports
an error or has no torque ends the flight.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.errors import InputError, SimulationError
from skywright.links.servo_bus.bus import ServoBus, open_bus
from skywright.links.servo_bus.emulator import Emulator
from skywright.links.servo_bus.protocol import describe_error, to_angle, to_counts
from skywright.links.servo_bus.worker import LIMP, ServoWorker
from skywright.models.compliant_arms import is_compliant
from skywright.models.rigid_body import posture
from skywright.vehicle.arms.truth import ServoState
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, InOut, Recorded, words

Vector = NDArray[np.float64]

STALE_S, LOST_S = 0.25, 1.0
BEHIND_S = 0.5  # s behind the wall clock beyond which the flight does not catch up


class ServosFailed(SimulationError):
    """A servo does not answer, reports an error or has no torque."""


class Driven(NamedTuple):
    """A servo and its joint."""

    servo: int  # id
    joint: int
    name: str


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
        self._closed = False
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
            if faults := shaft.status.faults:
                raise ServosFailed(f"servo {d.servo} ({d.name}): {describe_error(faults)}")
            if not shaft.status.torque:
                raise ServosFailed(f"servo {d.servo} ({d.name}): {LIMP}")
            self.stale += shaft.silent_s > STALE_S
            if shaft.silent_s > LOST_S:
                raise ServosFailed(
                    f"servo {d.servo} ({d.name}) has not answered for {shaft.silent_s:.1f} s"
                )
            me.angle[k] = shaft.angle
        self.cycle_max_s = max(self.cycle_max_s, self._worker.cycle_s)
        self._pace(t)

    def close(self) -> None:
        """Close the port, and report the counts; torque stays on."""
        if self._closed:
            return
        self._closed = True
        self._worker.stop()
        if self._anchor is not None:  # the flight has begun
            print("\n".join(self.describe()), file=sys.stderr, flush=True)

    def describe(self) -> list[str]:
        """Return lines about the bus: last known torque, slowest round of readings, losses."""
        off = [i for i, s in self._worker.read().items() if not s.status.torque]
        if off:
            torque = f"torque is off at servo {', '.join(map(str, off))} and stays on elsewhere"
        else:
            torque = "torque stays on; the servos hold their last goals"
        lines = [
            f"servo bus: {torque}",
            f"servo bus: a round of readings took at most {1e3 * self.cycle_max_s:.0f} ms",
        ]
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
