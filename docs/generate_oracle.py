"""Write the table of docs/howto/trust-a-verdict.md: `python docs/generate_oracle.py`.

Each file of benchmarks/oracle is what `benchmarks/oracle.py --table` wrote of one campaign, each of
benchmarks/oracle/fresh the same of requests that were drawn later with another seed, and each of
benchmarks/oracle/refused what `benchmarks/oracle_refusals.py --table` wrote.
"""

import csv
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "trust-a-verdict.md"
TABLES = DOCS.parent / "benchmarks" / "oracle"
BEGIN = "<!-- oracle: begin, made by docs/generate_oracle.py, do not edit -->"
END = "<!-- oracle: end -->"


def build_table(folder: Path) -> str:
    """One line a mission: what was asked, flown, done, and how many verdicts are right."""
    lines = [
        "| mission | requests | refused | flown | of these met | verdict right | first wrong one |",
        "|---|---|---|---|---|---|---|",
    ]
    for path in sorted(folder.glob("*.csv")):
        with path.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        flown = [r for r in rows if r["outcome"] != "refused"]
        met = sum(r["met"] == "True" for r in flown)
        wrong = [r for r in flown if r["right"] != "True"]
        share = 100.0 * (1.0 - len(wrong) / len(flown)) if flown else 0.0
        first = (
            f"row {int(wrong[0]['run'])}: {wrong[0]['why'] or wrong[0]['told']}" if wrong else ""
        )
        lines.append(
            f"| `{path.stem}` | {len(rows)} | {len(rows) - len(flown)} | {len(flown)} | {met} "
            f"| {len(flown) - len(wrong)} ({share:.0f} %) | {first} |"
        )
    return "\n".join(lines)


def build_refusals() -> str:
    """One line a mission: how its refused requests ended with the margins set aside."""
    lines = ["| mission | refusals flown | limit | right | careful |", "|---|---|---|---|---|"]
    for path in sorted((TABLES / "refused").glob("*.csv")):
        with path.open(encoding="utf-8") as file:
            ended = [r["ended"] for r in csv.DictReader(file)]
        counts = " | ".join(str(ended.count(k)) for k in ("limit", "right", "careful"))
        lines.append(f"| `{path.stem}` | {len(ended)} | {counts} |")
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its tables replaced."""
    tables = {
        "oracle": build_table(TABLES),
        "fresh": build_table(TABLES / "fresh"),
        "refusals": build_refusals(),
    }
    for name, table in tables.items():
        begin, end = BEGIN.replace("oracle:", f"{name}:"), END.replace("oracle:", f"{name}:")
        before, rest = text.split(begin)
        text = f"{before}{begin}\n\n{table}\n\n{end}{rest.split(end)[1]}"
    return text


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
