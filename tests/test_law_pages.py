"""The pages of the control laws are those of their modules."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from skywright.core.find import list_kinds

DOCS = Path(__file__).parents[1] / "docs"


def load_generator(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_each_law_has_its_page_and_its_place_in_the_navigation() -> None:
    module = load_generator("generate_law_pages")
    nav = (DOCS.parent / "mkdocs.yml").read_text(encoding="utf-8")
    names = [name.replace("_", "-") for name in list_kinds("law")]
    assert sorted(p.stem for p in (DOCS / "laws").glob("*.md")) == sorted(names)
    for kind, name in zip(list_kinds("law"), names, strict=True):
        text = (DOCS / "laws" / f"{name}.md").read_text(encoding="utf-8")
        assert text == module.build_page(kind), "run: python docs/generate_law_pages.py"
        assert f"laws/{name}.md" in nav


def test_a_cell_of_the_matrix_is_the_newest_flight_and_its_commit_is_told() -> None:
    module = load_generator("generate_laws")

    def build(name: str, when: str, flown: dict[str, tuple[int, int, str]]) -> dict[str, Any]:
        return {
            "name": name, "mission": "m", "robot": "r", "when": when, "commit": f"c-{name}",
            "changed": [], "laws": module.ALL if name == "all" else list(flown),
            "flown": [
                {"law": law, "case": "nominal", "succeeded": k, "runs": n, "refused": why}
                for law, (k, n, why) in flown.items()
            ],
        }  # fmt: skip

    old = build("old", "2026-11-24", {"a": (10, 10, ""), "b": (9, 10, ""), "c": (8, 10, "")})
    new = build(
        "all",
        "2026-11-26",
        {"a": (3, 3, ""), "b": (0, 0, ""), "c": (0, 3, "LAW no"), "d": (0, 0, "")},
    )
    text = module.build_matrix([old, new], module.Refusals())
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert rows[:4] == [
        "| `a` | 3 of 3 |",
        "| `b` | 9 of 10 |",
        "| `c` | refused (a) |",
        "| `d` | not flown |",
    ]
    assert rows[4:] == [
        "| `m`, `r` | `all` | `c-all` | 2026-11-26 | `a`, `c`, `d` |",
        "| `m`, `r` | `old` | `c-old` | 2026-11-24 | `b` |",
    ]
    same_day = [old | {"when": new["when"]}, new]
    assert module.choose_cells(same_day)["a", "`m`, `r`"][1]["runs"] == 10
