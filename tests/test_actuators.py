"""Actuators of a user's file: what a mission sets reaches the compiled step, by name."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import skywright
from skywright.description.loader import load_description
from skywright.description.template import write_template
from skywright.errors import InputError
from skywright.missions.waypoints.task import Waypoint, Waypoints
from skywright.run.check import check_file
from skywright.run.kind import load_kind
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.bus import Setpoint
from skywright.vehicle.link import LATEST, get_rule
from skywright.vehicle.simulated import SimulatedVehicle

PAGE = Path(__file__).parent.parent / "docs" / "howto" / "your-own-actuator.md"
MOST_LINES = 40
Build = Callable[..., SimulatedVehicle]


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Build a hexarotor with the nozzles of the page's example, by their names."""
    code = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)[0]
    assert sum(bool(line.strip()) for line in code.splitlines()) <= MOST_LINES
    file = tmp_path_factory.mktemp("own") / "my_nozzle.py"
    file.write_text(code)

    def build_with(*names: str, **sets: object) -> SimulatedVehicle:
        kinds = {f"robot.actuators.{name}.kind": f"{file}:Nozzle" for name in names}
        more = {key.replace("__", "."): value for key, value in sets.items()}
        return skywright.build_vehicle(
            skywright.load("waypoints", robot="hexarotor", sets=kinds | more)
        )

    return build_with


@pytest.fixture(scope="module")
def vehicle(build: Build) -> SimulatedVehicle:
    return build("nozzle")


def tick(vehicle: SimulatedVehicle, seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        vehicle.tick()


def test_what_is_set_reaches_the_step_and_the_recording(vehicle: SimulatedVehicle) -> None:
    """Momentum and mass: recoil rho Q^2 / A for 1.2 l/min through 2 mm; the tank loses Q t."""
    start = vehicle.save()
    tick(vehicle, 0.1)
    assert vehicle.last_sample["spray_left"][0] == 1.0
    vehicle.actuators["spray_flow"] = 1.2
    tick(vehicle, 2.0)
    sample = vehicle.last_sample
    assert sample["spray_flow"][0] == 1.2 == vehicle.actuators["spray_flow"]
    assert sample["spray_left"][0] == pytest.approx(1.0 - 1.2 * 2.0 / 60.0, abs=1e-3)
    area = math.pi * 0.001**2
    assert sample["spray_recoil"][0] == pytest.approx(1000.0 * 2e-5**2 / area, rel=1e-3)
    column = next(c for c in vehicle.recorded.columns if c.name == "spray_flow")
    assert (column.unit, column.meaning) == ("l/min", "as commanded")
    sprayed = vehicle.save()
    vehicle.restore(start)
    assert vehicle.actuators["spray_flow"] == 0.0
    vehicle.restore(sprayed)
    assert vehicle.actuators["spray_flow"] == 1.2


def test_an_empty_tank_pushes_nothing(build: Build) -> None:
    vehicle = build("nozzle", robot__actuators__nozzle__tank_l=0.01)
    vehicle.actuators["spray_flow"] = 2.0
    tick(vehicle, 0.5)
    assert vehicle.last_sample["spray_left"][0] == pytest.approx(0.0, abs=1e-12)
    assert vehicle.last_sample["spray_recoil"][0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("spray_flwo", 1.0, "actuator 'spray_flwo' is unknown; valid: spray_flow"),
        ("spray_left", 1.0, "actuator 'spray_left' is unknown; valid: spray_flow"),
        ("spray_flow", math.nan, "spray_flow = nan; valid: a finite number"),
        ("spray_flow", "much", "spray_flow = 'much'; valid: a finite number"),
        ("spray_flow", [1.0, 1.0], "spray_flow = [1.0, 1.0]; valid: a finite number"),
        ("spray_flow", -0.1, "spray_flow = -0.1 l/min; valid: 0 to 2"),
        ("spray_flow", 2.1, "spray_flow = 2.1 l/min; valid: 0 to 2"),
    ],
)
def test_wrong_values_are_refused_and_change_nothing(
    vehicle: SimulatedVehicle, name: str, value: object, says: str
) -> None:
    before = float(vehicle.actuators["spray_flow"])
    with pytest.raises(InputError) as caught:
        vehicle.actuators[name] = value  # type: ignore[assignment]
    assert str(caught.value) == says
    assert vehicle.actuators["spray_flow"] == before


def test_a_link_delays_what_is_set(build: Build) -> None:
    vehicle = build("nozzle", world__link__delay_s=0.2)
    tick(vehicle, 0.5)
    vehicle.actuators["spray_flow"] = 1.0
    tick(vehicle, 0.16)
    assert vehicle.last_sample["spray_flow"][0] == 0.0  # what the plant has been told
    assert vehicle.actuators["spray_flow"] == 1.0
    tick(vehicle, 0.1)
    assert vehicle.last_sample["spray_flow"][0] == 1.0


