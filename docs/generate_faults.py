"""Write the tables in docs/howto/faults.md from the rules and the faults.

python docs/generate_faults.py     (a test holds the page equal to it)
"""

from __future__ import annotations

import csv
import inspect
from pathlib import Path

from skywright.core.find import find, list_kinds
from skywright.run.faults._rule import RESPONSES

JUDGED = Path(__file__).parents[1] / "benchmarks" / "faults-judged.csv"
PAGE = Path(__file__).parent / "howto" / "faults.md"
TABLES = ("rules", "responses", "faults", "judged")


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


def list_judged() -> list[str]:
    """Count the flights of benchmarks/faults-judged.csv, a row a kind of fault, and list failures.

    `sensor=localisation` and the like are one kind.
    """
    if not JUDGED.exists():
        return ["No flight has been judged yet."]
    with JUDGED.open(encoding="utf-8", newline="") as file:
        flights = list(csv.DictReader(file))
    missions = sorted({f["mission"] for f in flights})
    kinds = sorted({f["fault"].split()[0] for f in flights})

    def count(chosen: list[dict[str, str]]) -> str:
        good = sum(f["passed"] == "True" for f in chosen)
        return f"{good} of {len(chosen)}" if chosen else "-"

    rows = ["| fault | " + " | ".join(f"`{m}`" for m in missions) + " | all |"]
    rows.append("|---|" + "---|" * (len(missions) + 1))
    for kind in [*kinds, ""]:
        mine = [f for f in flights if kind in ("", f["fault"].split()[0])]
        cells = [count([f for f in mine if f["mission"] == m]) for m in missions]
        rows.append(" | ".join([f"| {kind or 'all'}", *cells, f"{count(mine)} |"]))
    ended = sum(f["rule"] != "-" for f in flights)
    own = [f for f in flights if int(f["own"]) > 0]
    strict = sum(f["passed"] == "True" and f not in own for f in flights)
    before = [f for f in flights if int(f["before"] or 0) > 0]
    later = [f for f in flights if int(f["later"] or 0) > 0]
    told = "fell" in flights[0]  # not by the judge of older tables
    fell = [f for f in flights if told and int(f["fell"]) > 0]
    calm = [f for f in flights if f["passed"] == "True" and f not in later]
    rows += [
        "",
        f"A rule ended {ended} of the {len(flights)} flights. In {len(own)} the robot touched "
        "itself or its load after that"
        + (f", with {max(float(f['own_n']) for f in own):.0f} N at most" if own else "")
        + f". With these contacts counted as collisions, {strict} flights pass. A first collision, "
        f"which is allowed, began in {len(before)} before a rule acted, or without one, and in "
        f"{len(later)} after it; with none allowed after it, {len(calm)} flights pass."
        + (f" In {len(fell)} the robot fell onto something else than the ground." if told else ""),
    ]
    rows += [""] if own else []
    for f in own:
        when = f"{f['fault'].split(' jump')[0]} at {float(f['start_s']):g} s"
        rows.append(
            f"- `{f['mission']}` {int(f['run'])} ({when}): touched itself or its load "
            f"{f['own']} times, {float(f['own_n']):.0f} N"
        )
    bad = [f for f in flights if f["passed"] != "True"]
    if bad:
        rows += ["", "These flights did not pass:", ""]
    for f in bad:
        hits = int(f["before"] or 0) + int(f["later"] or 0)
        why = [f"{hits} collision{'s' * (hits > 1)}"] * (hits > 0)
        why += ["not down"] * (f["is_down"] != "True")
        what = ", ".join(why or ["no reason"])
        when = f"{f['fault']} at {float(f['start_s']):g} s"
        rows.append(f"- `{f['mission']}` {int(f['run'])} ({when}): {what}")
    return rows


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    makers = (list_rules, list_responses, list_faults, list_judged)
    for name, make in zip(TABLES, makers, strict=True):
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
        head, rest = text.split(begin)
        text = head + begin + "\n" + "\n".join(make()) + "\n\n" + end + rest.split(end)[1]
    return text


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
