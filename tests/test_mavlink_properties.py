"""Messages of MAVLink with any content: both ends stay finite, answer, and keep nothing."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common
from scipy.spatial.transform import Rotation

from skywright.description.world.origin import Origin
from skywright.links.mavlink.attitude_target import AttitudeTarget
from skywright.links.mavlink.frames import (
    from_ned_quaternion,
    swap_body,
    swap_heading,
    swap_world,
    to_ned_quaternion,
)
from skywright.links.mavlink.heard import Heard
from skywright.links.mavlink.modes import Mode
from skywright.links.mavlink.parameters import INT32, REAL32, Parameters, Settable, read_value
from skywright.links.mavlink.setpoints import (
    FAR,
    Scale,
    SetPoint,
    read_attitude,
    read_global,
    read_local,
)

SCRIPT = Path(__file__).parents[1] / "scripts" / "fuzz_mavlink.py"
numbers = st.floats(width=32)
finite = st.floats(-100.0, 100.0, width=32)
vectors = st.tuples(finite, finite, finite).map(np.array)
rotations = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: Rotation.from_quat(q).as_matrix())
)


class Standing:
    """A back end that stands somewhere."""

    def __init__(self) -> None:
        self.estimate = {"p_WB": np.array([1.0, 2.0, 3.0]), "R_WB": np.eye(3)}


@given(vectors)
def test_frames_are_their_own_inverses(v: Any) -> None:
    assert np.array_equal(swap_world(swap_world(v)), v)
    assert np.array_equal(swap_body(swap_body(v)), v)


@given(rotations, vectors)
def test_an_attitude_turns_vectors_alike_in_both_frames(R: Any, v: Any) -> None:
    """R_NED v_FRD is the NED of R_WB v_B: shown by scipy's quaternions."""
    q = to_ned_quaternion(R)
    there = Rotation.from_quat(np.roll(q, -1)).apply(swap_body(v))
    assert np.allclose(there, swap_world(R @ v), atol=1e-9 * max(1.0, np.abs(v).max()) * 1e3)
    back = from_ned_quaternion(q)
    assert back is not None and np.allclose(back, R, atol=1e-9)


@given(st.floats(-10.0, 10.0))
def test_a_heading_comes_back(yaw: float) -> None:
    assert math.cos(swap_heading(swap_heading(yaw)) - yaw) == pytest.approx(1.0)
    north = swap_heading(0.5 * math.pi)
    assert north == pytest.approx(0.0)


@given(st.integers(0, 255), st.integers(0, 255))
def test_a_mode_comes_back(main: int, sub: int) -> None:
    assert Mode.read(Mode(main, sub).custom) == (main, sub)


@given(
    st.integers(0, 2**32 - 1), st.integers(0, 255), st.lists(numbers, min_size=11, max_size=11)
)  # fmt: skip
def test_an_attitude_target_is_read_as_it_was_packed_or_refused(
    time_ms: int, mask: int, x: list[float]
) -> None:
    target = AttitudeTarget(
        time_ms,
        mask,
        tuple(x[:4]),
        tuple(x[4:7]),
        x[7],
        tuple(x[8:11]),  # type: ignore[arg-type]
    )
    (message,) = common.MAVLink(None).parse_buffer(target.pack(common.MAVLink(None, 1, 1)))
    read = AttitudeTarget.read(message)
    if read is not None:
        assert np.array_equal(
            np.array([*read.q, *read.rates, read.thrust, *read.thrust_body]),
            np.array(x), equal_nan=True,
        )  # fmt: skip
        assert (read.time_ms, read.type_mask) == (time_ms, mask)
    elif all(math.isfinite(v) for v in x):
        raise AssertionError("a target of finite numbers was refused")
    point = read_attitude(message, Standing(), Scale(100.0, True))  # type: ignore[arg-type]
    if isinstance(point, SetPoint):
        assert point.R_WB is not None and np.allclose(point.R_WB @ point.R_WB.T, np.eye(3))
        assert point.f_B is not None and np.isfinite(point.f_B).all()
        assert np.linalg.norm(point.f_B) <= 200.0 + 1e-3


