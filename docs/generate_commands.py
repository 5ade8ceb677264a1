"""Write the tables in docs/reference/vehicle.md from the table of commands.

python docs/generate_commands.py     (a test holds the page equal to it)
"""

from __future__ import annotations

from pathlib import Path

from skywright.vehicle.arm_commands import ARM_STREAMS, ARM_TABLE
from skywright.vehicle.commands import NEEDS, TABLE, State

PAGE = Path(__file__).parent / "reference" / "vehicle.md"
TABLES = ("commands", "arm commands", "needs")


def list_commands() -> list[str]:
    """One row a command."""
    rows = [
        "| command | does | accepted in | state meanwhile | state after | interrupts | requires |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for command, entry in TABLE.items():
        states = "every state" if set(entry.states) == set(State) else ", ".join(entry.states)
        rows.append(
            f"| `{command}` | {entry.says} | {states} | {entry.during or 'as it is'} | "
            f"{entry.after or 'as it is'} | {'yes' if entry.interrupts else 'no'} | "
            f"{', '.join(entry.needs) or '-'} |"
        )
    return rows


def list_arm_commands() -> list[str]:
    """One row a command of the arms."""
    rows = ["| command | does | a stream | requires |", "|---|---|---|---|"]
    for command, entry in ARM_TABLE.items():
        stream = "yes" if command in ARM_STREAMS else "no"
        rows.append(f"| `{command}` | {entry.says} | {stream} | {', '.join(entry.needs)} |")
    return rows


def list_needs() -> list[str]:
    """One row a requirement."""
    return ["| requirement | means |", "|---|---|"] + [
        f"| {need} | {says} |" for need, says in NEEDS.items()
    ]


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    for name, make in zip(TABLES, (list_commands, list_arm_commands, list_needs), strict=True):
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
        head, rest = text.split(begin)
        text = head + begin + "\n" + "\n".join(make()) + "\n\n" + end + rest.split(end)[1]
    return text


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
