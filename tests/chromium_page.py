"""A page in headless Chromium, asked by its debugging protocol: for tests of what a user sees."""

from __future__ import annotations

import json
import subprocess
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

from waiting import wait_for

PATIENCE_S = 120.0  # of one answer: a loaded machine is slow, not silent


@contextmanager
def open_page(
    chromium: str, url: str, profile: Path, *options: str
) -> Iterator[Callable[[str], object]]:
    """Open `url` with WebGL in software; yields a function that evaluates JavaScript in it.

    The page may still load: wait for what you read, and write expressions that give null until
    it is there; one that raises fails the test.
    """
    command = [
        chromium, "--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--use-gl=angle",
        "--use-angle=swiftshader", "--disable-background-networking", "--no-first-run",
        f"--user-data-dir={profile}", "--window-size=700,450", "--remote-debugging-port=0",
        *options, url,
    ]  # fmt: skip
    browser = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        port_file = profile / "DevToolsActivePort"
        wait_for(lambda: port_file.exists() and "\n" in port_file.read_text())
        port = int(port_file.read_text().split()[0])
        pages: list[dict[str, Any]] = []

        def listed() -> bool:
            address = f"http://127.0.0.1:{port}/json"
            with urllib.request.urlopen(address, timeout=PATIENCE_S) as answer:
                pages[:] = [p for p in json.load(answer) if p["type"] == "page"]
            return bool(pages)

        wait_for(listed)
        with connect(
            pages[0]["webSocketDebuggerUrl"], max_size=None, open_timeout=PATIENCE_S,
            ping_interval=None,
        ) as ws:  # fmt: skip

            def evaluate(expression: str) -> object:
                what = {"expression": expression, "returnByValue": True}
                ws.send(json.dumps({"id": 1, "method": "Runtime.evaluate", "params": what}))
                while True:
                    answer = json.loads(ws.recv(timeout=PATIENCE_S))
                    if answer.get("id") == 1:
                        if "result" not in answer:  # the page was left just now
                            return None
                        raised = answer["result"].get("exceptionDetails")
                        assert raised is None, f"{expression}: {raised}"
                        return answer["result"]["result"].get("value")

            yield evaluate
    finally:
        browser.terminate()
        browser.wait()
