"""Write the tables of docs/reference/mutants.md: `python docs/generate_mutants.py`.

benchmarks/mutants.csv is what `scripts/mutants.py` (`make evidence`) wrote.
"""

import csv
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "reference" / "mutants.md"
RESULTS = DOCS.parent / "benchmarks" / "mutants.csv"
BEGIN = "<!-- mutants: begin, made by docs/generate_mutants.py, do not edit -->"
END = "<!-- mutants: end -->"


def build_tables() -> str:
    """The share of each group that is killed, and each survivor with its reason."""
    with RESULTS.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    lines = ["| code | mutants | killed | survived |", "|---|---|---|---|"]
    for name in [*dict.fromkeys(r["group"] for r in rows), ""]:
        group = [r for r in rows if name in ("", r["group"])]
        killed = sum(r["result"] == "killed" for r in group)
        share = f"{killed} ({100.0 * killed / len(group):.0f} %)"
        lines.append(f"| {name or 'all'} | {len(group)} | {share} | {len(group) - killed} |")
    lines += ["", "| survivor | change | reason |", "|---|---|---|"]
    for r in rows:
        if r["result"] == "survived":
            file = r["file"].removeprefix("src/skywright/")
            change = f"`{r['before']}` → `{r['after']}`".replace("|", "\\|")
            lines.append(f"| {file}:{r['line']} | {change} | {r['reason']} |")
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its tables replaced."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n\n{build_tables()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
