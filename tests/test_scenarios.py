"""The pipe structures: the built-in scenario, the drawn ones, and how narrow they are."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.description.world.scenario import GOAL_X, draw_structures, get_structures
from skywright.description.world.spec import Passage
from skywright.errors import InputError
from skywright.models.scene import build_scene
from skywright.planning.motion.passages import list_passages
from skywright.planning.motion.transport import BENCHMARK, build_scenario, build_transport

ROBOT = load_robot("ars-lrm")[0]
WORLD = load_world("pipe-structures")[0]
SCENARIOS = [(None, 0.0), *BENCHMARK]


@pytest.mark.parametrize(("seed", "difficulty"), SCENARIOS)
def test_every_scenario_is_narrow_and_passable(seed: int | None, difficulty: float) -> None:
    world = build_scenario(WORLD, seed, difficulty)
    problem = build_transport(ROBOT, world)
    t = problem.transport
    widths = list_passages(world, problem.space, t.bar_length, t.margin)
    assert widths[0].ratio < 1.3
    assert widths[0].ratio > 1.0  # and the robot fits through all of them
    assert {w.what for w in widths} >= {"bar", "platform", "robot"} or seed is not None
    # one of the narrow passages is in the plane in which the robot flies, not only across it
    assert min(w.ratio for w in widths if w.what == "robot") < 1.3


def test_the_scenarios_of_the_benchmark_are_frozen() -> None:
    """Numbers measured on them are compared over years: a change here needs new ones."""
    frozen = [
        "01bcffd64b03", "e3ac4148c78b", "a9864f637326", "960208f71d08", "2ce2812b02e5",
        "5d40ca6b1fcb", "cf256fb226d6", "24b762138764", "7ee6efa2022b", "64cffe1b60dd",
        "23a9f53d26ad",
    ]  # fmt: skip
    for (seed, difficulty), digest in zip(SCENARIOS, frozen, strict=True):
        s = get_structures(build_scenario(WORLD, seed, difficulty))
        assert s.area is not None
        parts = [{k: v.model_dump() for k, v in x.items()} for x in (s.tubes, s.passages)]
        text = json.dumps([*parts, s.area.model_dump()], sort_keys=True)
        assert hashlib.sha256(text.encode()).hexdigest()[:12] == digest, (seed, difficulty)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_drawn_structures_stand_in_the_area_and_repeat(seed: int, difficulty: float) -> None:
    drawn = draw_structures(seed, difficulty)
    assert drawn == draw_structures(seed, difficulty)
    assert len({p.split()[1] for p in drawn.passages}) == (3 if difficulty > 0.5 else 2)
    for tube in drawn.tubes.values():
        assert 1.5 < tube.x_m < GOAL_X - 0.5
        assert min(tube.z_m, tube.to_z_m) >= 0.0
    for passage in drawn.passages.values():
        assert set(passage.between) <= {*drawn.tubes, "ground", "ceiling"}


def test_the_upper_gap_is_closed_to_the_bar_alone() -> None:
    problem = build_transport(ROBOT, WORLD)
    widths = {w.name: w for w in list_passages(WORLD, problem.space, 2.0, 0.2)}
    assert widths["upper gap"].opening < widths["lower gap"].needs  # the bar does not fit
    assert widths["upper gap"].ratio > 1.0  # the platform does


@pytest.mark.parametrize("ends", [["ground", "ceiling"], ["ceiling", "ground"]])
def test_a_passage_from_the_ground_to_the_ceiling_is_as_high_as_the_area(ends: list[str]) -> None:
    hall = Passage(between=ends, needs="robot")
    world = WORLD.model_copy(update={"passages": {"hall": hall}})
    (width,) = list_passages(world, build_transport(ROBOT, WORLD).space, 2.0, 0.2)
    assert world.area is not None and width.opening == world.area.z_max_m


def test_the_scene_holds_the_tubes_of_the_draw() -> None:
    world = build_scenario(WORLD, 3)
    model = build_scene(ROBOT, world).model
    names = {model.geom(i).name for i in range(model.ngeom)}
    assert {f"tube {n}" for n in draw_structures(3, 0.5).tubes} <= names


def test_bad_structures_are_refused(tmp_path: Path) -> None:
    def refusal(text: str) -> str:
        path = tmp_path / "w.toml"
        path.write_text('[world]\nname = "w"\n' + text)
        with pytest.raises(InputError) as error:
            load_world(path)
        return str(error.value)

    tube = "x_m = 0.0\ny_m = 0.0\nz_m = 1.0\nto_x_m = 0.0\nto_y_m = 0.0\n"
    assert "same point" in refusal(f"[world.tubes.a]\n{tube}to_z_m = 1.0\n")
    said = refusal(
        f"[world.tubes.a]\n{tube}to_z_m = 2.0\n"
        '[world.passages.p]\nbetween = ["a", "b"]\nneeds = "bar"\n'
    )
    assert "'b'" in said and "ground" in said
    said = refusal('[world.passages.p]\nbetween = ["ground", "ground"]\nneeds = "robot"\n')
    assert "passages.p.between names 'ground' twice; valid: two different ends" in said
    assert "below" in refusal("[world.area]\nx_min_m = 2.0\nx_max_m = 1.0\n")
