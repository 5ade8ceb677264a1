"""The ground station's rules: what pages may ask, who controls, how old a stick is, frames."""

from __future__ import annotations

import json
import math
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skywright.errors import InputError
from skywright.ground.control import LEASE_S, LET_GO_S, Control, StickJudge, Told
from skywright.ground.flights import Asked, Logbook
from skywright.ground.link import HEADER, MAGIC, is_frame, pack_frame
from skywright.ground.orders import LARGEST, parse_order
from skywright.ground.serve import serve
from skywright.ground.server import Address
from skywright.links.pair import build_pair, receive, say
from skywright.run.operator import Stick

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inside: st.lists(inside, max_size=4) | st.dictionaries(st.text(max_size=4), inside),
)
KINDS = st.sampled_from(
    ["ping", "pause", "speed", "order", "disturb", "stick", "start", "take", "nothing"]
)
KEYS = st.sampled_from(["w", "on", "x", "what", "s", "v", "d", "b", "mission", "seed", "sets"])


@given(st.text(max_size=300) | st.binary(max_size=300).map(lambda b: b.decode("latin-1")))
def test_any_text_is_an_order_or_nothing(text: str) -> None:
    try:
        parse_order(text)
    except InputError:
        return
    assert isinstance(json.loads(text), dict)


@given(KINDS, st.dictionaries(KEYS, JSON, max_size=8))
def test_whatever_an_order_holds_is_finite_and_within_limits(kind: str, content: dict) -> None:
    try:
        order = parse_order(json.dumps({"k": kind, **content}))
    except InputError:
        return
    json.dumps(order.content, allow_nan=False)
    if kind == "stick":
        assert len(order.content["v"]) == 3 and all(abs(x) <= 1.0 for x in order.content["v"])
    if kind == "speed":
        assert order.content["x"] == 0.0 or 0.1 <= order.content["x"] <= 20.0


@pytest.mark.parametrize(
    "text",
    [
        '{"k":"stick","s":1,"w":1,"v":[NaN,0,0],"d":true,"b":false}',
        '{"k":"stick","s":1,"w":1,"v":[1e400,0,0],"d":true,"b":false}',
        '{"k":"stick","s":1,"w":1,"v":[1.01,0,0],"d":true,"b":false}',
        '{"k":"stick","s":1,"w":1,"v":[0,0],"d":true,"b":false}',
        '{"k":"stick","s":1,"w":1,"v":[0,0,0],"d":1,"b":false}',
        '{"k":"order","what":"explode"}',
        '{"k":"start","mission":"../../etc/passwd"}',
        '{"k":"start","mission":"waypoints","sets":"x"}',
        '{"k":"start","mission":"waypoints","seed":-1}',
        '{"k":"start","mission":"waypoints","robot":"a/b.toml"}',
        '{"k":"speed","x":0.01}',
        "[" * 3000,
        '{"k":"take"}' + " " * LARGEST,
    ],
)
def test_orders_out_of_order_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"valid: |not a JSON object"):
        parse_order(text)


def test_a_page_cannot_load_code() -> None:
    for text in (
        "mission.law.kind=evil.py:Law", 'mission.kind="x.PY:Kind"',
        r'robot.control.law="evil.p\u0079:L"',
        r'robot.control="""evil.\U00000070y:L"""', r'robot.control={ law = "evil\u002epy:L" }',
        r'world.x=[[{ kind = 1 }, "a.\u0050Y:B"]]', r'robot.x={ "evil.p\u0079:L" = 1 }',
    ):  # fmt: skip
        with pytest.raises(InputError, match="Python file"):
            Asked("waypoints", sets=(text,)).check()
    Asked("waypoints", sets=("world.wind.kind=steady", r'mission.note="p\u0079"')).check()


