"""A second robot flies the weld scan: the tilted F550 with the OTHex's arm below its propellers."""

from __future__ import annotations

import pytest

from exact_map import EXACT
from skywright.description.loader import load_description
from skywright.run.backends import build_vehicle
from skywright.run.run import fly_and_evaluate


@pytest.mark.parametrize("sets", [(), ("world.pipe.diameter_m=0.3", "world.wind.mean_mps=2")])
def test_it_finds_the_weld_on_each_of_two_passes(sets: tuple[str, ...]) -> None:
    short = [*EXACT, "mission.task.passes=2", "mission.task.pass_length_m=0.1",
             "mission.timestep_ms=2"]  # fmt: skip
    d = load_description("pipe-weld-scan", "f550-scan", sets=[*short, *sets], seed=2)
    result = fly_and_evaluate(d)
    assert result.outcome == "succeeded", result.reason
    assert result.metrics["weld.crossings"] == 2.0
    assert result.metrics["force.min_n"] > 1.0 and result.metrics["force.max_n"] < 3.5


def test_its_propellers_turn_so_that_the_reaction_helps_the_heading_loop() -> None:
    """With the spin of the paper's F550 the loop is too soft to hold a tip that friction holds."""
    paper = "robot.rotors.spin=" + str(["ccw", "cw"] * 3).replace("'", '"')
    for sets, heading in (((), 14.0), ((paper,), 5.0)):
        d = load_description("pipe-weld-scan", "f550-scan", sets=sets)
        gains = build_vehicle(d).read_memory("law")["wn_R"]
        assert gains.tolist() == pytest.approx([14.0, 14.0, heading], abs=0.1)
