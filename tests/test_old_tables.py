"""World files of versions before 0.3 load as before, and say once what is new."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skywright.description.dump import dump_description
from skywright.description.loader import load_description
from skywright.description.world import old_tables
from skywright.description.world.loader import load_world
from skywright.description.world.things import find_carrier, list_movers, locate_thing
from skywright.errors import InputError
from skywright.models.things.box import Box
from skywright.models.things.cylinder import Cylinder
from skywright.models.things.pad import Pad
from skywright.models.things.tool import Tool

OLD = """
[world]
name = "old"

[world.obstacles.table]
x_m = 2.0
y_m = -1.0
z_m = 0.45
size_x_m = 0.4
size_y_m = 0.6
size_z_m = { value = 0.9, source = "assumed", range = [0.5, 1.0] }
yaw_deg = 90.0

[world.obstacles.table.pad]
travel_m = 0.03

[world.objects.roll]
shape = "cylinder"
size_x_m = { value = 0.1, source = "assumed", range = [0.05, 0.2] }
size_z_m = 0.3
mass_kg = 0.2
x_m = 1.0
y_m = 0.0
z_m = 0.15

[world.tool]
on = "table"
x_m = 2.1
y_m = -0.8
yaw_deg = 10.0

[world.rack]
x_m = 1.5
y_m = -0.4
z_m = 1.0
hole_m = 0.055

[world.peg]

[world.socket]
x_m = 1.5
y_m = 0.4
z_m = 1.0
hole_m = 0.032

[world.marker]
on = "roll"
x_m = 0.0
y_m = 0.0
z_m = 0.1

[world.tape]
strength_n = 3.0

[world.bench]
z_m = 1.3
"""


@pytest.fixture
def old(tmp_path: Path) -> Path:
    file = tmp_path / "world.toml"
    file.write_text(OLD)
    return file


def test_every_old_table_is_a_thing(old: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old_tables._told.clear()
    world, sources = load_world(old)
    load_world(old)
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "version 0.3" in told and str(old) in told
    table, tool = world.find_thing("table", Box), world.find_thing("tool", Tool)
    # the tool stood at a place of W and is at a place of the table's top, which is turned
    np.testing.assert_allclose((tool.x_m, tool.y_m), (0.2, -0.1), atol=1e-12)
    p = locate_thing(world.things, "tool").p
    np.testing.assert_allclose(p, [2.1, -0.8, 0.9 + tool.foot_m], atol=1e-12)
    assert tool.yaw_deg == pytest.approx(-80.0)
    assert not table.moves and table.friction is None
    pad = world.find_thing("table pad", Pad)
    assert (pad.width_m, pad.height_m, pad.travel_m) == (0.6, 0.9, 0.03)
    roll = world.find_thing("roll", Cylinder)
    assert roll.moves and (roll.diameter_m, roll.length_m) == (0.1, 0.3)
    assert list_movers(world.things) == ["roll", "tool", "peg"]
    assert find_carrier(world.things, "marker") == "roll"
    np.testing.assert_allclose(locate_thing(world.things, "marker", "roll").p, [0.0, 0.0, 0.1])
    np.testing.assert_allclose(locate_thing(world.things, "peg").p, [1.5, -0.4, 1.0])
    assert world.things["socket"].tracked and not world.things["rack"].tracked  # type: ignore[attr-defined]
    assert sources["world.things.roll.diameter_m"].range == (0.05, 0.2)
    assert sources["world.things.table.size_z_m"].kind == "assumed"


def test_old_keys_of_a_mission_and_of_the_command_line(tmp_path: Path) -> None:
    """Over a built-in world, which is written anew; numbers in W become places on the bench."""
    file = tmp_path / "mission.toml"
    file.write_text(
        '[mission]\nname = "m"\nkind = "tool-install"\nrobot = "bimanual"\n'
        'world = "tool-bench"\n[world.tool]\nmass_kg = 0.5\ny_m = -0.9\n'
    )
    sets = ["world.tool.x_m=2.05", "world.obstacles.bench.size_z_m=1.0",
            "world.obstacles.wall={x_m=5.0,y_m=0.0,z_m=1.0,size_x_m=0.1,size_y_m=1,size_z_m=2}",
            "world.obstacles.wall.size_z_m=1.5"]  # fmt: skip
    d = load_description(file, sets=sets)
    tool = d.world.find_thing("tool", Tool)
    np.testing.assert_allclose([tool.mass_kg, tool.x_m, tool.y_m], [0.5, 0.05, 0.1], atol=1e-12)
    assert d.world.find_thing("bench", Box).size_z_m == 1.0
    assert d.world.find_thing("wall", Box).size_z_m == 1.5
    again = tmp_path / "again.toml"
    again.write_text(dump_description(d))
    assert load_description(again).world == d.world


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('[world.things.peg]\nkind = "box"\n', "world.things.peg and world.peg both define"),
        (
            "[world.objects.table]\nsize_x_m = 1.0\n",
            "world.obstacles.table and world.obj",
        ),
    ],
)
def test_a_name_that_stands_twice_is_refused(old: Path, text: str, found: str) -> None:
    old.write_text(OLD + text)
    with pytest.raises(InputError, match=found):
        load_world(old)


def test_an_old_table_that_would_change_another_kind_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"world.bench is a bench, but world.things.bench is already a 'box'"
    ):
        load_description("tool-install", sets=["world.bench.z_m=1.5"])
    with pytest.raises(InputError, match=r"unknown key world.obstacles"):
        load_description("waypoints", sets=["world.obstacles=3"])
