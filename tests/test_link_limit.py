"""The delay of a link that an attitude loop bears, beside a simulation of that loop."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.run.backends import build_vehicle
from skywright.run.faults._senses import Senses
from skywright.run.faults.link_late import ARRIVALS, LinkLate
from skywright.run.link_limit import (
    SPARE,
    compute_most_delay,
    find_exceeded_delay,
    slow_down,
)
from skywright.run.setup import Setup
from skywright.vehicle.link import Reception
from skywright.vehicle.loops import AttitudeGains, compute_delay_margin
from skywright.vehicle.ticker import StepFailed


@pytest.mark.parametrize("reaction", [0.0, -0.0138, 0.01])
def test_at_the_margin_the_loop_neither_grows_nor_decays(reaction: float) -> None:
    """The closed loop of rotors, their reaction and a dead time, integrated step by step."""
    w, zeta, lag = 14.0, 1.0, 0.03
    margin = compute_delay_margin(AttitudeGains(w, zeta, 0.0), lag, 0.0, reaction)

    def grows(delay: float) -> float:
        h = 1e-4
        late = [0.0] * max(round(delay / h), 1)
        angle, rate, thrust = 0.1, 0.0, 0.0
        peaks = []
        for i in range(int(6.0 / h)):
            late.append(-w * w * angle - 2.0 * zeta * w * rate)
            change = (late.pop(0) - thrust) / lag
            thrust += h * change
            rate += h * (thrust + reaction * change)
            angle += h * rate
            if i * h > 3.0:
                peaks.append(abs(angle))
        half = len(peaks) // 2
        return math.log(max(max(peaks[half:]), 1e-300) / max(max(peaks[:half]), 1e-300))

    assert grows(0.8 * margin) < -0.1 and grows(1.2 * margin) > 0.1


@pytest.mark.parametrize(
    ("delay", "jitter", "loss", "refused"),
    [
        (0.004, 0.0, 0.0, False), (0.004, 0.001, 0.0, False), (0.0058, 0.0004, 0.0, True),
        (0.004, 0.003, 0.0, True), (0.002, 0.005, 0.0, True), (0.004, 0.0, 0.3, False),
        (0.0, 0.0, 0.8, True),
    ],
)  # fmt: skip
def test_the_scan_is_refused_where_its_flights_saturate(
    delay: float, jitter: float, loss: float, refused: bool
) -> None:
    """Flown without the check in benchmarks/jitter.csv (and refused there without need: 4, 2)."""
    table = {"delay_s": delay, "jitter_s": jitter, "loss_fraction": loss}
    sets = [f"world.link.{key}={value}" for key, value in table.items()]
    says = find_exceeded_delay(Setup(load_description("pipe-weld-scan", sets=sets)))
    assert (says is not None) == refused
    if says is not None:
        assert (
            "ms each way" in says and "mean age" in says and "attitude_bandwidth_rad_s = 14" in says
        )


@pytest.mark.parametrize("mission", ["pipe-weld-scan", "sensor-install", "bridge-contact"])
def test_a_slower_law_bears_a_later_link(mission: str) -> None:
    """Laws of three kinds; what a law has gathered stays."""
    d = load_description(mission, sets=["world.link.delay_s=0.001"])
    vehicle = build_vehicle(d)
    before = compute_most_delay(vehicle.nominal, vehicle.law)
    assert 0.005 < before < 0.05
    memory = vehicle.get_memory(vehicle.law.name)
    memory.theta[:] = 0.1
    share = slow_down(vehicle, 0.016)
    assert share is not None and 0.2 < share <= 1.0
    assert np.all(np.asarray(memory.theta) == 0.1)
    assert slow_down(vehicle, 0.5) is None
    assert compute_most_delay(vehicle.nominal, vehicle.law, SPARE) < before  # as it took off


def test_a_slowed_law_that_is_started_again_stays_slow() -> None:
    """It forgets what it gathered, not the gains that it was given in flight."""
    d = load_description("sensor-install", sets=["world.link.delay_s=0.001"])
    vehicle = build_vehicle(d)
    memory = vehicle.get_memory(vehicle.law.name)
    fast = np.array(memory.k_rate)
    assert slow_down(vehicle, 0.016) is not None
    slow = np.array(memory.k_rate)
    assert np.all(slow[:2] < fast[:2])
    memory.theta[:] = 0.1
    assert vehicle.stop_computer(StepFailed("it hangs"))
    assert np.array_equal(memory.k_rate, slow)
    assert not np.any(memory.theta)


def test_a_law_with_a_bandwidth_of_its_own_is_slowed_alike() -> None:
    """Its own table stands before [robot.control]."""
    shares, found = [], []
    for own in ([], ['mission.law.kind="cascade"', "mission.law.attitude_bandwidth_rad_s=8"]):
        d = load_description("sensor-install", sets=["world.link.delay_s=0.001", *own])
        vehicle = build_vehicle(d)
        shares.append(slow_down(vehicle, 0.016))
        found.append(np.array(vehicle.get_memory(vehicle.law.name).k_rate))
    assert shares[0] is not None and shares[0] == shares[1]
    assert np.array_equal(found[0], found[1])


def test_the_delay_of_what_arrives_counts_not_the_age_on_a_silent_link() -> None:
    """The median of arrivals: a lost packet or a silent moment is no late link."""
    rule = LinkLate("late")
    sent, delay = np.zeros(()), np.zeros(())
    rule._sent, rule._delay, rule._most = sent, delay, 0.005
    v = SimpleNamespace(t=0.0)
    for k in range(40):
        v.t = 0.02 * k + 0.02
        late = 0.012 if k >= 30 else 0.004
        if k % 7 and not 10 <= k < 20:  # lost, and silent
            sent[...], delay[...] = v.t - late, late
        value = rule.look(v)
        if ARRIVALS <= k < 30:
            assert value == pytest.approx(0.8)
    assert value == pytest.approx(2.4) and "delay of 12.0 ms" in rule.explain(value)


@pytest.mark.parametrize(("delay", "loss"), [(0.004, 0.0), (0.004, 0.5), (0.0, 0.3)])
def test_the_delay_of_packets_is_measured_without_the_lost_ones(delay: float, loss: float) -> None:
    sets = [f"world.link.delay_s={delay}", f"world.link.loss_fraction={loss}"]
    vehicle = build_vehicle(load_description("waypoints", "othex", sets=sets))
    reception, delays, sent = vehicle.look(Reception), [], []
    for _ in range(40):
        vehicle.tick()
        delays.append(float(reception.delay))
        sent.append(float(reception.sent))
    assert delays == pytest.approx([delay] * 40)
    assert np.all(np.diff(sent) > 0.0) and vehicle.t - sent[-1] < 0.03


def test_lost_packets_take_their_share_of_the_tolerated_age() -> None:
    """A link that loses half of its packets tolerates one tick less of delay."""

    def begin(loss: float) -> LinkLate:
        sets = ["world.link.delay_s=0.001", f"world.link.loss_fraction={loss}"]
        rule = LinkLate("late")
        rule.begin(Senses(build_vehicle(load_description("waypoints", "othex", sets=sets))))
        return rule

    assert begin(0.0)._most - begin(0.5)._most == pytest.approx(0.002)


def test_lost_packets_count_when_a_law_is_slowed() -> None:
    shares = []
    for loss in (0.0, 0.6):
        sets = ["world.link.delay_s=0.001", f"world.link.loss_fraction={loss}"]
        vehicle = build_vehicle(load_description("pipe-weld-scan", sets=sets))
        share = slow_down(vehicle, 0.012)
        assert share is not None
        shares.append(share)
    assert shares[1] < shares[0]