@given(
    st.integers(0, 2**16 - 1), st.integers(0, 12), st.lists(numbers, min_size=11, max_size=11)
)  # fmt: skip
def test_no_position_target_leads_to_what_is_no_number(
    mask: int, frame: int, x: list[float]
) -> None:
    message = common.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *x)
    (message,) = common.MAVLink(None).parse_buffer(message.pack(common.MAVLink(None, 1, 1)))
    check(read_local(message, Standing()))  # type: ignore[arg-type]


@given(
    st.integers(0, 2**16 - 1), st.integers(0, 12),
    st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1),
    st.lists(numbers, min_size=9, max_size=9),
)  # fmt: skip
def test_no_global_target_leads_to_what_is_no_number(
    mask: int, frame: int, lat: int, lon: int, x: list[float]
) -> None:
    message = common.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask, lat, lon, *x
    )
    (message,) = common.MAVLink(None).parse_buffer(message.pack(common.MAVLink(None, 1, 1)))
    origin = Origin(latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0)
    check(read_global(message, origin, 0.3))


def check(point: SetPoint | str) -> None:
    """A set-point has numbers or NaN for what is not given, and is near; or a reason."""
    if isinstance(point, str):
        assert point
        return
    assert not np.isinf(point.p).any() and not np.isinf(point.v).any()
    assert not np.isnan([*point.p, *point.v]).all()
    assert np.nanmax(np.abs([*point.p, 0.0])) < 2.0 * FAR
    assert not math.isinf(point.yaw) and not math.isinf(point.yaw_rate)


@given(st.integers(-(2**31), 2**31 - 1), numbers)
def test_parameters_come_back_as_px4_encodes_them(whole: int, real: float) -> None:
    held = Parameters([("WHOLE", whole)], [Settable("REAL", 1.0, -5.0, 5.0)])
    sent = held.build(common, "WHOLE")
    (message,) = common.MAVLink(None).parse_buffer(
        common.MAVLink_param_set_message(1, 1, b"WHOLE", sent.param_value, INT32).pack(
            common.MAVLink(None, 1, 1)
        )
    )
    # a float whose bits are a signalling NaN does not survive Python: those are refused as NaN
    value = read_value(message)
    assert value == whole or math.isnan(sent.param_value)
    says = held.set("REAL", real)
    assert (says == "") == (-5.0 <= real <= 5.0)
    assert -5.0 <= held["REAL"] <= 5.0
    message.param_type = REAL32
    assert held.set("WHOLE", 1.0) and held["WHOLE"] == whole


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_the_companion_hears_no_place_that_is_no_number(data: st.DataObject) -> None:
    heard, sender, parser = Heard(), common.MAVLink(None, 1, 1), common.MAVLink(None)
    beat = common.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)
    messages = [beat]
    for _ in range(data.draw(st.integers(1, 5))):
        x = data.draw(st.lists(numbers, min_size=7, max_size=7))
        ms = data.draw(st.integers(0, 2**32 - 1))
        messages += [
            common.MAVLink_local_position_ned_message(ms, *x[:6]),
            common.MAVLink_attitude_quaternion_message(ms, *x),
            common.MAVLink_home_position_message(0, 0, 0, *x[:3], x[:4], *x[4:7], 0),
            common.MAVLink_estimator_status_message(0, 0xFFFF, *x, x[0]),
        ]
    for message in messages:
        for m in parser.parse_buffer(message.pack(sender)) or []:
            heard.take(m, 1.0)
    assert np.isfinite(heard.p).all() and np.isfinite(heard.v).all()
    assert np.allclose(heard.R_WB @ heard.R_WB.T, np.eye(3), atol=1e-6)
    assert heard.home is None or np.isfinite(heard.home).all()


def test_fuzzed_packets_raise_nothing_and_leave_the_robot_sound() -> None:
    spec = importlib.util.spec_from_file_location("fuzz_mavlink", SCRIPT)
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    found = script.fuzz(3000, 2)
    assert found["counts"]["accepted"] > 300 and found["counts"]["version"] > 50
    assert found["counts"]["checksum"] + found["counts"]["garbage"] > 300
    assert found["answers"] > 100
