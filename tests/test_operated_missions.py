"""An operator brings a peg into a hole."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import skywright
from skywright.ground.operator_model import ModelOperator
from skywright.missions.skills.operated import LONGEST_S, Lead, OperatorGone
from skywright.run.operator import Sight, Stick, load_recording, write_recording
from skywright.run.run import run_mission
from skywright.vehicle.plant import MISSION_TICK

SIGHT = Sight(np.zeros(3), False)


@pytest.mark.parametrize(("manner", "seed"), [("careful", 18), ("hasty", 1)])
def test_an_operator_brings_the_peg_into_the_hole(tmp_path: Path, manner: str, seed: int) -> None:
    """Without a swing about the hole, which once grew to 7 cm, and without hooks that slip."""
    d = skywright.load("bar-insertion", sets=(f"mission.seed={seed}", "mission.timestep_ms=2"))
    result = skywright.run(d, operator=f"model:{manner}", report=False, out=tmp_path / "run")
    assert result.outcome == "succeeded", result.reason
    names = [p.name for p in result.phases]
    assert "insert" in names and names[names.index("insert") + 1] == "set free"
    assert result.metrics["operator.force_max_n"] < 8.0
    assert result.metrics["operator.time_s"] < 40.0
    align = next(p for p in result.phases if p.name == "align")
    s = result.samples
    late = (s["t"] > align.start_s + 5.0) & (s["t"] < align.end_s)
    assert not np.any(late) or np.max(np.ptp(s["p_WB"][late, :2], axis=0)) < 0.03


class _Sticks:
    """Plays back what it is given; then nobody is there."""

    def __init__(self, sticks: list[Stick]) -> None:
        self.sticks = sticks

    def read(self, t: float, sight: Sight) -> Stick | None:
        k = round(t / MISSION_TICK)
        return self.sticks[k] if k < len(self.sticks) else None


def _build_lead(sticks: list[Stick]) -> tuple[Lead, list[Any]]:
    shown: list[Any] = []
    vehicle = SimpleNamespace(set_stick=lambda axes, button: shown.append((tuple(axes), button)))
    s: Any = SimpleNamespace(sticks=[], stretches=[], vehicle=vehicle)
    return Lead(s, _Sticks(sticks)), shown


def test_an_operator_who_leaves_is_told_of_at_once() -> None:
    lead, _ = _build_lead([Stick(np.ones(3), False)] * 3)
    for _ in range(3):
        lead.read(SIGHT)
    with pytest.raises(OperatorGone, match="input ended"):
        lead.read(SIGHT)
    assert [t for t, _ in lead.s.sticks] == pytest.approx([0.0, MISSION_TICK, 2 * MISSION_TICK])


def test_a_button_held_at_the_end_of_a_recording_stays_held_for_a_while() -> None:
    lead, shown = _build_lead([Stick(np.ones(3), True)])
    for _ in range(100):
        assert lead.read(SIGHT).button
    assert shown[0] == ((1.0, 1.0, 1.0), True) and shown[-1] == ((0.0, 0.0, 0.0), True)
    with pytest.raises(OperatorGone):
        for _ in range(200):
            lead.read(SIGHT)


def test_the_input_of_an_absent_operator_is_recorded_without_a_gap(tmp_path: Path) -> None:
    """The button was pressed, then nobody was there for 1 s, then the next stretch began."""
    lead, shown = _build_lead([Stick(np.ones(3), True)])
    for _ in range(50):
        lead.read(SIGHT)
    lead.begin()
    lead._operator = _Sticks([Stick(np.zeros(3), False)] * 100)
    for _ in range(10):
        lead.read(SIGHT)
    write_recording(tmp_path / "o.csv", lead.s.sticks, 0.03, [0.0, *lead.s.stretches])
    found = load_recording(tmp_path / "o.csv")
    assert [(tuple(axes), bool(b)) for axes, b in zip(found.axes, found.button, strict=True)] == [
        (axes, button) for axes, button in shown
    ]


def test_a_stretch_of_work_has_an_end_and_the_next_one_its_own() -> None:
    lead, _ = _build_lead([Stick(np.zeros(3), False)] * 30_000)
    n = round(LONGEST_S / MISSION_TICK)
    for _ in range(n - 10):
        lead.read(SIGHT)
    lead.begin()
    for _ in range(n):
        lead.read(SIGHT)
    with pytest.raises(OperatorGone, match="more than 180 s"):
        for _ in range(5):
            lead.read(SIGHT)


def test_an_operator_presses_the_probe_on_a_wall(tmp_path: Path) -> None:
    """In flight: the stick leads the tip, then the force; the robot measures while it holds it."""
    sets = (
        "mission.task.survey=false", "mission.task.hold_s=2", "plant.map_error_m=0",
        "plant.map_error_deg=0",
    )  # fmt: skip
    result = run_mission(
        skywright.load("wall-contact", sets=sets),
        out=tmp_path / "run", operator=ModelOperator("careful", 3, 0.03),
    )  # fmt: skip
    names = [p.name for p in result.phases]
    assert result.outcome == "succeeded", (result.reason, names)
    held = next(p for p in result.phases if p.name.startswith("free hold"))
    assert names.index("free touch") < names.index("free press") < names.index(held.name)
    assert not any("slide" in n for n in names) and "slide.no_force_max_s" in result.waived
    s = result.samples
    during = (s["t"] > held.start_s + 0.5) & (s["t"] < held.end_s)
    force = np.linalg.norm(s["f_contact"][during], axis=1)
    assert abs(np.mean(force) - 3.0) < 0.4 * 3.0  # of the largest of forces_n
    assert result.metrics["press.place_error_mm"] < 30.0
    by_hand = (s["phase"] == names.index("free touch")) & (np.abs(s["operator_stick"]).max(1) > 0)
    assert np.any(by_hand) and (tmp_path / "run" / "operator.csv").is_file()
