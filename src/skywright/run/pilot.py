"""A pilot takes over a running mission by a switch, and gives it back.

While the switch is on, the pilot's stick moves the platform in a mode of run/hand_flight.py, the
arms keep their posture, and rules only report, except those that override the pilot. The switch has
priority over a phase and over the response of a rule. After the pilot gives back:

- a phase of free flight continues: the robot returns to where it was taken over, along the path
  that the pilot flew or a free straight line, and tracks the rest of the reference from rest;
- a phase in which the robot touches or carries something, or controls its hands in task space,
  raises `GivenBack`. A contact that can start again (run/orders.py) catches it; otherwise the
  robot comes home and lands.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.run.faults._response import build_rest, fly_back
from skywright.run.faults._trail import build_crumb
from skywright.run.hand_flight import CLIMB, HandFlight, Mode, find_tilt_in_place
from skywright.vehicle.commands import State
from skywright.vehicle.results import Result
from skywright.vehicle.uav import Uav

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

Table = NDArray[Any]

SILENT_S = 5.0
"""s without the pilot's stick after which the robot takes back control, comes home and lands."""
STANDS_S, STILL_MPS, SINK_S = 2.0, 0.05, 60.0  # landed: commanded down and slow, or for long
STEADY_S = 2.0  # s, of hovering before an interrupted phase continues
AGAIN_S = 1.0  # s, in which an interrupted reference reaches its speed


class TakenOver(NamedTuple):
    """State of a phase when a pilot took over."""

    phase: str
    row: Any  # REFERENCE, commanded at that time
    table: Table  # the tracked table
    along: float  # s, along it
    engaged: bool  # touching or carrying something, or hands in task space


class GivenBack(Exception):
    """Raised when the pilot gives back and the interrupted phase cannot continue by itself."""

    def __init__(self, says: str, taken: TakenOver, first: int, repeats: bool = False) -> None:
        """`first` is the index of the crumb at which the pilot took over.

        `repeats`: a mission that supports it may repeat the work.
        """
        super().__init__(says)
        self.taken, self.repeats, self.first = taken, repeats, first


class PilotLanded(Exception):
    """Raised when the pilot has landed, which ends the mission."""


