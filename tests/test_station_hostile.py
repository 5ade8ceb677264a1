"""A hostile client at the ground station is refused and counted; the station goes on."""

from __future__ import annotations

import asyncio
import http.client
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from skywright.ground.guard import Guard
from skywright.ground.server import Address, run_server
from skywright.ground.station import MOST_WATCHERS, Station
from waiting import wait_for

CHOICES = {
    "proposed": "", "missions": {"waypoints": "x"}, "robots": {}, "worlds": {},
    "backends": {"physics": "x", "kinematic": "x"},
}  # fmt: skip


class Running(NamedTuple):
    port: int
    entrance: str  # path with the one-time token
    guard: Guard
    station: Station

    def get(self, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
        """Ask with headers as given; Host is the right one unless given."""
        link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        link.putrequest("GET", path, skip_host=True)
        for name, value in {"Host": f"127.0.0.1:{self.port}", **headers}.items():
            link.putheader(name, value)
        link.endheaders()
        answer = link.getresponse()
        body = answer.read()
        link.close()
        return answer.status, {k.lower(): v for k, v in answer.getheaders()}, body

    def enter(self) -> str:
        """Use the token; returns the cookie."""
        status, headers, _ = self.get(self.entrance)
        assert status == 200
        return headers["set-cookie"].split(";")[0]

    def talk(self, cookie: str, **more: str | None) -> ClientConnection:
        headers = {"Origin": f"http://127.0.0.1:{self.port}", "Cookie": cookie, **more}
        given = {k: v for k, v in headers.items() if v is not None}
        return connect(
            f"ws://127.0.0.1:{self.port}/ws", additional_headers=given, open_timeout=60,
            ping_interval=None, max_size=None, max_queue=None,  # unread words delay no close
        )  # fmt: skip


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    found: list[Running] = []
    loop = asyncio.new_event_loop()

    async def serve() -> None:
        station = Station(tmp_path / "runs", CHOICES, {})

        async def opened(url: str, guard: Guard) -> None:
            found.append(Running(guard.port, url[url.index("/enter") :], guard, station))

        await run_server(station, Address(), None, opened)

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    wait_for(lambda: found or not thread.is_alive())
    yield found[0]
    loop.call_soon_threadsafe(found[0].station.done.set)
    thread.join(60)
    assert not thread.is_alive()
    loop.close()


def test_a_token_is_good_once_and_gives_a_strict_cookie(running: Running) -> None:
    status, headers, _ = running.get(running.entrance)
    cookie = headers["set-cookie"]
    assert status == 200 and "HttpOnly" in cookie and "samesite=strict" in cookie.lower()
    assert cookie.startswith(f"skywright_{running.port}=")
    assert running.get(running.entrance)[0] == 403  # used
    assert running.get("/enter?t=" + "a" * 32)[0] == 403
    assert running.get("/enter")[0] == 403
    assert running.guard.refused["token"] == 3
    good = cookie.split(";")[0]
    status, headers, page = running.get("/", Cookie=good)
    assert status == 200 and b"station.js" in page
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "script-src 'self';" in policy
    assert headers["x-content-type-options"] == "nosniff" and "server" not in headers


@pytest.mark.parametrize("path", ["/", "/station.js", "/scene.json", "/data.json", "/choices.json",
                                  "/flights/0/report.html", "/nothing"])  # fmt: skip
def test_nothing_without_a_cookie(running: Running, path: str) -> None:
    assert running.get(path)[0] == 403
    assert running.get(path, Cookie=f"skywright_{running.port}=" + "a" * 32)[0] == 403
    assert running.guard.refused["cookie"] == 2


def test_a_foreign_name_that_points_here_is_refused(running: Running) -> None:
    """DNS rebinding: the address is right, the name in Host is the attacker's."""
    cookie = running.enter()
    for host in ("evil.example", f"evil.example:{running.port}", f"127.0.0.1:{running.port + 1}",
                 "127.0.0.1", ""):  # fmt: skip
        assert running.get("/", Cookie=cookie, Host=host)[0] in (400, 403)
    assert running.get("/", Cookie=cookie, Host=f"localhost:{running.port}")[0] == 200
    entrance = running.guard.invite()
    assert running.get(entrance, Host="evil.example")[0] == 403
    assert running.get(entrance)[0] == 200  # the refused request did not use it up


@pytest.mark.parametrize(
    "origin", ["https://evil.example", "null", "http://127.0.0.1:1", "file://"]
)
def test_a_foreign_origin_is_refused_with_a_good_cookie(running: Running, origin: str) -> None:
    cookie = running.enter()
    assert running.get("/scene.json", Cookie=cookie, Origin=origin)[0] == 403
    with pytest.raises(InvalidStatus, match="403"):
        running.talk(cookie, Origin=origin)
    assert running.guard.refused["origin"] == 2


def test_a_web_socket_needs_origin_cookie_and_host(running: Running) -> None:
    cookie = running.enter()
    for more in ({"Origin": None}, {"Cookie": None}, {"Host": "evil.example"}):
        with pytest.raises(InvalidStatus, match=r"40[03]"):
            running.talk(cookie, **more)
    with running.talk(cookie) as ws:
        assert json.loads(ws.recv(timeout=60))["k"] == "you"


def test_other_methods_and_ways_out_of_the_folder_are_refused(running: Running) -> None:
    cookie = running.enter()
    for path in ("/../../etc/passwd", "/flights/0/../../x", "/flights/-1/report.html",
                 "/flights/0/mission.toml", "/%2e%2e/pyproject.toml"):  # fmt: skip
        assert running.get(path, Cookie=cookie)[0] == 404
    link = http.client.HTTPConnection("127.0.0.1", running.port, timeout=60)
    link.request("POST", "/", headers={"Cookie": cookie})
    assert link.getresponse().status == 403
    link.close()


def test_junk_is_counted_and_the_station_goes_on(
    running: Running, capfd: pytest.CaptureFixture[str]
) -> None:
    cookie = running.enter()
    with running.talk(cookie) as ws:
        for k in range(200):
            ws.send(['{"k":', "[" * 500, '{"k":"stick","v":[NaN]}', "1e400", ""][k % 5])
        for _ in range(20):
            ws.send(b"\x00\xff" * 50)  # binary
        ws.send('{"k":"ping","w":5}')
        while json.loads(ws.recv(timeout=60))["k"] != "pong":
            pass
    assert running.station.counts["malformed"] == 220
    with running.talk(cookie) as ws:
        ws.send("x" * 1_000_000)
        with pytest.raises(ConnectionClosed):
            while True:
                ws.recv(timeout=60)
    with running.talk(cookie) as ws:
        ws.send('{"k":"ping","w":6}')
        while json.loads(ws.recv(timeout=60))["k"] != "pong":
            pass
    wait_for(lambda: not running.station.watchers)
    told = capfd.readouterr()
    assert "Traceback" not in told.err + told.out


def test_only_the_controller_steers(running: Running) -> None:
    cookie = running.enter()

    def hear(ws: ClientConnection, kind: str) -> dict:
        while True:
            message = json.loads(ws.recv(timeout=60))
            if message["k"] == kind:
                return dict(message)

    with running.talk(cookie) as a, running.talk(cookie) as b:
        hear(a, "you"), hear(b, "you")
        a.send('{"k":"pause","on":true}')
        assert "control" in hear(a, "told")["text"]
        a.send('{"k":"take"}')
        while not hear(a, "state")["mine"]:
            pass
        b.send('{"k":"start","mission":"waypoints"}')
        assert "control" in hear(b, "told")["text"] and running.station.process is None
        b.send('{"k":"take"}')
        while not hear(b, "state")["mine"]:
            pass
        state = hear(a, "state")
        while state["controller"] != "page 2":
            state = hear(a, "state")
        assert not state["mine"]
        b.send('{"k":"invite"}')
        address = hear(b, "invited")["address"]
        assert running.get(address[address.index("/enter") :])[0] == 200
        while hear(a, "state")["controller"]:
            pass  # silent for 2 s: the lease ends
    assert running.station.counts["not in control"] == 2


def test_pages_are_bounded(running: Running) -> None:
    cookie = running.enter()
    open_ = [running.talk(cookie) for _ in range(MOST_WATCHERS)]
    more = running.talk(cookie)
    with pytest.raises(ConnectionClosed):
        while True:
            more.recv(timeout=60)
    for ws in open_:
        ws.close()
