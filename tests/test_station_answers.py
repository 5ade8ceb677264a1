"""What the station answers: refused requests, lost messages, the logbook's pages."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from skywright.errors import InputError
from skywright.ground.flights import KEPT, Asked, Logbook, Process, write_down
from skywright.ground.guard import Guard
from skywright.ground.orders import LARGEST, LONGEST_SET, MOST_SETS, Order, parse_order
from skywright.ground.serve import list_choices
from skywright.ground.server import Address, run_server
from skywright.ground.station import Station
from skywright.links.pair import build_pair, say
from skywright.reports.served import unlink_files
from waiting import wait_for

CHOICES: dict[str, Any] = {
    "proposed": "", "missions": {"waypoints": "x"}, "robots": {}, "worlds": {},
    "backends": {"physics": "x"},
}  # fmt: skip
REPORT = (
    '<h1>x</h1><p id="files">Files of this run: <a href="replay.html">3-D replay</a> '
    '<small>(replay.html)</small>, <a href="metrics.json">metrics</a>.</p>'
    '<nav><a href="#a">a</a></nav>'
)


def start(**more: Any) -> str:
    return json.dumps({"k": "start", "mission": "waypoints", **more})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (start(seed=-1), "start: seed is -1; valid: a whole number from 0"),
        (start(seed=1.5), "start: seed is 1.5"),
        (start(mission="a/b"), "start: mission is 'a/b'; valid: a name"),
        (start(robot=7), "start: robot is 7"),
        (start(sets=["a=1"] * 41), "start: sets has 41 values; valid: up to 40"),
        (start(sets=["a=1", "x" * 301]), "start: value 2 of sets has 301 char.*valid: up to 300"),
        (start(sets=["a=\0"]), r"start: value 1 of sets is 'a=\\x00'; valid: text without NUL"),
        (start(sets=["\ud800=1"]), r"start: value 1 of sets is '\\ud800=1'"),
        (start(sets="a=1"), "start: sets is 'a=1'; valid: a list"),
        (start(operated=1), "start: operated is 1; valid: true or false"),
        ('{"k":"choose","mission":"waypoints"}', "choose: n is missing; valid: a number"),
        ('{"k":"order","what":"explode"}', "order: what is 'explode'; valid: abort, "),
        ('{"k":"speed","x":0.01}', r"speed: x is 0.01; valid: 0 \(fastest\), 0.1 to 20"),
        ('{"k":"stick","v":[0,2,0]}', r"stick: v\[1\] is 2; valid: a number from -1 to 1"),
        ('{"k":"pause","on":[[1]]}', "pause: on is a list of 1; valid: true or false"),
        ('{"k":"dance"}', "'dance': no kind of message; valid: take, "),
        ("[]", "not a JSON object"),
        (" " * (LARGEST + 1), f"a message of {LARGEST + 1} characters; valid: up to {LARGEST}"),
    ],
)
def test_a_refused_request_has_its_field_its_value_and_valid_ones(text: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as told:
        parse_order(text)
    assert len(str(told.value)) < 500 and "\n" not in str(told.value)


def test_the_largest_start_within_the_limits_is_accepted() -> None:
    name = "n" * 256
    order = parse_order(start(mission=name, robot=name, sets=["x" * LONGEST_SET] * MOST_SETS))
    assert len(order.content["sets"]) == MOST_SETS


def test_every_mission_that_is_proposed_can_be_started(tmp_path: Path) -> None:
    """Also one from a file whose name has spaces and brackets."""
    for name in ("my mission", "inspect(2)", "prüfung", "a" * 100):
        station = Station(tmp_path, list_choices(name, {name: f"/x/{name}.toml"}), {name: "f.toml"})
        order = parse_order(start(mission=station.choices["proposed"]))
        asked = station._read_asked(order.content)
        assert isinstance(asked, Asked) and asked.mission == "f.toml"
        station._temporary.cleanup()


def test_an_unknown_choice_is_answered(tmp_path: Path) -> None:
    async def talk() -> dict[str, Any]:
        station = Station(tmp_path, CHOICES, {})
        page = station.enter()
        assert page is not None
        station.follow(page, Order("take", {}))
        station.follow(page, parse_order('{"k":"choose","mission":"no such","n":3}'))
        await station.close()
        return dict(page.words["backends"])

    assert asyncio.run(talk()) == {
        "k": "backends", "n": 3, "wrong": "There is no mission 'no such'.",
    }  # fmt: skip


def test_an_order_that_the_flight_does_not_read_is_reported(tmp_path: Path) -> None:
    async def talk() -> tuple[str, int]:
        station, (ours, theirs) = Station(tmp_path, CHOICES, {}), build_pair()
        station.host(ours, tmp_path)
        page = station.enter()
        assert page is not None
        station.follow(page, Order("take", {}))
        while say(ours, "watch", n=1):  # nobody reads: the queue becomes full
            pass
        station.follow(page, parse_order('{"k":"order","what":"abort"}'))
        stick = {"s": 1, "w": 1.0, "v": [0, 0, 0], "d": True, "b": False}
        station.follow(page, parse_order(json.dumps({"k": "stick", **stick})))
        await station.close()
        theirs.close()
        return page.words["told"]["text"], station.counts["unread stick"]

    text, sticks = asyncio.run(talk())
    assert text.startswith("order: not sent: the flight does not read") and sticks == 1


def test_a_flight_that_cannot_be_started_leaves_no_sockets_open(tmp_path: Path) -> None:
    async def begin(text: str) -> None:
        with pytest.raises(InputError, match="cannot be started"):
            await Process(Asked("waypoints", robot=text), tmp_path / "a", tmp_path).start()

    before = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").is_dir() else None
    for _ in range(5):
        asyncio.run(begin("a\0b"))
        asyncio.run(begin("\ud800"))
    if before is not None:
        assert len(os.listdir("/proc/self/fd")) <= before


@pytest.mark.parametrize("code", [0, -2, -15])
def test_a_finished_flight_keeps_its_outcome_if_its_process_is_killed(
    tmp_path: Path, code: int
) -> None:
    result = json.dumps({"outcome": "succeeded", "reason": "", "seed": 1})
    done, cut = Path(tmp_path / "done"), Path(tmp_path / "cut")
    for folder in (done, cut.with_name("cut.partial")):
        folder.mkdir()
        (folder / "metrics.json").write_text(result)
    entry = write_down(Process(Asked("waypoints"), done, tmp_path), code, [])
    assert (entry["outcome"], entry["reason"]) == ("succeeded", "")
    entry = write_down(Process(Asked("waypoints"), cut, tmp_path), code, [])
    assert (entry["outcome"] == "killed") == (code < 0)


def test_a_number_in_the_logbook_names_one_flight(tmp_path: Path) -> None:
    """Also after more flights than a page shows, a damaged line, and a restart of the station."""
    book = Logbook(tmp_path)
    book.add({"mission": "0"})
    with book.path.open("a") as file:
        file.write("[1]\n")
    book = Logbook(tmp_path)
    for k in range(KEPT + 5):
        book.add({"mission": str(k + 2)})
    for found in (book, Logbook(tmp_path)):
        assert len(found.entries) == KEPT
        assert all(int(e["mission"]) == e["number"] for e in found.entries)


def test_a_served_report_states_the_folder_of_its_files(tmp_path: Path) -> None:
    page = unlink_files(REPORT, Path("/runs/<a>"))
    assert re.findall(r'href="([^"]*)"', page) == ["#a"]
    assert "metrics.</p>" not in page and "<small>(replay.html)</small>" in page
    assert "They are in the folder <code>/runs/&lt;a&gt;</code>.</p>" in page


def test_the_template_of_a_report_marks_its_files() -> None:
    import skywright.reports.report as report

    source = Path(report.__file__).parent / "templates" / "report.html.j2"
    assert '<p id="files">Files of this run: ' in source.read_text()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Station, str, str]]:
    """A running station, its Host and a cookie."""
    found: list[tuple[Station, str, str]] = []
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "report.html").write_text(REPORT)
    (tmp_path / "run" / "replay.html").write_text(REPORT)
    loop = asyncio.new_event_loop()

    async def serve() -> None:
        station = Station(tmp_path / "runs", CHOICES, {})
        station.logbook.add({"mission": "waypoints", "directory": str(tmp_path / "run")})

        async def opened(url: str, guard: Guard) -> None:
            found.append((station, f"127.0.0.1:{guard.port}", url[url.index("/enter") :]))

        await run_server(station, Address(), None, opened)

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    wait_for(lambda: found or not thread.is_alive())
    station, host, entrance = found[0]
    yield station, host, get(host, entrance, "")[1]["set-cookie"].split(";")[0]
    loop.call_soon_threadsafe(station.done.set)
    thread.join(60)
    loop.close()


def get(host: str, path: str, cookie: str) -> tuple[int, dict[str, str], str]:
    link = http.client.HTTPConnection(host, timeout=60)
    link.request("GET", path, headers={"Cookie": cookie})
    answer = link.getresponse()
    text = answer.read().decode()
    link.close()
    return answer.status, {k.lower(): v for k, v in answer.getheaders()}, text


def test_every_link_of_a_served_page_leads_somewhere(served: tuple[Station, str, str]) -> None:
    station, host, cookie = served
    for name in ("report", "replay"):
        status, headers, page = get(host, f"/flights/0/{name}.html", cookie)
        assert status == 200 and headers["content-security-policy"].startswith("sandbox")
        assert all(link.startswith("#") for link in re.findall(r'href="([^"]*)"', page))
        assert f"<code>{station.logbook.entries[0]['directory']}</code>" in page
    for path in ("/flights/1/report.html", "/flights/0/metrics.json"):
        assert get(host, path, cookie)[0] == 404


def test_a_page_receives_the_reason_and_keeps_its_connection(
    served: tuple[Station, str, str],
) -> None:
    _, host, cookie = served
    with connect(
        f"ws://{host}/ws", additional_headers={"Origin": f"http://{host}", "Cookie": cookie},
        open_timeout=60, ping_interval=None,
    ) as link:  # fmt: skip

        def hear(kind: str) -> dict[str, Any]:
            while True:
                message = json.loads(link.recv(timeout=60))
                if message["k"] == kind:
                    return dict(message)

        for text, says in (
            (start(sets=["a=1"] * 41), "Refused: start: sets has 41 values"),
            ("é" * (LARGEST + 1), f"Refused: a message of {LARGEST + 1} characters"),
        ):
            link.send(text)
            assert hear("told")["text"].startswith(says)
        link.send(start(sets=["x" * LONGEST_SET] * MOST_SETS))
        assert "Take control first" in hear("told")["text"]
