"""Numbers that pages take from committed results are those of the results: docs/numbers.toml."""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
NUMBERS = tomllib.loads((ROOT / "docs" / "numbers.toml").read_text(encoding="utf-8"))["number"]


@pytest.mark.parametrize("number", NUMBERS, ids=lambda n: f"{n['page']}: {n['says']}")
def test_a_number_of_a_page_is_that_of_its_results(number: dict[str, str]) -> None:
    with (ROOT / number["file"]).open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows
    said = number["says"].format(eval(number["value"], {"rows": rows}))
    assert said in (ROOT / "docs" / number["page"]).read_text(encoding="utf-8")
