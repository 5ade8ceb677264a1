"""Layers, sourced numbers, `--set`, and one plain line for everything that can be wrong."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from skywright.core.keys import iterate_leaves, parse_assignment
from skywright.core.spec import Source
from skywright.core.toml_files import build_layer, merge_layers, parse_value, strip_sources
from skywright.description.dump import dump_description
from skywright.description.loader import Description, list_layer_problems, load_description
from skywright.description.robot.loader import find_robot
from skywright.errors import InputError
from skywright.models.things.box import Box

SCAN, WAYPOINTS = "pipe-weld-scan", "waypoints"


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def mission_file(folder: Path, more: str = "", head: str = "") -> Path:
    """A small waypoint mission; `more` is appended, `head` goes inside [mission]."""
    text = (
        f'[mission]\nname = "m"\nkind = "waypoints"\nrobot = "hexarotor"\nworld = "open"\n{head}\n'
        "[[mission.task.points]]\nx_m = 1.0\ny_m = 0.0\nz_m = 1.5\n" + more
    )
    return write(folder, "m.toml", text)


def refusal(*args: object, **kwargs: object) -> str:
    with pytest.raises(InputError) as info:
        load_description(*args, **kwargs)  # type: ignore[arg-type]
    message = str(info.value)
    assert "\n" not in message
    return message


# Values of Python


def test_values_of_numpy_and_tuples_are_plain_values():
    wanted = (30.0, 90.0, 150.0, 210.0, 270.0, 330.0)
    sets = {"world.wind.mean_mps": np.float64(1.5), "robot.rotors.azimuth_deg": wanted}
    d = load_description(WAYPOINTS, robot="hexarotor", sets=sets, seed=np.int64(3))
    assert d.mission.seed == 3 and d.world.wind.mean_mps == 1.5
    assert list(d.robot.rotors.azimuth_deg) == list(wanted)
    sets["robot.rotors.azimuth_deg"] = np.array(wanted)
    again = load_description(WAYPOINTS, robot="hexarotor", sets=sets, seed=3)
    assert dump_description(again) == dump_description(d)


@pytest.mark.parametrize("sets", [None, 3, [1], {1: 2.0}])
def test_assignments_that_are_none_are_refused(sets):
    assert "valid: a dictionary of keys and values" in refusal(WAYPOINTS, sets=sets)


def test_assignments_may_come_from_a_generator():
    texts = (f"world.wind.mean_mps={speed}" for speed in (1, 2))
    assert load_description(WAYPOINTS, sets=texts).world.wind.mean_mps == 2.0


# Layers


def test_later_layers_win(tmp_path: Path) -> None:
    path = mission_file(tmp_path, "[robot.platform]\nmass_kg = 6.0\n[world]\ngravity_mps2 = 9.8\n")
    d = load_description(path)
    assert (d.robot.platform.mass_kg, d.world.gravity_mps2) == (6.0, 9.8)
    assert d.robot.platform.inertia_xx_kgm2 == 0.287  # of the robot file, untouched
    d = load_description(path, sets=["robot.platform.mass_kg=6.5"])
    assert d.robot.platform.mass_kg == 6.5
    d = load_description(path, sets=["robot.platform.mass_kg=6.5", "robot.platform.mass_kg=7"])
    assert d.robot.platform.mass_kg == 7.0  # the last one wins


def test_origin_and_source_follow_the_winner(tmp_path: Path) -> None:
    path = mission_file(tmp_path, "[robot.platform]\nmass_kg = 6.0\n")
    d = load_description(path, sets=["robot.rotors.thrust_max_n=23"])
    assert d.origin["robot.platform.mass_kg"] == str(path)
    assert d.sources["robot.platform.mass_kg"] == Source("set", str(path))
    assert d.origin["robot.rotors.thrust_max_n"] == "--set"
    assert d.sources["robot.rotors.thrust_max_n"].kind == "set"
    assert d.origin["robot.platform.inertia_xx_kgm2"] == "robot hexarotor"
    assert d.sources["robot.platform.inertia_xx_kgm2"].kind == "datasheet"


def test_robot_and_world_beside_the_mission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "a"
    here.mkdir()
    write(here, "yard.toml", '[world]\nname = "yard"\n')
    path = mission_file(here)
    path.write_text(path.read_text().replace('"open"', '"yard.toml"'))
    assert load_description(path).world.name == "yard"
    elsewhere = tmp_path / "b"
    elsewhere.mkdir()
    write(elsewhere, "other.toml", '[world]\nname = "other"\n')
    monkeypatch.chdir(elsewhere)
    d = load_description(path, world="other.toml")  # relative to the current folder
    assert (d.world.name, d.mission.world) == ("other", "other.toml")
    assert load_description(path, sets=["mission.world=other.toml"]).world.name == "other"


def test_robot_flag_exchanges_the_robot() -> None:
    d = load_description(WAYPOINTS, robot="f550-bridge", seed=7)
    assert (d.robot.name, d.mission.robot, d.mission.seed) == ("f550-bridge", "f550-bridge", 7)
    assert load_description(WAYPOINTS, sets={"mission.robot": "othex"}).robot.name == "othex"


# The resolved file


@pytest.mark.parametrize("name", [SCAN, WAYPOINTS])
def test_resolved_file_gives_the_same_description(name: str, tmp_path: Path) -> None:
    sets = ["robot.platform.mass_kg=2.3", "world.wind.kind=steady", "world.wind.mean_mps=2.5"]
    d = load_description(name, sets=sets, seed=3)
    (tmp_path / "run").mkdir()
    write(tmp_path / "run", "mission.toml", dump_description(d))
    again = load_description(tmp_path / "run")  # a run's directory
    assert again._replace(origin={}) == d._replace(origin={})
    assert dump_description(again) == dump_description(d)


def test_resolved_file_needs_no_base_files(tmp_path: Path) -> None:
    d = load_description(SCAN)
    text = dump_description(d).replace('robot = "othex"', 'robot = "long-gone.toml"')
    path = write(tmp_path, "mission.toml", text)
    assert load_description(path).robot == d.robot
    other = load_description(path, robot="f550-bridge")  # but a robot can still be exchanged
    assert other.robot == load_description(WAYPOINTS, robot="f550-bridge").robot


# --set reaches every value


def all_keys(d: Description) -> list[tuple[str, object]]:
    leaves: list[tuple[str, object]] = []
    for root in ("robot", "world", "mission", "plant"):
        leaves += iterate_leaves(getattr(d, root), root)
    return leaves


def test_set_reaches_every_value(tmp_path: Path) -> None:
    """Setting any key to what it is anyway changes nothing, whether a file wrote it or not."""
    for name in (SCAN, WAYPOINTS):
        d = load_description(name)
        sets = [
            f"{key}={toml_value(value)}"
            for key, value in all_keys(d)
            if value not in (None, [], {})
        ]
        assert len(sets) > 100
        again = load_description(name, sets=sets)
        for part in ("robot", "world", "plant", "mission"):
            assert getattr(again, part) == getattr(d, part)


def toml_value(value: object) -> str:
    return tomli_w.dumps({"v": value}).partition("=")[2].strip()


@pytest.mark.parametrize(
    ("assignment", "value"),
    [
        ("world.pipe.diameter_m=0.3", 0.3),
        ("robot.arm.link1.length_m=0.3", 0.3),
        ("robot.arm.motor1.stall_torque_nm=5", 5.0),
        ("mission.requirements.contact.gap_max_mm.limit=0.5", 0.5),
        ("mission.requirements.tip.new_mm.limit=3", 3.0),  # a requirement of one's own
        ("mission.task.depth_m=0.01", 0.01),  # unset by default
        ("world.wind.kind=steady", "steady"),
        ("world.wind.kind='steady'", "steady"),
        ("world.pipe.supports=false", False),
        ("plant.mass_error=-0.05", -0.05),
        ("mission.description=a = b", "a = b"),
        ("mission.name=5", "5"),
        ("robot.rotors.alpha_deg=[1, 2, 3, 4, 5, 6]", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        ("robot.arm.belt=[[1, 0], [-0.9, 1]]", [[1.0, 0.0], [-0.9, 1.0]]),
        ("robot.platform.mass_kg={value=1.7, source='assumed', range=[1.5, 1.9]}", 1.7),
    ],
)
def test_set(assignment: str, value: object) -> None:
    d = load_description(SCAN, sets=[assignment])
    assert dict(all_keys(d))[assignment.partition("=")[0]] == value


def test_set_reaches_list_items_and_new_tables() -> None:
    box = "{kind='box', x_m=3.0, y_m=0.0, z_m=1.0, size_x_m=0.1, size_y_m=1.0, size_z_m=2.0}"
    d = load_description(
        SCAN,
        sets=["robot.rotors.alpha_deg.2=20", "robot.arm.belt.1.0=-0.9", "robot.rotors.spin.0=cw"]
        + [f"world.things.wall={box}", "world.things.wall.size_z_m=1.5"],
    )
    assert d.robot.rotors.alpha_deg[1:4] == [-35.0, 20.0, -35.0]
    assert d.robot.rotors.spin[:2] == ["cw", "cw"]
    assert d.robot.arm is not None and d.robot.arm.belt == [[1.0, 0.0], [-0.9, 1.0]]
    assert d.world.find_thing("wall", Box).size_z_m == 1.5
    sourced = "robot.platform.mass_kg={value=1.7, source='assumed', range=[1.5, 1.9]}"
    source = load_description(SCAN, sets=[sourced]).sources["robot.platform.mass_kg"]
    assert source == Source("assumed", "", (1.5, 1.9))


def test_set_reaches_list_tables() -> None:
    d = load_description(WAYPOINTS, sets=["mission.task.points.0.x_m=0.5"])
    assert d.mission.task.points[0].x_m == 0.5
    assert d.mission.task.points[1] == load_description(WAYPOINTS).mission.task.points[1]


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"mission": None}, "mission is a NoneType; valid: a name"),
        ({"mission": "waypoints", "robot": 3}, "robot is a int; valid"),
        ({"mission": "waypoints", "world": b"open"}, "world is a bytes; valid"),
    ],
)
def test_what_is_no_name_is_refused(given: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        load_description(**given)


def test_sets_as_mapping() -> None:
    d = load_description(SCAN, sets={"world.pipe.diameter_m": 0.3, "world.wind.kind": "steady"})
    assert (d.world.pipe.diameter_m, d.world.wind.kind) == (0.3, "steady")  # type: ignore[union-attr]


def test_optional_table_is_created_by_a_valid_key_only() -> None:
    d = load_description(WAYPOINTS, sets=["world.pipe.x_m=4"])
    assert d.world.pipe is not None and d.world.pipe.x_m == 4
    assert "unknown key world.pipe.z" in refusal(WAYPOINTS, sets=["world.pipe.z=4"])


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("world.pipe.diameter=0.3", ["world.pipe.diameter", "diameter_m", "metres"]),
        ("world.pipe.diameter_mm=300", ["world.pipe.diameter_mm", "diameter_m (in metres)"]),
        ("robot.platform.mass_g=1600", ["mass_kg (in kilograms)"]),
        ("world.wind.toward_rad=1", ["toward_deg (in degrees)"]),
        ("world.pipe.diametr_m=0.3", ["world.pipe.diametr_m", "diameter_m"]),
        ("robot.arm.lnk1.length_m=0.3", ["robot.arm.lnk1", "link1"]),
        ("robot.arm.motor1.stall_torque=5", ["stall_torque_nm (in newton metres)"]),
        ("wrold.pipe.diameter_m=0.3", ["'wrold'", "robot, world, mission, plant"]),
        ("mission.requirements.contact.gap_max.limit2=1", ["contact.gap_max_mm"]),
        ("mission.task.points.0.x_m=1", ["mission.task", "points"]),
        ("robot.rotors.alpha_deg.6=1", ["0 to 5"]),
        ("robot.rotors.alpha_deg.-1=1", ["0 to 5"]),
        ("world.pipe.diameter_m.x=1", ["single value"]),
        ("world.pipe.diameter_m=big", ["'big'", "a number is needed"]),
        ("world.pipe.diameter_m=", ["''", "a number is needed"]),
        ("world.pipe.diameter_m='0.3'", ["'0.3'", "a number is needed"]),
        ("world.pipe.diameter_m=true", ["true", "a number is needed"]),
        ("world.pipe.diameter_m=nan", ["world.pipe.diameter_m is nan", "finite"]),
        ("world.pipe.diameter_m=-inf", ["-inf", "finite"]),
        ("world.pipe.diameter_m=1e999", ["inf", "finite"]),
        ("world.pipe.diameter_m=-1", ["-1", "greater than 0"]),
        ("world.pipe.diameter_m={v=1}", ["a table with the keys v", "{ value = "]),
        ("world.mocap.rate_hz=0", ["world.mocap.rate_hz is 0", "greater than 0"]),
        ("robot.control.rate_hz=0", ["robot.control.rate_hz is 0", "greater than 0"]),
        ("world.wind.kind=gale", ["'gale'", "'none', 'steady'"]),
        ("mission.task.passes=2.5", ["2.5", "whole number"]),
        ("mission.seed=-1", ["-1", "at least 0"]),
        ("world.pipe=3", ["world.pipe is a table", "3"]),
        ("world.pipe={inclination_deg=80, length_m=6}", ["1.49 m below the ground"]),
        ("world.weld.offset_m=-5", ["offset_m = -5", "beyond the pipe's ends at -0.25 and 0.25"]),
        ("mission.seed=" + 400 * "1", ["a number beyond 1e308", "valid: 0 to"]),
        (
            "robot.platform.mass_kg={value=1.7}",
            ["robot.platform.mass_kg", "has a value but no source"],
        ),
        ("robot.platform.mass_kg={value=1.7, source='guess'}", ["'guess'", "assumed"]),
        ("robot.platform.mass_kg={value=1.7, source='assumed'}", ["range"]),
        ("robot.platform.mass_kg={value=1.7, source='assumed', range=[2, 3]}", ["outside"]),
        ("robot.platform.mass_kg={value=1.7, source='paper', sauce=1}", ["sauce"]),
        ("robot.rotors.spin.0=left", ["'left'", "'ccw', 'cw'"]),
        ("robot.rotors.alpha_deg=[1.0]", ["alpha_deg has 1 entries", "azimuth_deg has 6"]),
        ("mission.law=nowhere.py:step", ["mission.law", "nowhere.py"]),
        ("no-equals-sign", ["KEY=VALUE"]),
        ("=1", ["KEY=VALUE"]),
    ],
)
def test_set_refuses(assignment: str, words: list[str]) -> None:
    message = refusal(SCAN, sets=[assignment])
    for word in words:
        assert word in message


# Files


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["m.toml", "empty", "robot, world, mission, plant"]),
        ("# only a comment\n", ["empty"]),
        ("[mission]\nname = \n", ["malformed TOML", "line 2"]),
        ("[mission]\nname = 1\nname = 2\n", ["malformed TOML", "line 3"]),
        ("[misson]\nname = 'x'\n", ["misson", "robot, world, mission, plant"]),
        ("mission = 3\n", ["mission must be a table"]),
        ("[robot]\nname = 'x'\n", ["no [mission] table", "robot"]),
        ("[mission]\nname = 'x'\n", ["mission lacks robot"]),
        ("[mission]\nrobot = 3\n", ["mission.robot is 3"]),
        ("[mission]\nrobot = 'othx'\nworld = 'pipe'\n", ["unknown robot 'othx'", "othex"]),
        ("[mission]\nrobot = 'othex'\nworld = 'pip'\n", ["unknown world 'pip'", "pipe"]),
        ("a = " + "[" * 5000, ["malformed TOML"]),
    ],
)
def test_bad_files(tmp_path: Path, text: str, words: list[str]) -> None:
    message = refusal(write(tmp_path, "m.toml", text))
    for word in words:
        assert word in message


def test_bad_bytes_and_missing_files(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_bytes(b"\xff\xfe[mission]")
    assert "UTF-8" in refusal(path)
    assert "built-in missions: " in refusal("no-such-mission")
    for odd in ("", "x" * 5000, "a\0b", str(tmp_path)):
        assert "unknown mission" in refusal(odd)
    assert "unknown robot" in refusal(SCAN, robot="no-such-robot")
    world = write(tmp_path, "w.toml", '[world]\nname = "w"\n')
    assert "no [robot] table" in refusal(SCAN, robot=world)


def test_problems_name_the_file_that_wrote_the_key(tmp_path: Path) -> None:
    path = mission_file(tmp_path, "[robot.platform]\nmass_kg = -1.0\n")
    assert refusal(path).startswith(f"{path}: robot.platform.mass_kg is -1.0")
    assert refusal(SCAN, sets=["robot.platform.mass_kg=-1"]).startswith("--set: robot.platform")


def test_misspelt_link_tells_its_siblings(tmp_path: Path) -> None:
    path = mission_file(tmp_path, "[robot.arm.lnk1]\nlength_m = 0.3\n")
    path.write_text(path.read_text().replace("hexarotor", "othex"))
    assert "robot.arm.lnk1 lacks mass_kg" in refusal(path)
    assert "link1" in refusal(path)


def test_all_problems_at_once(tmp_path: Path) -> None:
    path = mission_file(
        tmp_path,
        "[robot.platform]\nmass_kg = 'x'\n[world.mocap]\nrate_hz = 0\n[world.wind]\nspeed = 1\n",
        head="seed = 1.5\nhovr_height_m = 1\n",
    )
    problems = "\n".join(list_layer_problems(path))
    for word in ("mass_kg", "rate_hz", "world.wind.speed", "mission.seed", "hovr_height_m"):
        assert word in problems
    assert "hover_height_m" in problems  # the neighbour
    assert list_layer_problems(mission_file(tmp_path)) == []


LAW = "from skywright.vehicle.component import Law\nclass Mine(Law): ...\n"


def test_user_law_file_is_found_beside_the_mission(tmp_path: Path) -> None:
    path = mission_file(tmp_path, head='law = "my_law.py:Mine"')
    assert "my_law.py" in refusal(path)
    write(tmp_path, "my_law.py", LAW)
    assert load_description(path).mission.law.kind == f"{tmp_path / 'my_law.py'}:Mine"


def test_user_law_of_a_robot_is_found_beside_the_robot(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    source = Path(find_robot("hexarotor").path).read_text(encoding="utf-8")
    text = source.replace("[robot.control]\n", '[robot.control]\nlaw = "my_law.py:Mine"\n')
    robot = write(tmp_path / "r", "robot.toml", text)
    assert "robot.control.law" in refusal(WAYPOINTS, robot=robot)
    law = write(tmp_path / "r", "my_law.py", LAW)
    assert load_description(WAYPOINTS, robot=robot).robot.control.law == f"{law}:Mine"


@pytest.mark.parametrize("other", ["mission", "world"])
def test_robot_file_holds_a_robot_only(tmp_path: Path, other: str) -> None:
    source = Path(find_robot("hexarotor").path).read_text(encoding="utf-8")
    path = write(tmp_path, "robot.toml", source + f'\n[{other}]\nname = "x"\n')
    assert f"cannot contain the table [{other}]" in refusal(WAYPOINTS, robot=path)


# Properties

names = st.text("abcdefghijklmnop_", min_size=1, max_size=8).filter(lambda n: n != "value")
numbers = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**62), 2**62)
plain_values = numbers | st.booleans() | st.text(max_size=10) | st.lists(numbers, max_size=4)
trees = st.recursive(
    st.dictionaries(names, plain_values, max_size=4),
    lambda inner: st.dictionaries(names, inner, max_size=3),
    max_leaves=10,
)
kinds = st.sampled_from(["paper", "derived", "datasheet", "set"])
sources = st.builds(Source, kinds, st.text(max_size=9), st.none())


@given(trees, st.data())
def test_wrappers_come_off_and_nothing_else_changes(tree: dict, data: st.DataObject) -> None:
    """Wrapping any number of leaves and stripping again gives the tree and exactly the sources."""
    expected: dict[str, Source] = {}

    def wrap(value: object, key: str) -> object:
        if isinstance(value, dict):
            return {n: wrap(c, f"{key}.{n}" if key else n) for n, c in value.items()}
        if data.draw(st.booleans()):
            source = data.draw(sources)
            expected[key] = source
            return {"value": value, "source": source.kind, "note": source.note}
        return value

    plain, found = strip_sources(wrap(tree, ""), "f")  # type: ignore[arg-type]
    assert plain == tree
    assert found == expected


@given(numbers, numbers, numbers)
def test_range_holds_the_value(value: float, a: float, b: float) -> None:
    low, high = float(min(a, b)), float(max(a, b))
    raw = {"k": {"value": value, "source": "assumed", "range": [low, high]}}
    if low <= float(value) <= high:
        assert strip_sources(raw, "f")[1]["k"].range == (low, high)
    else:
        with pytest.raises(InputError, match="outside its range"):
            strip_sources(raw, "f")


@given(plain_values)
def test_set_value_round_trip(value: object) -> None:
    """What TOML writes, KEY=VALUE reads."""
    assert parse_value(toml_value(value)) == value


@given(st.text(max_size=30))
def test_any_set_value_is_read_or_kept_as_text(text: str) -> None:
    value = parse_value(text)
    assert isinstance(value, bool | int | float | str | list | dict)
    if isinstance(value, float) and not math.isfinite(value):
        with pytest.raises(InputError, match="finite"):
            load_description(WAYPOINTS, sets={"world.gravity_mps2": value})


@given(st.text(max_size=40))
def test_any_assignment_is_split_or_refused(text: str) -> None:
    try:
        key, value = parse_assignment(text)
    except InputError:
        assert not text.partition("=")[0].strip() or "=" not in text
    else:
        assert key == text.partition("=")[0].strip()
        assert value == text.partition("=")[2].strip()


@given(st.text(max_size=200))
def test_no_text_breaks_the_file_reader(text: str) -> None:
    try:
        build_layer(text, "f")
    except InputError as error:
        assert str(error).startswith("f: ")


@given(st.lists(trees.map(lambda t: {"robot": t}), min_size=1, max_size=3))
def test_merging_is_key_by_key(layers: list[dict]) -> None:
    """Every leaf of the result is the last layer's that has it; clashing kinds are refused."""
    from skywright.core.toml_files import Layer

    stack = [Layer(str(i), t, {}) for i, t in enumerate(layers)]
    try:
        merged, _, origin = merge_layers(stack)
    except InputError as error:
        assert "is a table" in str(error)
        return

    def leaf(tree: object, path: list[str]) -> object:
        for name in path:
            if not isinstance(tree, dict) or name not in tree:
                return None
            tree = tree[name]
        return tree

    for key, label in origin.items():
        path = key.split(".")
        assert leaf(merged, path) == leaf(layers[int(label)], path)


