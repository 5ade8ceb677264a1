"""The arms of a vehicle: commands with a handle, refusals with a reason, streams that expire.

`CommandedArms` complements `Uav` and shares its motion: a command of the arms brakes and holds the
platform, and a command of the platform leaves the hands' tasks unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skywright.description.robot.limbs import SIDES, list_grippers
from skywright.errors import InputError
from skywright.models.rigid_body import posture
from skywright.vehicle.actuators._gripper import GripperState
from skywright.vehicle.arguments import check_bounded, check_number, check_positive, check_vector
from skywright.vehicle.arm_commands import ArmCommand
from skywright.vehicle.arms.ports import ArmModel, HandForce, Hands, HandState
from skywright.vehicle.arms_interface import Arms, check_grippers
from skywright.vehicle.drives import Drive
from skywright.vehicle.hand_stream import Told
from skywright.vehicle.motions import TICK, Motion
from skywright.vehicle.results import Handle, Result
from skywright.vehicle.uav import Uav

Array = NDArray[np.float64]
Points = Mapping[str, ArrayLike]

NEAR_M, DWELL_S, PATIENCE_S = 0.02, 0.3, 8.0
"""Distance (m) and dwell (s) of an arrival of a hand; a motion fails PATIENCE_S after its planned
end."""
FELT, GRIPPED = 0.8, 0.6  # share of a push that must be measured; of a grasp (friction)
LOOSE_N, LOOSEN_S = 0.1, 2.0  # N of a grasp before the hands part, and s until then
APART_M = 0.1
STILL_M, EMPTY_M = 2e-5, 1e-3
"""Fingers that move less than STILL_M in a tick are at rest; slow ones below half the speed of
their motor. Grippers within EMPTY_M of an end are at that end."""


class PositionSensor:
    """Measures the platform's position by a hand that rests on a fixed object."""

    def __init__(self, uav: Uav, hand: int) -> None:
        self._backend, self._hand = uav.backend, hand
        self._anchor = np.array(uav.backend.look(Hands).p_WH[hand])

    def read(self) -> Array:
        """Return p_WB (3,) m from the present arm angles and attitude."""
        b = self._backend
        p_BH = np.array(b.look(Hands).p_BH[self._hand])
        return np.asarray(self._anchor - np.array(b.estimate["R_WB"]) @ p_BH)


