"""The ground station's state: watchers, control, and the current flight.

Each watcher has one slot for the newest frame: a slow page skips frames, and there is no queue.
Everything runs in one event loop.
"""

from __future__ import annotations

import asyncio
import json
import math
import secrets
import socket
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from skywright.errors import InputError
from skywright.ground.backends import ask
from skywright.ground.control import HOLD_S, LEASE_S, Control
from skywright.ground.flights import Asked, Logbook, Process, choose_out, write_down
from skywright.ground.link import is_frame
from skywright.ground.orders import Order
from skywright.links.pair import parse, receive, say
from skywright.run.backends import LINKED, split_backend

TICK_S = 0.25  # s between messages to the flight and to the pages
MOST_WATCHERS = 16
STEERING = frozenset(
    {"pause", "speed", "order", "mode", "disturb", "stick", "choose", "start", "invite", "stop"}
)
"""Requests that only the page in control may make."""
PAGES = ("report.html", "replay.html")
UNREAD = "the flight does not read its messages; try again, or use Kill the flight in Station"


class Watcher:
    """One page."""

    def __init__(self, name: str) -> None:
        self.id, self.name = secrets.token_hex(8), name
        self.wake = asyncio.Event()
        self.frame: bytes | None = None  # the newest, not yet sent
        self.words: dict[str, Any] = {}  # by kind: the newest of each, not yet sent
        self.sent, self.skipped, self.bad = 0, 0, 0

    def show(self, frame: bytes) -> None:
        """Set the newest frame; an unsent one is skipped."""
        self.skipped += self.frame is not None
        self.frame = frame
        self.wake.set()

    def tell(self, kind: str, **content: Any) -> None:
        """Set a message; an unsent one of the same kind is replaced."""
        self.words[kind] = {"k": kind, **content}
        self.wake.set()


