"""The pages of the control laws are those of their modules."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from skywright.core.find import list_kinds

DOCS = Path(__file__).parents[1] / "docs"


def test_each_law_has_its_page_and_its_place_in_the_navigation() -> None:
    spec = importlib.util.spec_from_file_location("pages", DOCS / "generate_law_pages.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    nav = (DOCS.parent / "mkdocs.yml").read_text(encoding="utf-8")
    names = [name.replace("_", "-") for name in list_kinds("law")]
    assert sorted(p.stem for p in (DOCS / "laws").glob("*.md")) == sorted(names)
    for kind, name in zip(list_kinds("law"), names, strict=True):
        text = (DOCS / "laws" / f"{name}.md").read_text(encoding="utf-8")
        assert text == module.build_page(kind), "run: python docs/generate_law_pages.py"
        assert f"laws/{name}.md" in nav