class CommandedArms:
    """Commands of the arms of a vehicle; see ARM_TABLE."""

    def __init__(self, uav: Uav) -> None:
        self._uav, self.plain = uav, Arms(uav.backend)
        """`plain` executes the same tasks at once, as missions do: without state and handle."""

    # --- joints ------------------------------------------------------------------------------

    def rest_pose(self, *, wait: bool | None = None) -> Handle:
        """Fold the arms as for take-off and landing; `land` also does so."""
        return self._pose(ArmCommand.REST_POSE, "folded", wait)

    def operation_pose(self, *, wait: bool | None = None) -> Handle:
        """Move the arms to the robot's working posture."""
        return self._pose(ArmCommand.OPERATION_POSE, "working", wait)

    def move_to(
        self, q: ArrayLike, seconds: float | None = None, *, wait: bool | None = None
    ) -> Handle:
        """Move all joints to q (n_joints,) rad; a passive joint's entry is ignored.

        `seconds` is the duration; it is extended if the servos are slower.
        """
        goal = check_vector("q", q, self._uav.backend.n_joints)
        says = self._uav.find_beyond(goal)
        if says:
            return self._uav.refuse(ArmCommand.MOVE_TO, says)
        play = None if seconds is None else check_positive("seconds", seconds)
        return self._start(ArmCommand.MOVE_TO, lambda: self._move(goal, play), wait)

    def torques(self, hand: str, tau: ArrayLike, delta: ArrayLike | None = None) -> Handle:
        """Control the joint torques tau (4,) N m of an arm; a joint with `delta` 1 holds its
        angle."""
        held = None if delta is None else check_vector("delta", delta, 4)
        wanted = check_vector("tau", tau, 4)
        return self._do(ArmCommand.TORQUES, lambda: self.plain.torques(hand, wanted, held))

    def torque_off(self, hand: str) -> Handle:
        """Make an arm compliant: zero spring torque, the servos follow the output links."""
        return self._do(ArmCommand.TORQUE_OFF, lambda: self.plain.torques(hand, np.zeros(4)))

    def torque_on(self, hand: str) -> Handle:
        """Hold an arm's joints at their present angles."""

        def hold() -> None:
            self.plain.hold_joints(hand)

        return self._do(ArmCommand.TORQUE_ON, hold)

    # --- hands -------------------------------------------------------------------------------

    def hands_to(
        self, goals: Points, speed: float | None = None, roll: float | None = None,
        *, wait: bool | None = None,
    ) -> Handle:  # fmt: skip
        """Move hands to points (3,) m in W, by hand, at `speed` (m/s); see `Arms.hands_to`."""
        points, v = self._check(goals), _check_speed(speed)
        turn = None if roll is None else check_number("roll", roll)

        def fly() -> Motion:
            self.plain.hands_to(points, v, turn)
            return self._arrive(points, v)

        return self._start(ArmCommand.HANDS_TO, fly, wait)

    def hands_to_marker(self, places: Points, speed: float | None = None) -> Handle:
        """Move hands to points (3,) m in the frame of the visible marker, continuously."""
        points, v = self._check(places), _check_speed(speed)
        return self._do(ArmCommand.HANDS_TO_MARKER, lambda: self.plain.hands_to_marker(points, v))

    def push(
        self, forces: Points, *, at: Points | None = None, ramp_s: float = 0.5,
        wait: bool | None = None,
    ) -> Handle:  # fmt: skip
        """Exert forces (3,) N in W, by hand, over `ramp_s`; ends when measured, forces remain."""
        asked, places = self._check(forces), self._check(at) if at else {}
        ramp = check_positive("ramp_s", ramp_s)

        def fly() -> Motion:
            self.plain.push(asked, at=places or None, ramp_s=ramp)
            return self._feel(asked, FELT, ramp)

        return self._start(ArmCommand.PUSH, fly, wait)

    def grasp(
        self, force: float, p_left: ArrayLike | None = None, p_right: ArrayLike | None = None,
        ramp_s: float = 2.0, *, hand: str | None = None, wait: bool | None = None,
    ) -> Handle:  # fmt: skip
        """Hold an object by friction with `force` (N) until the next grasp or release.

        Grippers close, that of `hand` or all. Hands without fingers press towards each other around
        two points (3,) m in W; hooks hold objects that hang on them.
        """
        size = check_positive("force", force)
        if hand is not None or list_grippers(self._uav.backend.robot):
            if p_left is not None or p_right is not None:
                raise InputError("p_left and p_right are of hands without fingers; valid: force")
            return self._grip(ArmCommand.GRASP, hand, size, wait)
        left, right = check_vector("p_left", p_left), check_vector("p_right", p_right)
        ramp = check_positive("ramp_s", ramp_s)

        def fly() -> Motion:
            self.plain.squeeze(size, left, right, ramp_s=ramp)
            along = (right - left) / max(float(np.linalg.norm(right - left)), 1e-9)
            return self._feel({"left": size * along, "right": -size * along}, GRIPPED, ramp)

        return self._start(ArmCommand.GRASP, fly, wait)

    def release(self, hand: str | None = None, *, wait: bool | None = None) -> Handle:
        """Open grippers, that of `hand` or all.

        Without fingers: loosen a grasp to 0.1 N over 2 s, then part the hands by 0.1 m each.
        """
        arm = self._uav.backend.robot.arm
        if hand is not None or list_grippers(self._uav.backend.robot):
            force = 0.0 if arm is None else arm.hand.grip_force_n
            return self._grip(ArmCommand.RELEASE, hand, -force, wait)

        def fly() -> Motion:
            left, right = (np.array(p) for p in self._uav.backend.look(Hands).p_WH[:2])
            apart = APART_M * (left - right) / max(float(np.linalg.norm(left - right)), 1e-9)
            self.plain.squeeze(LOOSE_N, left, right, ramp_s=LOOSEN_S)
            return self._part({"left": left + apart, "right": right - apart})

        return self._start(ArmCommand.RELEASE, fly, wait)

    def bar_to(
        self, p: ArrayLike, n: ArrayLike, width: float, speed: float = 0.05, force: float = 0.0
    ) -> Handle:
        """Move a bar held at `width` (m) to centre p (3,) m and direction n (3,), continuously."""
        centre, along = check_vector("p", p), check_vector("n", n)
        held, v = check_positive("width", width), check_positive("speed", speed)
        press = check_number("force", force)
        return self._do(ArmCommand.BAR_TO, lambda: self.plain.bar_to(centre, along, held, v, press))

    def tare(self, seconds: float = 0.5, *, wait: bool | None = None) -> Handle:
        """Set the mean contact forces estimated over `seconds` (s) to zero."""
        total = check_positive("seconds", seconds)

        def fly() -> Motion:
            self.plain.tare()
            yield from self._pause(total)
            self.plain.tare(on=False)
            return Result(True)

        return self._start(ArmCommand.TARE, fly, wait)

    def sense_position(self, hand: str) -> PositionSensor:
        """Use a hand that rests on a fixed object as a position sensor (Suarez 2020, VI).

        Raises InputError with the reason if it is refused, for example if the hand has no contact.
        """
        h = self._find(hand)
        says = self._uav.find_refusal(ArmCommand.SENSE_POSITION, hand=h)
        if says:
            raise InputError(says)
        return PositionSensor(self._uav, h)

    def platform_shift(self, hand: str) -> Array:
        """Return the displacement (3,) m of the platform for a good pose of the arm."""
        return self.plain.platform_shift(hand)

    # --- streams -----------------------------------------------------------------------------

    def set_hands(self, goals: Points, speed: float | None = None) -> Handle:
        """Move hands to points (3,) m in W; called at up to 50 Hz, a stream."""
        points = self._check(goals)
        v = _check_speed(speed)
        return self._stream(ArmCommand.SET_HANDS, {h: Told("p", p, v) for h, p in points.items()})

    def hands_velocity(self, velocities: Points) -> Handle:
        """Move hands at velocities (3,) m/s in W; called at up to 50 Hz, a stream."""
        speeds = self._check(velocities)
        return self._stream(ArmCommand.HANDS_VELOCITY, {h: Told("v", v) for h, v in speeds.items()})

    def set_forces(self, forces: Points) -> Handle:
        """Exert forces (3,) N in W; called at up to 50 Hz, a stream."""
        asked = self._check(forces)
        return self._stream(ArmCommand.SET_FORCES, {h: Told("f", f) for h, f in asked.items()})

    # --- execution ---------------------------------------------------------------------------

    def _pose(self, command: ArmCommand, name: str, wait: bool | None) -> Handle:
        q = posture(self._uav.backend.robot, name) if self._uav.backend.n_joints else np.zeros(0)
        return self._start(command, lambda: self._move(q, None), wait)

    def _move(self, goal: Array, seconds: float | None) -> Motion:
        return self._uav.move_joints(goal, seconds)

    def _stream(self, command: ArmCommand, told: Mapping[str, Told]) -> Handle:
        def tell(drive: Drive) -> None:
            for name, what in told.items():
                drive.tell_hand(self._find(name), what)

        return self._uav.stream_arms(command, tell)

    def _do(self, command: ArmCommand, what: Callable[[], None]) -> Handle:
        def fly() -> Motion:
            what()
            return Result(True)
            yield

        return self._uav.start_arms(command, fly, None)

    def _start(self, command: ArmCommand, fly: Callable[[], Motion], wait: bool | None) -> Handle:
        return self._uav.start_arms(command, fly, wait)

    def _find(self, name: str) -> int:
        b = self._uav.backend
        valid = SIDES[: int(b.look(ArmModel).n_hands)] if "hands" in b.offers else ()
        if name not in valid:
            raise InputError(f"hand {name!r} is unknown; valid: {', '.join(valid) or 'none'}")
        return valid.index(name)

    def _check(self, values: Points) -> dict[str, Array]:
        if not isinstance(values, Mapping) or not values:
            raise InputError(f"{values!r} names no hand; valid: a vector for each, by hand")
        if "hands" in self._uav.backend.offers:
            for name in values:
                self._find(name)
        return {name: check_bounded(name, value) for name, value in values.items()}

    def _pause(self, seconds: float) -> Generator[None, None, None]:
        end = self._uav.backend.t + seconds
        while self._uav.backend.t < end - 1e-9:
            yield

    def _arrive(self, goals: dict[str, Array], speed: float | None) -> Motion:
        """Wait until hands have been near their goals for DWELL_S."""
        b = self._uav.backend
        places = {self._find(name): p for name, p in goals.items()}
        way = max(
            (float(np.linalg.norm(b.look(Hands).p_WH[h] - p)) for h, p in places.items()),
            default=0.0,
        )
        ends = b.t + way / (speed or float(b.look(HandState).speed_hand)) + PATIENCE_S
        near = 0.0
        while near < DWELL_S - 1e-9:
            yield
            off = {h: float(np.linalg.norm(b.look(Hands).p_WH[h] - p)) for h, p in places.items()}
            worst = max(off, key=lambda h: off[h])
            near = near + TICK if off[worst] <= NEAR_M else 0.0
            if b.t > ends:
                stopped = b.look(HandState).saturated[worst] > 0.5
                why = "; a limit of its joints or its reach holds it back" if stopped else ""
                return Result(
                    False,
                    f"{SIDES[worst]} hand {off[worst]:.3f} m from its goal (tolerance "
                    f"{NEAR_M:g} m){why}",
                )
        return Result(True)

    def _feel(self, asked: dict[str, Array], share: float, ramp_s: float) -> Motion:
        """Wait until a share of the forces along their directions has been measured for DWELL_S."""
        b = self._uav.backend
        forces = {self._find(name): f for name, f in asked.items()}
        ends, felt = b.t + ramp_s + PATIENCE_S, 0.0
        while felt < DWELL_S - 1e-9:
            yield
            found: dict[int, float] = {}
            for h, f in forces.items():
                size = max(float(np.linalg.norm(f)), 1e-9)
                found[h] = float(b.look(HandForce).f_WH[h] @ f) / size**2
            worst = min(found, key=lambda h: found[h])
            felt = felt + TICK if found[worst] >= share else 0.0
            if b.t > ends:
                size = float(np.linalg.norm(forces[worst]))
                return Result(
                    False,
                    f"{SIDES[worst]} hand exerts {found[worst] * size:.2f} N of {size:.2f} N",
                )
        return Result(True)

    def _grip(
        self, command: ArmCommand, hand: str | None, force: float, wait: bool | None
    ) -> Handle:
        """Close (`force` above 0) or open grippers; ends when the fingers are at rest."""
        names = list_grippers(self._uav.backend.robot) if hand is None else [hand]
        check_grippers(self._uav.backend, names)

        def fly() -> Motion:
            self.plain.grip(dict.fromkeys(names, force))
            return self._stand([SIDES.index(name) for name in names], force)

        return self._start(command, fly, wait)

    def _stand(self, hands: list[int], force: float) -> Motion:
        """Wait until the fingers have been at rest; fails if they stop at a wrong opening."""
        b, arm = self._uav.backend, self._uav.backend.robot.arm
        assert arm is not None
        speed = arm.hand.grip_speed_mps * min(abs(force) / arm.hand.grip_force_n, 1.0)
        least, most = arm.hand.opening_min_m, arm.hand.opening_max_m
        ends, still = b.t + (most - least) / speed + PATIENCE_S, min(STILL_M, 0.5 * TICK * speed)
        stood, before = 0.0, np.full(len(hands), np.inf)
        while stood < DWELL_S - 1e-9:
            yield
            now = np.array(b.look(GripperState).opening)[hands]
            empty = now < least + EMPTY_M
            stands = (np.abs(now - before) < still) | empty  # pads in contact vibrate
            stood, before = stood + TICK if stands.all() else 0.0, now
            if b.t > ends:
                return Result(False, f"the fingers still move, {1e3 * now[0]:.0f} mm apart")
        for h, opening in zip(hands, before, strict=True):
            if force > 0.0 and opening < least + EMPTY_M:
                return Result(False, f"the {SIDES[h]} gripper closed on nothing")
            if force < 0.0 and opening < most - EMPTY_M:
                return Result(False, f"the {SIDES[h]} gripper opened by {1e3 * opening:.0f} mm")
        return Result(True)

    def _part(self, goals: dict[str, Array]) -> Motion:
        yield from self._pause(LOOSEN_S)
        self.plain.hands_to(goals)
        return (yield from self._arrive(goals, None))


def _check_speed(speed: float | None) -> float | None:
    """Return a speed (m/s) or None; raises InputError unless it is finite and above 0."""
    return None if speed is None else check_positive("speed", speed)
