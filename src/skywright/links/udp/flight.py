"""A simulated flight as the arms program: it publishes its state and receives commands.

While a client is connected, the flight runs at the pace of the wall clock and publishes its state
at every mission tick (50 Hz). Without a client nothing is built and the flight does not wait. The
state contains estimates and measurements of the robot's computer, not the truth.
"""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from skywright.core.rotations import quat_from_rot
from skywright.errors import InputError
from skywright.links.radio import build_ways
from skywright.links.udp.address import load_key, open_socket, parse_address
from skywright.links.udp.packets import MAX_JOINTS
from skywright.links.udp.receiver import Arrived
from skywright.links.udp.server import Operation, Server
from skywright.models.compliant_arms import is_compliant
from skywright.vehicle.arms.ports import ArmModel, HandForce, Hands, HandState, Joints
from skywright.vehicle.component import Component
from skywright.vehicle.observers.deflection_board import DeflectionBoard

if TYPE_CHECKING:
    from skywright.description.loader import Description
    from skywright.vehicle.simulated import SimulatedVehicle

LATE_S = 0.5  # s behind the wall clock beyond which the flight does not catch up
KEPT = 32  # operations queued for the mission


def open_gateway(
    gateway: str | None,
    operator: str | None,
    key_file: str | os.PathLike[str] | None,
    description: Description,
) -> FlightGateway | None:
    """Return the gateway of the option `--gateway` or `--operator udp:...`, or None.

    Raises InputError for a wrong address or key.
    """
    by_operator = operator is not None and operator.partition(":")[0] == "udp"
    if gateway is None and not by_operator:
        if key_file is not None:
            raise InputError("--gateway-key requires --gateway or --operator udp:PORT")
        return None
    if gateway is not None and by_operator:
        raise InputError(
            "--gateway and --operator udp:... are the same gateway; give the second one only"
        )
    option = "--operator" if by_operator else "--gateway"
    address = parse_address(str(operator if by_operator else gateway), option)
    key = load_key(key_file)
    ways = build_ways(description.world.radio, description.mission.seed) or (None, None)
    server = Server(open_socket(address, key, option), key, up=ways[0], down=ways[1])
    return FlightGateway(server, description)


class FlightGateway:
    """An observer of a run that is the arms program of a gateway; see docs/howto/gateway.md."""

    def __init__(self, server: Server, description: Description) -> None:
        self.server, self.robot = server, description.robot
        self.task = 0
        """Code of the current task, for the state packet."""
        self.stick: Arrived | None = None
        self.joints: Arrived | None = None
        self.operations: deque[Operation] = deque(maxlen=KEPT)
        self.late_s = 0.0  # s, largest delay behind the wall clock
        self.skipped = 0  # number of states that were not sent because they were not finite
        self._hands = is_compliant(description.robot)
        self._board = DeflectionBoard("deflection board") if self._hands else None
        self._anchor: float | None = None
        self._closed = False
        print(f"gateway: listening on port {server.port}", file=sys.stderr, flush=True)

    @property
    def parts(self) -> list[Component]:
        """Components to add to the vehicle."""
        return [] if self._board is None else [self._board]

    def poll(self) -> None:
        """Store the received commands."""
        for command in self.server.poll():
            if isinstance(command, Operation):
                self.operations.append(command)
            elif command.packet.kind.name == "stick":
                self.stick = command
            else:
                self.joints = command

    @staticmethod
    def measure_age(arrived: Arrived | None) -> float:
        """Return the age (s) of a command; infinite without one."""
        if arrived is None:
            return np.inf
        return arrived.age + time.monotonic() - arrived.arrival

    # --- Observer --------------------------------------------------------------------------------

    def on_plan(self, plan: Any, description: Description) -> None:
        """Nothing to do: sessions may be opened before the flight."""
        self.poll()

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Receive, publish, and wait for the wall clock while a client is connected."""
        self.poll()
        readings = [] if self._board is None else self._board.take()
        if not self.server.watched:
            self._anchor = None
            return
        try:
            if self._hands:
                measured = _list_measured(vehicle)
                for reading in readings:
                    self.server.publish("deflection", {
                        "t": reading.t, "n": vehicle.n_joints, "measured": measured,
                        "deflection": reading.deflection,
                    })  # fmt: skip
            self.server.publish("state", self._build_state(t, phase, vehicle))
        except ValueError:  # not finite: it must not be sent
            self.skipped += 1
        self._pace(t)

    def close(self) -> None:
        """Stop listening, and report the counts."""
        if self._closed:
            return
        self._closed = True
        self.server.close()
        counts = ", ".join(f"{n} {cause}" for cause, n in sorted(self.server.counts.items()))
        late = f"; up to {self.late_s:.2f} s behind the wall clock" if self.late_s > 0.1 else ""
        skipped = f"; {self.skipped} states held no numbers" if self.skipped else ""
        print(f"gateway: packets: {counts or 'none'}{late}{skipped}", file=sys.stderr)

    def _pace(self, t: float) -> None:
        now = time.monotonic()
        if self._anchor is None:
            self._anchor = now - t
        ahead = self._anchor + t - now
        if ahead > 0.0:
            time.sleep(min(ahead, 0.1))
        else:
            self.late_s = max(self.late_s, -ahead)
            if ahead < -LATE_S:
                self._anchor = now - t

    def _build_state(self, t: float, phase: str, vehicle: SimulatedVehicle) -> dict[str, Any]:
        n, estimate = min(vehicle.n_joints, MAX_JOINTS), vehicle.estimate
        age = min(self.measure_age(self.stick), self.measure_age(self.joints))
        state = {
            "t": t, "task": self.task, "n": n, "q": estimate["q"][:n], "qd": estimate["qd"][:n],
            "q_ref": vehicle.reference_now["q"][:n], "p_WB": estimate["p_WB"],
            "q_WB": quat_from_rot(estimate["R_WB"]), "operation": self.server.accepted,
            "input_age": age if age < 1e6 else -1.0, "phase": phase,
        }  # fmt: skip
        if self._hands:
            arm, hands = vehicle.look(ArmModel), vehicle.look(Hands)
            joints, goal = vehicle.look(Joints), vehicle.look(HandState)
            count = int(arm.n_hands)
            state |= {
                "n_hands": count, "tau": arm.k[:n] * joints.deflection[:n],
                "p_hand": hands.p_WH[:count].ravel(), "v_hand": hands.v_WH[:count].ravel(),
                "p_hand_ref": goal.p_ref[:count].ravel(),
                "f_hand": vehicle.look(HandForce).f_WH[:count].ravel(),
            }  # fmt: skip
        return state


def _list_measured(vehicle: SimulatedVehicle) -> int:
    """Return the bits of the joints with a deflection encoder."""
    sensed = vehicle.look(ArmModel).sensed[: vehicle.n_joints]
    return int(sum(1 << j for j, on in enumerate(sensed) if on > 0.0))
