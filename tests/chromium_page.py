"""A page in headless Chromium, asked by its debugging protocol: for tests of what a user sees."""

from __future__ import annotations

import json
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from websockets.sync.client import connect


def wait_for(what: Callable[[], object], seconds: float = 10.0) -> None:
    """Poll until `what` is true; fails the test after `seconds`."""
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)


@contextmanager
def open_page(
    chromium: str, url: str, profile: Path, *options: str
) -> Iterator[Callable[[str], object]]:
    """Open `url` with WebGL in software; yields a function that evaluates JavaScript in it."""
    command = [
        chromium, "--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--use-gl=angle",
        "--use-angle=swiftshader", "--disable-background-networking", "--no-first-run",
        f"--user-data-dir={profile}", "--window-size=700,450", "--remote-debugging-port=0",
        *options, url,
    ]  # fmt: skip
    browser = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        port_file = profile / "DevToolsActivePort"
        wait_for(lambda: port_file.exists() and port_file.read_text(), 40.0)
        port = int(port_file.read_text().split()[0])
        listing = urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=20).read()
        page = next(p for p in json.loads(listing) if p["type"] == "page")
        with connect(page["webSocketDebuggerUrl"], max_size=None) as ws:

            def evaluate(expression: str) -> object:
                what = {"expression": expression, "returnByValue": True}
                ws.send(json.dumps({"id": 1, "method": "Runtime.evaluate", "params": what}))
                while True:
                    answer = json.loads(ws.recv(timeout=30))
                    if answer.get("id") == 1:
                        return answer["result"]["result"].get("value")

            yield evaluate
    finally:
        browser.terminate()
        browser.wait()
