"""Whoever is in control of the gateway leads the arms: the tasks of Suarez 2020, section III-C.

For a mission in which the platform hovers and the arms do what an operator asks for. References
from outside are limited to the ranges and speeds of the joints. Those older than 0.25 s hold the
arms; after a second without a fresh one the task ends, and the arms stay where they are until the
operator asks again.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.interrupt import check_interrupt
from skywright.core.rotations import rot_z
from skywright.core.types import TASK_JOINTS
from skywright.description.robot.limbs import list_joints
from skywright.links.udp.flight import FlightGateway
from skywright.links.udp.packets import CODES, find_kind
from skywright.links.udp.receiver import Arrived
from skywright.models.geometry import compute_clearance
from skywright.models.rigid_body import posture
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import ArmModel, HandState
from skywright.vehicle.interface import fill_tips
from skywright.vehicle.plant import MISSION_TICK

Array = NDArray[np.float64]

OFFERED = ("hold", "rest", "operate", "stick", "joints", "land")
STALE_S = find_kind("joints").old_s
STOP_S = 1.0  # s without a fresh reference after which the task ends
PATIENCE_S = 60.0  # s of wall time for somebody to connect
CLEAR_M = 0.01  # m, nearest that references may bring the robot to what it must not touch
NAMES = {CODES[name][0]: name for name in OFFERED}


class Led(NamedTuple):
    """How it ended, and what was not followed."""

    reason: str  # why it ended before the operator asked to land, or ""
    stale: int  # ticks in which the references were too old
    refused: int  # ticks in which a reference was too near to something, or for other joints


class Lead:
    """One operator's turn."""

    def __init__(self, s: Supervisor, gateway: FlightGateway, v_max: float) -> None:
        """`v_max` (m/s) is that of (24), the speed of the hands at full deflection of the stick."""
        self.s, self.gateway, self.v_max = s, gateway, v_max
        robot = gateway.robot
        self.poses = {"rest": posture(robot, "folded"), "operate": posture(robot, "working")}
        """Joint angles (n,) rad of the tasks that are poses."""
        joints = list_joints(robot)
        self._low = np.array([limb.link.reach[0] for limb in joints])
        self._high = np.array([limb.link.reach[1] for limb in joints])
        self._driven = np.array([limb.servo >= 0 for limb in joints])
        self._query = None if s.surroundings is None else s.surroundings()
        self._task, self._since = "hold", 0.0  # and when it began (s)
        self._q = np.zeros(s.vehicle.n_joints)  # rad, where references have led the joints
        self.stale = self.refused = 0

    def run(self, longest_s: float) -> Led:
        """Lead the arms until the operator asks to land, is gone, or `longest_s` is over."""
        server = self.gateway.server
        server.offered = frozenset(NAMES)
        try:
            return Led(self._run(longest_s), self.stale, self.refused)
        finally:
            server.offered = frozenset()
            self._set_task("hold")

    def _run(self, longest_s: float) -> str:
        ends = time.monotonic() + PATIENCE_S
        self._set_task("hold")
        while not self.gateway.server.watched:
            if time.monotonic() > ends:
                return f"nobody connected within {PATIENCE_S:g} s"
            check_interrupt()
            self.gateway.poll()
            time.sleep(0.01)
        for _ in range(round(longest_s / MISSION_TICK)):
            self.gateway.poll()
            while self.gateway.operations:
                task = NAMES[self.gateway.operations.popleft().code]
                if task == "land":
                    return ""
                self._set_task(task)
            if not self.gateway.server.watched:
                return "the operator is gone"
            self._step()
            self.s.tick()
        return f"the operator took more than {longest_s:g} s"

    def _set_task(self, task: str) -> None:
        """Begin a task, as a phase of the flight."""
        self.s.begin(task)
        self.gateway.task, self._task = CODES[task][0], task
        self.gateway.stick = self.gateway.joints = None
        vehicle = self.s.vehicle
        self._since = vehicle.t
        self._q = np.array(vehicle.read(HandState).q_goal[: vehicle.n_joints])
        self.s.arms.move_to(self.poses.get(task, self._q))

    def _step(self) -> None:
        if self._task == "joints":
            self._follow(self.gateway.joints)
        elif self._task == "stick":
            self._push(self.gateway.stick)

    def _is_fresh(self, arrived: Arrived | None) -> bool:
        """Whether a command may be followed now; ends the task where none has come for long."""
        age = self.gateway.measure_age(arrived)
        if arrived is None:
            age = self.s.vehicle.t - self._since
        if arrived is not None and age <= STALE_S:
            return True
        self.stale += 1
        if age > STOP_S:
            self._set_task("hold")
        return False

    def _follow(self, arrived: Arrived | None) -> None:
        """Go towards the newest joint references, as fast as the joints may."""
        still = np.zeros(len(self._q))
        if not self._is_fresh(arrived):
            if self._task == "joints":
                self._track(still)
            return
        assert arrived is not None
        vehicle, values, n = self.s.vehicle, arrived.packet.values, len(self._q)
        wanted = np.clip(np.array(values["q_ref"][:n]), self._low, self._high)
        step = MISSION_TICK * vehicle.limits.joint_speed
        change = np.where(self._driven, np.clip(wanted - self._q, -step, step), 0.0)
        if values["n"] != n or self._is_near(self._q + change):
            self.refused += 1
            change = still
        self._track(change)

    def _push(self, arrived: Arrived | None) -> None:
        """Move the hands by (24), in the platform's heading."""
        axes = np.zeros(3)
        if self._is_fresh(arrived):
            assert arrived is not None
            axes = np.array(arrived.packet.values["axes"][:3])
        elif self._task != "stick":
            return
        R = self.s.vehicle.reference["R_WB"]
        v = self.v_max * rot_z(math.atan2(R[1, 0], R[0, 0])) @ axes
        self.s.arms.hands_velocity({side: v for side in self._sides()})

    def _sides(self) -> list[str]:
        return ["left", "right"][: int(self.s.vehicle.read(ArmModel).n_hands)]

    def _is_near(self, q: Array) -> bool:
        """Whether q would bring the robot nearer to something than it may come."""
        if self._query is None:
            return False
        row = self.s.vehicle.reference
        ahead, now = (
            compute_clearance(self._query, row["p_WB"], row["R_WB"], x).distance
            for x in (q, self._q)
        )
        return ahead < CLEAR_M and ahead < now

    def _track(self, change: Array) -> None:
        """Lead the joints by `change` (n,) rad within one mission tick."""
        vehicle, n = self.s.vehicle, len(change)
        row = np.array(vehicle.reference)
        for field in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "tare"):
            row[field] = 0.0
        row["task"] = TASK_JOINTS
        table = np.repeat(row[None], 2)
        table["t"] = [0.0, MISSION_TICK]
        table["q"][:, :n] = self._q, self._q + change
        table["qd"][:, :n] = change / MISSION_TICK
        fill_tips(vehicle, table)
        vehicle.track(table)
        self._q = self._q + change