def test_a_link_carries_a_setpoint_whatever_its_fields_are_called() -> None:
    """Fields `fresh`, or `t` and `n`, mark samples and batches of sensors only."""

    class Told(Setpoint):
        fresh: float
        flow: float

    class Timed(Setpoint):
        t: float
        n: float

    assert get_rule(Told) == get_rule(Timed) == LATEST


@pytest.mark.parametrize("sets", [{}, {"world.link.delay_s": 0.2}])
def test_a_law_has_what_is_set_at_once(tmp_path: Path, sets: dict[str, object]) -> None:
    """It is at the robot's end of a link, as who sets the value."""
    file = tmp_path / "lifted.py"
    file.write_text(
        "from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, Setpoint\n"
        "from skywright.vehicle.bus import WrenchCommand\n"
        "from skywright.vehicle.component import Out, Output, Recorded\n"
        "from skywright.vehicle.laws.push_and_slide import PushAndSlide\n"
        "class Lifted(PushAndSlide):\n"
        "    class Trim(Setpoint):\n        up: float\n"
        "    class Seen(Output):\n        up: float\n"
        "    columns = (Recorded('trim_up', Trim, 'up', 'N', ''),\n"
        "               Recorded('seen_up', Seen, 'up', 'N', ''))\n"
        "    @staticmethod\n"
        "    def step(me: PushAndSlide.Me, ref: Reference, est: Estimate, body: Body,\n"
        "             allocated: Allocated, trim: Trim, cmd: Out[WrenchCommand],\n"
        "             seen: Out[Seen]) -> None:\n"
        "        seen.up = trim.up\n"
    )
    sets = {"mission.law": f"{file}:Lifted"} | sets
    vehicle = skywright.build_vehicle(skywright.load("waypoints", robot="othex", sets=sets))
    vehicle.actuators["trim_up"] = 2.0
    tick(vehicle, 0.04)
    assert vehicle.last_sample["seen_up"][0] == 2.0


def test_two_of_a_class_are_set_by_their_names(build: Build) -> None:
    vehicle = build("left", "right")
    assert list(vehicle.actuators) == ["left_spray_flow", "right_spray_flow"]
    vehicle.actuators["right_spray_flow"] = 1.5
    tick(vehicle, 1.0)
    sample = vehicle.last_sample
    assert sample["left_spray_left"][0] == 1.0
    assert sample["right_spray_left"][0] == pytest.approx(1.0 - 1.5 / 60.0, abs=1e-3)


def test_a_back_end_without_physics_moves_none() -> None:
    vehicle = skywright.fly("hexarotor", backend="kinematic")
    with pytest.raises(InputError, match="valid: none, the back end moves no actuators"):
        vehicle.actuators["spray_flow"] = 1.0


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("mine_goal = 1.0", "mine_gaol = 1.0", "actuators: actuator 'mine_gaol' is unknown"),
        ("mine_goal = 1.0", "mine_goal = 3.0", "actuators: mine_goal = 3.0 m; valid: 0 to 2"),
    ],
)
def test_a_mission_that_sets_what_there_is_not_is_refused_before_take_off(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    write_template("actuator", tmp_path / "mine")
    file = tmp_path / "mine" / "mission.toml"
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(InputError, match=re.escape(f"mission.task.points.0.{says}")):
        fly_and_evaluate(load_description(file))
    assert any(says in problem for problem in check_file(str(file)).problems)


def test_a_column_of_a_name_that_exists_is_refused(tmp_path: Path) -> None:
    code = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)[0]
    (tmp_path / "own.py").write_text(code.replace('"spray_flow"', '"ref_q"'))
    sets = {"robot.actuators.nozzle.kind": f"{tmp_path / 'own.py'}:Nozzle"}
    d = skywright.load("waypoints", robot="hexarotor", sets=sets)
    with pytest.raises(InputError, match="'recorder' and 'nozzle' have a column of the same name"):
        skywright.build_vehicle(d)


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ('{"spray_flwo": (0.0, 2.0)}', "'spray_flwo' is no column of a Setpoint; valid: spray_fl"),
        ('{"spray_flow": 2.0}', "'spray_flow' = 2.0; valid: (least, most)"),
        ('{"spray_flow": (2.0, 0.0)}', "'spray_flow' = (2.0, 0.0); valid: (least, most)"),
        ('{"spray_flow": (0.0, None)}', "'spray_flow' = (0.0, None); valid: (least, most)"),
        ('[("spray_flow", 2.0)]', "limits = [('spray_flow', 2.0)]; valid: {column"),
    ],
)
def test_limits_that_hold_nothing_are_refused(tmp_path: Path, limits: str, says: str) -> None:
    code = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)[0]
    (tmp_path / "own.py").write_text(code.replace('{"spray_flow": (0.0, 2.0)}', limits))
    sets = {"robot.actuators.nozzle.kind": f"{tmp_path / 'own.py'}:Nozzle"}
    d = skywright.load("waypoints", robot="hexarotor", sets=sets)
    with pytest.raises(InputError, match=re.escape(says)):
        skywright.build_vehicle(d)


