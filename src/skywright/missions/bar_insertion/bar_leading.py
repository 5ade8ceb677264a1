"""Control of a bar that is suspended in both hooks, in flight (Suarez 2020, (29) to (31)).

Centre and direction of the bar follow from the hands by (29) and (30); the inverse gives the hands
for a desired pose. The hands determine the bar's pose to some millimetres only (encoders, backlash,
position of the bar in the cradles). This error changes slowly and is measured with the marker on
the bar.

In free air the platform controls the bar's centre and the arms control its direction, with their
joints at rest otherwise. On its springs the bar is steadier (2 mm) than with hands that compensate
the platform's motion (4 mm), since a servo's step of 0.33 deg is 2 mm at the hand and excites a
swing of the bar. In contact the arms press by (31), and the platform follows them.
"""

import math
from typing import Any

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.core.types import TASK_FORCE_POSITION, TASK_JOINTS
from skywright.missions.bar_insertion.bar_pose import OFF, BarPose, average_error, locate_bar
from skywright.missions.bar_insertion.bar_step import (
    LEAD_SPEED,
    build_hook_arms,
    find_stretch,
    hold_bar,
    lead_platform,
    turn_bar,
)
from skywright.missions.skills.moves import set_rest
from skywright.missions.skills.tool_handling import Grip, Weight
from skywright.missions.skills.tool_pose import measure_tool
from skywright.models.arm_inverse_kinematics import ArmChain
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import Hands, HandState
from skywright.vehicle.bus import Estimate
from skywright.vehicle.plant import MISSION_TICK

CORRECT_S = 1.0
"""s, time constant of the marker's correction: slow compared with the ringing of the springs."""
FILTER_S = 0.6  # s, over which the error of the bar is averaged
ROOM = 1.2  # largest weight that is fed forward, relative to the bar's
LEAST_N = 0.1  # N, least requested force: its direction has to be defined
LOAD_RATE = 6.0  # N/s, at which the weight that is fed forward changes
LOST_M, LOST_ANGLE = 0.05, math.radians(15.0)  # beyond these a bar has left the hooks
FOLLOW_RATE = 0.5  # 1/s, at which the platform follows a bar that is pressed
HANGS = 0.95  # fraction of its weight in the hands from which a bar is freely suspended


