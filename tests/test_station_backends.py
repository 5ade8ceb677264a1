"""The back ends that a page may choose: what flies a mission, and the reason of a refusal."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path
from typing import Any

import pytest

import skywright
from skywright.errors import InputError
from skywright.ground.backends import NO_ADDRESS, find_refusals, list_backends
from skywright.ground.feed import Feed
from skywright.ground.flights import Asked
from skywright.ground.orders import parse_order
from skywright.ground.station import Station
from skywright.links.pair import build_pair, say

CHOICES: dict[str, Any] = {
    "missions": {"waypoints": "x"}, "robots": {}, "worlds": {}, "backends": list_backends(()),
}  # fmt: skip


def test_a_page_is_told_what_the_command_line_says(tmp_path: Path) -> None:
    names = list_backends(())
    assert list(names) == ["physics", "kinematic", "px4", "mavlink"]
    assert find_refusals(Asked("waypoints"), names) == {"mavlink": NO_ADDRESS}
    refused = find_refusals(Asked("excitation"), [*names, "mavlink:udpin:14540"])
    assert list(refused) == ["kinematic", "px4", "mavlink", "mavlink:udpin:14540"]
    for name in ("kinematic", "px4", "mavlink:udpin:14540"):
        with pytest.raises(InputError) as told:
            skywright.run("excitation", out=tmp_path / "never", backend=name)
        assert refused[name] == str(told.value)
    assert not (tmp_path / "never").exists()
    assert "truth" in find_refusals(Asked("waypoints", sets=("mission.estimator=truth",)),
                                    names)["px4"]  # fmt: skip


def test_links_of_the_command_line_are_offered_in_place_of_the_hint() -> None:
    assert list(list_backends(["mavlink:udpin:14540", "px4?force"])) == [
        "physics", "kinematic", "px4", "mavlink:udpin:14540", "px4?force",
    ]  # fmt: skip
    for wrong in ("gazebo", "mavlink", "mavlink:udpin:x", "px4?warp"):
        with pytest.raises(InputError, match=r"valid|back ends that fly"):
            list_backends([wrong])


@pytest.mark.parametrize(
    "more", ['"backend":7', '"backend":["kinematic"]', '"backend":null', '"backend":{}']
)
def test_a_back_end_is_a_name(more: str) -> None:
    for kind in ('"start"', '"choose","n":1'):
        with pytest.raises(InputError, match=r"backend is .*; valid: the name of a back end"):
            parse_order(f'{{"k":{kind},"mission":"waypoints",{more}}}')


def test_a_question_has_a_number() -> None:
    with pytest.raises(InputError, match="n is missing"):
        parse_order('{"k":"choose","mission":"waypoints"}')
    order = parse_order('{"k":"choose","mission":"waypoints","n":3}')
    assert order.content["n"] == 3
    assert order.content["backend"] == "physics"


def test_a_vehicle_with_a_clock_of_its_own_is_not_paused(tmp_path: Path) -> None:
    for backend, paced in (("px4?force", True), ("mavlink:udpin:14540", False)):
        ours, theirs = build_pair()
        feed = Feed(ours, tmp_path, backend=backend)
        for kind, more in (("watch", {"n": 1}), ("speed", {"x": 0.1}), ("pause", {"on": True})):
            say(theirs, kind, **more)
        feed.poll()
        assert feed.watched and feed.paced == feed.paused == paced
        if not paced:
            began = time.perf_counter()
            feed._pace(0.0)
            feed._pace(60.0)  # s of the mission: no waiting
            assert time.perf_counter() - began < 10.0
        ours.close(), theirs.close()


def test_a_station_answers_and_starts_nothing_that_it_does_not_offer(tmp_path: Path) -> None:
    async def talk() -> tuple[list[str], dict[str, Any], dict[str, Any]]:
        station, notes = Station(tmp_path, CHOICES, {}), []
        page = station.enter()
        assert page is not None

        def order(kind: str, **more: Any) -> None:
            station.follow(page, parse_order(json.dumps({"k": kind, **more})))

        async def ask(number: int, *sets: str) -> dict[str, Any]:
            order("choose", mission="waypoints", n=number - 1)  # the newest question counts
            order("choose", mission="waypoints", n=number, sets=list(sets))
            while "backends" not in page.words:
                await asyncio.sleep(0.02)
            return dict(page.words.pop("backends"))

        order("take")
        for backend in ("gazebo", "mavlink:tcp:example.org:80", "file.py:Backend", "p" * 200):
            order("start", mission="waypoints", backend=backend)
            notes.append(station.note)
        assert station.process is None
        found = await ask(2), await ask(4, "mission.nonsense=1")
        order("choose", mission="waypoints", n=5)
        await station.close()  # while a question is open
        return notes, *found

    notes, good, wrong = asyncio.run(talk())
    assert [note.partition(": ")[0][:20] for note in notes] == ["There is no back end"] * 4
    assert good["n"] == 2 and good["refused"] == {"mavlink": NO_ADDRESS}
    assert wrong["n"] == 4 and "nonsense" in wrong["wrong"]