class Station:
    """State and operations of the station, for the server's routes."""

    def __init__(self, folder: Path, choices: dict[str, Any], files: dict[str, str]) -> None:
        """`folder` contains the runs; `choices` are the choices of a page.

        `files` maps names among the missions to files of the command line.
        """
        self.folder, self.choices, self.files = folder, choices, files
        self.control = Control()
        self.watchers: dict[str, Watcher] = {}
        self.counts: Counter[str] = Counter()
        self.logbook = Logbook(folder)
        self.process: Process | None = None
        self.scene: Path | None = None  # of the current flight
        self.scene_number = 0
        self.status: dict[str, Any] = {}
        self.note = ""  # result of the last request
        self.options: tuple[str, ...] = ()  # of `skywright run`, for every flight
        self.hosted = False  # by a flight that was started elsewhere (`run --view`)
        self.invite: Any = None  # returns an address
        self.done = asyncio.Event()
        self._temporary = tempfile.TemporaryDirectory(prefix="skywright-")
        self._end: socket.socket | None = None
        self._named = 0
        self._heard = -math.inf
        self._busy: asyncio.Task[None] | None = None
        self._flown: asyncio.Task[None] | None = None
        self._judging: asyncio.Task[None] | None = None

    # --- watchers ------------------------------------------------------------------------------

    def enter(self) -> Watcher | None:
        """Return a new watcher; None if there are too many."""
        if len(self.watchers) >= MOST_WATCHERS:
            self.counts["too many pages"] += 1
            return None
        self._named += 1
        watcher = Watcher(f"page {self._named}")
        self.watchers[watcher.id] = watcher
        watcher.tell("you", name=watcher.name)
        watcher.tell("logbook", entries=self.logbook.entries)
        self._count()
        self.tell_all()
        return watcher

    def leave(self, watcher: Watcher) -> None:
        """Remove a watcher and release its control."""
        self.watchers.pop(watcher.id, None)
        if self.control.release(watcher.id):
            self._control_changed()
        self._count()
        self.tell_all()

    def _count(self) -> None:
        if self._end is not None:
            say(self._end, "watch", n=len(self.watchers))

    def tell_all(self) -> None:
        """Send the status to every page."""
        flying = self.process is not None or self.hosted
        holder = self.watchers.get(self.control.who or "")
        for w in self.watchers.values():
            w.tell(
                "state", status=self.status, flying=flying, scene=self.scene_number,
                watchers=len(self.watchers), controller=holder.name if holder else "",
                mine=holder is w, note=self.note, hosted=self.hosted,
                mission=self.process.asked.mission if self.process else "",
                silent=flying and bool(self.status) and time.monotonic() - self._heard > LEASE_S,
                refused=sum(self.counts.values()), skipped=w.skipped,
            )  # fmt: skip

    # --- orders --------------------------------------------------------------------------------

    def follow(self, watcher: Watcher, order: Order) -> None:
        """Execute a page's request, if it is permitted."""
        now, kind, content = time.monotonic(), order.kind, order.content
        mine = self.control.hear(watcher.id, now)
        if kind == "here":
            return
        if kind == "ping":
            watcher.tell("pong", w=content["w"])
        elif kind == "take":
            self.control.take(watcher.id, now)
            self._control_changed()
        elif kind == "release":
            if self.control.release(watcher.id):
                self._control_changed()
        elif kind in STEERING and not mine:
            self.counts["not in control"] += 1
            watcher.tell("told", text="Take control first: this page does not have it.")
        elif kind == "stick":
            self._pass_stick(watcher, content, now)
        elif kind == "choose":
            self._choose(watcher, content)
        elif kind == "start":
            self._start(content)
        elif kind == "stop":
            self._stop()
        elif kind == "invite":
            if self.invite is not None:
                watcher.tell("invited", address=self.invite())
        elif self._end is not None:
            if not say(self._end, kind, **content):
                watcher.tell("told", text=f"{kind}: not sent: {UNREAD}")
        else:
            watcher.tell("told", text="There is no flight.")

    def _pass_stick(self, watcher: Watcher, content: dict[str, Any], now: float) -> None:
        stamp = content.pop("w")
        age = self.control.judge(watcher.id, content["s"], stamp, now)
        if age is None:
            self.counts["old stick"] += 1
        elif self._end is not None and not say(self._end, "stick", at=now - age, **content):
            self.counts["unread stick"] += 1

    def _control_changed(self) -> None:
        if self._end is not None:
            say(self._end, "control")
        self.tell_all()

    # --- flights -------------------------------------------------------------------------------

    def host(self, end: socket.socket, folder: Path) -> None:
        """Show the flight at the other end of `end`, which was started elsewhere."""
        self.hosted = True
        self._attach(end, folder)

    def _attach(self, end: socket.socket, folder: Path) -> None:
        self._detach()
        self._end, self.scene, self.status = end, folder / "scene.json", {}
        self._heard = time.monotonic()
        asyncio.get_running_loop().add_reader(end.fileno(), self._read)
        self._count()

    def _detach(self) -> None:
        if self._end is not None:
            asyncio.get_running_loop().remove_reader(self._end.fileno())
            self._end.close()
            self._end = None

    def _read(self) -> None:
        assert self._end is not None
        for data in receive(self._end):
            self._heard = time.monotonic()
            if is_frame(data):
                for watcher in self.watchers.values():
                    watcher.show(data)
                continue
            message = parse(data)
            if message is not None and message["k"] == "sight":
                del message["k"]
                for watcher in self.watchers.values():
                    watcher.tell("sight", **message)
                continue
            if message is None or message["k"] != "status":
                self.counts["bad word of a flight"] += 1
                continue
            if message.get("scene") is True and self.status.get("scene") is not True:
                self.scene_number, self.note = self.scene_number + 1, ""
            self.status = message
            self.tell_all()

    def _start(self, content: dict[str, Any]) -> None:
        if self.process is not None or self._busy is not None or self.hosted:
            self.note = "A flight is under way: abort it first."
            self.tell_all()
            return
        asked = self._read_asked(content)
        if isinstance(asked, str):
            self.note = asked
            self.tell_all()
            return
        if self._judging is not None:
            self._judging.cancel()
        mission = content["mission"]
        self.note = f"Preparing {mission} ..."
        self.tell_all()
        self._busy = asyncio.create_task(self._launch(asked, mission))

    def _read_asked(self, content: dict[str, Any]) -> Asked | str:
        """Return the requested flight, or a message that names an unknown item."""
        for name in ("mission", "robot", "world", "backend"):
            value = content[name]
            if value is not None and value not in self.choices[f"{name}s"]:
                return f"There is no {'back end' if name == 'backend' else name} {value[:80]!r}."
        mission = content["mission"]
        return Asked(
            self.files.get(mission, mission), content["robot"], content["world"], content["seed"],
            tuple(content["sets"]), content["operated"], content["backend"],
        )  # fmt: skip

    def _choose(self, watcher: Watcher, content: dict[str, Any]) -> None:
        """Send a page the back ends that can fly its set-up; the newest request replaces others."""
        if self.process is not None or self._busy is not None or self.hosted:
            return
        asked = self._read_asked(content)
        if isinstance(asked, str):
            watcher.tell("backends", n=content["n"], wrong=asked)
            return
        if self._judging is not None:
            self._judging.cancel()
        self._judging = asyncio.create_task(self._judge(watcher, asked, content["n"]))

    async def _judge(self, watcher: Watcher, asked: Asked, number: int) -> None:
        watcher.tell("backends", n=number, **await ask(asked, self.choices["backends"]))

    async def _launch(self, asked: Asked, name: str) -> None:
        try:
            folder = Path(tempfile.mkdtemp(dir=self._temporary.name))
            out = choose_out(self.folder, name)
            process = Process(asked, out, folder, self.options)
            await process.start()
        except InputError as error:
            self.note = f"Not started: {error}"
            return
        except Exception as error:  # an internal error must not end the station
            self.note = f"Not started: {type(error).__name__}: {error}"
            return
        else:
            assert process.end is not None
            self.process = process
            self.logbook.begin(process, name)
            self._attach(process.end, folder)
            linked = split_backend(asked.backend)[0] in LINKED
            meets = f", then waiting for {asked.backend}" if linked else ""
            self.note = f"Planning {name}{meets} ..."
            self._flown = asyncio.create_task(self._watch(process))
        finally:
            self._busy = None
            self.tell_all()

    async def _watch(self, process: Process) -> None:
        """Wait for the end of a flight, and add it to the logbook."""
        code = await process.wait()
        if self._end is not None:
            self._read()  # its last messages
        entry = write_down(process, code, list(self.status.get("repeats", ())))
        self.process = None
        self._detach()
        if self.files:
            names = {file: name for name, file in self.files.items()}
            entry["mission"] = names.get(entry["mission"], entry["mission"])
        self.status = {**self.status, "over": True, "asked": ""}
        self.note = f"{entry['mission']}: {entry['outcome']}" + (
            f": {entry['reason']}" if entry["reason"] else ""
        )
        try:
            self.logbook.add(entry)
        except InputError as error:
            self.note += f" ({error})"
        for watcher in self.watchers.values():
            watcher.tell("logbook", entries=self.logbook.entries)
        self.tell_all()

    def _stop(self) -> None:
        """Interrupt a flight that does not answer; its recording is kept."""
        if self.process is not None:
            self._busy_stop = asyncio.create_task(self.process.stop())

    def find_report(self, number: int, page: str) -> Path | None:
        """Return a page of the flight with a number in the logbook; None if it does not exist."""
        entry = next((e for e in self.logbook.entries if e["number"] == number), {})
        if page not in PAGES or not entry.get("directory"):
            return None
        path = Path(str(entry["directory"])) / page
        return path if path.is_file() else None

    # --- time ----------------------------------------------------------------------------------

    async def tick(self) -> None:
        """Maintain leases and the flight's connection, until cancelled."""
        now = time.monotonic()
        while True:
            before = now
            await asyncio.sleep(TICK_S)
            now = time.monotonic()
            self.control.forgive(now - before - TICK_S)
            if self.control.expire(now):
                self._control_changed()  # the page that had control informs its operator
            self._count()
            if self.watchers:
                self.tell_all()
            gone = now - self._heard > 3 * HOLD_S
            if self.hosted and self.status.get("over") and gone:
                self.done.set()

    async def close(self) -> None:
        """Stop all processes."""
        if self._judging is not None:
            self._judging.cancel()
            await asyncio.wait([self._judging])
        if self._busy is not None:
            await self._busy
        if self.process is not None:
            await self.process.stop()
        if self._flown is not None:
            await self._flown
        self._detach()
        self._temporary.cleanup()


def dump(message: dict[str, Any]) -> str:
    """Return a message as text."""
    return json.dumps(message, allow_nan=False, separators=(",", ":"))
