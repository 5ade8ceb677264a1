"""Write the tables in docs/howto/faults.md from the rules and the faults.

python docs/generate_faults.py     (a test holds the page equal to it)
"""

from __future__ import annotations

import inspect
from pathlib import Path

from skywright.core.find import find, list_kinds
from skywright.run.faults._rule import RESPONSES

PAGE = Path(__file__).parent / "howto" / "faults.md"
TABLES = ("rules", "responses", "faults")


def list_rules() -> list[str]:
    """One row a rule."""
    rows = [
        "| rule | watches | limit | for | response | why this limit |",
        "|---|---|---|---|---|---|",
    ]
    for kind in list_kinds("rule"):
        rule = find("rule", kind).cls
        t = rule.Table()
        limit = f"{t.limit:g} {rule.unit}".strip()
        rows.append(
            f"| `{kind}` | {rule.watches} | {limit} | {t.hold_s:g} s | `{t.response}` | "
            f"{rule.source} |"
        )
    return rows


def list_responses() -> list[str]:
    """One row a response."""
    return ["| response | what is flown |", "|---|---|"] + [
        f"| `{name}` | {says} |" for name, says in RESPONSES.items()
    ]


def list_faults() -> list[str]:
    """One row a fault."""
    rows = ["| kind | what happens | keys and defaults |", "|---|---|---|"]
    for kind in list_kinds("fault"):
        cls = find("fault", kind).cls
        keys = ", ".join(
            f"`{name} = {'[]' if f.default == [] else f.default}`"
            for name, f in cls.Table.model_fields.items()
        )
        rows.append(f"| `{kind}` | {(inspect.getdoc(cls) or '').splitlines()[0]} | {keys} |")
    return rows


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    for name, make in zip(TABLES, (list_rules, list_responses, list_faults), strict=True):
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
        head, rest = text.split(begin)
        text = head + begin + "\n" + "\n".join(make()) + "\n\n" + end + rest.split(end)[1]
    return text


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
