"""Numbers in sentences of pages are those of results or of the code: docs/numbers.toml."""

from __future__ import annotations

import csv
import importlib
import json
import re
import tomllib
from functools import partial
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
NUMBERS = tomllib.loads((ROOT / "docs" / "numbers.toml").read_text(encoding="utf-8"))["number"]


def read_names(number: dict[str, str]) -> dict[str, Any]:
    """Return what an expression may use: the content of a file of results, or a module's names."""
    if "module" in number:
        return dict(vars(importlib.import_module(number["module"])))
    path = ROOT / number["file"]
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return {"found": json.loads(text)}
    if path.suffix not in (".csv", ".jsonl"):
        find = partial(re.search, string=text, flags=re.S | re.M)
        return {"text": text, "find": lambda pattern: find(pattern).groups()}  # type: ignore[union-attr]
    lines = text.splitlines()
    rows = [json.loads(x) for x in lines] if path.suffix == ".jsonl" else [*csv.DictReader(lines)]
    assert rows
    return {"rows": rows}


@pytest.mark.parametrize("number", NUMBERS, ids=lambda n: f"{n['page']}: {n['says']}")
def test_a_number_of_a_page_is_that_of_its_origin(number: dict[str, str]) -> None:
    said = number["says"].format(eval(number["value"], read_names(number)))
    assert said in (ROOT / "docs" / number["page"]).read_text(encoding="utf-8")
