"""Where a robot lands after a fault, and how it leads joints that do not follow."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.models.geometry import compute_clearance
from skywright.models.self_contact import is_apart
from skywright.run.faults._response import BELOW, _descend
from skywright.run.faults._room import (
    MARGIN,
    find_open,
    find_room,
    hold_stuck,
    list_places,
)
from skywright.run.setup import Setup
from skywright.vehicle.interface import Ticked


@pytest.fixture(scope="module")
def bench() -> Any:
    """A supervisor's parts over the nominal scene of tool-install, hovering before its bench."""
    setup = Setup(load_description("tool-install"))
    model, n = setup.model, len(setup.model[0]["q_min"])
    assert model is not None
    q = np.zeros(n)
    row = {"p_WB": np.array([1.74, -1.0, 1.5]), "R_WB": np.eye(3), "q": q}
    senses = SimpleNamespace(
        doubt=np.zeros(3), fix_age=0.0, vehicle=SimpleNamespace(pose_std=0.02, n_joints=8)
    )
    s = SimpleNamespace(
        senses=senses, surroundings=lambda: setup.clearance_aloft, ground_height=0.45,
        uav=SimpleNamespace(arc=None), vehicle=senses.vehicle, R_hold=None,
    )  # fmt: skip
    return s, row


def test_a_robot_over_a_bench_lands_beside_it_wherever_it_may_be(bench: Any) -> None:
    s, row = bench
    over = row | {"p_WB": np.array([2.1, -1.0, 1.7])}
    way = find_room(s, over)
    assert len(way) > 1
    query, ends = s.surroundings(), []

    def measure(p: Any) -> float:
        heights = np.arange(0.5, p[2], 0.05)
        return min(
            compute_clearance(query, np.array([p[0], p[1], z]), row["R_WB"], row["q"]).distance
            for z in heights
        )

    assert measure(over["p_WB"]) <= MARGIN < measure(way[-1])
    s.senses.doubt = np.array([0.3, 0.0, 0.0])
    try:
        doubted = find_room(s, over)
        ends = [measure(doubted[-1]), measure(doubted[-1] + s.senses.doubt)]
    finally:
        s.senses.doubt = np.zeros(3)
    assert min(ends) > MARGIN


def test_hands_below_a_pipe_draw_back_downwards() -> None:
    """The platform is above them: towards it is into the pipe."""
    setup = Setup(load_description("sensor-install"))
    query = setup.clearance_aloft
    s: Any = SimpleNamespace(
        surroundings=lambda: query, vehicle=SimpleNamespace(n_joints=9), senses=None
    )
    up = np.array([0.0, 0.0, 1.0])
    row = {"p_WB": np.array([2.79, 0.045, 3.444]), "R_WB": np.eye(3),
           "q": np.array([0.05, -0.12, 0.0, 0.0, -1.72, -0.12, 0.0, 0.0, -1.72])}  # fmt: skip
    way = find_open(s, row, up, 0.25)
    gaps = [
        compute_clearance(query, row["p_WB"] + 0.25 * w, row["R_WB"], row["q"]).distance
        for w in (way, up)
    ]
    assert gaps[0] > 0.2 > 0.0 > gaps[1] and way[2] < 0.5, (way, gaps)


def test_without_localisation_the_place_is_less_known_the_longer_it_takes(bench: Any) -> None:
    s, row = bench
    assert len(list_places(s, row)) == 1
    s.senses.fix_age = 2.0
    try:
        sizes = [float(np.linalg.norm(list_places(s, row, t)[1])) for t in (0.0, 1.0)]
    finally:
        s.senses.fix_age = 0.0
    for size, first in zip(sizes, (0.0, 1.0), strict=True):
        last = first + (1.5 - 0.45) / 0.35
        assert size == pytest.approx(min(3.0 * 0.02 * (1.0 + last / 2.0) ** 2, 1.0))


def test_joints_that_do_not_follow_stay_where_they_are() -> None:
    v: Any = SimpleNamespace(stuck={1}, estimate={"q": np.array([0.1, 0.7, 0.3])})
    np.testing.assert_array_equal(hold_stuck(v, np.array([1.0, 2.0, 3.0])), [1.0, 0.7, 3.0])


def test_a_forearm_that_would_meet_its_base_is_known() -> None:
    query = Setup(load_description("pipe-weld-scan")).clearance_aloft
    out, folded = np.array([-0.93, 1.0]), np.array([-0.93, 3.05])
    assert is_apart(query, out, np.array([-0.93, 2.5]))
    assert not is_apart(query, out, folded)
    assert not is_apart(None, out, out)


class Sinking:
    """A vehicle that follows its reference at once, until it stands at a true height."""

    def __init__(self, wrong: float, stands: float) -> None:
        self.t, self.z, self.wrong, self.stands = 0.0, 2.0, wrong, stands
        self.n_joints, self.limits = 2, SimpleNamespace(joint_speed=1.0)
        dtype = [("t", float), ("p_WB", float, 3), ("R_WB", float, (3, 3)), ("q", float, 2),
                 ("v_WB", float, 3), ("qd", float, 2), ("p_WT", float, 3),
                 ("R_WT", float, (3, 3)), ("v_WT", float, 3)]  # fmt: skip
        self.row = np.zeros(1, dtype)[0]
        self.row["p_WB"], self.row["R_WB"] = [0.0, 0.0, 2.0], np.eye(3)
        self.table = self.row[None]

    def tip_of(self, row: Any) -> tuple[Any, Any]:
        return row["p_WB"], row["R_WB"]

    def track(self, table: Any) -> None:
        self.table, self.begun = table, self.t

    def tick(self) -> Ticked:
        self.t += 0.02
        k = min(int(np.searchsorted(self.table["t"], self.t - self.begun)), len(self.table) - 1)
        self.row = self.table[k]
        self.z = max(float(self.row["p_WB"][2]) + self.wrong, self.stands)
        return Ticked(self.t, 0, self.t - self.begun >= float(self.table["t"][-1]))


@pytest.mark.parametrize("wrong", [0.0, 1.5, -0.5])
def test_a_landing_ends_on_the_ground_however_wrong_the_height_is(
    wrong: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`wrong` (m) is the true height less the estimated one."""
    v = Sinking(wrong, stands=0.2)
    monkeypatch.setattr("skywright.run.faults._response.build_rest", lambda s: v.row.copy())

    class Now:
        carrying, stuck = False, set[int]()

        @property
        def reference(self) -> Any:
            return v.row

        @property
        def estimate(self) -> Any:
            return {"p_WB": np.array([0.0, 0.0, v.z - wrong]), "R_WB": np.eye(3)}

    s: Any = SimpleNamespace(
        faults=SimpleNamespace(land=lambda: None), trail=SimpleNamespace(crumbs=[]),
        senses=Now(), uav=SimpleNamespace(arc=None), ground_height=0.2, vehicle=v,
        body=SimpleNamespace(track=v.track), tick=v.tick, turns=False, surroundings=None,
        R_hold=None,
    )  # fmt: skip
    _descend(s, here=True)
    assert v.z == 0.2
    assert math.isclose(v.t, (1.8 + wrong) / 0.35, abs_tol=3.0)
    assert BELOW < 1.5  # what is tried first would end in the air
