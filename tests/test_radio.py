"""The radio between operator and robot: what arrives, when, in which order."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skywright.description.loader import load_description
from skywright.description.world.radio import Radio
from skywright.errors import InputError
from skywright.ground.operator_model import ModelOperator
from skywright.ground.radio_operator import LET_GO_S, RadioOperator, add_radio
from skywright.links.radio import COMMAND, DEPTH, OVERHEAD, STATE, VIDEO, Way, build_ways
from skywright.run.operator import Sight, Stick
from skywright.vehicle.plant import MISSION_TICK


def test_without_keys_there_is_no_radio() -> None:
    d = load_description("tool-install")
    assert not d.world.radio.present and build_ways(d.world.radio, 1) is None
    operator = ModelOperator("careful", 1, 0.03)
    assert add_radio(operator, d.world.radio, 1) is operator


def test_a_packet_takes_its_size_over_the_bandwidth_and_the_delay() -> None:
    way = Way(Radio(delay_s=0.1, bandwidth_kbps=100.0), 1, "up")
    for k in range(3):  # 1000 bytes: 80 ms each
        way.send(0.0, COMMAND, 1000 - OVERHEAD, k)
    for k in range(3):
        arrival = 0.08 * (k + 1) + 0.1
        assert way.receive(arrival - 1e-6) == [] and way.receive(arrival + 1e-6) == [k]


def test_commands_go_before_states_before_video() -> None:
    way = Way(Radio(bandwidth_kbps=100.0), 1, "up")
    way.send(0.0, VIDEO, 5000, "picture under way")
    for t, priority, item in ((0.01, VIDEO, "old picture"), (0.02, VIDEO, "picture"),
                              (0.03, STATE, "state"), (0.04, COMMAND, "command")):  # fmt: skip
        way.send(t, priority, 1000, item)
    assert way.receive(10.0) == ["picture under way", "command", "state", "picture"]
    assert way.dropped == 1


SHARES = st.integers(0, 100).map(lambda n: n / 100)


@given(
    SHARES,
    SHARES,
    SHARES.map(lambda x: 0.9 * x),
    st.one_of(st.none(), st.integers(10, 10000).map(float)),
    st.integers(0, 100),
    st.lists(
        st.tuples(
            st.floats(0.0, 0.1), st.sampled_from([COMMAND, STATE, VIDEO]), st.integers(1, 2000)
        ),
        max_size=60,
    ),
)
def test_nothing_is_early_doubled_or_out_of_order(
    delay: float, jitter: float, loss: float, rate: float | None, seed: int,
    packets: list[tuple[float, int, int]],
) -> None:  # fmt: skip
    radio = Radio(delay_s=delay, jitter_s=jitter, loss_fraction=loss, bandwidth_kbps=rate)

    def run() -> list[tuple[float, int, int]]:
        way, t, found = Way(radio, seed, "up"), 0.0, []
        for k, (wait, priority, size) in enumerate(packets):
            t += wait
            found += [(t, *item) for item in way.receive(t)]
            way.send(t, priority, size, (priority, k))
            assert sum(map(len, way._waiting)) <= sum(DEPTH)
        found += [(math.inf, *item) for item in way.receive(1e6)]
        assert len(found) + way.lost + way.dropped == len(packets)
        return found

    found = run()
    assert found == run()  # the same seed
    sent = np.cumsum([p[0] for p in packets])
    for priority in (COMMAND, STATE, VIDEO):
        numbers = [k for _, p, k in found if p == priority]
        assert numbers == sorted(set(numbers))
    assert all(t >= sent[k] - 1e-12 for t, _, k in found)


def test_loss_and_jitter_are_as_stated() -> None:
    way, arrivals = Way(Radio(delay_s=0.2, jitter_s=0.01, loss_fraction=0.1), 4, "up"), {}
    for k in range(4000):
        t = 0.1 * k
        way.send(t, COMMAND, 100, k)
        for tick in range(100):
            for item in way.receive(t + 1e-3 * tick):
                arrivals[item] = t + 1e-3 * tick
    delays = np.array([t - 0.1 * k for k, t in arrivals.items()])
    assert way.lost / 4000 == pytest.approx(0.1, abs=0.015)
    assert float(np.mean(delays)) == pytest.approx(0.2005, abs=1e-3)
    assert float(np.std(delays)) == pytest.approx(0.01, rel=0.05)


class Echo:
    """An operator whose stick shows when it saw something: the first axis is the sight's."""

    def read(self, t: float, sight: Sight) -> Stick | None:
        return Stick(np.array([sight.off[0], 0.0, 0.0]), False)


def fly(radio: Radio, seconds: float = 4.0) -> np.ndarray:
    """Return, for each tick, the time (s) that the stick has seen; NaN where it is at rest."""
    operator, seen = RadioOperator(Echo(), radio, 3), []
    for k in range(round(seconds / MISSION_TICK)):
        stick = operator.read(
            k * MISSION_TICK, Sight(np.array([k * MISSION_TICK + 1e-3, 0, 0]), False)
        )
        assert stick is not None
        seen.append(stick.axes[0] if stick.axes[0] else math.nan)
    return np.array(seen)


def test_an_operator_sees_late_and_is_heard_late() -> None:
    """There and back: twice the delay, each rounded up to a mission tick."""
    seen = fly(Radio(delay_s=0.15))
    t = MISSION_TICK * np.arange(len(seen))
    assert np.all(np.isnan(seen[:16])) and not np.any(np.isnan(seen[17:]))
    age = (t - seen)[20:]
    assert np.all(np.abs(age - 0.32) < 0.025)


def test_a_link_that_is_lost_lets_the_stick_go() -> None:
    operator = RadioOperator(Echo(), Radio(delay_s=0.02), 1)
    sticks = []
    for k in range(100):
        if k == 50:
            operator._up.radio = Radio(loss_fraction=0.999999)
        stick = operator.read(0.02 * k, Sight(np.array([0.5, 0.0, 0.0]), False))
        assert stick is not None
        sticks.append(float(stick.axes[0]))
    assert sticks[10:51] == [0.5] * 41
    silent = sticks.index(0.0, 51)
    assert 0.02 * (silent - 51) == pytest.approx(LET_GO_S, abs=0.041) and not any(sticks[silent:])


def test_a_video_that_fills_the_link_is_seen_later_than_states() -> None:
    states = fly(Radio(delay_s=0.05, bandwidth_kbps=1000.0))
    video = fly(Radio(delay_s=0.05, bandwidth_kbps=1000.0, video_kbps=700.0))
    t = MISSION_TICK * np.arange(len(states))
    late = np.nanmean((t - video)[50:]) - np.nanmean((t - states)[50:])
    assert 0.03 < late < 0.12  # a picture of 28 kbit takes 28 ms, and comes every 40 ms


@pytest.mark.parametrize(
    ("sets", "says"),
    [
        (["world.radio.delay_s=-1"], "world.radio.delay_s"),
        (["world.radio.loss_fraction=1"], "world.radio.loss_fraction"),
        (["world.radio.bandwidth_kbps=100", "world.radio.video_kbps=200"], "must be below"),
        (["world.radio.latency_s=1"], "latency_s"),
    ],
)
def test_wrong_keys_are_told(sets: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        load_description("tool-install", sets=sets)
