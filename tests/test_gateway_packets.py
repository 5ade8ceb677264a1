"""The gateway's packets: defined once, the same in Python, C and MATLAB's table, hard to forge."""

from __future__ import annotations

import math
import re
import shutil
import struct
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.links.udp.codec import Packet, Rejected, decode, encode
from skywright.links.udp.generate import build_c_header, build_matlab, build_tables
from skywright.links.udp.packets import (
    HEADER,
    KINDS,
    MAX_SIZE,
    TAG,
    Field,
    Kind,
    find_kind,
    get_size,
)
from skywright.links.udp.receiver import CAUSES, Ages, Receiver, read_packet

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples" / "gateway"
KEY = b"0123456789abcdef"
U32, U64 = st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)


def draw_field(f: Field) -> st.SearchStrategy[Any]:
    if f.type == "char":
        return st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=f.length)
    if f.type[0] == "f":
        bound = min(f.limit, 1e6)
        item: st.SearchStrategy[Any] = st.floats(-bound, bound, width=32).filter(
            lambda x: abs(x) <= bound
        )
    else:
        most = min(2 ** int(f.type[1:]) - 1, f.limit)  # an integer: 2.0**64 - 1 is 2.0**64
        item = st.integers(0, int(most))
    return item if f.length == 1 else st.lists(item, min_size=f.length, max_size=f.length)


def draw_values(kind: Kind) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({f.name: draw_field(f) for f in kind.fields})


DRAWN = st.sampled_from(KINDS).flatmap(lambda k: st.tuples(st.just(k), draw_values(k)))


def as_sent(values: dict[str, Any]) -> dict[str, Any]:
    return {n: tuple(v) if isinstance(v, list) else v for n, v in values.items()}


@given(DRAWN, U32, U32, U64, st.sampled_from([b"", KEY]))
def test_a_packet_is_read_as_it_was_written(
    drawn: tuple[Kind, dict[str, Any]], session: int, sequence: int, time_us: int, key: bytes
) -> None:
    kind, values = drawn
    data = encode(kind.name, session, sequence, time_us, values, key)
    assert len(data) == get_size(kind) <= MAX_SIZE
    assert decode(data, key) == Packet(kind, session, sequence, time_us, as_sent(values))


@given(DRAWN, st.data())
def test_a_changed_bit_or_another_key_is_noticed(
    drawn: tuple[Kind, dict[str, Any]], data: st.DataObject
) -> None:
    packet = bytearray(encode(drawn[0].name, 7, 1, 1, drawn[1], KEY))
    assert decode(bytes(packet), KEY[::-1]) == Rejected("tag")
    assert decode(bytes(packet)) == Rejected("tag")
    bit = data.draw(st.integers(0, 8 * len(packet) - 1))
    packet[bit // 8] ^= 1 << bit % 8
    found = decode(bytes(packet), KEY)
    assert isinstance(found, Rejected) and found.cause in CAUSES


@given(st.binary(max_size=2 * MAX_SIZE))
def test_bytes_are_a_packet_or_have_a_cause(data: bytes) -> None:
    counts: Counter[str] = Counter()
    assert read_packet(data, b"", counts) is not None or set(counts) <= set(CAUSES)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1.5])
def test_numbers_out_of_range_are_neither_sent_nor_received(bad: float) -> None:
    with pytest.raises(ValueError, match="axes"):
        encode("stick", 1, 1, 1, {"axes": [0.0, bad]}, KEY)
    good = encode("stick", 1, 1, 1, {"axes": [0.25]})
    forged = good.replace(struct.pack("<f", 0.25), struct.pack("<f", bad))
    assert decode(forged) == Rejected("value")


def test_what_no_packet_holds_is_refused() -> None:
    for values in ({"axis": 1.0}, {"axes": [0.0] * 7}, {"buttons": -1}, {"buttons": 2**32}):
        with pytest.raises(ValueError, match="stick"):
            encode("stick", 1, 1, 1, values)


# --- what follows from the tables ----------------------------------------------------------------