def test_control_is_taken_explicitly_and_falls_free() -> None:
    control = Control()
    assert not control.hear("a", 0.0) and control.judge("a", 1, 0.0, 0.0) is None
    control.take("a", 0.0)
    assert control.hear("a", 1.0) and not control.hear("b", 1.0)
    assert not control.expire(1.0 + LEASE_S) and control.expire(1.01 + LEASE_S)
    assert control.who is None and not control.hear("a", 4.0)
    control.take("a", 5.0)
    control.forgive(3.0)  # the station stood for 3 s: the page may have spoken
    assert not control.expire(9.0) and control.expire(10.1)
    control.take("a", 5.0)
    control.take("b", 5.1)  # takes over
    assert control.judge("a", 1, 5.1, 5.1) is None and control.judge("b", 1, 5.1, 5.1) == 0.0
    assert not control.release("a") and control.release("b")


@given(st.lists(st.tuples(st.integers(0, 20), st.floats(0.0, 1.0)), max_size=40))
def test_followed_sticks_have_a_growing_sequence_and_are_young(
    sent: list[tuple[int, float]],
) -> None:
    control, followed = Control(), []
    control.take("a", 0.0)
    for k, (seq, delay) in enumerate(sent):
        stamp = 100.0 + 0.1 * k  # another clock
        age = control.judge("a", seq, stamp, 0.1 * k + delay)
        if age is not None:
            assert 0.0 <= age < LET_GO_S
            followed.append(seq)
    assert followed == sorted(set(followed))


def test_a_burst_after_a_stall_is_old() -> None:
    """Ten messages of 1 s arrive at once: the time since the last one would call them fresh."""
    control = Control()
    control.take("a", 7.0)
    assert control.judge("a", 0, 50.0, 7.0) == 0.0
    burst = [control.judge("a", 1 + k, 50.1 + 0.1 * k, 8.1) for k in range(10)]
    assert burst[:8] == [None] * 8  # 1.0 to 0.3 s old
    assert burst[8:] == pytest.approx([0.2, 0.1], abs=1e-9)


@pytest.mark.parametrize(("hz", "growth"), [(30, 0.003), (50, 0.003), (60, 0.0035)])
def test_a_delay_that_grows_slowly_releases_the_stick(hz: int, growth: float) -> None:
    """Each message is later than the one before, over more messages than any window holds."""
    control, followed = Control(), []
    control.take("a", 0.0)
    for k in range(2000):
        control.hear("a", k / hz + growth * k)
        if control.judge("a", k, 100.0 + k / hz, k / hz + growth * k) is not None:
            followed.append(growth * k)
    assert 0.2 < max(followed) < LET_GO_S


def test_the_smallest_delay_is_forgotten_when_clocks_drift() -> None:
    """The page's clock is slow by 0.5 %: after minutes its messages are still young."""
    control = Control()
    control.take("a", 0.0)
    ages = [control.judge("a", k, 0.995 * 0.5 * k, 0.5 * k) for k in range(1200)]
    assert None not in ages and max(age for age in ages if age is not None) < 0.16


def test_the_robots_side_judges_a_stick_again() -> None:
    judge, push = StickJudge(), Stick(np.array([0.5, 0.0, 0.0]), False)
    assert np.all(judge.read(0.0).axes == 0.0) and math.isinf(judge.age(0.0))
    assert judge.hear(Told(1, 10.0, push), 10.1) and judge.read(10.2).axes[0] == 0.5
    assert np.all(judge.read(10.0 + LET_GO_S).axes == 0.0)
    assert not judge.hear(Told(1, 10.4, push), 10.4)  # repeated
    assert not judge.hear(Told(2, 10.0, push), 10.4)  # the station had stalled
    assert not judge.hear(Told(3, 11.0, push), 10.4)  # from the future
    assert judge.dropped == 3


