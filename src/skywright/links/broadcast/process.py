"""The child process of a flight that publishes it: reads the newest row, encodes, forwards
commands.

links/broadcast/flight.py starts it; it ends with the flight.
"""

from __future__ import annotations

import json
import os
import pickle
import socket
import sys
import threading
import time
from pathlib import Path
from typing import Protocol

from skywright.errors import InputError
from skywright.links.broadcast.caller import HELD_S, Caller
from skywright.links.broadcast.options import DISTRO, Live
from skywright.links.broadcast.rows import ROW, Reader, Setup
from skywright.links.pair import parse, prepare, receive, say

WATCH_S = 0.25  # s between messages on the subscribers
TEXT_S = 1.0  # s between texts
LEAST_S = 0.005  # s between reads of the socket


class Sink(Protocol):
    """A destination of messages."""

    def declare(self, reader: Reader) -> None:
        """Declare the topics of a flight."""

    @property
    def watched(self) -> bool:
        """Whether any topic has a subscriber."""

    def publish(self, reader: Reader) -> None:
        """Publish the newest row on the topics with subscribers."""

    def tell(self, name: str, text: str, ns: int) -> None:
        """Publish a text."""

    def close(self) -> None:
        """Close the sockets."""


def open_sinks(options: Live, caller: Caller) -> list[Sink]:
    """Open the requested sinks; raises InputError if that fails."""
    sinks: list[Sink] = []
    if options.ros2 is not None:
        from skywright.links.ros2.node import Ros2Node

        sinks.append(Ros2Node(str(options.ros2), options.distro or DISTRO, options.domain, caller))
    if options.foxglove is not None:
        from skywright.links.foxglove.server import FoxgloveServer

        sinks.append(FoxgloveServer(options.foxglove))
    return sinks


class Publisher:
    """The loop of the process."""

    def __init__(self, end: socket.socket, sinks: list[Sink], caller: Caller) -> None:
        self._end, self._sinks, self._caller = end, sinks, caller
        self._reader: Reader | None = None
        self._phase = ""
        self._next_watch = self._next_text = 0.0
        self._over = False

    def run(self) -> None:
        """Publish until the flight is over."""
        while not self._over:
            newest = self._read()
            reader = self._reader
            if reader is not None:
                if newest is not None and reader.read(newest):
                    for sink in self._sinks:
                        sink.publish(reader)
                self._tell(reader)
            if newest is None:
                time.sleep(LEAST_S)

    def _read(self) -> bytes | None:
        """Process the flight's messages; return the newest row."""
        newest = None
        for data in receive(self._end):
            if data.startswith(ROW):
                newest = data[len(ROW) :]
                continue
            message = parse(data) or {"k": ""}
            if message["k"] == "reply":
                self._caller.answer(message["id"], message["ok"], message["says"])
            elif message["k"] == "phase":
                self._phase, self._next_text = message["name"], 0.0
            elif message["k"] == "setup":
                self._declare(pickle.loads(Path(message["file"]).read_bytes()))
            elif message["k"] == "over":
                self._over = True
        return newest

    def _declare(self, setup: Setup) -> None:
        self._reader = Reader(setup)
        for sink in self._sinks:
            sink.declare(self._reader)
        say(self._end, "declared")

    def _tell(self, reader: Reader) -> None:
        now = time.monotonic()
        if now >= self._next_watch:
            self._next_watch = now + WATCH_S
            called = now - self._caller.last_s < HELD_S
            say(self._end, "watch", on=called or any(s.watched for s in self._sinks))
        if now >= self._next_text:
            self._next_text = now + TEXT_S
            ns = int(reader.ns[0])
            for sink in self._sinks:
                sink.tell("/mission/phase", self._phase, ns)
                sink.tell("/robot_description", reader.setup.urdf, ns)


def main(number: str, options: str) -> None:
    """Publish the flight at the other end of socket `number`."""
    end = socket.socket(fileno=int(number))
    prepare(end)
    caller, sinks = Caller(end), list[Sink]()

    def follow_parent() -> None:  # a killed flight leaves no process behind
        parent = os.getppid()
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(0)

    threading.Thread(target=follow_parent, daemon=True).start()
    try:
        sinks = open_sinks(Live(**json.loads(options)), caller)
        say(end, "opened")
        Publisher(end, sinks, caller).run()
    except InputError as error:
        say(end, "failed", says=str(error))
    finally:
        caller.end()
        for sink in sinks:
            sink.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
