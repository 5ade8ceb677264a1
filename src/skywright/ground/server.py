"""The ground station's server: routes of the page, its web socket, and its event loop."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import re
import signal
import socket
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from skywright.errors import InputError
from skywright.ground.guard import REPORT_POLICY, Guard
from skywright.ground.orders import LARGEST, parse_order
from skywright.ground.station import Station, Watcher, dump
from skywright.reports.served import read_asset, read_report

HOST_NAME = re.compile(r"[\w.:%-]{1,253}")
LOCAL = ("127.0.0.1", "localhost", "::1")
BYTES = 4  # of a character in UTF-8, at most
MOST_BAD = 1000
"""Invalid messages after which a page is disconnected."""


class Address(NamedTuple):
    """Listening address and host names of the station."""

    host: str = "127.0.0.1"
    port: int = 0  # 0 selects a free one
    names: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None
    unencrypted: bool = False  # allowed on an address that other computers reach

    def check(self) -> None:
        """Raise InputError if the station would listen to others without a certificate."""
        for option, name in (("--host", self.host), *(("--name", n) for n in self.names)):
            if not HOST_NAME.fullmatch(name):
                raise InputError(f"{option} {name[:80]!r}; valid: a host's name or address")
        if self.host not in LOCAL and self.certificate is None and not self.unencrypted:
            raise InputError(
                f"--host {self.host}: other computers could connect without encryption; give "
                "--certificate and --key, or --unencrypted to accept that"
            )
        if (self.certificate is None) != (self.key is None):
            raise InputError("--certificate and --key: give both, or none")
        if self.certificate is not None:
            try:
                ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(self.certificate, self.key)
            except (OSError, ssl.SSLError) as error:
                raise InputError(
                    f"--certificate {self.certificate}, --key {self.key}: "
                    f"{error.strerror or error}; valid: a certificate and its private key, both as "
                    "PEM files"
                ) from None

    def list_names(self) -> set[str]:
        """Return the host names by which a browser may reach the station."""
        names = {*self.names, "127.0.0.1", "localhost"}
        if self.host not in ("0.0.0.0", "::"):
            names.add(f"[{self.host}]" if ":" in self.host else self.host)
        return {name.lower() for name in names}

    def bind(self) -> socket.socket:
        """Return a listening socket; raises InputError if the address is not available."""
        family = socket.AF_INET6 if _is_v6(self.host) else socket.AF_INET
        listening = socket.socket(family, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((self.host, self.port))
        except OSError as error:
            listening.close()
            raise InputError(
                f"cannot listen on {self.host}, port {self.port}: {error.strerror or error}"
            ) from None
        return listening


def _is_v6(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).version == 6
    except ValueError:
        return False


def build_app(station: Station, data: str | None) -> Starlette:
    """Return the application without its guard; `data` is that of a replay."""

    async def page(request: Request) -> Response:
        text = read_asset("station.html")
        if data is not None:
            text = text.replace('<html lang="en">', '<html lang="en" data-mode="replay">', 1)
        return Response(text, media_type="text/html")

    async def script(request: Request) -> Response:
        return Response(read_asset("station.js"), media_type="text/javascript")

    async def style(request: Request) -> Response:
        return Response(read_asset("station.css"), media_type="text/css")

    async def replay(request: Request) -> Response:
        return _absent() if data is None else Response(data, media_type="application/json")

    async def scene(request: Request) -> Response:
        if station.scene is None or not station.scene.is_file():
            return _absent()
        return FileResponse(station.scene, media_type="application/json")

    async def choices(request: Request) -> Response:
        return Response(json.dumps(station.choices), media_type="application/json")

    async def report(request: Request) -> Response:
        path = station.find_report(request.path_params["number"], request.path_params["page"])
        if path is None:
            return _absent()
        headers = {"content-security-policy": REPORT_POLICY}
        try:  # in another thread: the event loop carries the sticks of a flight
            text = await asyncio.to_thread(read_report, path)
        except InputError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return Response(text, media_type="text/html", headers=headers)

    async def talk(sock: WebSocket) -> None:
        await _talk(station, sock)

    return Starlette(
        routes=[
            Route("/", page), Route("/station.js", script), Route("/station.css", style),
            Route("/data.json", replay), Route("/scene.json", scene),
            Route("/choices.json", choices), Route("/flights/{number:int}/{page}", report),
            WebSocketRoute("/ws", talk),
        ]
    )  # fmt: skip


def _absent() -> Response:
    return PlainTextResponse("There is nothing here.\n", 404)


async def _talk(station: Station, sock: WebSocket) -> None:
    """Serve one page until it disconnects."""
    await sock.accept()
    watcher = station.enter()
    if watcher is None:
        await sock.close(1013, "too many pages")
        return
    pump = asyncio.create_task(_pump(watcher, sock))
    try:
        while watcher.bad < MOST_BAD:
            message = await sock.receive()
            if message["type"] == "websocket.disconnect":
                break
            try:
                order = parse_order(message.get("text") or "")
            except InputError as error:
                watcher.bad += 1
                station.counts["malformed"] += 1
                watcher.tell("told", text=f"Refused: {error}")
                continue
            station.follow(watcher, order)
    except (WebSocketDisconnect, RuntimeError):  # disconnected during a send
        pass
    finally:
        pump.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await pump
        station.leave(watcher)
        with contextlib.suppress(RuntimeError):
            await sock.close()


async def _pump(watcher: Watcher, sock: WebSocket) -> None:
    """Send the newest data at the rate of the page."""
    try:
        while True:
            await watcher.wake.wait()
            watcher.wake.clear()
            words, watcher.words = list(watcher.words.values()), {}
            frame, watcher.frame = watcher.frame, None
            for word in words:
                await sock.send_text(dump(word))
            if frame is not None:
                watcher.sent += 1
                await sock.send_bytes(frame)
    except (WebSocketDisconnect, RuntimeError, OSError):
        return


class _Server(uvicorn.Server):
    """uvicorn raises signals again after its end; here the station ends in order."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to `run_server`."""
        yield


