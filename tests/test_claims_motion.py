"""Measures of Caballero 2018 on planning: small cases of what the claims rest on."""

from __future__ import annotations

import pytest

from skywright.evidence.reproduce import measures_motion
from skywright.evidence.reproduce.load import load_claims
from skywright.evidence.reproduce.spec import judge

CLAIMS = {c.id: c for c in load_claims("caballero-2018").claims}


def test_only_joint_planning_passes_below_the_ceiling(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measures_motion, "SCENARIOS", {"paper": (None, 0.0)})
    monkeypatch.setattr(measures_motion, "SEEDS", 1)
    monkeypatch.setattr(measures_motion, "SHORT_S", 0.3)
    found = measures_motion.measure_joint_planning({}).values
    assert (found["joint"], found["decoupled"], found["decoupled_high"]) == (1.0, 0.0, 1.0)
    # by construction: met, and not counted as reproduced
    assert judge(CLAIMS["joint-planning"], found) == ("not_comparable", [True, True, None])
    assert judge(CLAIMS["joint-planning"], found | {"joint": 0.9}).name == "contradicted"


def test_the_bar_fits_through_the_lower_opening_only() -> None:
    found = measures_motion.measure_lower_gap({}).values
    assert found["upper_m"] < found["needs_m"] < found["lower_m"]
    assert found["reserve_mm"] >= 0.0
    assert judge(CLAIMS["lower-part"], found) == ("not_comparable", [True, True, True])


def test_a_planner_without_a_path_is_not_compared() -> None:
    assert judge(CLAIMS["optimality"], {"found": 0.0, "ours_gap": 0.01}).name == "not_comparable"