class BarLeader:
    """Controller of a bar in both hands; each `step` is one tick."""

    def __init__(
        self, s: Supervisor, grip: Grip, chains: tuple[ArmChain, ArmChain], weight: float
    ) -> None:
        """`weight` (N) is the initial load of the hands; takes a second to average its effect."""
        self.s, self.grip, self.weight = s, grip, weight
        self._felt, self._load = Weight(s, weight), weight
        self.correct = True  # whether the marker corrects the pose
        self._hands, self._R_WB = s.vehicle.look(Hands).p_WH, s.vehicle.look(Estimate).R_WB
        self._off, self._error, self._turn = np.zeros(OFF), np.zeros(3), np.zeros(3)
        first = self._locate(1.0)
        self._p_handle = first.p + first.R @ grip.handle
        self._q = np.array(s.vehicle.reference["q"])
        self._n = np.array([0.0, 1.0, 0.0])  # in a frame with the heading
        self._middle = np.mean(grip.hands, axis=0)
        self._held = self._middle + grip.cradle
        width = float(np.linalg.norm(grip.hands[0] - grip.hands[1]))
        self._arms = (self._middle, width, *build_hook_arms(chains, grip.q))
        held = np.zeros(len(self._q))
        hold_bar(self._n, *self._arms, held)
        self._q_rest = self._q - held
        self._pressed = False
        self._hang = np.zeros(3)  # m, in W: from the grip's pose to the freely suspended bar

    def _heading(self) -> Array:
        return rot_z(math.atan2(self._R_WB[1, 0], self._R_WB[0, 0]))

    def measure(self) -> BarPose:
        """Return the bar's pose by (29), (30), corrected."""
        return self._locate(MISSION_TICK / CORRECT_S if self.correct else 0.0)

    def _locate(self, share: float) -> BarPose:
        """Return the bar's pose, after a correction by `share` of the marker's deviation."""
        p, R = np.empty(3), np.empty((3, 3))
        p_tool, R_tool = measure_tool(self.s)
        locate_bar(
            self._hands, self._R_WB, self.grip.cradle, self.grip.handle, p_tool, R_tool, share,
            self._off, p, R,
        )  # fmt: skip
        return BarPose(p, R)

    def lead(
        self, p: Array, n: Array, point_O: Array, sink: float = 0.0, let_go: bool = False,
        along: tuple[Array, Array] | None = None, in_hole: bool = False,
    ) -> BarPose:  # fmt: skip
        """Move the bar for one tick, with joints at rest except for its direction; return its pose.

        `p` (3,) m is the goal of the bar's point `point_O` (3,) m, n (3,) that of its direction, in
        W. With `sink` (m/s, negative to rise) the platform descends at this speed, and only the
        horizontal part of `p` applies. `along`, (3,) m/s and (3,) m/s^2, is the motion of p, which
        the platform follows. With `in_hole` the platform acts as a spring across the hole,
        proportional to the error: an integral against the walls would bend the springs until a hook
        slips. The bar's weight is fed forward to springs and platform: the full weight, so that a
        bar that touches something stays in the hooks, or with `let_go` the weight measured at the
        hands, so that it passes to the bar's support.
        """
        s, pose = self.s, self._watch(p, n, point_O)
        if self._pressed:
            self._q = np.array(s.vehicle.read(HandState).q_goal[: s.vehicle.n_joints])
            self._pressed = False
        row = set_rest(s.vehicle.reference)
        free = not in_hole and self.carried > HANGS * self.weight
        v, settle = np.empty(3), MISSION_TICK / CORRECT_S if free else 0.0
        lead_platform(self._error, self._find_stretch(row), settle, in_hole, self._hang, v)
        if along is not None:
            v += along[0]
            row["a_WB"] = along[1]
        if sink != 0.0:
            v[2] = -sink
        turn_bar(self._turn, self._R_WB, *self._arms, self._q_rest, self._n, self._q)
        k = s.vehicle.n_joints
        row["q"][:k], row["task"] = self._q[:k], TASK_JOINTS
        row["p_WB"] += MISSION_TICK * v
        row["v_WB"] = v
        return self._send(row, pose, self.carried if let_go else self.weight)

    def press(self, p: Array, n: Array, point_O: Array, force: float, gamma: float) -> BarPose:
        """Press the bar down with `force` (N) for one tick, and control it across: (31).

        The load of the hands falls by this force; the part that is missing already is subtracted.
        The platform follows, so that the arms keep the pose of the grip.
        """
        s, pose = self.s, self._watch(p, n, point_O)
        more = max(force - (self.weight - self.carried), LEAST_N)
        row = set_rest(s.vehicle.reference)
        hands = self._hands
        half = 0.5 * math.dist(hands[0], hands[1])
        across = self._error * [1.0, 1.0, 0.0]
        for h, sign in ((0, 1.0), (1, -1.0)):
            row["task"][h], row["gamma"][h] = TASK_FORCE_POSITION, gamma
            row["p_WH"][h] = hands[h] + across + sign * half * self._turn
            row["f_WH"][h], row["v_WH"][h] = [0.0, 0.0, -0.5 * more], 0.0
        v = self._follow(row)
        row["p_WB"] += MISSION_TICK * v
        row["v_WB"] = v
        self._pressed = True
        return self._send(row, pose, self.carried)

    def hold(self) -> BarPose:
        """Keep joints, platform and feedforward for one tick.

        The walls of a hole hold the bar: a platform that continued to correct it across would bend
        the springs until a hook slips.
        """
        s = self.s
        self._felt.feel(ROOM * self.weight)
        if self._pressed:
            self._q = np.array(s.vehicle.read(HandState).q_goal[: s.vehicle.n_joints])
            self._pressed = False
        row, k = set_rest(s.vehicle.reference), s.vehicle.n_joints
        row["q"][:k], row["task"] = self._q[:k], TASK_JOINTS
        return self._send(row, self.measure(), self._load)

    def _watch(self, p: Array, n: Array, point_O: Array) -> BarPose:
        """Measure the bar, filter its error, and update its weight."""
        self._felt.feel(ROOM * self.weight)
        pose = self.measure()
        goal = (np.array(x, dtype=float) for x in (p, n, point_O))  # columns may be among them
        average_error(
            *goal,
            self.grip.handle,
            *pose,
            MISSION_TICK / FILTER_S,
            self._error,
            self._turn,
            self._p_handle,
        )
        return pose

    def _follow(self, row: Any) -> Array:
        """Return the platform's velocity (3,) m/s towards the arms' pose of the grip."""
        sag = min(self.carried / self.weight, 1.0) * self._hang
        v = FOLLOW_RATE * (self._find_stretch(row) - sag)
        return np.asarray(v * min(1.0, LEAD_SPEED / max(math.hypot(*v), 1e-9)))

    def _find_stretch(self, row: Any) -> Array:
        """Return the offset (3,) m of the bar from its position for the arms' pose of the grip."""
        away = np.empty(3)
        find_stretch(self._p_handle, row["R_WB"], row["p_WB"], self._held, away)
        return away

    @property
    def lost(self) -> bool:
        """Whether the bar, measured by the marker, is away from where the hands would hold it."""
        p, R = measure_tool(self.s)
        held = np.mean(self._hands, axis=0) + self._heading() @ self.grip.cradle
        away = math.dist(p + R @ self.grip.handle, held)
        return away > LOST_M or abs(float(R[2, 1])) > math.sin(LOST_ANGLE)

    @property
    def carried(self) -> float:
        """The part of the bar's weight (N) on the hands, from the platform's external force."""
        return self._felt.carried

    def _send(self, row: Any, pose: BarPose, load: float) -> BarPose:
        most = MISSION_TICK * LOAD_RATE
        self._load += min(max(load - self._load, -most), most)
        row["load"] = 0.5 * self._load
        self.s.body.track(row[None])
        self.s.tick()
        return pose
