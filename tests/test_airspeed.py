"""The airspeed sensor, built in and as a user's file outside of the package."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plant_parts import build_context, build_plant, take_samples
from skywright.core.find import find, list_kinds
from skywright.core.record import View
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.evidence.bench.flights import fly_to_hover
from skywright.vehicle.sensors import airspeed
from skywright.vehicle.sensors.airspeed import Airspeed


def test_it_is_a_kind():
    assert "airspeed" in list_kinds("sensor") and find("sensor", "airspeed").cls is Airspeed


def load_from_file(tmp_path: Path) -> Any:
    """A user's copy of the built-in sensor, under another name, beside a mission."""
    text = Path(str(airspeed.__file__)).read_text().replace("class Airspeed", "class Pitot")
    (tmp_path / "pitot.py").write_text(text)
    return find("sensor", "pitot.py:Pitot", [tmp_path]).cls


@pytest.mark.parametrize("user", [False, True])
def test_airspeed_is_that_of_the_wind_behind_a_lag(user, tmp_path):
    cls = load_from_file(tmp_path) if user else Airspeed
    table = cls.Table(noise_mps=0.1, lag_s=0.1)
    wind = ["world.wind.kind=steady", "world.wind.mean_mps=5", "world.wind.toward_deg=180"]
    context = build_context(sets=wind)
    plant = build_plant(context, cls("pitot", table))
    plant.run(round(0.1 / context.dt))
    late = float(View(plant.assembly.get(cls.Reading)).v)
    assert late == pytest.approx(5.0 * (1.0 - math.exp(-1.0)), abs=1.2)
    plant.run(round(1.0 / context.dt))
    row = take_samples(plant)
    assert np.mean(row["airspeed"][-50:]) == pytest.approx(5.0, abs=0.15)
    steps = np.diff(row["airspeed"])
    assert np.mean(steps == 0.0) == pytest.approx(0.5, abs=0.05)  # 50 Hz in rows of 100 Hz


def test_a_delayed_link_delays_a_users_sensor(tmp_path):
    cls = load_from_file(tmp_path)
    context = build_context(sets=["world.link.delay_s=0.02"])
    plant = build_plant(context, cls("pitot", cls.Table()))
    seen = []
    for k in range(100):
        plant.run(1)
        reading = View(plant.assembly.get(cls.Reading))
        if reading.fresh > 0.0:
            seen.append(k * context.dt - float(reading.t))
    assert len(seen) > 5
    assert seen[0] == 0.0  # the link stood before the start
    np.testing.assert_allclose(seen[1:], 0.02, atol=1e-9)


@pytest.mark.parametrize("user", [False, True])
def test_it_flies_by_a_table_of_the_robot(user, tmp_path):
    """In a headwind, delayed by the link, recorded; its table is reached by --set."""
    load_from_file(tmp_path)
    kind = f"{tmp_path / 'pitot.py'}:Pitot" if user else "airspeed"
    sets = [
        f"robot.sensors.pitot.kind={kind}", "robot.sensors.pitot.noise_mps=0.05",
        "world.wind.kind=steady", "world.wind.mean_mps=3", "world.wind.toward_deg=180",
        "world.link.delay_s=0.004",
    ]  # fmt: skip
    vehicle = fly_to_hover(load_description("pipe-weld-scan", sets=sets))
    blocks: list[Any] = []
    vehicle.on_samples = blocks.append
    vehicle.flush()
    for _ in range(100):
        vehicle.tick()
    vehicle.flush()
    seen = np.concatenate(blocks)["airspeed"][-100:]
    assert np.mean(seen) == pytest.approx(3.0, abs=0.1)
    assert 0.02 < np.std(seen) < 0.2


def test_an_unknown_key_of_its_table_is_told():
    sets = ["robot.sensors.pitot.kind=airspeed", "robot.sensors.pitot.noise=0.05"]
    with pytest.raises(InputError, match="noise_mps"):
        load_description("pipe-weld-scan", sets=sets)