class Pilot:
    """The pilot's switch and stick of one flight."""

    def __init__(self, s: Supervisor) -> None:
        self._s: Supervisor = weakref.proxy(s)  # weak: a cycle would keep the flight in memory
        self.switch = False
        """Whether the pilot requests or has control."""
        self.flies = False
        """Whether the stick moves the robot."""
        self.says = ""
        """Result of the last order, for a display."""
        self.away_s = 0.0
        """Time (s) for which pilots have interrupted the mission."""
        self.mode = Mode.ATTITUDE
        """The selected mode of the stick."""
        self.follows = True
        """Whether a switch on the vehicle itself interrupts the mission."""
        self._outside = False
        self._hand: HandFlight | None = None
        self._axes: list[float] | None = None  # of a stick, not yet applied
        self._heard = 0.0

    def take_over(self) -> Result:
        """Give the pilot control from the next tick on; refused only while the motors are off."""
        says = ""
        if not self._s.kind.flies:
            says = "take_over refused: the robot does not fly in this mission"
        elif self._s.senses.told("active") < 0.5:
            says = "take_over refused: the motors are off"
        self.switch, self.says = self.switch or not says, says
        return Result(not says, says, self._s.vehicle.t)

    def give_back(self) -> Result:
        """Return control to the mission; refused if the position loops cannot take over."""
        says = ""
        if not self.switch and not self.flies:
            says = "give_back refused: no pilot has taken over"
        elif self._hand is not None and self.switch:
            says = self._hand.find_refusal().replace("recover_from_manual", "give_back")
        self.switch, self.says = self.switch and bool(says), says
        return Result(not says, says, self._s.vehicle.t)

    def choose(self, mode: str) -> Result:
        """Select the stick's mode; angle mode is refused if the robot cannot tilt in place."""
        says = ""
        if mode not in list(Mode):
            says = f"mode {mode!r} refused: valid: {', '.join(Mode)}"
        elif mode == Mode.ANGLE and find_tilt_in_place(self._s) <= 0.0:
            robot = self._s.vehicle.robot.name
            says = f"angle mode refused: {robot} cannot tilt in place, its rotors are parallel"
        self.mode, self.says = self.mode if says else Mode(mode), says
        if self._hand is not None:
            self._hand.mode = self.mode
        return Result(not says, says, self._s.vehicle.t)

    def move(self, axes: Sequence[float]) -> Result:
        """Set the stick: right, ahead, turn, climb. It is valid for 0.5 s and then centred.

        Axes beyond -1 and 1 are limited to them. Anything but four finite numbers is refused: the
        pilot then counts as silent, and the flight continues.
        """
        try:
            stick = np.array(axes, float)
        except (TypeError, ValueError):
            stick = np.full(4, math.nan)
        t = self._s.vehicle.t
        if stick.shape != (4,) or not np.isfinite(stick).all():
            self.says = (
                f"stick {str(axes)[:80]} refused: valid: four finite numbers from -1 to 1: right, "
                "ahead, turn, climb"
            )
            return Result(False, self.says, t)
        self._axes, self._heard = np.clip(stick, -1.0, 1.0).tolist(), t
        return Result(True, "", t)

    def follow_switch(self) -> None:
        """Read the switch on the vehicle itself, which has priority; raises PilotLanded.

        While the motors are off, no switch has an effect: a pilot must not start motors that a
        fault rule has stopped in the air.
        """
        vehicle = self._s.vehicle
        if vehicle.stopped and (self.switch or self.flies):
            self.switch = False
            raise PilotLanded(f"the pilot took over; {vehicle.stopped}")
        if not self.flies and self._s.senses.told("active") < 0.5:
            self.switch = self._outside = False
        elif not self.follows:
            return
        elif vehicle.piloted:
            self.switch, self._outside = True, True
            self.move([0.0, 0.0, 0.0, 0.0])  # the vehicle reads its own stick
        elif self._outside:
            self._outside = False
            self.give_back()

    @property
    def flown(self) -> str:
        """The mode in effect, "" if no pilot flies."""
        return "" if self._hand is None else str(self._hand.flown)

    @property
    def lacks(self) -> str:
        """Why the selected mode or giving back is not possible; "" otherwise."""
        return "" if self._hand is None else self._hand.says or self._hand.find_refusal()

    def fly(self) -> None:
        """Let the pilot fly, then return the robot to the mission.

        Raises GivenBack, PilotLanded, and RuleActed by a rule that overrides the pilot.
        """
        s, started = self._s, self._s.vehicle.t
        phase = s.phase
        row = np.array(s.vehicle.reference)
        engaged = s.senses.engaged or s.watch is not None
        taken = TakenOver(phase, row, *s.vehicle.tracking, engaged)
        first = len(s.trail.crumbs)
        s.trail.crumbs.append(build_crumb(s.senses))
        s.end("taken over")
        s.begin("manual")
        rest = build_rest(s)
        rest["load"] = row["load"]
        s.vehicle.track(rest[None])
        watch, s.watch = s.watch, None
        self.flies, self._heard = True, s.vehicle.t
        try:
            present = self._follow_stick(phase)
        finally:
            self.flies, self._hand = False, None
            s.faults.told.clear()
        s.watch = watch
        s.end("done")
        where = f"the pilot took over in {phase or 'the flight'} at t = {started:.1f} s"
        if not present:
            silent = f"{where} and was silent for {SILENT_S:g} s"
            raise GivenBack(silent, taken, first)
        if s.senses.responding:
            raise GivenBack(f"{where} and gave back", taken, first)
        if engaged:
            why = f"{where} and gave back; {phase} does not go on: the robot was at work there"
            raise GivenBack(why, taken, first, repeats=True)
        rejoin(s, first, row)
        s.begin(phase)
        s.vehicle.track(build_rest_of(taken))
        self.away_s += s.vehicle.t - started

    def _follow_stick(self, phase: str) -> bool:
        """Fly by the stick until the pilot gives back; returns False if the stick fell silent."""
        s = self._s
        hand = self._hand = HandFlight(s, self.mode)
        while True:
            axes, self._axes = self._axes, None
            hand.step(axes)
            if hand.uav.state == State.LANDED_DISARMED:
                self.switch = False
                raise PilotLanded(f"the pilot took over in {phase} and landed")
            silent = s.vehicle.t - self._heard > SILENT_S
            if self.switch and not silent:
                continue
            handle = hand.settle()
            if not handle:
                self.switch, self.says = True, handle.result.reason if handle.result else ""
                if silent:
                    self._sink(hand.uav)
                continue
            self.switch = False
            while not (handle.done or self.switch):
                hand.uav.tick()
            if not self.switch:
                return not silent
            self._heard = s.vehicle.t
            hand.uav.take_over()

    def _sink(self, uav: Uav) -> None:
        """Descend level: the stick is unattended, and the robot is too low to recover."""
        uav.stick(climb=-CLIMB)
        asked = self._s.vehicle.t - self._heard - SILENT_S  # s, for which it has descended
        still = float(np.linalg.norm(self._s.vehicle.estimate["v_WB"])) < STILL_MPS
        if asked > SINK_S or (still and asked > STANDS_S):
            uav.stop_motors(confirm=True)


def rejoin(s: Supervisor, first: int, row: Any) -> None:
    """Fly back over the crumbs from `first` on, and to the pose and joints of a REFERENCE row."""
    s.begin("rejoin")
    crumbs = s.trail.crumbs
    goal = crumbs[first]._replace(
        p_WB=np.array(row["p_WB"]), R_WB=np.array(row["R_WB"]), away=np.zeros(3)
    )
    fly_back(s, [goal, *crumbs[first:]])
    s.wait(STEADY_S)
    del crumbs[first:]


def build_rest_of(taken: TakenOver) -> Table:
    """Return the rest of an interrupted reference; it starts at rest.

    Its time is scaled at first: t^2 / (2 T) until T = AGAIN_S, then t - T / 2.
    """
    table, T = taken.table, AGAIN_S
    left = table[table["t"] > taken.along + 1e-9]
    rows = np.concatenate([taken.row[None], left]) if len(left) else table[-1:].copy()
    own = np.maximum(rows["t"] - taken.along, 0.0)
    own[0] = 0.0
    t = np.where(own < 0.5 * T, np.sqrt(2.0 * T * own), own + 0.5 * T)
    pace = np.minimum(t / T, 1.0)
    for field, of in (("a_WB", "v_WB"), ("wd_WB_B", "w_WB_B")):
        rows[field] = rows[field] * (pace**2)[:, None]
        rows[field] += np.where(t < T, 1.0 / T, 0.0)[:, None] * rows[of] if len(left) else 0.0
    for field in ("v_WB", "w_WB_B", "v_WT", "qd"):
        rows[field] *= pace[:, None]
    rows["t"] = t
    return rows
