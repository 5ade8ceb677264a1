"""Write the tables that modules of skywright.evidence print: `python docs/generate_evidence.py`.

They come from benchmarks/evidence, which `python benchmarks/print_evidence.py` wrote, and replace
what is between the markers of the pages.
"""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).parent
KEPT = DOCS.parent / "benchmarks" / "evidence"
PAGES = (
    "papers/suarez-2020.md", "papers/caballero-2018.md", "howto/identify.md",
    "howto/estimator-and-link.md",
)  # fmt: skip
PLACE = re.compile(
    r"(<!-- evidence ([\w-]+): begin[^>]*-->\n\n).*?(\n\n<!-- evidence: end -->)", re.S
)


def read_table(name: str) -> str:
    """Return the lines of the table, and where it comes from."""
    lines = (KEPT / f"{name}.md").read_text(encoding="utf-8").splitlines()
    command, _, made = lines[0].removeprefix("<!-- ").removesuffix(" -->").partition("; ")
    table = "\n".join(line for line in lines if line.startswith("|"))
    return f"{table}\n\nMade by `{command}`, {made}."


def build_page(text: str) -> str:
    """Return a page with its tables made anew."""
    return PLACE.sub(lambda m: m[1] + read_table(m[2]) + m[3], text)


if __name__ == "__main__":
    for page in PAGES:
        path = DOCS / page
        path.write_text(build_page(path.read_text(encoding="utf-8")), encoding="utf-8")
