"""Motions of the platform up to their result; each is a generator that advances once a tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.mission.safety import Checklist
from skywright.models.rigid_body import posture
from skywright.vehicle.arms_interface import Arms, find_led_joints
from skywright.vehicle.drives import VelocityDrive, build_row_here
from skywright.vehicle.interface import Backend
from skywright.vehicle.moves import Brake, Moves
from skywright.vehicle.preflight import Checked, check_rotors
from skywright.vehicle.results import Result

Array = NDArray[np.float64]
Motion = Generator[None, None, Result]

TICK = 0.02  # s
STANDS_M, STANDS_S, STANDS_MPS = 0.15, 0.3, 0.1  # landed: so far above its reference, at rest
SINK = 0.15  # m/s, descent below the expected ground
SINK_MAX = 5.0  # m, of that
SPIN_S = 0.5  # s, of the spin check
IN_GROUND = 0.025  # m, landed: so far above a reference that ends 0.05 m below the ground
AT_REST = 1e-3  # m/s and rad/s, below which a reference is at rest
FOLDED, JOINT_RAD, JOINT_PATIENCE = 0.02, 0.1, 5.0  # rad, rad, s
PRESSED = 0.02  # m, depth of the reference below the ground during the spin check


class Arrival(NamedTuple):
    """Conditions under which a motion counts as arrived."""

    tolerance_m: float = 0.05  # distance of the estimate from the goal
    dwell_s: float = 1.0  # time within the tolerance
    yaw_rad: float = 0.1
    patience_s: float = 10.0  # after the end of the reference


class Motions:
    """The motions of `Uav`; `checked` includes the results of the spin check."""

    def __init__(self, backend: Backend, arrival: Arrival, checklist: Checklist | None) -> None:
        self.backend, self.arrival, self.checklist = backend, arrival, checklist
        self.moves = Moves(backend, blend=True)
        self.checked: list[Checked] = []
        self.home: Array | None = None
        self.spun = self.is_turning
        """Whether the motors, if they turn, have passed the spin check, or need none."""

    @property
    def is_turning(self) -> bool:
        """Whether the motors are on."""
        return bool(self.backend.reference_now["active"] > 0.5)

    def arm(self) -> Motion:
        says = yield from self._spin()
        if says:
            return Result(False, f"arm refused: {says}")
        if not self.is_turning:
            self.moves.motors(True)
        return Result(True)

    def _spin(self) -> Generator[None, None, str]:
        """Run the motors with the reference slightly below the ground; returns the reason of a
        failure, or "". The check of motors that turn is not repeated if it has passed."""
        wanted = self.checklist is not None and self.checklist.spin
        self.spun = not wanted or (self.spun and self.is_turning)
        if self.checklist is None or self.spun:
            return ""
        row = build_row_here(self.backend)
        row["p_WB"][2] -= PRESSED
        row["v_WB"] = 0.0
        self.backend.track(row[None])
        yield from self._pause(SPIN_S)
        found = check_rotors(self.checklist, self.backend)
        self.checked, self.spun = [*self.checked, found], found.passed
        if found.passed:
            return ""
        self.moves.motors(False)
        return found.says

    def take_off(self, height: float) -> Motion:
        says = yield from self._spin()
        if says:
            return Result(False, f"take_off refused: {says}")
        if self.home is None:
            self.home = np.array(self.backend.estimate["p_WB"])
        self.moves.take_off(height)
        return (yield from self._arrive())

    def brake_then(self, fly: Callable[[], Motion]) -> Motion:
        """Bring the reference to rest, then start the motion that `fly` returns."""
        row = self.backend.reference_now
        if max(np.abs(row["v_WB"]).max(), abs(row["w_WB_B"][2])) > AT_REST:
            self.moves.hold()
            while self.backend.t < self.moves.ends - 1e-9:
                yield
        return (yield from fly())

    def rest_then(self, fly: Callable[[], Motion]) -> Motion:
        """Fold arms that carry nothing, as for take-off and landing, then start `fly`."""
        b = self.backend
        if "arms" in b.offers and not np.any(b.reference["load"] > 0.0):
            folded = posture(b.robot, "folded")
            if self._find_off(folded, find_led_joints(b)) > FOLDED:
                result = yield from self.brake_then(lambda: self.move_joints(folded, None))
                if not result:
                    return Result(False, f"the arms do not fold: {result.reason}")
        return (yield from fly())

    def move_joints(self, q: Array, seconds: float | None) -> Motion:
        """Move the joints, and wait until their measured angles have arrived."""
        b = self.backend
        yield from self._pause(Arms(b).move_to(q, seconds or 0.0))
        ends = b.t + JOINT_PATIENCE
        while (off := self._find_off(q, self._find_joints())) > JOINT_RAD:
            if b.t > ends:
                return Result(
                    False,
                    f"a joint is {math.degrees(off):.1f} deg from its goal (tolerance "
                    f"{math.degrees(JOINT_RAD):.1f} deg)",
                )
            yield
        return Result(True)

    def _find_joints(self) -> Array:
        """Return the joints' angles; for compliant arms those of the servos, without the load's
        deflection."""
        b = self.backend
        return find_led_joints(b) if "hands" in b.offers else np.array(b.estimate["q"])

    def _find_off(self, q: Array, now: Array) -> float:
        """Return the largest error (rad) of the joints that have a servo."""
        first = 1 if self.backend.robot.pendulum is not None else 0
        n = self.backend.n_joints
        return float(np.max(np.abs(now[first:n] - q[first:n]), initial=0.0))

    def go_to(self, p: Array, yaw: float) -> Motion:
        self.moves.go_to(p, yaw)
        return (yield from self._arrive())

    def hold(self) -> Motion:
        row = self.backend.reference
        brake = Brake(row, self.backend.limits.acceleration)
        yaw = math.atan2(row["R_WB"][1, 0], row["R_WB"][0, 0])
        self.moves.go_to(row["p_WB"] + brake.way, yaw + brake.turn)
        return (yield from self._arrive())

    def land(self, ground: float, here: bool) -> Motion:
        self.moves.land(ground, here)
        stood = 0.0
        while True:
            yield
            ref, est = self.backend.reference_now, self.backend.estimate
            above = float(est["p_WB"][2] - ref["p_WB"][2])
            still = float(np.linalg.norm(est["v_WB"])) < STANDS_MPS
            stood = stood + TICK if still and above > STANDS_M else 0.0
            if stood >= STANDS_S:
                break
            if self.backend.t >= self.moves.ends - 1e-9:
                if self.backend.arc is not None or above > IN_GROUND:
                    yield from self._pause(0.3)
                    break
                return (yield from self._sink())
        self.moves.motors(False)
        return Result(True)

    def _sink(self) -> Motion:
        """Continue the descent: the ground is lower than expected."""
        drive = VelocityDrive(self.backend)
        lowest = float(self.backend.reference_now["p_WB"][2]) - SINK_MAX
        while not drive.has_touched_down:
            drive.tell(np.array([0.0, 0.0, -SINK]), 0.0)
            self.backend.track(drive.step())
            yield
            if drive.p[2] < lowest:
                return Result(False, f"no ground was met within {SINK_MAX:g} m below the expected")
        self.moves.motors(False)
        return Result(True)

    def _pause(self, seconds: float) -> Generator[None, None, None]:
        end = self.backend.t + seconds
        while self.backend.t < end - 1e-9:
            yield

    def _arrive(self) -> Motion:
        """Wait until the estimate has been near the end of the reference for the dwell time."""
        a, goal = self.arrival, self.moves.goal
        near = 0.0
        while True:
            yield
            est, t = self.backend.estimate, self.backend.t
            off = float(np.linalg.norm(est["p_WB"] - goal["p_WB"]))
            turn = _turn(est["R_WB"], goal["R_WB"])
            near = near + TICK if off <= a.tolerance_m and turn <= a.yaw_rad else 0.0
            ended = t >= self.moves.ends - 1e-9
            if ended and near >= a.dwell_s - 1e-9:
                return Result(True)
            if t > self.moves.ends + a.patience_s:
                return Result(
                    False,
                    f"not arrived {a.patience_s:g} s after the end of the motion: {off:.3f} m from "
                    f"the goal (tolerance {a.tolerance_m:g} m), heading {math.degrees(turn):.1f} "
                    f"deg off (tolerance {math.degrees(a.yaw_rad):.1f} deg)",
                )


def _turn(R: Array, R_goal: Array) -> float:
    """Return the angle (rad) between two headings."""
    off = math.atan2(R[1, 0], R[0, 0]) - math.atan2(R_goal[1, 0], R_goal[0, 0])
    return abs((off + math.pi) % (2.0 * math.pi) - math.pi)