def test_the_generated_files_are_those_of_today() -> None:
    for name, text in (("h", build_c_header()), ("m", build_matlab())):
        path = EXAMPLES / f"skywright_packets.{name}"
        assert path.read_text("utf-8") == text, f"run: python docs/generate_gateway.py ({path})"


def test_the_page_has_the_tables_of_today() -> None:
    page = (ROOT / "docs" / "howto" / "gateway.md").read_text("utf-8")
    for name, table in build_tables().items():
        inside = page.split(f"<!-- {name} -->\n")[1].split(f"<!-- end of {name} -->")[0]
        assert inside.strip() == table, "run: python docs/generate_gateway.py"


@given(DRAWN)
def test_the_matlab_table_finds_every_field(drawn: tuple[Kind, dict[str, Any]]) -> None:
    """Bytes are read by the rows of the table alone, as a MATLAB user would."""
    kind, values = drawn
    data = encode(kind.name, 3, 4, 5, values)
    letters = {"uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q", "single": "f",
               "double": "d", "char": "s"}  # fmt: skip
    row = re.compile(r"'(\w+)', (\d+), (\d+), '(\w+)', '(\w+)', (\d+), (\d+), '")
    found = {}
    for name, number, size, field, kind_of, at, count in row.findall(build_matlab()):
        if name == kind.name:
            assert int(number) == kind.number and int(size) == len(data)
            part = struct.unpack_from(f"<{count}{letters[kind_of]}", data, int(at))
            found[field] = part if len(part) > 1 else part[0]
    assert found.pop("session") == 3 and found.pop("sequence") == 4 and found.pop("time_us") == 5
    for f in HEADER[:4]:
        found.pop(f.name)
    found = {n: v.rstrip(b"\0").decode() if isinstance(v, bytes) else v for n, v in found.items()}
    assert found == as_sent(values)


ECHO = """
#include <stdio.h>
#include "skywright_packets.h"
int main(void) {
    uint8_t in[2], packet[SKW_MAX_SIZE], out[SKW_MAX_SIZE];
    while (fread(in, 1, 2, stdin) == 2) {
        size_t n = in[0] | in[1] << 8, m = 0;
        skw_header h;
        if (fread(packet, 1, n, stdin) != n) return 1;
        switch (skw_get_header(packet, n, &h)) {
        %s
        default: return 2;
        }
        fwrite(out, 1, m, stdout);
    }
    return 0;
}
"""
CASE = """case SKW_{upper}: {{ skw_{name} v;
            if (!skw_decode_{name}(packet, n, &h, &v)) return 3;
            m = skw_encode_{name}(out, &h, &v); break; }}"""


@pytest.fixture(scope="module")
def c_echo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A C program that decodes packets and encodes them again, by the generated header."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler (cc) on PATH")
    folder = tmp_path_factory.mktemp("c")
    cases = "\n".join(CASE.format(upper=k.name.upper(), name=k.name) for k in KINDS)
    (folder / "echo.c").write_text(ECHO % cases)
    options = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{EXAMPLES}"]
    subprocess.run(
        [compiler, *options, folder / "echo.c", "-o", folder / "echo"], check=True, cwd=folder
    )
    return folder / "echo"


@settings(max_examples=40)  # a process each
@given(packets=st.lists(DRAWN, min_size=1, max_size=40))
def test_c_decodes_what_python_encodes_and_back(
    c_echo: Path, packets: list[tuple[Kind, dict[str, Any]]]
) -> None:
    sent = [encode(k.name, 2**31, n, 2**60 + n, values) for n, (k, values) in enumerate(packets)]
    data = b"".join(struct.pack("<H", len(p)) + p for p in sent)
    back = subprocess.run([c_echo], input=data, capture_output=True, check=True, timeout=60)
    assert back.stdout == b"".join(sent)


# --- what is accepted ----------------------------------------------------------------------------


def make(name: str, sequence: int, stamp: float, session: int = 5) -> Packet:
    found = decode(encode(name, session, sequence, int(1e6 * stamp), {}))
    assert isinstance(found, Packet)
    return found


