"""A pilot who takes a running mission over by a switch, and gives it back.

While the switch is on, the pilot's stick moves the platform in a mode of run/hand_flight.py, the
arms stay, and rules only tell. The switch wins at any time: over a phase, and over the response
of a rule. What is flown after the pilot gave back:

- a phase of free flight goes on: back to where it was taken over, along what the pilot flew or a
  straight way that is free, and the rest of the reference from rest;
- a phase in which something is touched, carried, or led to by hands raises `GivenBack`: a contact
  that can begin anew (run/orders.py) catches that; otherwise the robot comes home and lands.
"""

from __future__ import annotations

import weakref
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
"""s without the pilot's stick after which the robot is taken back, comes home and lands."""
STANDS_S, STILL_MPS, SINK_S = 2.0, 0.05, 60.0  # asked to sink, and slower or for long: it stands
STEADY_S = 2.0  # s, of hovering before an interrupted phase goes on
AGAIN_S = 1.0  # s, in which an interrupted reference comes up to its speed


class TakenOver(NamedTuple):
    """Where a phase was taken over."""

    phase: str
    row: Any  # REFERENCE, what was commanded then
    table: Table  # that was tracked
    along: float  # s, along it
    engaged: bool  # something was touched, carried, or led to by hands


class GivenBack(Exception):
    """The pilot gave back where the interrupted phase does not go on by itself."""

    def __init__(self, says: str, taken: TakenOver, first: int, repeats: bool = False) -> None:
        """`first` is the crumb of the trail at which it was taken over.

        `repeats`: a mission that knows how may go on.
        """
        super().__init__(says)
        self.taken, self.repeats, self.first = taken, repeats, first


class PilotLanded(Exception):
    """The pilot has landed: the mission is over."""


class Pilot:
    """The pilot's switch and stick of one flight."""

    def __init__(self, s: Supervisor) -> None:
        self._s: Supervisor = weakref.proxy(s)  # it has this: a cycle would keep the flight
        self.switch = False
        """Whether the pilot wants the robot, or has it."""
        self.flies = False
        """Whether the stick is followed now."""
        self.says = ""
        """What became of the last order, for a display."""
        self.away_s = 0.0
        """Time (s) that the mission has stood still for pilots."""
        self.mode = Mode.ATTITUDE
        """What the stick shall do."""
        self.follows = True
        """Whether a switch on the vehicle itself ends what the mission flies."""
        self._outside = False
        self._hand: HandFlight | None = None
        self._axes: list[float] | None = None  # of a stick that was not followed yet
        self._heard = 0.0

    def take_over(self) -> Result:
        """Take the robot from the next tick on; refused only while the motors are off."""
        says = ""
        if not self._s.kind.flies:
            says = "take_over refused: the robot does not fly in this mission"
        elif self._s.senses.told("active") < 0.5:
            says = "take_over refused: the motors are off"
        self.switch, self.says = self.switch or not says, says
        return Result(not says, says, self._s.vehicle.t)

    def give_back(self) -> Result:
        """Give the robot back; refused where the position loops could not take over."""
        says = ""
        if not self.switch and not self.flies:
            says = "give_back refused: no pilot has taken over"
        elif self._hand is not None and self.switch:
            says = self._hand.find_refusal().replace("recover_from_manual", "give_back")
        self.switch, self.says = self.switch and bool(says), says
        return Result(not says, says, self._s.vehicle.t)

    def choose(self, mode: Mode) -> Result:
        """Choose what the stick does; refused where the robot cannot tilt in place."""
        says = ""
        if mode == Mode.ANGLE and find_tilt_in_place(self._s) <= 0.0:
            robot = self._s.vehicle.robot.name
            says = f"angle mode refused: {robot} cannot tilt in place, its rotors are parallel"
        self.mode, self.says = self.mode if says else mode, says
        if self._hand is not None:
            self._hand.mode = self.mode
        return Result(not says, says, self._s.vehicle.t)

    def move(self, axes: list[float]) -> None:
        """Take the stick: right, ahead, turn, climb. It counts for 0.5 s, then it is let go."""
        self._axes, self._heard = axes, self._s.vehicle.t

    def follow_switch(self) -> None:
        """See what a switch on the vehicle itself says, which always wins; raises PilotLanded."""
        vehicle = self._s.vehicle
        if vehicle.stopped and (self.switch or self.flies):
            self.switch = False
            raise PilotLanded(f"the pilot took over; {vehicle.stopped}")
        if not self.follows:
            return
        if vehicle.piloted:
            self.switch, self._outside = True, True
            self.move([0.0, 0.0, 0.0, 0.0])  # the vehicle follows a stick of its own
        elif self._outside:
            self._outside = False
            self.give_back()

    @property
    def flown(self) -> str:
        """The mode that is in effect, "" where no pilot flies."""
        return "" if self._hand is None else str(self._hand.flown)

    @property
    def lacks(self) -> str:
        """Why the stick does not do what the mode says, or cannot be given back; "" otherwise."""
        return "" if self._hand is None else self._hand.says or self._hand.find_refusal()

    def fly(self) -> None:
        """Let the pilot fly, and bring the robot back to the mission.

        Raises GivenBack, PilotLanded, and RuleActed where no computer is left to follow a stick.
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
        """Fly by the stick until the pilot gives back; returns whether there was one to the end."""
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
        """Nobody is at the stick, and it is too low to recover: go down, level."""
        uav.stick(climb=-CLIMB)
        asked = self._s.vehicle.t - self._heard - SILENT_S  # s, for which it has sunk
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
    """Return what is left of an interrupted reference; it starts at rest.

    Its own time runs slower at first: t^2 / (2 T) until T = AGAIN_S, then t - T / 2.
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
