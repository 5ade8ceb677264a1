"""Execution of commands: state of the vehicle, motions one at a time, refusals, ticks."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.description.mission.safety import Checklist, Fence
from skywright.errors import InputError
from skywright.vehicle.arguments import check_number
from skywright.vehicle.arm_commands import ARM_STREAMS, ArmCommand, get_entry
from skywright.vehicle.commands import (
    NEEDS,
    Command,
    ControlMode,
    Need,
    State,
    explain_refusal,
)
from skywright.vehicle.conditions import find_lack
from skywright.vehicle.drives import (
    Drive,
)
from skywright.vehicle.interface import Backend, Ticked
from skywright.vehicle.motions import STANDS_M, Arrival, Motion, Motions
from skywright.vehicle.preflight import Checked, run_checklist
from skywright.vehicle.recorded import RecordedVehicle
from skywright.vehicle.results import Handle, Result

Array = NDArray[np.float64]

STREAMS = (
    Command.SET_POSE, Command.SET_VELOCITY, Command.SET_ATTITUDE, Command.SET_JOINTS, *ARM_STREAMS,
)  # fmt: skip
SETTLE_S = 1.0  # s, on the ground while the estimator settles


class Commanded:
    """A vehicle with a state, which executes one motion at a time."""

    def __init__(
        self,
        backend: Backend,
        *,
        arrival: Arrival | None = None,
        checklist: Checklist | None = None,
        fence: Fence | None = None,
        tick: Callable[[], Ticked] | None = None,
        waits: bool = False,
    ) -> None:
        """`arrival`: see Arrival (default: 5 cm for 1 s).

        `checklist` must pass before the motors start (default: no checks), and goals must lie
        within the `fence` (default: none). `tick` flies a mission tick (default: that of the back
        end). `waits` is the default of `wait` in commands.
        """
        self.backend, self.checklist, self.fence = backend, checklist, fence
        self._fly = Motions(backend, arrival or Arrival(), checklist)
        self.mode = ControlMode.OFF
        self.on_state: Callable[[State], None] | None = None
        self.waits, self._tick = waits, tick or backend.tick
        self._motion: Motion | None = None
        self._handle: Handle | None = None
        self._drive: Drive | None = None
        self._ground = backend.robot.platform.gear_height_m
        self._state = self._find_state()
        if self.is_turning:
            self.mode = ControlMode.EXTERNAL

    # --- state -------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """The present state."""
        return self._state

    @property
    def home(self) -> Array | None:
        """Home (3,) m in W: the position of the first take-off, or that of `set_home`."""
        return self._fly.home

    @property
    def checked(self) -> list[Checked]:
        """Results of the last pre-flight checks."""
        return self._fly.checked

    @property
    def is_turning(self) -> bool:
        """Whether the motors are on."""
        return bool(self.backend.reference_now["active"] > 0.5)

    def _find_state(self) -> State:
        """Return the state of a vehicle from its motors, position and estimate."""
        if isinstance(self.backend, RecordedVehicle):
            return self.backend.state
        if not self.is_turning:
            return State.LANDED_DISARMED if self.backend.localised else State.UNINITIALIZED
        high = float(self.backend.estimate["p_WB"][2]) > self._ground + STANDS_M
        return State.FLYING_AUTO if high else State.LANDED_ARMED

    def _enter(self, state: State | None) -> None:
        if state is not None and state != self._state:
            self._state = state
            if self.on_state is not None:
                self.on_state(state)

    # --- ticks -------------------------------------------------------------------------------

    def tick(self) -> Ticked:
        """Fly one mission tick (20 ms)."""
        if self._drive is not None:
            self.backend.track(self._drive.step())
        ticked = self._tick()
        self._look()
        return ticked

    def wait(self, seconds: float) -> None:
        """Fly for a time (s)."""
        end = self.backend.t + check_number("seconds", seconds)
        while self.backend.t < end - 1e-9:
            self.tick()

    def end(self, reason: str) -> None:
        """End the present motion, and update state and mode after another controller has flown."""
        self._interrupt(reason)
        self._enter(self._find_state())
        self.mode = ControlMode.EXTERNAL if self.is_turning else ControlMode.OFF

    def _look(self) -> None:
        """Advance the motion, and update the state after a tick."""
        if isinstance(self.backend, RecordedVehicle):
            self._enter(self.backend.state)
            return
        settled = self.backend.t >= SETTLE_S - 1e-9 and self.backend.localised
        if self._state == State.UNINITIALIZED and settled:
            self._enter(State.LANDED_DISARMED)
        if self._drive is not None and self._drive.has_touched_down:
            self._finish(Result(True, "touched down", self.backend.t))
            self._stop()
        if self._motion is not None:
            self._advance()

    def _advance(self) -> None:
        """Let the present motion prepare the next tick."""
        assert self._motion is not None
        try:
            next(self._motion)
        except StopIteration as stop:
            self._finish(stop.value)
        except InputError as error:  # the motion ends; the flight continues
            self._finish(Result(False, str(error), self.backend.t))
        except Exception as error:
            self._interrupt(f"the motion failed: {error}")
            raise

    # --- execution of commands ----------------------------------------------------------------

    def find_refusal(
        self, command: Command | ArmCommand, goal: Array | None = None, hand: int = 0
    ) -> str:
        """Return the reason why a command would be refused now, "" if it would be accepted.

        `goal` (3,) m is its goal.
        """
        says = self.backend.refuses
        if says:
            return f"{command} refused: {says}"
        says = explain_refusal(command, get_entry(command), self._state)
        if says:
            return says
        for need in get_entry(command).needs:
            if need == Need.CHECKLIST:
                says = self._check()
            elif need == Need.STARTED:
                says = self._find_start()
            else:
                says = find_lack(need, self.backend, self.fence, goal, hand)
            if says:
                return f"{command} refused: {says}"
        return ""

    def _check(self) -> str:
        """Run the checklist if the motors are off; returns the failed checks."""
        if self.checklist is None or self._state != State.LANDED_DISARMED:
            return ""
        self._fly.checked = run_checklist(self.checklist, self.backend, self.fence)
        return "; ".join(c.says for c in self.checked if not c.passed)

    def _find_start(self) -> str:
        """Return which command under way has not yet started the motors, "" if none.

        Without this, `hold` would end the spin check of a take-off, and then fly.
        """
        under_way = None if self._handle is None else self._handle.command
        if under_way not in (Command.ARM, Command.TAKE_OFF):
            return ""
        if self.is_turning and self._fly.spun:
            return ""
        return f"{under_way} is still starting the motors; `stop_motors(confirm=True)` ends it"

    def _refuse(self, command: Command | ArmCommand, need: Need) -> Handle:
        says = self.find_refusal(command) or f"{command} refused: it requires that {NEEDS[need]}"
        return self._ended(command, Result(False, says, self.backend.t))

    def refuse(self, command: Command | ArmCommand, says: str) -> Handle:
        """Return the handle of a refused command, with the reason."""
        return self._ended(command, Result(False, f"{command} refused: {says}", self.backend.t))

    def _ended(self, command: Command | ArmCommand, result: Result) -> Handle:
        handle = Handle(command, self.tick)
        handle.end(result)
        return handle

    def _do(
        self, command: Command | ArmCommand, what: Callable[[], None], goal: Array | None = None
    ) -> Handle:
        """Execute a command that ends at once, unless it is refused."""
        says = self.find_refusal(command, goal)
        if says:
            return self._ended(command, Result(False, says, self.backend.t))
        streams = command in STREAMS
        if get_entry(command).interrupts and not (streams and self._motion is None):
            self._interrupt(f"interrupted by {command}")
        what()
        return self._ended(command, Result(True, "", self.backend.t))

    def _start(
        self,
        command: Command | ArmCommand,
        fly: Callable[[], Motion],
        wait: bool | None,
        goal: Array | None = None,
    ) -> Handle:
        """Start a motion, unless it is refused."""
        says = self.find_refusal(command, goal)
        if says:
            return self._ended(command, Result(False, says, self.backend.t))
        self._interrupt(f"interrupted by {command}")
        self._handle = handle = Handle(command, self.tick)
        self.mode = ControlMode.MOTION
        self._enter(get_entry(command).during)
        self._motion = fly()
        self._advance()
        if self.waits if wait is None else wait:
            handle.wait()
        return handle

    def _interrupt(self, reason: str) -> None:
        if self._motion is not None:
            self._motion.close()
        if self._handle is not None:
            self._handle.end(Result(False, reason, self.backend.t))
        self._motion, self._handle, self._drive = None, None, None

    def _finish(self, result: Result) -> None:
        """End the present motion; the platform holds its reference."""
        self._motion, self._drive = None, None
        handle, self._handle = self._handle, None
        if handle is None:
            return
        after = get_entry(handle.command).after
        if result.ok:
            self._enter(after)
        elif self._state == State.TAKING_OFF:
            if not self._fly.spun:  # it ended the check of `arm`, and the arms do not fold
                self._fly.moves.motors(False)
            self._enter(self._find_state())
        elif self._state == State.LANDING:
            self._enter(State.FLYING_AUTO)
        self.mode = ControlMode.HOLD if self.is_turning else ControlMode.OFF
        handle.end(result._replace(t_s=self.backend.t))

    def _take(self, cls: type[Any], mode: ControlMode) -> Any:
        """Return the drive of a stream, created if it is not active."""
        if not isinstance(self._drive, cls):
            before, self._drive = self._drive, cls(self.backend)
            if before is not None:
                self._drive.adopt(before)
        self.mode = mode
        return self._drive

    def _stop(self) -> None:
        self._drive, self.mode = None, ControlMode.OFF
        self._fly.moves.motors(False)
        self._enter(State.LANDED_DISARMED)

    def _heading(self, yaw: float | None) -> float:
        R = self.backend.reference_now["R_WB"]
        return math.atan2(R[1, 0], R[0, 0]) if yaw is None else check_number("yaw", yaw)
