"""Packets of MAVLink, whole, cut, with errors and random: nothing raises and nothing grows."""

from __future__ import annotations

import math
import random
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from skywright.links.mavlink.stream import MavlinkStream, is_finite
from skywright.links.px4.lockstep import Lockstep
from skywright.links.px4.sensors import compute_time_us
from skywright.links.px4.telemetry import Telemetry

MESSAGES = [
    cls for cls in common.mavlink_map.values()
    if cls.msgname in {
        "HEARTBEAT", "HIL_ACTUATOR_CONTROLS", "COMMAND_LONG", "LOCAL_POSITION_NED",
        "ATTITUDE_QUATERNION", "POSITION_TARGET_LOCAL_NED", "HIL_SENSOR", "HIL_GPS",
        "HIL_STATE_QUATERNION", "ODOMETRY", "STATUSTEXT",
    }
]  # fmt: skip
"""Every message that is sent or heard, and one that is ignored."""
NUMBERS = {
    "float": st.floats(width=32), "double": st.floats(), "char": st.just(b"text"),
    "uint8_t": st.integers(0, 2**8 - 1), "uint16_t": st.integers(0, 2**16 - 1),
    "uint32_t": st.integers(0, 2**32 - 1), "uint64_t": st.integers(0, 2**64 - 1),
    "int8_t": st.integers(-(2**7), 2**7 - 1), "int16_t": st.integers(-(2**15), 2**15 - 1),
    "int32_t": st.integers(-(2**31), 2**31 - 1),
}  # fmt: skip


@st.composite
def messages(draw: st.DrawFn) -> Any:
    """Draw a message with any numbers that its fields hold."""
    cls = draw(st.sampled_from(MESSAGES))
    values = []
    for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True):
        length = cls.array_lengths[cls.ordered_fieldnames.index(name)]
        number = NUMBERS[kind]
        values.append(
            draw(number) if length <= 1 or kind == "char"
            else draw(st.lists(number, min_size=length, max_size=length))
        )  # fmt: skip
    return cls(*values)


class Notes:
    """Where telemetry is noted."""

    def __init__(self) -> None:
        self.heard = 0.0
        self.p_WB, self.v_WB, self.R_WB = np.zeros(3), np.zeros(3), np.eye(3)
        self.p_WB_des, self.v_WB_des = np.zeros(3), np.zeros(3)


def equal(a: Any, b: Any) -> bool:
    return bool(np.array_equal(np.array(a), np.array(b), equal_nan=not isinstance(a, str | bytes)))


@given(messages())
@settings(max_examples=300, deadline=None)
def test_every_message_comes_back_as_it_was_packed(message: Any) -> None:
    stream = MavlinkStream()
    (found,) = stream.feed(stream.pack(message))
    assert found.get_type() == message.get_type()
    for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        if kind != "char":
            assert equal(getattr(found, name), getattr(message, name)), name


@given(st.lists(messages(), min_size=1, max_size=6), st.data())
@settings(max_examples=60, deadline=None)
def test_it_does_not_matter_how_a_stream_is_cut(sent: list[Any], data: st.DataObject) -> None:
    packer, stream, whole = MavlinkStream(), MavlinkStream(), b""
    for m in sent:
        whole += packer.pack(m)
    found = []
    while whole:
        n = data.draw(st.integers(1, len(whole)))
        found += stream.feed(whole[:n])
        whole = whole[n:]
    assert [m.get_type() for m in found] == [m.get_type() for m in sent]


@given(messages(), st.integers(0, 10_000), st.integers(1, 255))
@settings(max_examples=200, deadline=None)
def test_a_packet_with_a_wrong_byte_is_refused(message: Any, place: int, change: int) -> None:
    """Only incompatibility flags, lengths and the like make it another packet: none is taken."""
    stream = MavlinkStream()
    packet = bytearray(stream.pack(message))
    packet[place % len(packet)] ^= change
    before = stream.counts["accepted"]
    found = stream.feed(bytes(packet))
    changed_checksum_of_nothing = place % len(packet) == 3  # compat_flags are in the checksum, too
    assert not found or changed_checksum_of_nothing
    assert stream.counts["accepted"] == before + len(found)
    # whatever is kept of it, the stream recovers after at most one longest packet
    for _ in range(40):
        found += stream.feed(stream.pack(common.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3)))
    assert found