@given(st.integers(0, 2**40), st.floats(0, 1e5), st.integers(0, 65535), st.integers(0, 7))
def test_a_frame_says_what_was_put_in(seq: int, t: float, phase: int, flags: int) -> None:
    row = np.array([1.5, np.nan, -2.0], "<f4")
    data = pack_frame(seq, t, 1.7e9, phase, flags, 3.5, row)
    assert is_frame(data) and len(data) == HEADER.size + 12 and HEADER.size == 36
    magic, number, time, _, at, bits, late, _ = HEADER.unpack_from(data)
    assert (magic, number, time, at, bits, late) == (MAGIC, seq % 2**32, t, phase, flags, 3.5)
    np.testing.assert_array_equal(np.frombuffer(data[36:], "<f4"), row)
    assert struct.unpack_from("<I", data)[0] == 0x31594B53  # as the page reads it


def test_sending_never_waits() -> None:
    a, b = build_pair()
    taken = sum(say(a, "status", text="x" * 2000) for _ in range(5000))
    assert 10 < taken < 5000  # full: the rest was dropped
    assert 10 < sum(1 for _ in receive(b)) <= taken
    b.close()
    assert not say(a, "status")  # nobody there
    a.close()


def test_the_logbook_survives_a_damaged_line(tmp_path: Path) -> None:
    book = Logbook(tmp_path / "runs")
    book.add({"mission": "a"})
    with book.path.open("a") as file:
        file.write('{"mission": \n[1]\n')
    book.add({"mission": "b"})
    assert [e["mission"] for e in Logbook(tmp_path / "runs").entries] == ["a", "b"]


def test_a_flight_that_outlived_its_station_is_written_down_by_the_next(tmp_path: Path) -> None:
    """Not while it flies, and not twice; a note that is no note is left alone."""
    ended = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"],
                           capture_output=True, text=True, check=True)  # fmt: skip
    gone, runs = int(ended.stdout), tmp_path / "runs"
    (runs / "waypoints-1").mkdir(parents=True)
    result = {"outcome": "aborted", "reason": "the operator is silent", "seed": 3}
    (runs / "waypoints-1" / "metrics.json").write_text(json.dumps(result))
    asked = {**Asked("waypoints")._asdict(), "sets": ["a.b=1"]}
    note = {"asked": asked, "out": str(runs / "waypoints-1"), "started": 0.0, "pid": os.getppid()}
    file = runs / f".flying-{gone}.json"
    file.write_text(json.dumps(note))
    (runs / ".flying-x.json").write_text("[")
    assert Logbook(runs).entries == [] and file.exists()
    file.write_text(json.dumps({**note, "pid": gone}))
    for _ in range(2):
        (entry,) = Logbook(runs).entries
        assert entry["outcome"] == "aborted" and entry["sets"] == ["a.b=1"] and entry["seed"] == 3
        assert entry["directory"] == str(runs / "waypoints-1") and not file.exists()


def test_other_computers_need_a_certificate_or_a_flag(tmp_path: Path) -> None:
    Address().check()
    Address("0.0.0.0", unencrypted=True).check()
    with pytest.raises(InputError, match="--certificate and --key, or --unencrypted"):
        Address("0.0.0.0").check()
    with pytest.raises(InputError, match="give both"):
        Address(certificate=tmp_path / "x").check()
    (tmp_path / "x").write_text("no certificate")
    with pytest.raises(InputError, match=r"--certificate .* both as PEM files"):
        Address("0.0.0.0", certificate=tmp_path / "x", key=tmp_path / "x").check()
    assert "0.0.0.0" not in Address("0.0.0.0", names=("gs.example",)).list_names()
    for wrong in (Address(""), Address(names=("a b",)), Address("a/b", unencrypted=True)):
        with pytest.raises(InputError, match="valid: a host's name or address"):
            wrong.check()


def test_what_is_no_mission_and_no_run_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no recording"):
        serve(str(tmp_path), Address(), tmp_path / "runs")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"--runs .*file/runs: "):
        serve(None, Address(), tmp_path / "file" / "runs")
