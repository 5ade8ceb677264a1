"""Faults of operated missions: what the committed table says, and a flight of it."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import operated_faults
from operated_faults import FAULTS, KEPT, WORKS, Hand, fly, judge


def read() -> list[dict[str, str]]:
    with KEPT.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_every_flight_of_the_table_ended_as_promised() -> None:
    rows = read()
    keys = [(r["mission"], r["moment"], r["fault"]) for r in rows]
    assert len(set(keys)) == len(keys)
    known = {
        (mission, m.name, fault)
        for mission, work in WORKS.items()
        for m in work.moments
        for fault in FAULTS
    }
    assert set(keys) == known
    assert [r for r in rows if r["passed"] != "True"] == []
    hit = [r for r in rows if float(r["collisions"] or 0.0) > 0.0]
    assert {(r["mission"], r["fault"]) for r in hit} <= {("tool-install", "fence")}  # by the push
    for r in rows:
        if r["fault"] in operated_faults.RULES:
            assert r["rule"] == operated_faults.RULES[r["fault"]]
        assert r["reason"] or r["outcome"] == "succeeded"  # who is refused is told why


def test_a_pilot_takes_over_a_peg_in_its_hole(tmp_path: Path) -> None:
    """Given back, the robot raises the bar out of the hole and comes home with it in its hooks."""
    hand = Hand(WORKS["bar-insertion"], "insert", "pilot")
    result = fly("bar-insertion", hand, tmp_path / "run")
    away, passed = judge("pilot", hand, result)
    assert passed, (result.outcome, result.reason, away)
    assert "the pilot took over in insert" in result.reason
    s = result.samples
    bar = s["object0_p_WO"]
    retract = next(p for p in result.phases if p.name == "retract")
    raised = bar[(s["t"] >= retract.start_s) & (s["t"] < retract.end_s)]
    assert raised[-1, 2] - raised[0, 2] > 0.05  # straight up, out of the hole
    assert np.linalg.norm(raised[-1, :2] - raised[0, :2]) < 0.02
    back = (s["t"] > hand.at) & (bar[:, 2] > 0.15)
    for side in ("left", "right"):  # half of the bar weighs 2 N
        assert np.max(np.linalg.norm(s[f"{side}_f_W"][back], axis=1)) < 6.0
    touched = np.abs(s["f_collision"]) > 0.0
    assert not np.any(touched & (bar[:, 2] > 0.15))  # the ground alone, as the bar is set down


def test_a_fence_is_put_where_the_way_to_work_does_not_cross_it() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    p = np.zeros((len(t), 3))
    p[:, 1] = np.minimum(t, 5.0)  # it works at y = 5
    samples = np.zeros(len(t), [("t", float), ("p_WB", float, 3)])
    samples["t"], samples["p_WB"] = t, p
    plain = type("Plain", (), {"samples": samples})()
    sets = operated_faults.find_sets("bar-insertion", "fence", 8.0, plain)
    assert sets[0] == f"mission.fence.y_max_m={5.0 + operated_faults.FENCE_M!r}"
    force = next(float(x.split("=")[1]) for x in sets if "force_y_n" in x)
    assert force == pytest.approx(3.5 * 6.6)
    assert operated_faults.find_sets("bar-insertion", "silent", 8.0, plain) == ()