@given(messages())
@settings(max_examples=300, deadline=None)
def test_no_message_makes_a_command_that_is_no_number(message: Any) -> None:
    rules, notes = Lockstep(6), Notes()
    rules.connect()
    rules.send(0.1)
    telemetry = Telemetry("127.0.0.1", 0, notes, np.array([0.01, 0.0, -0.2]))
    try:
        rules.take(message)
        telemetry._take(message, np.zeros(3), True)
    finally:
        telemetry.close()
    assert np.all((rules.command >= 0.0) & (rules.command <= 1.0))
    assert np.all(np.isfinite(notes.p_WB)) and np.all(np.isfinite(notes.R_WB))
    assert np.allclose(notes.R_WB @ notes.R_WB.T, np.eye(3), atol=1e-6)


def fuzz(n: int, seed: int) -> tuple[MavlinkStream, Lockstep]:
    """Feed `n` packets: random bytes, packets with errors, and answers that are random or right."""
    rng, stream, rules = random.Random(seed), MavlinkStream(), Lockstep(6)
    packer = common.MAVLink(None, 1, 1)
    rules.connect()
    good = [
        common.MAVLink_hil_actuator_controls_message(
            compute_time_us(0.004 * k), [rng.uniform(-2, 2) for _ in range(16)], 129, 1
        ).pack(packer)
        for k in range(50)
    ]
    for k in range(n):
        rules.send(0.004 * (k % 50))
        packet = bytearray(rng.choice(good))
        way = rng.random()
        if way < 0.4:
            for _ in range(rng.randint(1, 4)):
                packet[rng.randrange(len(packet))] = rng.randrange(256)
        elif way < 0.6:
            packet = packet[: rng.randrange(len(packet))]
        elif way < 0.8:
            packet = bytearray(rng.randbytes(rng.randint(1, 40)))
        for m in stream.feed(bytes(packet)):
            rules.take(m)
            assert np.all((rules.command >= 0.0) & (rules.command <= 1.0))
    return stream, rules


@pytest.mark.parametrize("seed", [1, 2])
def test_fuzzed_packets_raise_nothing_and_keep_nothing(seed: int) -> None:
    start = time.perf_counter()
    stream, rules = fuzz(50_000, seed)
    assert time.perf_counter() - start < 120.0
    assert stream.counts["accepted"] > 5_000  # the right ones between them
    assert sum(stream.counts[c] for c in ("checksum", "garbage", "unknown")) > 5_000
    assert rules.counts["answers"] > 0
    assert len(stream._parser.buf) < 4096
    assert len(stream.counts) < 8 and len(rules.counts) < 8


def test_numbers_of_arrays_are_looked_at_too() -> None:
    good = common.MAVLink_hil_actuator_controls_message(1, [0.0] * 16, 1, 1)
    bad = common.MAVLink_hil_actuator_controls_message(1, [0.0] * 15 + [np.inf], 1, 1)
    assert is_finite(good, "controls") and not is_finite(bad, "controls")


def test_px4s_centre_of_mass_is_noted_as_the_platform() -> None:
    notes, p_BC = Notes(), np.array([0.1, 0.0, -0.2])
    telemetry = Telemetry("127.0.0.1", 0, notes, p_BC)
    half = math.sqrt(0.5)
    for message in (
        # heading north: x of B points along y of W; it turns to the right
        common.MAVLink_attitude_quaternion_message(1, 1, 0, 0, 0, 0, 0, 0.5),
        common.MAVLink_local_position_ned_message(1, 2.0, 1.0, -3.0, 0.5, 0.0, 0.0),
        common.MAVLink_position_target_local_ned_message(
            1, 1, 0x0DC0, 2.0, 1.0, -4.0, 0, 0, 0, 0, 0, 0, 0, 0
        ),
    ):
        telemetry._take(message, np.zeros(3), False)
    np.testing.assert_allclose(notes.R_WB[:, 0], [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(notes.p_WB, [1.0, 2.0 - 0.1, 3.0 + 0.2], atol=1e-9)
    np.testing.assert_allclose(notes.v_WB, [-0.05, 0.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(notes.p_WB_des, [1.0, 2.0 - 0.1, 4.0 + 0.2], atol=1e-9)
    # heading east: x of B points along x of W
    telemetry._take(
        common.MAVLink_attitude_quaternion_message(1, half, 0, 0, half, 0, 0, 0), np.zeros(3), False
    )
    np.testing.assert_allclose(notes.R_WB[:, 0], [1, 0, 0], atol=1e-7)
    telemetry.close()
