"""Numbers in sentences of pages are those of results or of the code: docs/numbers.toml."""

from __future__ import annotations

import csv
import importlib
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
NUMBERS = tomllib.loads((ROOT / "docs" / "numbers.toml").read_text(encoding="utf-8"))["number"]


def read_names(number: dict[str, str]) -> dict[str, Any]:
    """What the expression of a number may use: rows of a file of results, or a module's names."""
    if "module" in number:
        return dict(vars(importlib.import_module(number["module"])))
    with (ROOT / number["file"]).open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows
    return {"rows": rows}


@pytest.mark.parametrize("number", NUMBERS, ids=lambda n: f"{n['page']}: {n['says']}")
def test_a_number_of_a_page_is_that_of_its_origin(number: dict[str, str]) -> None:
    said = number["says"].format(eval(number["value"], read_names(number)))
    assert said in (ROOT / "docs" / number["page"]).read_text(encoding="utf-8")