async def run_server(
    station: Station, address: Address, data: str | None,
    on_open: Callable[[str, Guard], Awaitable[None]],
) -> None:  # fmt: skip
    """Serve until interrupted, or until `station.done`; `on_open` receives the one-time address."""
    listening = address.bind()
    port = int(listening.getsockname()[1])
    secure = address.certificate is not None
    guard = Guard(build_app(station, data), address.list_names(), port, secure=secure)
    shown = address.names[0] if address.names else address.host
    shown = "127.0.0.1" if shown in ("0.0.0.0", "::") else shown
    shown = f"[{shown}]" if ":" in shown else shown
    base = f"{'https' if secure else 'http'}://{shown}:{port}"
    station.invite = lambda: base + guard.invite()
    config = uvicorn.Config(
        guard, log_level="critical", access_log=False, lifespan="off", server_header=False,
        ws="websockets-sansio", ws_max_size=BYTES * LARGEST, ws_max_queue=16,
        ws_per_message_deflate=False, ws_ping_interval=10.0, ws_ping_timeout=20.0,
        timeout_graceful_shutdown=2, h11_max_incomplete_event_size=16_384,
        ssl_certfile=str(address.certificate) if secure else None,
        ssl_keyfile=str(address.key) if secure else None,
    )  # fmt: skip
    server = _Server(config)
    with contextlib.suppress(
        RuntimeError, ValueError
    ):  # not the main thread: the caller ends the server
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, station.done.set)

    async def end_when_done() -> None:
        await station.done.wait()
        server.should_exit = True

    async with _running(station.tick()), _running(end_when_done()):
        serving = asyncio.create_task(server.serve([listening]))
        try:
            while not server.started and not serving.done():
                await asyncio.sleep(0.01)
            await on_open(base + guard.invite(1e9), guard)
            await serving
        finally:
            server.should_exit = True
            await station.close()
            with contextlib.suppress(asyncio.CancelledError):
                await serving


@contextlib.asynccontextmanager
async def _running(what: Any) -> AsyncIterator[None]:
    task = asyncio.create_task(what)
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
