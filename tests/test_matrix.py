"""The page of robots and missions: complete, and as plans and flights of quick pairs answer."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

from skywright.description.loader import list_missions
from skywright.description.robot.loader import list_robots

SCRIPT = Path(__file__).parents[1] / "docs" / "generate_matrix.py"


def load_script() -> Any:
    spec = importlib.util.spec_from_file_location("generate_matrix", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


MATRIX = load_script()
FLOWN = ("succeeded", "failed", "aborted")


def read_rows(section: str) -> dict[str, tuple[str, str]]:
    rows = [
        line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| `")
    ]
    return {row[0].strip("`"): (row[1].strip("*"), " | ".join(row[2:])) for row in rows}


def test_every_pair_has_an_answer_and_every_refusal_a_reason() -> None:
    sections = MATRIX.read_sections(MATRIX.PAGE.read_text("utf-8"))
    assert list(sections) == [entry.name for entry in list_robots()]
    for robot, section in sections.items():
        rows = read_rows(section)
        assert set(rows) == {entry.name for entry in list_missions()}, robot
        for mission, (verdict, reason) in rows.items():
            assert verdict in (*FLOWN, "no plan", "refused", "not decided"), (robot, mission)
            assert (verdict == "succeeded") == (reason == "-"), (robot, mission)


@pytest.mark.parametrize(
    ("robot", "mission"),
    [("hexarotor", "pipe-weld-scan"), ("omnicopter", "bar-transport"), ("othex", "sensor-install"),
     ("tilthex-arm", "arm-test-bench"), ("bimanual", "crack-scan")],
)  # fmt: skip
def test_the_page_says_what_planning_says(robot: str, mission: str) -> None:
    rows = read_rows(MATRIX.read_sections(MATRIX.PAGE.read_text("utf-8"))[robot])
    verdict, reason = MATRIX.judge(robot, mission)
    assert rows[mission] == (verdict, MATRIX.shorten(reason) or "-")


def test_the_page_says_what_a_flight_gives() -> None:
    """A pair that flies is short enough to fly here; the rest of the page is made by the script."""
    rows = read_rows(MATRIX.read_sections(MATRIX.PAGE.read_text("utf-8"))["hexarotor"])
    assert rows["follow-plan"] == ("succeeded", "-")
    assert MATRIX.judge("hexarotor", "follow-plan") == ("succeeded", "")


def test_reasons_fit_into_a_cell() -> None:
    assert MATRIX.shorten("a | b\n  c") == "a \\| b c"
    assert len(MATRIX.shorten("word " * 100)) <= MATRIX.LONGEST + 4
