"""A scripted page of the ground station: enters with the one-time address, watches and steers.

It uses only the interfaces of a browser: the token, the cookie and the web socket.
"""

from __future__ import annotations

import http.client
import json
import re
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from websockets.sync.client import connect

from skywright.run.operator import Sight, Stick
from skywright.vehicle.plant import MISSION_TICK


def start_station(folder: Path, *arguments: str) -> tuple[subprocess.Popen[bytes], str]:
    """Run `skywright serve` in `folder`; return the process and its one-time address."""
    log = folder / "station.log"
    with log.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "skywright", "serve", *arguments, "--no-open"],
            cwd=folder, stdout=file, stderr=file,
        )  # fmt: skip
    ends = time.monotonic() + 120.0
    while time.monotonic() < ends and process.poll() is None:
        found = re.search(r"http://\S+", log.read_text())
        if found is not None:
            return process, found[0]
        time.sleep(0.1)
    raise RuntimeError(f"the station did not start: {log.read_text()[-500:]}")


class Page:
    """One page; `poll` receives messages."""

    def __init__(self, address: str) -> None:
        """`address` is a one-time address."""
        url = urlsplit(address)
        assert url.hostname is not None
        link = http.client.HTTPConnection(url.hostname, url.port, timeout=60)
        link.request("GET", f"{url.path}?{url.query}" if url.query else url.path)
        cookie = link.getresponse().getheader("set-cookie")
        link.close()
        if cookie is None:
            raise RuntimeError("the address has been used")
        self.sock = connect(
            f"ws://{url.netloc}/ws", open_timeout=60, max_size=None, ping_interval=None,
            additional_headers={
                "Origin": f"http://{url.netloc}", "Cookie": cookie.split(";")[0],
            },
        )  # fmt: skip
        self.words: dict[str, dict[str, Any]] = {}
        self.frames = 0
        self.on_word: Callable[[dict[str, Any]], None] = lambda word: None
        self._seq, self._here = 0, 0.0

    @property
    def state(self) -> dict[str, Any]:
        """The station's last message about the flight and the controlling page."""
        return self.words.get("state", {})

    @property
    def status(self) -> dict[str, Any]:
        """The last status of the flight."""
        return dict(self.state.get("status") or {})

    def send(self, kind: str, **content: Any) -> None:
        """Send a message."""
        self.sock.send(json.dumps({"k": kind, **content}))

    def poll(self, seconds: float) -> None:
        """Receive messages for a time (s of wall time); keep the lease."""
        ends = time.monotonic() + seconds
        while (left := ends - time.monotonic()) > 0.0:
            if time.monotonic() - self._here > 0.5:
                self._here = time.monotonic()
                self.send("here")
            try:
                data = self.sock.recv(timeout=min(left, 0.5))
            except TimeoutError:
                continue
            if isinstance(data, bytes):
                self.frames += 1
                continue
            word = json.loads(data)
            self.words[word["k"]] = word
            self.on_word(word)

    def wait(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Poll until a condition holds; return whether it did within a time (s)."""
        ends = time.monotonic() + seconds
        while not condition() and time.monotonic() < ends:
            self.poll(0.05)
        return condition()

    def push_stick(self, stick: Stick, held: bool = True) -> None:
        """Send a stick."""
        self._seq += 1
        self.send(
            "stick", s=self._seq, w=time.monotonic(), v=[float(x) for x in stick.axes], d=held,
            b=bool(stick.button),
        )  # fmt: skip

    def close(self) -> None:
        """Close the connection."""
        self.sock.close()


class Pilot:
    """Steers a page with an operator model whose view and stick are delayed."""

    def __init__(self, page: Page, operator: Any, delay_s: float) -> None:
        """`delay_s` (s) is the round-trip delay, half in each direction."""
        self.page, self.operator, self.half = page, operator, 0.5 * delay_s
        self.sights: deque[tuple[float, Sight]] = deque()
        self.sticks: deque[tuple[float, Stick]] = deque()
        self.seen: Sight | None = None
        self.active, self._t, self._now = True, 0.0, 0.0
        page.on_word = self._hear

    def _hear(self, word: dict[str, Any]) -> None:
        if word["k"] == "sight":
            sight = Sight(
                np.array(word["off"]), word["done"], tuple(word["towards"]), word["force"],
                word["asked"], word["hold_s"],
            )  # fmt: skip
            self._now = word["t"]
            self.sights.append((time.monotonic(), sight))

    def step(self) -> None:
        """Process views, decide, and send the stick; call it about 50 times per second."""
        now = time.monotonic()
        while self.sights and self.sights[0][0] <= now - self.half:
            self.seen = self.sights.popleft()[1]
        stick = Stick(np.zeros(3), False)
        if self.seen is not None:
            while self._t <= self._now:  # one step of the operator per tick of the flight
                stick = self.operator.read(self._t, self.seen)
                self.sticks.append((now, stick))
                self._t += MISSION_TICK
        while self.sticks and self.sticks[0][0] <= now - self.half:
            self.stick = self.sticks.popleft()[1]
        if self.active and self.page.status.get("asked"):
            self.page.push_stick(self.stick)

    stick = Stick(np.zeros(3), False)
