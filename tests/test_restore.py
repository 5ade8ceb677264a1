"""Saved states: whose they are, the noise of another seed, and the newest sample."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skywright
from skywright.description.template import write_template
from skywright.errors import InputError
from skywright.recordings.columns import Column, Topic, build_dtype
from skywright.recordings.sample_rows import build_rows
from skywright.run.backends import build_vehicle
from skywright.run.check import check_file
from skywright.vehicle.follower import Follower
from skywright.vehicle.moves import Moves
from skywright.vehicle.readings import Fix, Odometry
from skywright.vehicle.sensors.ultrasonic import Ultrasonic
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.ticker import StepFailed


def tick(vehicle: SimulatedVehicle, n: int) -> bytes:
    for _ in range(n):
        vehicle.tick()
    return bytes(vehicle.last_sample.tobytes())


@pytest.fixture(scope="module")
def vehicle() -> SimulatedVehicle:
    vehicle = skywright.build_vehicle("waypoints")
    tick(vehicle, 30)
    return vehicle


def test_a_state_of_another_vehicle_is_refused(vehicle: SimulatedVehicle) -> None:
    """It contains addresses of the memory of its own; nothing is changed."""
    other = skywright.build_vehicle("waypoints")
    before = other.assembly.arena.tobytes(), other.sim.qpos.tobytes()
    with pytest.raises(InputError, match="saved by another vehicle; valid: a state of this"):
        other.restore(vehicle.save())
    assert (other.assembly.arena.tobytes(), other.sim.qpos.tobytes()) == before


def test_a_copy_of_a_state_is_as_good(vehicle: SimulatedVehicle) -> None:
    state, name = vehicle.save(), vehicle.find(Follower).name
    twin = copy.deepcopy(state)
    after = tick(vehicle, 60)
    for one in (state, twin):
        vehicle.restore(one)
        assert vehicle.get_memory(name).rows == one.parts[name].ctypes.data
        assert tick(vehicle, 60) == after


@pytest.mark.parametrize("seed", [-1, 1.5, True, "1"])
def test_a_seed_is_a_whole_number(vehicle: SimulatedVehicle, seed: Any) -> None:
    before, state = vehicle.t, vehicle.save()
    vehicle.tick()
    with pytest.raises(InputError, match=r"seed = .*; valid: a whole number from 0"):
        vehicle.restore(state, seed)
    assert vehicle.t > before
    vehicle.restore(state, np.int64(3))


def test_the_newest_sample_is_that_of_the_state(vehicle: SimulatedVehicle) -> None:
    state, newest = vehicle.save(), vehicle.last_sample.copy()
    for n in (1, 200):  # within the buffer, and after deliveries
        tick(vehicle, n)
        vehicle.restore(state)
        assert vehicle.last_sample.tobytes() == newest.tobytes()
        assert vehicle.last_sample["t"][0] == pytest.approx(vehicle.t, abs=0.011)


def test_noise_of_all_sensors_follows_the_seed() -> None:
    """Motors off: the true motion is that of every seed. The ground is too near for the range
    finder, so its drawn noise is compared."""
    vehicle = skywright.build_vehicle("bridge-contact")
    tick(vehicle, 10)
    state = vehicle.save()

    def read(*seed: int) -> list[bytes]:
        vehicle.restore(state, *seed)
        fixes, moves = [], []
        for _ in range(100):
            vehicle.tick()
            fixes.append(np.copy(vehicle.read(Fix).p))
            moves.append(np.copy(vehicle.read(Odometry).p))
        drawn = vehicle.get_memory("range finder").finder["unit"]
        return [np.array(x).tobytes() for x in (fixes, moves, drawn)]

    same, one, two = read(), read(1), read(2)
    assert read() == same and read(2) == two and read(1) == one
    for k, sensor in enumerate(("total station", "tracking camera", "range finder")):
        assert len({same[k], one[k], two[k]}) == 3, sensor


def test_a_stopped_law_runs_again_after_a_restore(vehicle: SimulatedVehicle) -> None:
    """The watchdog leaves the rows of a law out at once, and for good after a second failure."""
    before = vehicle.save()
    Moves(vehicle).motors(True)
    state = vehicle.save()
    after = tick(vehicle, 60)
    for times in (1, 2):
        vehicle.restore(state)
        restarts = [vehicle.stop_computer(StepFailed("it hangs")) for _ in range(times)]
        assert restarts == [True, False][:times]
        memory = next(iter(vehicle.watchdog.memories.values()))
        memory.view(np.float64)[:] += 1.0  # as tune_law sets gains
        vehicle.order = "abort"
        vehicle.tick()
        vehicle.restore(state)
        assert tick(vehicle, 60) == after
        assert vehicle.order == ""
        assert not vehicle.watchdog.is_pending
    assert vehicle.stop_computer(StepFailed("it hangs"))  # a restart is still available
    stopped = vehicle.save()
    restarted = tick(vehicle, 60)
    vehicle.restore(stopped)
    assert tick(vehicle, 60) == restarted
    vehicle.restore(before)


def test_a_clamp_is_closed_again_after_a_restore() -> None:
    """The kinematic platform follows its reference only while the clamp is open."""
    vehicle: Any = build_vehicle(skywright.load("arm-test-bench"), backend="kinematic")
    tick(vehicle, 2)
    place = vehicle.estimate["p_WB"]
    row = np.array(vehicle.reference)
    row["p_WB"] = place + [0.0, 0.0, 0.5]
    vehicle.track(row[None])
    lifted = vehicle.save()
    vehicle.release()
    tick(vehicle, 2)
    assert vehicle.estimate["p_WB"][2] == pytest.approx(place[2] + 0.5)
    vehicle.restore(lifted)
    tick(vehicle, 2)
    np.testing.assert_allclose(vehicle.estimate["p_WB"], place)


def test_noise_of_ascans_follows_the_seed() -> None:
    sensor = Ultrasonic("ultrasonic")
    sensor._seed = 4
    saved = sensor.save()
    sensor.reseed(7)
    assert sensor.save() == 7
    sensor.restore(saved)
    assert sensor.save() == 4


def test_a_component_with_a_stream_of_its_own_is_told_the_seed(vehicle: SimulatedVehicle) -> None:
    part = vehicle.assembly.components[0]
    told: list[int] = []
    part.reseed = told.append  # type: ignore[method-assign]
    state = vehicle.save()
    vehicle.restore(state)
    assert told == []
    vehicle.restore(state, 5)
    assert told == [5]
    del part.reseed


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("", r"of the shape \(3, 3\); valid: one number, or one row .* Annotated\[Array, 9\], .*"),
        ("item=1, rotation=True", r"of the shape \(3,\) as a rotation; valid: \(3, 3\)"),
    ],
)
def test_a_column_of_a_matrix_is_refused_before_a_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: str, says: str
) -> None:
    """Its 9 numbers were written into the place of 3, and no reader opened the recording."""
    monkeypatch.chdir(tmp_path)
    write_template("sensor", tmp_path / "my-alt")
    file = next(tmp_path.rglob("my_alt.py"))
    code = file.read_text("utf-8")
    first = code.index("columns = (") + len("columns = (")
    code = f'{code[:first]}Recorded("my_att", Reading, "att", "", "", {more}), {code[first:]}'
    code = code.replace("import Record\n", "import Mat3, Record\n")
    at = code.index("        height: float")
    file.write_text(f"{code[:at]}        att: Mat3\n{code[at:]}", "utf-8")
    problems = check_file("my-alt").problems
    assert len(problems) == 1, problems
    with pytest.raises(InputError, match=rf"'my_alt': column 'my_att' shows 'att' {says}"):
        skywright.build_vehicle("my-alt")


def test_a_column_longer_than_its_field_is_refused() -> None:
    columns = (Column("t"), Column("m", (3, 3)))
    topic = Topic(
        "/m", "skywright_msgs/Numbers", "", {"data": "m"}, lengths={"data": 3},
        types={"skywright_msgs/Numbers": "std_msgs/Header header\nfloat64[] data"},
    )  # fmt: skip
    with pytest.raises(InputError, match=r"'/m': column 'm' has 9 numbers, .* 'data' .* has 3"):
        build_rows([(0, topic)], build_dtype(columns))
    build_rows([(0, topic._replace(lengths={"data": 9}))], build_dtype(columns))
