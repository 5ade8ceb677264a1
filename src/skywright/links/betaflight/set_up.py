"""Writes settings to Betaflight before a flight: over its command line, then a restart."""

from __future__ import annotations

import socket
from collections.abc import Callable

from skywright.errors import InputError, SimulationError
from skywright.links.betaflight.command_line import CommandLine, connect
from skywright.links.betaflight.link import wait
from skywright.links.betaflight.process import Firmware

RESTART_S = 30.0
"""s, time limit for a restart by its owner after `save`."""
BOOT_S = 1.0  # s after its start until its ports are open


class SetUp:
    """Configures a Betaflight with a robot's settings until it answers by MSP."""

    def __init__(
        self, host: str, port: int, wait_s: float, firmware: Firmware | None,
        say: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._host, self._port, self._wait_s = host, port, wait_s
        self._firmware, self._say = firmware, say
        self.version = ""

    def run(self, commands: list[str]) -> socket.socket:
        """Send the settings; return the connection for MSP.

        Raises InputError if no Betaflight answers or a setting is refused.
        """
        if self._firmware is not None:
            self._check_free()
            self._firmware.start()
        self._say(f"waiting for Betaflight on {self._host}:{self._port}")
        peer = connect(self._host, self._port, self._wait_s)
        if peer is None:
            raise InputError(
                f"no Betaflight at {self._host}:{self._port} within {self._wait_s:g} s; start its "
                "SITL program, or give --binary FILE"
            )
        try:
            line = CommandLine(peer)
            self.version = line.open()
            for command in commands:
                line.ask(command)
            line.save()
        except SimulationError as error:  # no flight has started
            raise InputError(str(error)) from None
        except OSError as error:
            raise InputError(
                f"{self._host}:{self._port} closed the connection ({error.strerror or error}): "
                "another program is connected to Betaflight, or this port is not Betaflight's"
            ) from None
        finally:
            peer.close()
        self._say(f"{self.version}: {len(commands)} settings")
        return self.restart()

    def _check_free(self) -> None:
        """Raise InputError if another instance uses the ports."""
        peer = connect(self._host, self._port, 0.0)
        if peer is not None:
            peer.close()
            raise InputError(
                f"port {self._port} on {self._host}: a Betaflight runs already; end it, or leave "
                "--binary out to fly with it"
            )

    def restart(self) -> socket.socket:
        """Restart it, or wait for a restart by its owner; return the connection for MSP."""
        if self._firmware is not None:
            self._firmware.start()
        else:
            self._say("Betaflight has ended to keep its settings: start it again")
        wait(BOOT_S)
        peer = connect(self._host, self._port, RESTART_S)
        if peer is None:
            raise InputError(
                f"Betaflight did not come back within {RESTART_S:g} s; run it in a loop that "
                "starts it again when it ends"
            )
        return peer
