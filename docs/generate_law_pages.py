"""Write the pages of the control laws, docs/laws/NAME.md: `python docs/generate_law_pages.py`.

A page is the text of the law's module, where its equations and their sources stand, what the law
requires, and its keys.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from pathlib import Path
from typing import Any

from skywright.core.find import find, list_kinds

DOCS = Path(__file__).parent
FOLDER = DOCS / "laws"
DISPLAYED = re.compile(r"(?<=\n\n)((?:    .*\n)+)")


def tell_text(cls: type) -> str:
    """Return the module's text; displayed equations become blocks."""
    module = inspect.getsource(sys.modules[cls.__module__])
    text = ast.get_docstring(ast.parse(module)) or ""
    first, _, rest = text.partition("\n")
    body = DISPLAYED.sub(lambda m: "```text\n" + inspect.cleandoc(m[1]) + "\n```\n", rest + "\n")
    own = inspect.cleandoc(cls.__doc__ or "")
    return f"{first}\n\n{body.strip()}".strip() + f"\n\nThe command: {own[0].lower()}{own[1:]}"


def list_requirements(cls: Any) -> list[str]:
    """Return what a robot needs for the law."""
    out = []
    if cls.needs_full_actuation:
        out.append("a fully actuated platform")
    if cls.commands_torque:
        out.append('servos with `mode = "torque"`')
    if cls.presses_with_arm:
        out.append("for force control with the arm: a probe that measures its force")
    return out


def tell_value(value: object) -> str:
    """A default as a mission file writes it; a dash for one that follows from others."""
    return "–" if value is None else f"`{value}`"


def build_page(name: str) -> str:
    """Return the page of a law."""
    cls = find("law", name).cls
    lines = [f"# `{name}`", "", tell_text(cls), ""]
    needs = list_requirements(cls)
    if needs:
        lines += [f"Requires: {'; '.join(needs)}.", ""]
    fields = cls.Table.model_fields
    if fields:
        lines += [
            f"Keys of `[mission.law]` with `kind = \"{name}\"`. A dash marks a default that is "
            "computed from the robot file ([meanings](../reference/keys.md)).", "",
            "| key | default |", "|---|---|",
        ]  # fmt: skip
        lines += [f"| `{key}` | {tell_value(field.default)} |" for key, field in fields.items()]
        lines.append("")
    lines.append(
        "[Select a law](../howto/your-own-control-law.md) · "
        "[Compare laws](../howto/compare-laws.md) · [Measured comparison](../reference/laws.md)"
    )
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Write all pages."""
    FOLDER.mkdir(exist_ok=True)
    for name in list_kinds("law"):
        (FOLDER / f"{name.replace('_', '-')}.md").write_text(build_page(name), encoding="utf-8")


if __name__ == "__main__":
    main()
