"""An operator connected through the UDP gateway (`--operator udp:PORT`; links/udp)."""

from __future__ import annotations

import sys
import time

import numpy as np

from skywright.core.interrupt import check_interrupt
from skywright.ground.person import PATIENCE_S, Person
from skywright.links.udp.flight import FlightGateway
from skywright.links.udp.packets import find_kind
from skywright.run.operator import Stick


class GatewayOperator(Person):
    """The stick of the client in control of the gateway. The sender's stamps give its age."""

    stale_s = find_kind("stick").old_s

    def __init__(self, gateway: FlightGateway) -> None:
        super().__init__()
        self.gateway = gateway

    def begin(self) -> bool:
        """Discard earlier data; wait for the first stick."""
        print(
            f"operator: waiting for a stick on port {self.gateway.server.port}",
            file=sys.stderr, flush=True,
        )  # fmt: skip
        self.gateway.poll()
        self.gateway.stick, ends = None, time.perf_counter() + PATIENCE_S
        while self.gateway.stick is None and time.perf_counter() < ends:
            check_interrupt()
            time.sleep(0.01)
            self.gateway.poll()
        self.listen()
        return self.gateway.stick is not None

    def listen(self) -> None:
        """Store the newest stick with its age."""
        self.gateway.poll()
        arrived = self.gateway.stick
        if arrived is None:
            return
        values = arrived.packet.values
        self._stick = Stick(np.array(values["axes"][:3], float), bool(values["buttons"] & 1))
        self._heard = time.perf_counter() - self.gateway.measure_age(arrived)
