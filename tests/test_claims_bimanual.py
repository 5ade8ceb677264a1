"""Measures of the claims of Suarez 2020 that need no flight, against closed forms."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import skywright
from skywright.analysis.compare.table import build_rows, judge_statements
from skywright.evidence.reproduce.cache import FLIGHTS, Record
from skywright.evidence.reproduce.flights import FLIGHTS as KINDS
from skywright.evidence.reproduce.flights_arms import load_arms
from skywright.evidence.reproduce.load import load_claims
from skywright.evidence.reproduce.measures import MEASURES
from skywright.evidence.reproduce.measures_bimanual import judge_statement, load_sides
from skywright.evidence.reproduce.measures_bimanual_flown import measure_lean
from skywright.evidence.reproduce.spec import judge

FILE = load_claims("suarez-2020")


@pytest.mark.parametrize(
    "measure", ["reaction", "recoil", "direction", "shoulder", "stiffness", "arm_motion"]
)
def test_every_number_that_a_claim_tells_is_measured(measure: str) -> None:
    found = MEASURES[measure]({})
    for claim in (c for c in FILE.claims if c.measure == measure):
        told = re.findall(r"{(\w+)", claim.why.reproduced + claim.why.contradicted)
        assert {*told, *(t.quantity for t in claim.tests)} <= set(found.values), claim.id
        assert judge(claim, found.values).name in ("reproduced", "contradicted")
    assert found.figure is not None and all(math.isfinite(v) for v in found.values.values())


def test_reaction_has_the_levers_of_the_geometry() -> None:
    v = MEASURES["reaction"]({}).values
    p = load_arms("bimanual").hand(load_arms("bimanual").q)[0]
    assert v["near_pitch_nm"] == pytest.approx(2.0 * -p[2])
    assert v["far_pitch_nm"] == pytest.approx(2.0 * v["hinge_m"])
    assert v["shoulder_nm"] == pytest.approx(2.0 * 0.25, rel=1e-3)  # upper arm hangs: its length
    # weight and push meet at the joint: their resultant's line is near the link's
    assert v["whole_deg"] < v["change_deg"]


def test_stiffness_along_the_straight_arm_grows_with_the_square_of_the_bend() -> None:
    """The lever of the elbow along the arm is sin(bend / 2) of it: K goes with 1 / bend^2."""
    v = MEASURES["stiffness"]({}).values
    assert v["straight_n_per_m"] / v["ten_n_per_m"] == pytest.approx(100.0, rel=0.02)


def test_the_links_angle_tells_the_force_that_turned_it() -> None:
    arms = load_arms("bimanual-longreach")
    forces, rows = [0.0, 1.0, 2.0, 3.0], []
    for f in forces:
        found = arms.compute_reaction(np.array([-f, 0.0, 0.0]))
        assert found is not None
        q = arms.q.copy()
        q[0] += found.swing
        rows.append(q)
    record = Record({"forces_n": forces}, {"q": np.array(rows), "goal": arms.q})
    v = measure_lean({"pull": [record]}).values
    assert v["error_n"] < 1e-6 and v["angle_error_deg"] < 1e-6
    rows[2][0] += math.radians(1.0)  # about 18 N of weight at 0.8 m below the joint
    record = Record({"forces_n": forces}, {"q": np.array(rows), "goal": arms.q})
    v = measure_lean({"pull": [record]}).values
    assert 0.15 < v["error_n"] < 0.35


def test_what_decides_a_flight_is_in_its_cache_key() -> None:
    root = Path(skywright.__file__).parent
    assert all((root / name).is_file() for name in FLIGHTS)
    assert {case.kind for case in FILE.cases.values()} <= set(KINDS)


def test_reproduce_and_compare_judge_table_3_alike() -> None:
    """The verdicts of `skywright compare` are the claims' own: one judge for both."""
    sides = load_sides()
    told = {s.text: s.verdict for s in judge_statements(sides, build_rows(*sides))}
    names = {"controllability": "more controllable", "narrow_access": "access to narrow places",
             "weight": "heavier", "take_off": "harder take-off and landing"}  # fmt: skip
    for measure, text in names.items():
        found = MEASURES[measure]({}).values
        claim = next(c for c in FILE.claims if c.measure == measure)
        expected = "reproduced" if told[text] == "holds" else "contradicted"
        assert judge(claim, found).name == expected, text
    assert told["ground and airflow effects near surfaces"] == "not measured"
    assert judge_statement("safer", {"impact.peak_torque_nm": (3.0, 1.0)}) == 0.5
    assert judge_statement("heavier") == 1.0


def test_the_printed_flight_times_hold_together_near_the_printed_payload() -> None:
    """Induced power goes with the mass to the 3/2: half of the time at 1.59 times the mass."""
    v = MEASURES["platform_table"]({}).values
    scale = ((v["empty_kg"] + 3.0) / v["empty_kg"]) ** 1.5
    assert v["empty_min"] / v["loaded_min"] == pytest.approx(scale, rel=0.03)
    assert scale == pytest.approx(2.0, rel=0.05)


def test_a_joint_in_the_centre_passes_no_pitch_torque_on() -> None:
    assert MEASURES["reaction"]({}).values["centred"] < 1e-6
