"""Insertion of the peg of a bar: survey, align, lower, insert; draw out after a failure.

The steps of `bar-insertion` at the socket. Motion capture surveys the socket, bar_leading.py
measures the peg, and the load of the hands indicates contact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.missions.bar_insertion.bar_leading import BarLeader
from skywright.missions.bar_insertion.bar_pose import BarPose
from skywright.missions.bar_insertion.task import BarInsertion
from skywright.missions.skills.tool_handling import Grip, Place
from skywright.models.things.peg import Peg
from skywright.models.things.socket import Socket
from skywright.run.supervisor import Supervisor
from skywright.vehicle.plant import MISSION_TICK

SURVEY_S = 1.0  # s, in which motion capture measures the socket
READY = 0.012  # m, of the peg's end above the socket before it is lowered
CALM_S = 0.3  # s, for which the peg has to stay over the hole
ALIGN_MAX_S = 12.0  # s, after which it is lowered from its present position
SINK_S = 0.4  # s without progress in the hole from which the hands press
DRAW_MAX_S = 8.0
STALL_S, STALL_M = 2.0, 0.001  # s, m: no more progress in the hole, the peg is jammed
ENTERED_M = 0.003  # m, below the chamfer, from which the peg is in the hole
SPIRAL = 0.7  # distance of neighbouring points, relative to the chamfer's reach
SEAT_S, FELT = 0.4, 0.6  # s, for which this fraction of the force has to last on the seat
FULL = 0.95  # of the peg's length, from which it is inserted
TOUCHED = 0.7  # of the bar's weight on the hands, below which the peg has contact
TOUCH_S = 0.8  # s without progress during the descent: the peg is beside the hole


def survey(s: Supervisor, socket: str) -> tuple[Place, Array]:
    """Measure a socket for a time; return its place (O of an inserted bar) and R_WS."""
    s.wait(SURVEY_S)
    p, R = s.devices.surveyor.survey(socket)
    return Place(p, math.atan2(R[1, 0], R[0, 0])), R


def find_offset(missed: int, capture: float) -> Array:
    """Return the offset (2,) m, in S, at which to lower the peg after `missed` misses: a spiral.

    A miss indicates an error of the survey. The points of the spiral (of a sunflower) are at most
    as far apart as the chamfer reaches, so that they leave no gap.
    """
    angle = missed * math.pi * (3.0 - math.sqrt(5.0))
    return SPIRAL * capture * math.sqrt(missed) * np.array([math.cos(angle), math.sin(angle)])


def build_hole(s: Supervisor, p: Array, R: Array, grip: Grip, task: BarInsertion) -> Hole:
    peg = s.vehicle.world.find_thing(task.bar, Peg)
    socket = s.vehicle.world.find_thing(task.socket, Socket)
    return Hole(
        p, R, peg.list_frames()["tip"].p, grip.handle,
        0.5 * (socket.hole_m - peg.side_m) + socket.chamfer_m, socket.chamfer_m + ENTERED_M,
    )  # fmt: skip


class Hole(NamedTuple):
    """The hole as surveyed, and the points of the bar that move to it."""

    p: Array  # (3,) m, middle of the opening
    R: Array  # (3, 3) R_WS
    tip: Array  # (3,) m, in O: middle of the peg's end
    bar: Array  # (3,) m, in O: middle of the crossbar
    capture: float  # m, across, within which the chamfer guides the peg into the hole
    entered: float  # m, depth from which the peg is in the hole

    def depth_of(self, pose: BarPose) -> float:
        """Return the depth (m) of the peg's end below the opening."""
        return float((self.p - pose.p - pose.R @ self.tip) @ self.R[:, 2])