@pytest.mark.parametrize(
    ("column", "says"),
    [
        ('"flwo", "l/min", "as commanded"', "its record has no field 'flwo'; valid: flow"),
        ('"flow", "l/min", "as commanded", item=1', "item 1 of 'flow', which has the shape ()"),
    ],
)
def test_a_column_of_what_is_not_there_is_refused(tmp_path: Path, column: str, says: str) -> None:
    code = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)[0]
    head = '"flow", "l/min", "as commanded"'
    assert head in code
    (tmp_path / "own.py").write_text(code.replace(head, column))
    sets = {"robot.actuators.nozzle.kind": f"{tmp_path / 'own.py'}:Nozzle"}
    d = skywright.load("waypoints", robot="hexarotor", sets=sets)
    with pytest.raises(InputError, match=re.escape(f"column 'spray_flow': {says}")):
        skywright.build_vehicle(d)


@pytest.mark.parametrize("field", ["int", "Mat3"])
def test_fields_that_cannot_be_set_are_refused(tmp_path: Path, field: str) -> None:
    """1.7 was set as 1, and a matrix ended in a traceback."""
    code = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)[0]
    code = code.replace("flow: float", f"flow: {field}").replace("import Record", "import *")
    code = code.replace("valve.flow /", "0.0 /")
    (tmp_path / "own.py").write_text(code)
    sets = {"robot.actuators.nozzle.kind": f"{tmp_path / 'own.py'}:Nozzle"}
    d = skywright.load("waypoints", robot="hexarotor", sets=sets)
    with pytest.raises(InputError, match="'nozzle': 'spray_flow' shows a field of"):
        skywright.build_vehicle(d)


def test_arrays_are_set_as_a_whole(tmp_path: Path) -> None:
    """A setpoint with an array: shape and every number are checked."""
    file = tmp_path / "cups.py"
    file.write_text(
        "from typing import Annotated\n"
        "from skywright.core.record import Array\n"
        "from skywright.vehicle.bus import Setpoint\n"
        "from skywright.vehicle.component import Actuator, Out, Output, Recorded\n"
        "class Cups(Actuator):\n"
        "    class Told(Setpoint):\n        vacuum: Annotated[Array, 3]\n"
        "    class Seen(Output):\n        total: float\n"
        "    limits = {'vacuum': (0.0, 60.0)}\n"
        "    columns = (Recorded('vacuum', Told, 'vacuum', 'kPa', ''),\n"
        "               Recorded('total', Seen, 'total', 'kPa', ''))\n"
        "    @staticmethod\n"
        "    def step(told: Told, out: Out[Seen]) -> None:\n"
        "        out.total = told.vacuum[0] + told.vacuum[1] + told.vacuum[2]\n"
    )
    sets = {"robot.actuators.cups.kind": f"{file}:Cups"}
    vehicle = skywright.build_vehicle(skywright.load("waypoints", robot="hexarotor", sets=sets))
    vehicle.actuators["vacuum"] = [10.0, 20.0, 30.0]
    tick(vehicle, 0.1)
    assert vehicle.last_sample["total"][0] == 60.0
    np.testing.assert_array_equal(vehicle.last_sample["vacuum"][0], [10.0, 20.0, 30.0])
    point = Waypoint(x_m=0, y_m=0, z_m=1, actuators={"vacuum": [1.0, 2.0, 3.0]})
    load_kind("waypoints").check_vehicle(vehicle, Waypoints(points=[point]))
    point = Waypoint(x_m=0, y_m=0, z_m=1, actuators={"vacuum": [1.0]})
    with pytest.raises(InputError, match=r"points\.0\.actuators: vacuum = .* 3 finite numbers"):
        load_kind("waypoints").check_vehicle(vehicle, Waypoints(points=[point]))
    for wrong in ([1.0, 2.0], 1.0, [1.0, 2.0, math.inf], [1.0, 2.0, 61.0]):
        with pytest.raises(InputError, match="vacuum = "):
            vehicle.actuators["vacuum"] = wrong
