"""Control of the arms by the gateway's operator: the tasks of Suarez 2020, section III-C.

It serves missions in which the platform hovers and an operator commands the arms. External
references are limited to the ranges and speeds of the joints. If they are older than 0.25 s, the
arms hold. After a second without a fresh one the task ends, and the arms hold until the operator
requests a task again.
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
from skywright.description.robot.limbs import list_grippers, list_joints
from skywright.links.udp.flight import FlightGateway
from skywright.links.udp.packets import CODES, find_kind
from skywright.links.udp.receiver import Arrived
from skywright.missions.skills.moves import set_rest
from skywright.models.geometry import compute_clearance
from skywright.models.rigid_body import posture
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arm_commands import ArmCommand, get_entry
from skywright.vehicle.arms.ports import ArmModel, Hands, HandState, Marker
from skywright.vehicle.conditions import find_arms_lack
from skywright.vehicle.hand_stream import LEAST_N, HandStream, Told
from skywright.vehicle.interface import fill_tips
from skywright.vehicle.plant import MISSION_TICK

Array = NDArray[np.float64]

COMMANDS = {
    "hold": ArmCommand.MOVE_TO, "rest": ArmCommand.REST_POSE, "operate": ArmCommand.OPERATION_POSE,
    "stick": ArmCommand.HANDS_VELOCITY, "joints": ArmCommand.MOVE_TO,
    "torque_on": ArmCommand.TORQUE_ON, "torque_off": ArmCommand.TORQUE_OFF,
    "grasp": ArmCommand.GRASP, "force": ArmCommand.SET_FORCES,
    "visual": ArmCommand.HANDS_TO_MARKER,
}  # fmt: skip
"""Task -> command of the arms with the same requirements (vehicle/arm_commands.py)."""
STREAMED = ("stick", "joints", "force")
"""Tasks that end when their references stop."""
STALE_S = find_kind("joints").old_s
STOP_S = 1.0  # s without a fresh reference after which the task ends
PATIENCE_S = 60.0  # s of wall time to wait for a client
CLEAR_M = 0.01  # m, least clearance of referenced postures
NAMES = {CODES[name][0]: name for name in (*COMMANDS, "land")}


class Led(NamedTuple):
    """Result of an operator's turn, and numbers of references that were not tracked."""

    reason: str  # why it ended before the operator asked to land, or ""
    stale: int  # ticks in which the references were too old
    refused: int  # ticks in which a reference had too little clearance, or was for other joints