NASTY: list[object] = [
    math.nan, -math.inf, 0, -1, 1e308, 10**400, True, "", "x", [], [1], {}, {"a": 1}, [[]],
    [math.nan],
]  # fmt: skip


@given(st.data())
def test_no_value_of_any_key_breaks_the_loader(data: st.DataObject) -> None:
    """Whatever stands at a key, the description is valid or one line names the key's table."""
    d = load_description(SCAN)
    key = data.draw(st.sampled_from(sorted(k for k, _ in all_keys(d))))
    value = data.draw(st.sampled_from(NASTY) | st.text(max_size=5) | st.floats())
    try:
        load_description(SCAN, sets={key: value})
    except InputError as error:
        assert "\n" not in str(error)
        assert any(part in str(error) for part in (key.split(".")[0], key.split(".")[-1]))


@given(st.data())
def test_no_misspelt_key_breaks_the_loader(data: st.DataObject) -> None:
    d = load_description(WAYPOINTS)
    key = data.draw(st.sampled_from(sorted(k for k, _ in all_keys(d))))
    at = data.draw(st.integers(0, len(key) - 1))
    junk = data.draw(st.text(max_size=3))
    try:
        load_description(WAYPOINTS, sets={key[:at] + junk + key[at + 1 :]: 1.0})
    except InputError as error:
        assert "\n" not in str(error).replace(junk, "")


@pytest.mark.parametrize(
    "key",
    [
        "world.wind.mean_mps",
        "world.wind.vertical_mps",
        "world.mocap.position_noise_m",
        "robot.sensors.gyro_noise_rad_s_sqrthz",
    ],
)
def test_a_number_whose_square_overflows_is_refused(key: str) -> None:
    """1e308 m/s of wind once flew as no wind at all: its direction was 0 / infinity."""
    message = refusal(WAYPOINTS, sets=[f"{key}=1e308"])
    assert message.startswith(f"--set: {key}: 1e+308 is implausible; valid: ")


@pytest.mark.parametrize("mission", ["bimanual-bench", "tool-install"])
@pytest.mark.parametrize("robot", ["othex", "f550-bridge", "hexarotor"])
def test_a_robot_without_a_part_that_a_mission_changes(mission: str, robot: str) -> None:
    """The part is the cause, not the keys that only a robot's own file gives it."""
    with pytest.raises(InputError) as caught:
        load_description(mission, robot=robot)
    said = str(caught.value)
    assert (
        f"robot '{robot}' has no [robot.arm.shoulder_roll], which mission {mission} needs" in said
    )
    assert said.endswith("built-in robots that have it: bimanual, bimanual-longreach")
