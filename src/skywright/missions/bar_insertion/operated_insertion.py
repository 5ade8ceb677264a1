"""An operator inserts the peg of a bar with the stick, the bar in both hooks.

The robot moves the peg over the hole, offset by `HAND_OVER`, and hands over. The stick moves the
peg's end; both hands and the platform carry the bar (bar_leading.py). In the hole the walls guide
the peg: the stick lowers the bar, and at resistance its deflection sets the force with which the
hands press by (31). On the seat, and with the stick at rest, the robot holds. The button takes
effect when the peg is inserted and the seat carries the weight.
"""

from __future__ import annotations

import numpy as np

from skywright.core.arrays import Array
from skywright.missions.bar_insertion.bar_leading import BarLeader
from skywright.missions.bar_insertion.insertion import FELT, FULL, READY, SINK_S, Hole, Progress
from skywright.missions.bar_insertion.task import BarInsertion
from skywright.missions.skills.assistance import Assistance
from skywright.missions.skills.operated import Lead, OperatorGone, compute_velocity
from skywright.models.things.peg import Peg
from skywright.run.operator import Sight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.plant import MISSION_TICK

HAND_OVER = np.array([-0.015, 0.015, 0.02])  # m, in the hole's frame, beyond READY above it
FENCE = np.array([[-0.06, -0.06, -0.02], [0.06, 0.06, 0.1]])
"""m, of the peg's end from the hole: lowest and highest position that the stick can command."""
FACE = -0.003  # m: only over the hole may the peg's end go lower than the socket's face
STICK_S = 0.25
"""s, lag of the speed behind the stick. The platform receives the acceleration as well. Without it
the peg's end would move 2.5 times as far as commanded at 1.6 rad/s, 48 deg late, and an operator
who sees a position and controls a speed would oscillate with it."""
STAND, TOUCH = 0.15, 0.08  # of the bar's weight, on the peg's end outside the hole
STIFFNESS = 100.0
"""N/m, of both arms upward: shoulder and elbow (2.93 and 1.48 N m/rad, levers of 0.27 and 0.23 m)
give 34, and three times that beyond 10 deg, to which the weight of the bar bends them."""
SETTLE = 0.3
"""1/s, rate of the force on the peg's end: a quarter of the rate of the weight estimate (0.8 s)."""
CLOSE = 0.5  # 1/s, increase of the speed limit with the gap
LEASH = 0.005  # m, distance of the goal from the peg's end during contact
LEAVES = {"align": np.inf, "lower": READY, "insert": 0.0}
"""m, of the peg's end above the hole, from which it returns to the previous phase."""
PUSHED, FIRM = 0.05, 0.4
"""Deflections of the stick: the first begins a press, the second is one with `press_share`."""


def insert_by_operator(
    s: Supervisor[BarInsertion], lead: Lead, leader: BarLeader, hole: Hole
) -> str:
    """Fly "align", "lower" and "insert" with the operator; returns "in", or why it failed."""
    work = _Insertion(s, lead, leader, hole)
    s.begin("align")
    lead.begin()
    try:
        while not work.step():
            if leader.lost:
                return "the bar was lost at the socket"
    except OperatorGone as gone:
        return f"{gone} before the peg was in: its end was {1e3 * work.depth:.0f} mm deep"
    finally:
        work.lead.end()
    return "in"