class Lead:
    """One operator's turn."""

    def __init__(self, s: Supervisor, gateway: FlightGateway, v_max: float, f_max: float) -> None:
        """`v_max` (m/s) and `f_max` (N) are the commands to a hand at full stick deflection.

        The hands grasp with `f_max`.
        """
        self.s, self.gateway, self.v_max, self.f_max = s, gateway, v_max, f_max
        robot = gateway.robot
        self.poses = {"rest": posture(robot, "folded"), "operate": posture(robot, "working")}
        """Joint angles (n,) rad of the tasks that are postures."""
        joints = list_joints(robot)
        self._low = np.array([limb.link.reach[0] for limb in joints])
        self._high = np.array([limb.link.reach[1] for limb in joints])
        self._driven = np.array([limb.servo >= 0 for limb in joints])
        self._query = None if s.surroundings is None else s.surroundings()
        self._task, self._since = "hold", 0.0  # and its start time (s)
        self._q = np.zeros(s.vehicle.n_joints)  # rad, commanded joint angles
        self._forces = HandStream(s.vehicle)
        self._places: dict[str, Array] = {}  # m, of the hands in the frame of the marker
        self.stale = self.refused = 0

    def run(self, longest_s: float) -> Led:
        """Command the arms until the operator requests to land or disconnects, or `longest_s` is
        over."""
        server = self.gateway.server
        server.offered = frozenset(CODES[name][0] for name in ("land", *self._list_offered()))
        try:
            return Led(self._run(longest_s), self.stale, self.refused)
        finally:
            server.offered = frozenset()
            self._set_task("hold")

    def _list_offered(self) -> list[str]:
        """Return the tasks that this vehicle supports."""
        b = self.s.vehicle
        needs = {name: get_entry(command).needs for name, command in COMMANDS.items()}
        offered = [name for name in needs if not any(find_arms_lack(n, b) for n in needs[name])]
        presses = len(self._list_sensing()) == 2 and not list_grippers(b.robot)
        return [name for name in offered if name != "grasp" or presses]

    def _list_sensing(self) -> list[str]:
        """Return the hands with a force estimate: a joint of their arm measures its deflection."""
        arm = self.s.vehicle.read(ArmModel)
        return [
            side for first, side in zip(arm.first, self._sides(), strict=False)
            if np.any(arm.sensed[first : first + arm.n])
        ]  # fmt: skip

    def _run(self, longest_s: float) -> str:
        ends = time.monotonic() + PATIENCE_S
        self._set_task("hold")
        while not self.gateway.server.watched:
            if time.monotonic() > ends:
                return f"nobody connected within {PATIENCE_S:g} s"
            check_interrupt()
            self.gateway.poll()
            time.sleep(0.01)
        ends = time.monotonic() + PATIENCE_S
        led = False  # a session that only watches does not lead
        for _ in range(round(longest_s / MISSION_TICK)):
            self.gateway.poll()
            led = led or self.gateway.server.led
            if not led and time.monotonic() > ends:
                return f"nobody took control within {PATIENCE_S:g} s"
            while self.gateway.operations:
                task = NAMES[self.gateway.operations.popleft().code]
                if task == "land":
                    return ""
                self._set_task(task)
            if led and not self.gateway.server.led:
                return "the operator is gone"
            self._step()
            self.s.tick()
        return f"the operator took more than {longest_s:g} s"

    def _set_task(self, task: str) -> None:
        """Start a task, as a phase of the flight."""
        self.s.begin(task)
        self.gateway.task, self._task = CODES[task][0], task
        self.gateway.stick = self.gateway.joints = None
        vehicle = self.s.vehicle
        self._since = vehicle.t
        self._q = np.array(vehicle.read(HandState).q_goal[: vehicle.n_joints])
        arms, sides = self.s.arms, self._sides()
        places = dict(zip(sides, np.array(vehicle.read(Hands).p_WH), strict=False))
        if task == "torque_off":
            for side in sides:
                arms.torques(side, np.zeros(4))
        elif task == "torque_on":
            for side in sides:
                arms.hold_joints(side)
        elif task == "grasp":
            arms.squeeze(self.f_max, places["left"], places["right"])
        elif task == "visual":
            seen = vehicle.read(Marker)
            self._places = {side: seen.R_WO.T @ (p - seen.p_WO) for side, p in places.items()}
            arms.hands_to_marker(self._places)
        else:
            arms.move_to(self.poses.get(task, self._q))

    def _step(self) -> None:
        if self._task == "joints":
            self._follow(self.gateway.joints)
        elif self._task in ("stick", "force", "visual"):
            self._push(self.gateway.stick)

    def _is_fresh(self, arrived: Arrived | None) -> bool:
        """Whether a command is fresh; ends the task if none has arrived for STOP_S."""
        age = self.gateway.measure_age(arrived)
        if arrived is None:
            age = self.s.vehicle.t - self._since
        if arrived is not None and age <= STALE_S:
            return True
        self.stale += 1
        if age > STOP_S and self._task in STREAMED:
            self._set_task("hold")
        return False

    def _follow(self, arrived: Arrived | None) -> None:
        """Move towards the newest joint references within the joints' speeds."""
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
        """Move the hands by (24), or let them exert a force, in the platform's heading."""
        task, axes = self._task, np.zeros(3)
        if self._is_fresh(arrived):
            assert arrived is not None
            axes = np.array(arrived.packet.values["axes"][:3])
        elif self._task != task:
            return
        R, vehicle = self.s.vehicle.reference["R_WB"], self.s.vehicle
        along = rot_z(math.atan2(R[1, 0], R[0, 0])) @ axes
        if task == "stick":
            self.s.arms.hands_velocity({side: self.v_max * along for side in self._sides()})
        elif task == "visual":
            shift = MISSION_TICK * self.v_max * vehicle.read(Marker).R_WO.T @ along
            self._places = {side: p + shift for side, p in self._places.items()}
            self.s.arms.hands_to_marker(self._places)
        else:
            row = set_rest(vehicle.reference)[None]
            for side in self._list_sensing():
                h = self._sides().index(side)
                self._forces.tell(h, Told("f", self.f_max * along + [0.0, 0.0, LEAST_N]))
            self._forces.fill(row)
            self.s.body.track(row)

    def _sides(self) -> list[str]:
        return ["left", "right"][: int(self.s.vehicle.read(ArmModel).n_hands)]

    def _is_near(self, q: Array) -> bool:
        """Whether the robot would have too little clearance at q."""
        if self._query is None:
            return False
        row = self.s.vehicle.reference
        ahead, now = (
            compute_clearance(self._query, row["p_WB"], row["R_WB"], x).distance
            for x in (q, self._q)
        )
        return ahead < CLEAR_M and ahead < now

    def _track(self, change: Array) -> None:
        """Command a change of the joints (n,) rad within one mission tick."""
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