@pytest.fixture
def receiver() -> Receiver:
    return Receiver(5, Counter(), to_arms=True)


def test_replayed_foreign_and_returning_packets_are_counted_and_dropped(
    receiver: Receiver,
) -> None:
    assert receiver.take(make("stick", 10, 1.0), 100.0) is not None
    assert receiver.take(make("joints", 3, 1.0), 100.0) is not None  # each kind has its own order
    assert receiver.take(make("stick", 10, 1.0), 100.0) is None
    assert receiver.take(make("stick", 9, 1.1), 100.1) is None
    assert receiver.take(make("stick", 11, 0.9), 100.1) is None  # a clock that went back
    assert receiver.take(make("stick", 12, 1.1, session=6), 100.1) is None
    assert receiver.take(make("state", 13, 1.1), 100.1) is None  # goes the other way
    assert receiver.counts == {"accepted": 2, "replayed": 3, "session": 1, "kind": 1}


def test_a_burst_after_a_stall_is_old_though_it_has_just_arrived(receiver: Receiver) -> None:
    """Ages come from stamps: the last packets of the burst are the only fresh ones."""
    for k in range(50):
        assert receiver.take(make("stick", k, 0.02 * k), 7.0 + 0.02 * k) is not None
    burst = [receiver.take(make("stick", 50 + k, 1.0 + 0.02 * k), 9.0) for k in range(50)]
    ages = [b.age for b in burst if b is not None]
    assert burst[:38] == [None] * 38 and len(ages) == 12  # they are 1.0 to 0.02 s old
    assert ages == pytest.approx([0.26 - 0.02 * k for k in range(1, 13)], abs=1e-5)
    assert receiver.counts["old"] == 38


@given(st.floats(-1e6, 1e6), st.floats(-200e-6, 200e-6), st.integers(0, 2**31))
def test_ages_need_no_common_clock_and_forget_its_drift(
    offset: float, drift: float, seed: int
) -> None:
    """Quartz clocks differ by up to 200 ppm: after an hour by 0.7 s, yet ages stay right."""
    import random

    rng, ages = random.Random(seed), Ages()
    for k in range(3600):
        sent = float(k)
        delay = 0.01 + 0.1 * rng.random() ** 4
        age = ages.measure(sent + delay, offset + (1.0 + drift) * sent)
        if k > 60:
            assert age >= -1e-9
            assert abs(age - (delay - 0.01)) <= 200e-6 * 60.0 + 0.03


def test_a_silence_longer_than_the_window_is_no_reference() -> None:
    ages = Ages(window_s=1.0)
    assert ages.measure(0.0, 0.0) == 0.0
    assert ages.measure(1.5, 1.3) == pytest.approx(0.2)  # the window before still counts
    assert ages.measure(9.0, 5.0) == 0.0  # whatever was known is too old


def test_junk_is_counted_in_bounded_memory(tmp_path: Path) -> None:
    """20,000 packets here; benchmarks/gateway-fuzz.txt has a million, by the same script."""
    out = subprocess.run(
        [sys.executable, ROOT / "scripts" / "fuzz_gateway.py", "20000", "3"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    counts = {cause: int(n) for n, cause in re.findall(r"^ *(\d+) ([a-z]+)$", out, re.M)}
    assert set(counts) <= {*CAUSES, "accepted"}
    assert {"tag", "session", "replayed", "size", "oversized", "short", "kind"} <= set(counts)
    grown = re.search(r"grown ([-\d.]+) kB", out)
    assert grown is not None and float(grown[1]) < 100.0
    committed = (ROOT / "benchmarks" / "gateway-fuzz.txt").read_text()
    assert committed.startswith("packets 1000000,")


def test_a_tag_is_that_of_rfc_2104() -> None:
    """HMAC-SHA256 of test case 2 of RFC 4231, cut to 16 bytes."""
    from skywright.links.udp.codec import compute_tag

    tag = compute_tag(b"what do ya want for nothing?", b"Jefe")
    assert tag.hex() == "5bdcc146bf60754e6a042426089575c7" and len(tag) == TAG
    assert find_kind("stick").old_s == 0.25
