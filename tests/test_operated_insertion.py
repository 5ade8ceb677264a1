"""How the stick leads a peg to its hole, and what its end may bear outside it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.missions.bar_insertion import operated_insertion
from skywright.missions.bar_insertion.bar_leading import FOLLOW_RATE, BarLeader
from skywright.missions.bar_insertion.insertion import READY, Hole
from skywright.missions.bar_insertion.operated_insertion import STAND, _Insertion
from skywright.models.scene import build_scene
from skywright.models.things.peg import Peg
from skywright.vehicle.plant import MISSION_TICK

D = load_description("bar-insertion")
PEG = D.world.find_thing("peg", Peg)
WEIGHT = 3.9
HOLE = Hole(np.array([1.5, 0.4, 1.0]), np.eye(3), np.array([0.0, 0.0, -0.05]),
            np.array([0.0, 0.0, 0.1]), 0.004, 0.006)  # fmt: skip
DOWN = np.array([0.0, 0.0, -1.0])


class Leader:
    """Takes what the bar is told; its tip stands at `off`."""

    weight = WEIGHT

    def __init__(self) -> None:
        self.goals: list[np.ndarray] = []
        self.v: list[np.ndarray] = []
        self.a: list[np.ndarray] = []

    def lead(self, p: Any, n: Any, point: Any, *, along: tuple[Any, Any]) -> Any:
        self.goals.append(np.array(p) - HOLE.p)
        self.v.append(np.array(along[0]))
        self.a.append(np.array(along[1]))
        return SimpleNamespace(p=p - HOLE.tip, R=np.eye(3))


def lead(
    axes: np.ndarray, off: list[float], felt: float, seconds: float
) -> tuple[_Insertion, Leader]:
    s: Any = SimpleNamespace(
        task=D.mission.task, vehicle=SimpleNamespace(world=D.world, t=0.0), begin=lambda _: None
    )
    leader: Any = Leader()
    work = _Insertion(s, SimpleNamespace(read=None), leader, HOLE)
    for _ in range(round(seconds / MISSION_TICK)):
        work._lead(axes, np.array(off), felt)
    return work, leader


def test_a_bar_on_its_peg_topples_from_a_load_far_above_what_its_end_may_bear() -> None:
    """About the crossbar: m g l holds it upright, the force on its end times h turns it over."""
    model = build_scene(D.robot, D.world).model
    body = model.body("object peg").id
    below = PEG.handle_height_m - float(model.body_ipos[body][2])
    share = below / (PEG.handle_height_m + PEG.length_m)
    assert share == pytest.approx(0.57, abs=0.01)
    assert share > 3.0 * STAND


def test_the_platform_is_told_how_the_stick_accelerates_it() -> None:
    _, leader = lead(np.array([0.5, 0.0, 0.0]), [0.0, 0.0, 0.05], 0.0, 2.0)
    v, a = np.array(leader.v)[:, 0], np.array(leader.a)[:, 0]
    v_max = D.mission.task.stick_speed_mps
    assert v[-1] == pytest.approx(0.5 * v_max, rel=0.01)
    assert np.allclose(np.diff(v), MISSION_TICK * a[1:], atol=1e-12)
    p = np.array(leader.goals)[:, 0]
    assert np.allclose(np.diff(p), MISSION_TICK * v[1:], atol=1e-12)
    assert np.max(a) <= 0.5 * v_max / operated_insertion.STICK_S + 1e-12


def test_the_goal_never_leaves_the_fence() -> None:
    work, _ = lead(np.array([1.0, -1.0, 1.0]), [0.0, 0.0, 0.05], 0.0, 20.0)
    low, high = operated_insertion.FENCE
    assert np.all(work.goal >= low - 1e-9) and np.all(work.goal <= high + 1e-9)


@pytest.mark.parametrize(
    ("felt", "sign"), [(0.0, -1.0), (0.5 * STAND, -1.0), (STAND, 0.0), (2.0 * STAND, 1.0)]
)
def test_outside_the_hole_the_stick_cannot_press_the_pegs_end_harder(
    felt: float, sign: float
) -> None:
    """Its end stands on the face beside the hole; the stick says down. Above STAND it is raised."""
    _, leader = lead(DOWN, [0.008, 0.0, 0.0], felt * WEIGHT, 2.0)
    v = leader.v[-1][2]
    assert np.sign(round(v, 9)) == sign
    assert abs(v) < 0.003  # m/s: what it weighs on is felt 0.8 s late


def test_what_is_led_does_not_run_away_from_a_peg_that_is_held() -> None:
    work, _ = lead(np.array([1.0, 0.0, -1.0]), [0.008, 0.0, 0.0], 0.1 * WEIGHT, 10.0)
    assert work.goal[0] <= 0.008 + operated_insertion.LEASH + 1e-9
    assert work.goal[2] == pytest.approx(0.0)
    free, _ = lead(np.array([1.0, 0.0, 0.0]), [0.008, 0.0, READY], 0.0, 1.0)
    assert free.goal[0] > 0.0


def test_a_peg_that_leaves_the_hole_goes_back_by_the_phases_and_the_stick_leads_it() -> None:
    """In "insert" it would be led to the hole's middle, wherever the stick points."""
    begun: list[str] = []
    s: Any = SimpleNamespace(
        task=D.mission.task, vehicle=SimpleNamespace(world=D.world, t=0.0),
        begin=begun.append, end=begun.append,
    )  # fmt: skip
    work = _Insertion(s, SimpleNamespace(read=None), Leader(), HOLE)  # type: ignore[arg-type]
    work.phase = "insert"
    work._watch(np.array([0.0, 0.0, -0.001]))
    assert begun == []
    out = np.array([0.002, 0.03, 0.001])
    work._watch(out)
    assert begun == ["retry", "lower"] and np.array_equal(work.goal, out)
    work._watch(np.array([0.0, 0.0, 2.0 * READY]))
    assert begun[2:] == ["retry", "align"]


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_behind_hands_that_press_the_platform_stands_where_the_springs_do(share: float) -> None:
    """Springs are linear: with a share of the weight they stand at that share of the sag."""
    leader = BarLeader.__new__(BarLeader)
    sag = np.array([-0.0105, -0.006, 0.0145])
    leader._hang, leader.weight = sag, WEIGHT
    leader._felt = SimpleNamespace(carried=share * WEIGHT)  # type: ignore[assignment]
    for beyond in (np.zeros(3), np.array([0.0, 0.004, -0.002])):
        leader._find_stretch = lambda row, d=beyond: share * sag + d  # type: ignore[method-assign]
        np.testing.assert_allclose(leader._follow(None), FOLLOW_RATE * beyond, atol=1e-12)
