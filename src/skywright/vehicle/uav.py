"""The platform with the states and commands of UAL; a refused command states its reason.

A command returns a `Handle` at once, or with `wait=True` when it has ended. `tick()` flies one
mission tick (20 ms). `vehicle/commands.py` has the table of what is accepted in which state.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skywright.errors import InputError
from skywright.models.rigid_body import joint_names
from skywright.vehicle.arguments import (
    LARGEST,
    check_bounded,
    check_heading,
    check_number,
    check_vector,
)
from skywright.vehicle.arm_commands import ArmCommand
from skywright.vehicle.attitude_drive import AttitudeDrive, check_attitude
from skywright.vehicle.commanded import Commanded
from skywright.vehicle.commands import (
    LANDED,
    Command,
    ControlMode,
    Need,
    State,
)
from skywright.vehicle.drives import (
    Drive,
    PoseDrive,
    Stick,
    StickDrive,
    VelocityDrive,
    build_row_here,
)
from skywright.vehicle.geodesy import Geodetic, to_local
from skywright.vehicle.motions import Motion
from skywright.vehicle.results import Handle, Result

Array = NDArray[np.float64]


LEAST_RISE = 0.1  # m, of a take-off
IN_RANGE = 1e-3  # rad, by which a joint's goal may exceed its range, due to rounding


class Uav(Commanded):
    """The platform of a vehicle and its commands."""

    def arm(self, *, wait: bool | None = None) -> Handle:
        """Start the motors on the ground, after the checklist and its spin check."""
        return self._start(Command.ARM, self._fly.arm, wait)

    def disarm(self) -> Handle:
        """Stop the motors on the ground."""
        return self._do(Command.DISARM, self._stop)

    def take_off(self, height: float, *, wait: bool | None = None) -> Handle:
        """Climb to `height` (m) of the platform's origin above the ground.

        Raises InputError if a swinging link would not hang freely at this height.
        """
        height = check_number("height", height, LARGEST)
        p = np.array(self.backend.estimate["p_WB"])
        low = float(p[2]) + LEAST_RISE
        if self.state in LANDED and height < low:
            return self.refuse(
                Command.TAKE_OFF, f"height = {height:g} m; valid: {low:.2f} m or more, above here"
            )
        p[2] = height
        if self.backend.arc is not None and height < self.backend.arc.top:
            raise InputError(
                f"height = {height:g} m is too low: the link hangs freely only above "
                f"{self.backend.arc.top:.2f} m"
            )
        return self._start(
            Command.TAKE_OFF,
            lambda: self._fly.rest_then(lambda: self._fly.take_off(height)),
            wait,
            p,
        )

    def go_to(self, p: ArrayLike, yaw: float | None = None, *, wait: bool | None = None) -> Handle:
        """Fly straight to p (3,) m in W with the heading `yaw` (rad; default: as it is).

        Raises InputError for a yaw of more than four turns, which would be in degrees.
        """
        goal, heading = check_bounded("p", p), check_heading(self._heading(yaw))
        return self._start(Command.GO_TO, lambda: self._fly.go_to(goal, heading), wait, goal)

    def go_to_geo(
        self, latitude: float, longitude: float, altitude: float, yaw: float | None = None,
        *, wait: bool | None = None,
    ) -> Handle:  # fmt: skip
        """Fly straight to a position in WGS 84: degrees, and m above the ellipsoid."""
        origin, heading = self.backend.world.origin, check_heading(self._heading(yaw))
        if origin is None:
            return self._refuse(Command.GO_TO_GEO, Need.ORIGIN)
        goal = check_bounded(
            "goal", to_local(origin, Geodetic.check(latitude, longitude, altitude))
        )
        return self._start(Command.GO_TO_GEO, lambda: self._fly.go_to(goal, heading), wait, goal)

    def go_home(self, *, wait: bool | None = None) -> Handle:
        """Fly above the home position at the present height."""
        if self.home is None:
            return self._refuse(Command.GO_HOME, Need.HOME)
        goal = np.array([*self.home[:2], self.backend.reference_now["p_WB"][2]])
        heading = self._heading(None)
        return self._start(Command.GO_HOME, lambda: self._fly.go_to(goal, heading), wait, goal)

    def hold(self, *, wait: bool | None = None) -> Handle:
        """Brake and hold the position."""
        return self._start(Command.HOLD, self._fly.hold, wait)

    def land(
        self, ground_height: float | None = None, here: bool = False, *, wait: bool | None = None
    ) -> Handle:
        """Descend to the ground and stop the motors, also on ground of unexpected height.

        `ground_height` (m) is the height of the platform's origin on the ground (default: on z =
        0). A link that swings is laid down along its arc; `here` omits the forward motion before
        that.
        """
        ground = self._ground
        if ground_height is not None:
            ground = check_number("ground_height", ground_height, LARGEST)
        return self._start(
            Command.LAND, lambda: self._fly.rest_then(lambda: self._fly.land(ground, here)), wait
        )

    def set_pose(
        self, p: ArrayLike, yaw: float | None = None, v: ArrayLike = (0.0, 0.0, 0.0),
        yaw_rate: float = 0.0,
    ) -> Handle:  # fmt: skip
        """Move the platform to p (3,) m in W and `yaw` (rad); called repeatedly, as a stream.

        For a moving pose, v (3,) m/s and `yaw_rate` (rad/s) are fed forward.
        """
        goal, heading = check_bounded("p", p), self._heading(yaw)
        ahead, rate = check_bounded("v", v), check_number("yaw_rate", yaw_rate)

        def tell() -> None:
            self._take(PoseDrive, ControlMode.POSE).tell(goal, heading, ahead, rate)

        return self._do(Command.SET_POSE, tell, goal)

    def set_velocity(
        self, v: ArrayLike, yaw_rate: float = 0.0, *, roll: float = 0.0, pitch: float = 0.0
    ) -> Handle:
        """Move at v (3,) m/s in W and turn at `yaw_rate` (rad/s), within the limits.

        A reference is valid for 0.5 s; then the platform brakes and holds. If it descends onto a
        surface, it has landed, and the motors stop. `roll` and `pitch` (rad) tilt a robot with
        lateral thrust in place; laws of other robots determine the tilt themselves.
        """
        velocity, rate = check_bounded("v", v), check_number("yaw_rate", yaw_rate)
        tilt = check_number("roll", roll), check_number("pitch", pitch)

        def tell() -> None:
            self._take(VelocityDrive, ControlMode.VELOCITY).tell(velocity, rate, *tilt)

        return self._do(Command.SET_VELOCITY, tell)

    def lift_off(self) -> Handle:
        """Let streams of references lift the robot off the ground while its motors turn."""
        return self._do(Command.LIFT_OFF, lambda: self._leave_ground(State.FLYING_AUTO))

    def _leave_ground(self, state: State) -> None:
        """Enter a state in the air; the first place that is left becomes the home position."""
        if self._state == State.LANDED_ARMED and self._fly.home is None:
            self._fly.home = np.array(self.backend.estimate["p_WB"])
        self._enter(state)

    def set_attitude(self, R_WB: ArrayLike, f_B: ArrayLike) -> Handle:
        """Hold the attitude R_WB (3, 3) and push with the force f_B (3,) N; a stream.

        No loop holds the position. A reference is valid for 0.5 s; then the platform levels and
        brakes. Laws of coplanar rotors derive the attitude from the force: f_B lies along z.
        The integrals of the law (wind, trim) are added to f_B.
        """
        R, f = check_attitude(R_WB), check_bounded("f_B", f_B)

        def tell() -> None:
            self._take(AttitudeDrive, ControlMode.ATTITUDE).tell(R, f)

        return self._do(Command.SET_ATTITUDE, tell)

    def set_joints(self, q: ArrayLike) -> Handle:
        """Move the arms' joints to q (n_joints,) rad; called at up to 50 Hz, as a stream.

        `set_pose` and `set_velocity` may run at the same time; otherwise the platform holds.
        """
        goal = check_vector("q", q, self.backend.n_joints)
        says = self.find_beyond(goal)
        if says:
            return self.refuse(Command.SET_JOINTS, says)

        def tell() -> None:
            (self._drive or self._take(PoseDrive, ControlMode.POSE)).tell_joints(goal)

        return self._do(Command.SET_JOINTS, tell)

    def find_beyond(self, q: Array) -> str:
        """Return which of the joints q (n_joints,) rad is outside its range, "" if none is."""
        robot, n = self.backend.robot, self.backend.n_joints
        low, high = (self.backend.model[0][name][:n] for name in ("q_min", "q_max"))
        beyond = (q < low - IN_RANGE) | (q > high + IN_RANGE)
        beyond[: int(robot.pendulum is not None)] = False  # no servo
        if not beyond.any():
            return ""
        j = int(np.argmax(beyond))
        name = joint_names(robot)[j]
        return f"q[{j}] = {q[j]:g} rad; {name} turns from {low[j]:.3g} to {high[j]:.3g} rad"

    def start_arms(
        self, command: ArmCommand, fly: Callable[[], Motion], wait: bool | None
    ) -> Handle:
        """Start a command of the arms (vehicle/commanded_arms.py): the platform brakes."""
        return self._start(command, lambda: self._fly.brake_then(fly), wait)

    def stream_arms(self, command: ArmCommand, tell: Callable[[Drive], None]) -> Handle:
        """Pass a streamed reference to the arms, in parallel with that of the platform."""
        return self._do(
            command, lambda: tell(self._drive or self._take(PoseDrive, ControlMode.POSE))
        )

    def start_joints(self, q: Array) -> Result | None:
        """Move the joints to q (n_joints,) rad and wait; returns the result."""
        handle = self.start_arms(ArmCommand.MOVE_TO, lambda: self.move_joints(q, None), True)
        return handle.result

    def move_joints(self, q: Array, seconds: float | None) -> Motion:
        """Move the joints to q (n_joints,) rad; ends when they have arrived."""
        return self._fly.move_joints(q, seconds)

    def set_home(self) -> Handle:
        """Make the present position the home position."""

        def note() -> None:
            self._fly.home = np.array(self.backend.estimate["p_WB"])

        return self._do(Command.SET_HOME, note)

    def take_over(self) -> Handle:
        """Give control to the pilot, whose stick the platform follows in attitude mode.

        A vehicle with its own pilot's switch is set to the pilot's mode.
        """
        if not self.find_refusal(Command.TAKE_OVER):
            says = self.backend.give_control()
            if says:
                return self._ended(Command.TAKE_OVER, Result(False, says, self.backend.t))

        def give() -> None:
            row = build_row_here(self.backend)
            if self.state != State.LANDED_ARMED:
                row["v_WB"][2] = min(max(row["v_WB"][2], -1.0), 1.0)
            self.backend.track(row[None])
            self._take(StickDrive, ControlMode.ATTITUDE)
            self._leave_ground(State.FLYING_MANUAL)

        return self._do(Command.TAKE_OVER, give)

    def stick(
        self, roll: float = 0.0, pitch: float = 0.0, yaw_rate: float = 0.0, climb: float = 0.0,
        thrust: float | None = None,
    ) -> Handle:  # fmt: skip
        """Set the pilot's stick: tilt (rad), turn (rad/s), climb (m/s) or thrust over weight.

        Positive roll moves to the right, positive pitch ahead. It is valid for 0.5 s; then the
        platform levels, holds its height and drifts.
        """
        told = Stick(
            check_number("roll", roll),
            check_number("pitch", pitch),
            check_number("yaw_rate", yaw_rate),
            check_number("climb", climb),
            None if thrust is None else min(max(check_number("thrust", thrust), 0.0), 2.0),
        )

        def tell() -> None:
            if isinstance(self._drive, StickDrive):
                self._drive.tell(told)

        return self._do(Command.STICK, tell)

    def recover_from_manual(self, *, wait: bool | None = None) -> Handle:
        """Take control from the pilot: brake from the present speed and hold the position."""
        if not self.find_refusal(Command.RECOVER_FROM_MANUAL):
            says = self.backend.take_control()
            if says:
                return self._ended(Command.RECOVER_FROM_MANUAL, Result(False, says, self.backend.t))

        def recover() -> Motion:
            self.backend.track(build_row_here(self.backend)[None])
            return self._fly.hold()

        return self._start(Command.RECOVER_FROM_MANUAL, recover, wait)

    def stop_motors(self, confirm: bool = False) -> Handle:
        """Stop the motors at once, also in the air; requires `confirm=True`."""
        if not confirm:
            return self._refuse(Command.STOP_MOTORS, Need.CONFIRMED)
        return self._do(Command.STOP_MOTORS, self._stop)