def insert(s: Supervisor, leader: BarLeader, hole: Hole, offset: Array, task: BarInsertion) -> str:
    """Make one attempt; returns "in", "jammed", "missed" or "beside".

    "beside": the peg came down away from its goal, for example in a gust. "missed": it came down at
    its goal, but not in the hole. Before the peg is in the hole its end is controlled. After that
    the walls guide it, and the crossbar is kept over it, so that lateral forces and their friction
    stay small. At resistance, and finally on the seat, the hands press by (31).
    """
    peg = s.vehicle.world.find_thing(task.bar, Peg)
    n, speed = hole.R[:, 1], task.lower_speed_mps
    above = hole.p + hole.R[:, :2] @ offset + READY * hole.R[:, 2]
    s.begin("align")
    _align(s, leader, hole, above, task)
    s.begin("lower")
    watch, pose = Progress(s, hole), leader.measure()
    while watch.deepest < hole.entered and watch.stalled < TOUCH_S:
        if leader.carried < TOUCHED * leader.weight:
            break
        pose = leader.lead(above, n, hole.tip, sink=speed)
        watch.step(pose)
    if watch.deepest < hole.entered:
        aside = hole.R.T @ (pose.p + pose.R @ hole.tip - above)
        found = "missed" if float(np.max(np.abs(aside[:2]))) < 0.5 * hole.capture else "beside"
    else:
        s.begin("insert")
        over = hole.p + hole.R[:, 2] * float(hole.bar[2] - hole.tip[2])
        watch, pressed, found = Progress(s, hole), 0.0, "jammed"
        while watch.stalled < STALL_S and pressed < SEAT_S:
            if watch.stalled < SINK_S and watch.deepest < FULL * peg.length_m:
                pose = leader.lead(over, n, hole.bar, sink=speed, let_go=True)
            else:
                pose = leader.press(over, n, hole.bar, task.press_share * leader.weight, task.gamma)
            watch.step(pose)
            seated = leader.carried < (1.0 - FELT * task.press_share) * leader.weight
            pressed = (
                pressed + MISSION_TICK if seated and watch.depth > FULL * peg.length_m else 0.0
            )
        if pressed >= SEAT_S:
            return "in"
    s.end("retry")
    s.begin("draw out")
    draw_out(s, leader, hole, above, speed)
    return found


def draw_out(s: Supervisor, leader: BarLeader, hole: Hole, above: Array, speed: float) -> None:
    """Raise the peg at `speed` (m/s) out of the hole, its end guided to below `above` (3,) m."""
    watch = Progress(s, hole)
    while watch.depth > -0.5 * READY and s.vehicle.t - watch.began < DRAW_MAX_S:
        watch.step(leader.lead(above, hole.R[:, 1], hole.tip, sink=-speed))


class Progress:
    """Depth of the peg, and the time since it last advanced."""

    def __init__(self, s: Supervisor, hole: Hole) -> None:
        self._s, self._hole = s, hole
        self.depth, self.deepest = math.inf, -math.inf  # m; before the first measurement
        self.began = self._since = s.vehicle.t

    def step(self, pose: BarPose) -> None:
        """Update with a pose of the bar."""
        self.depth = self._hole.depth_of(pose)
        if self.depth > self.deepest + STALL_M:
            self.deepest, self._since = self.depth, self._s.vehicle.t

    @property
    def stalled(self) -> float:
        """Time (s) without progress."""
        return float(self._s.vehicle.t - self._since)


def _align(s: Supervisor, leader: BarLeader, hole: Hole, tip: Array, task: BarInsertion) -> None:
    """Move the peg's end to `tip` (3,) m and the bar along the hole, until it stays there."""
    ends, calm, n = s.vehicle.t + ALIGN_MAX_S, 0.0, hole.R[:, 1]
    while s.vehicle.t < ends and calm < CALM_S:
        if leader.carried < TOUCHED * leader.weight:
            return  # contact: the socket is higher than surveyed
        pose = leader.lead(tip, n, hole.tip)
        error = tip - pose.p - pose.R @ hole.tip
        turn = math.acos(min(abs(float(n @ pose.R[:, 1])), 1.0))
        near = float(np.linalg.norm(error[:2])) < task.align_m and abs(error[2]) < 0.5 * READY
        calm = calm + MISSION_TICK if near and turn < math.radians(task.align_deg) else 0.0