class _Insertion:
    """State of an operated insertion; each step is one tick."""

    def __init__(
        self, s: Supervisor[BarInsertion], lead: Lead, leader: BarLeader, hole: Hole
    ) -> None:
        self.s, self.task, self.lead, self.leader, self.hole = s, s.task, lead, leader, hole
        self.goal = HAND_OVER + [0.0, 0.0, READY]
        self.pressed = s.task.press_share * leader.weight  # N, largest press
        self.help = Assistance(s.task.assistance, self.pressed)
        self.length = s.vehicle.world.find_thing(s.task.bar, Peg).length_m
        self.watch = Progress(s, hole)
        self.phase, self.depth = "align", -READY
        self.v = np.zeros(3)  # m/s, of the goal, in the hole's frame

    def step(self) -> bool:
        """Read the stick and fly a tick; returns whether the peg is in."""
        leader = self.leader
        off = self._measure()
        felt = max(leader.weight - leader.carried, 0.0)
        seated = felt > FELT * self.pressed and self.depth > FULL * self.length
        stick = self.lead.read(Sight(off, seated))
        if stick.button and seated:
            return True
        axes, v_max = np.array(stick.axes), self.task.stick_speed_mps
        axes[2] = -self.help.step(-float(axes[2]), v_max, float(off[2]), felt) / v_max
        self._watch(off)
        if self.phase == "insert":
            self._insert(float(axes[2]), seated)
        else:
            self._lead(axes, off, felt)
        return False

    def _lead(self, axes: Array, off: Array, felt: float) -> None:
        """Move the peg's end for a tick; in contact its load is limited.

        The peg's end lies h below the crossbar and the bar's mass m at l. With more than l / h of
        its weight on the end, the bar topples about the crossbar; the closer the load is to that,
        the more friction on the end turns it. Outside the hole the load is therefore limited to
        STAND.
        """
        leader, hole, weight = self.leader, self.hole, self.leader.weight
        fence = FENCE if self._is_over(off) else np.maximum(FENCE, [[-1.0, -1.0, FACE]])
        asked = compute_velocity(axes, self.task.stick_speed_mps, self.goal, fence)
        a = (asked - self.v) / STICK_S
        self.v = compute_velocity(self.v + MISSION_TICK * a, 1.0, self.goal, fence)
        sink = SETTLE * (STAND * weight - felt) / STIFFNESS + CLOSE * max(float(off[2]), 0.0)
        if self.v[2] < -sink:
            self.v[2], a[2] = -sink, 0.0
        self.goal = self.goal + MISSION_TICK * self.v
        if felt > TOUCH * weight:
            self.goal[:2] = np.clip(self.goal[:2], off[:2] - LEASH, off[:2] + LEASH)
            self.goal[2] = off[2]
        along = (hole.R @ self.v, hole.R @ a)
        pose = leader.lead(hole.p + hole.R @ self.goal, hole.R[:, 1], hole.tip, along=along)
        self.depth = hole.depth_of(pose)

    def _watch(self, off: Array) -> None:
        """Begin the phase that matches the peg's position; `off` (3,) m is its end relative to the
        hole."""
        if self.phase == "align" and off[2] < 0.5 * READY:
            self._begin("lower")
        elif self.phase == "lower" and self.depth > self.hole.entered and self._is_over(off):
            self.watch = Progress(self.s, self.hole)
            self._begin("insert")
        elif off[2] > LEAVES[self.phase]:  # the stick moves the peg's end again
            self.goal = off
            self.s.end("retry")
            self._begin("align" if self.phase == "lower" else "lower")

    def _is_over(self, off: Array) -> bool:
        """Return whether a peg's end at `off` (3,) m is over the hole, not beside the socket."""
        return float(np.hypot(off[0], off[1])) < self.hole.capture

    def _begin(self, phase: str) -> None:
        self.phase = phase
        self.s.begin(phase)

    def _measure(self) -> Array:
        """Return the position of the peg's end relative to the hole, (3,) m in the hole's frame."""
        pose = self.leader.measure()
        return self.hole.R.T @ (pose.p + pose.R @ self.hole.tip - self.hole.p)

    def _insert(self, up: float, seated: bool) -> None:
        """Lower, press or raise the bar in the hole for a tick; hold once it is seated."""
        leader, hole, n = self.leader, self.hole, self.hole.R[:, 1]
        self.v[:] = 0.0
        over = hole.p + hole.R[:, 2] * float(hole.bar[2] - hole.tip[2])
        stuck = self.watch.stalled > SINK_S or self.depth > FULL * self.length
        if up == 0.0 or (seated and up < 0.0):
            pose = leader.hold()
        elif up < -PUSHED and stuck:
            pose = leader.press(
                over, n, hole.bar, min(-up / FIRM, 1.0) * self.pressed, self.task.gamma
            )
        else:
            sink = max(-up, -1.0) * self.task.stick_speed_mps
            pose = leader.lead(over, n, hole.bar, sink=sink or 1e-9, let_go=True, in_hole=True)
        self.watch.step(pose)
        self.depth = self.watch.depth
