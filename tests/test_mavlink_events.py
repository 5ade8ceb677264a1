"""Events of missions over MAVLink: what the committed table says, and one flight of it."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from mavlink_events import EVENTS, KEPT, MOMENTS, TOUCH_DOWN, fly, judge

import skywright
from short_mission import write_short


def test_every_event_of_the_table_ended_by_its_rule() -> None:
    with KEPT.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(r["moment"], r["event"]) for r in rows] == [(m, e) for m in MOMENTS for e in EVENTS]
    assert [r for r in rows if r["passed"] != "True"] == []


def test_a_pilot_who_gives_back_while_the_autopilot_lands_is_landed(tmp_path: Path) -> None:
    """The pilot's mode wins; the landing is asked for again when the pilot has given back."""
    backend = skywright.build_vehicle(write_short(tmp_path))
    row = judge(*fly(tmp_path, backend, backend.save(), TOUCH_DOWN, "pilot"))
    assert row.passed, row
