"""Commands of arms for missions, on any back end that offers arms."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from skywright.core.types import (
    TASK_FORCE,
    TASK_FORCE_POSITION,
    TASK_JOINTS,
    TASK_LOOPS,
    TASK_POSITION,
    TASK_SQUEEZE,
    TASK_VELOCITY,
    TASK_VISUAL,
)
from skywright.description.robot.limbs import SIDES, list_grippers
from skywright.errors import InputError
from skywright.models.bimanual import Bar, compute_bar_hands
from skywright.vehicle.arguments import check_number
from skywright.vehicle.arms.ports import ArmModel, Hands, HandState
from skywright.vehicle.interface import JOINT_SPEED, Array, Backend, fill_tips
from skywright.vehicle.rest_to_rest import ROW_PERIOD, duration, quintic

JOINT_ACCELERATION = 2.0
"""rad/s^2, of the joints."""
LED_SPEED = 0.05
"""m/s, speed at which a hand that exerts a force moves to another point."""


def compute_joints_s(delta: Array, speed: float = JOINT_SPEED) -> float:
    """Return the duration (s) of `Arms.move_to` by `delta` (n,) rad at up to `speed` (rad/s)."""
    most = float(np.max(np.abs(delta), initial=0.0))
    return duration(most, speed, JOINT_ACCELERATION)


class Arms:
    """The arms: joint angles, and for compliant arms (back ends that offer `hands`) the hands.

    Hands are "left" and "right"; points, velocities and forces are in W. A command holds the
    platform and leaves the other hand's task unchanged. The task of a hand remains in effect when
    the platform moves (`Uav`) afterwards.
    """

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def move_to(self, q: Array, seconds: float = 0.0) -> float:
        """Move all joints to q (n_joints,) rad with the platform held; passive joints are ignored.

        It takes at least `seconds` (s); returns the duration (s).
        """
        b = self.backend
        start = self._start()
        delta = np.asarray(q, dtype=float) - start["q"][: b.n_joints]
        total = compute_joints_s(delta, b.limits.joint_speed)
        n = max(math.ceil(max(total, seconds) / ROW_PERIOD), 1)
        u = np.linspace(0.0, 1.0, n + 1)
        s, ds, _ = quintic(u)
        table = np.repeat(start[None], n + 1)
        table["t"] = u * n * ROW_PERIOD
        table["q"][:, : b.n_joints] += s[:, None] * delta
        table["qd"][:, : b.n_joints] = ds[:, None] * delta / (n * ROW_PERIOD)
        table["task"] = TASK_JOINTS
        fill_tips(b, table)
        b.track(table)
        return n * ROW_PERIOD

    def hold_joints(self, hand: str) -> None:
        """Hold an arm's joints at the present angles of its links."""
        row = self._start()
        (h, _), arm = self._hands({hand: np.zeros(3)})[0], self.backend.read(ArmModel)
        mine = slice(arm.first[h], arm.first[h] + arm.n)
        row["task"][h], row["q"][mine] = TASK_JOINTS, self.backend.estimate["q"][mine]
        self.backend.track(row[None])

    def hands_to(
        self, goals: dict[str, Array], speed: float | None = None, roll: float | None = None
    ) -> None:
        """Move hands on straight lines to `goals` (m, by hand) at `speed` (m/s): (23).

        `roll` (rad, positive outwards) is the roll of the shoulder (default: that of the
        reference). Raises InputError on names, numbers or a robot without hands.
        """
        row = self._start()
        for h, goal in self._hands(goals):
            row["task"][h], row["p_WH"][h] = TASK_POSITION, goal
            row["v_WH"][h] = [speed or self.backend.read(HandState).speed_hand, 0.0, 0.0]
            if roll is not None:
                row["q"][self.backend.read(ArmModel).first[h] + 1] = -roll if h else roll
        self.backend.track(row[None])

    def hands_to_marker(self, places: dict[str, Array], speed: float | None = None) -> None:
        """Move hands to `places` (m, by hand) in the frame of the visible marker: (23).

        The robot's camera measures the marker, or motion capture if there is no camera; while the
        marker is not visible the hands stay (`Marker.age`, s).
        """
        row = self._start()
        for h, place in self._hands(places):
            row["task"][h], row["p_WH"][h] = TASK_VISUAL, place
            row["v_WH"][h] = [speed or self.backend.read(HandState).speed_hand, 0.0, 0.0]
        self.backend.track(row[None])

    def hands_velocity(self, velocities: dict[str, Array]) -> None:
        """Move hands at `velocities` (m/s, by hand) until the next command: (24)."""
        row = self._start()
        for h, v in self._hands(velocities):
            row["task"][h], row["v_WH"][h] = TASK_VELOCITY, v
            state = self.backend.read(HandState)
            led = state.task_last[h] == TASK_VELOCITY  # for the recording: the goal
            row["p_WH"][h] = (state.p_ref if led else self.backend.read(Hands).p_WH)[h]
        self.backend.track(row[None])

    def push(
        self,
        forces: dict[str, Array],
        *,
        at: dict[str, Array] | None = None,
        gamma: float = 0.5,
        ramp_s: float = 0.5,
        speed: float = LED_SPEED,
    ) -> None:
        """Exert `forces` (N, by hand) along their directions, reached over `ramp_s`: (25)-(28).

        With `at` (m, by hand) the hand also moves to that point, at no more than `speed` (m/s), by
        (31) with `gamma`.
        """
        end = self._start()
        for h, f in self._hands(forces):
            self._needs_force_sensing(h)
            end["task"][h], end["f_WH"][h], end["gamma"][h] = TASK_FORCE, f, 1.0
        for h, p in self._hands(at or {}):
            end["task"][h], end["p_WH"][h], end["gamma"][h] = TASK_FORCE_POSITION, p, gamma
        self._ramp(end, [h for h, _ in self._hands(forces)], ramp_s, speed)

    def squeeze(
        self,
        force: float,
        p_left: Array,
        p_right: Array,
        gamma: float = 0.5,
        ramp_s: float = 0.5,
        speed: float = LED_SPEED,
    ) -> None:
        """Press the hands towards each other with `force` (N), around two points: (31), (32).

        The points move from their present positions to `p_left` and `p_right` at no more than
        `speed`.
        """
        end = self._start()
        for h, p in self._hands({"left": p_left, "right": p_right}):
            self._needs_force_sensing(h)
            end["task"][h], end["p_WH"][h], end["gamma"][h] = TASK_SQUEEZE, p, gamma
            end["f_WH"][h] = [force, 0.0, 0.0]
        self._ramp(end, [0, 1], ramp_s, speed)

    def grip(self, forces: dict[str, float]) -> None:
        """Close grippers with `forces` (N, by hand; negative: open them) until the next command.

        Raises InputError for a hand that is not a gripper, and for a force that it cannot exert.
        """
        check_grippers(self.backend, forces)
        told = self.backend.actuators["grip"]
        for name, force in forces.items():
            told[SIDES.index(name)] = check_number(f"grip of {name}", force)
        self.backend.actuators["grip"] = told
        self.backend.track(self._start()[None])

    def bar_to(
        self, p: Array, n: Array, width: float, speed: float = LED_SPEED, force: float = 0.0
    ) -> None:
        """Move a bar held at `width` (m) to centre p (m) and direction n: (29), (30) inverted.

        If hooks do not hold it, hands press with `force` (N) on its ends: (31), (32).
        """
        left, right = compute_bar_hands(Bar(np.asarray(p), np.asarray(n)), width)
        if force > 0.0:
            self.squeeze(force, left, right, speed=speed)
        else:
            self.hands_to({"left": left, "right": right}, speed)

    def torques(self, hand: str, tau: Array, delta: Array | None = None) -> None:
        """Control the joints of an arm by (22): torque tau (4,) N m where `delta` is 0 (default).

        Where `delta` is 1 the output link holds the reference.
        """
        row = self._start()
        for h, values in self._hands({hand: tau}, 4):
            first = self.backend.read(ArmModel).first[h]
            row["task"][h] = TASK_LOOPS
            row["tau"][first : first + 4] = values
            row["delta"][first : first + 4] = 0.0 if delta is None else delta
        self.backend.track(row[None])

    def tare(self, on: bool = True) -> None:
        """Set the estimated contact forces to zero, while this is on."""
        row = np.array(self.backend.reference)
        row["t"], row["tare"] = 0.0, float(on)
        self.backend.track(row[None])

    def platform_shift(self, hand: str) -> Array:
        """Return the displacement (3,) m, in W, of the platform for a good pose of the hand's arm.

        Zero while the arm is far enough from its singularity.
        """
        h = self._hands({hand: np.zeros(3)})[0][0]
        state = self.backend.read(HandState)
        return state.shift_W[h] if state.singular[h] > 0.5 else np.zeros(3)

    def _start(self) -> Any:
        """Return the present reference at rest, with the joints as the servos are commanded."""
        b = self.backend
        row = np.array(b.reference)
        row["t"] = row["tare"] = 0.0
        for field in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd"):
            row[field] = 0.0
        row["q"] = find_led_joints(b)
        return row

    def _hands(self, values: dict[str, Array], size: int = 3) -> list[tuple[int, Array]]:
        """Return (hand, value) pairs; raises InputError for an invalid hand or value."""
        if "hands" not in self.backend.offers or not self.backend.read(ArmModel).chain:
            raise InputError(
                "hand commands require compliant arms with the joints pitch, roll, yaw, elbow"
            )
        names = SIDES[: self.backend.read(ArmModel).n_hands]
        out = []
        for name, value in values.items():
            if name not in names:
                raise InputError(f"hand {name!r} is unknown; valid: {', '.join(names)}")
            array = np.asarray(value, dtype=float)
            if array.shape != (size,) or not np.all(np.isfinite(array)):
                raise InputError(
                    f"hand {name!r}: {size} finite numbers are required, got {array.tolist()}"
                )
            out.append((names.index(name), array))
        return out

    def _needs_force_sensing(self, h: int) -> None:
        arm = self.backend.read(ArmModel)
        if not np.any(arm.sensed[arm.first[h] : arm.first[h] + arm.n]):
            raise InputError(
                f"hand {SIDES[h]!r} cannot control a force: no joint of its arm measures "
                "its deflection; set deflection_encoder = true on its joints"
            )

    def _ramp(self, end: Any, hands: list[int], ramp_s: float, speed: float) -> None:
        """Track `end`: its forces ramp over `ramp_s`, its points move at `speed`.

        Both start from the present command; without one, the hand starts at its position without
        force.
        """
        start, here = self.backend.reference, self.backend.read(Hands).p_WH
        size = {h: float(np.linalg.norm(end["f_WH"][h])) for h in hands}
        p, f = np.array(end["p_WH"]), np.full(len(end["task"]), 1e-3)  # a direction, not a force
        for h in hands:
            if start["task"][h] in (TASK_FORCE_POSITION, TASK_SQUEEZE):
                p[h] = start["p_WH"][h]
            elif end["task"][h] != TASK_FORCE:
                p[h] = here[h]
            if start["task"][h] in (TASK_FORCE, TASK_FORCE_POSITION, TASK_SQUEEZE):
                f[h] = np.linalg.norm(start["f_WH"][h]) / max(size[h], 1e-9)
        way = end["p_WH"] - p
        led_s = duration(float(np.max(np.linalg.norm(way, axis=1))), speed, 1.0)
        rows = math.ceil(max(ramp_s, led_s, ROW_PERIOD) / ROW_PERIOD)
        table = np.repeat(end[None], rows + 1)
        table["t"] = t = ROW_PERIOD * np.arange(rows + 1)
        s, ds, _ = quintic(np.minimum(t / led_s, 1.0))
        for h in hands:
            table["p_WH"][:, h] = p[h] + s[:, None] * way[h]
            table["v_WH"][:, h] = ds[:, None] * way[h] / led_s
            grown = np.minimum(t / max(ramp_s, ROW_PERIOD), 1.0)
            table["f_WH"][:, h] *= (f[h] + (1.0 - f[h]) * grown)[:, None]
        self.backend.track(table)


def check_grippers(b: Backend, names: Iterable[str]) -> None:
    """Raise InputError for a hand that is not a gripper."""
    valid = list_grippers(b.robot)
    for name in names:
        if name not in valid:
            raise InputError(f"gripper {name!r} is unknown; valid: {', '.join(valid) or 'none'}")


def find_led_joints(b: Backend) -> Array:
    """Return the commanded joint angles of the servos, in the layout of a row's `q`."""
    row = b.reference
    q = np.array(row["q"])
    if "hands" in b.offers:
        arm, goal = b.read(ArmModel), b.read(HandState).q_goal
        for h in range(arm.n_hands):
            if row["task"][h] != TASK_JOINTS:
                mine = slice(arm.first[h], arm.first[h] + arm.n)
                q[mine] = goal[mine]
    return q
