"""Generates the tables of docs/howto/ros2.md from the code."""

from __future__ import annotations

from collections.abc import Sequence

from skywright.links.broadcast.table import SERVICES, STREAMS, Service, Stream
from skywright.links.broadcast.topics import GIVEN, ROBOT, STATES, TEXTS
from skywright.recordings.messages import full_name


def build_tables() -> dict[str, str]:
    """Return the tables by name."""
    return {
        "topics": _build_table(
            ("topic", "type", "is"),
            [
                (f"`{g.topic.name}`", f"`{full_name(g.topic.kind)}`", g.what)
                for g in [*GIVEN, *ROBOT, *TEXTS]
            ],
        ),
        "commands": _build_table(
            ("name", "type", "vehicle of a script", "while a mission flies"),
            [
                (f"`{c.name}`", f"`{_name_type(c.kind, c in SERVICES)}`", c.what,
                 c.by_mission or "refused")
                for c in list[Service | Stream]([*SERVICES, *STREAMS])
            ],
        ),
        "states": _build_table(
            ("number", "state"), [(str(n), f"`{state}`") for state, n in STATES.items()]
        ),
    }  # fmt: skip


def _name_type(kind: str, service: bool) -> str:
    package, _, name = kind.partition("/")
    return f"{package}/{'srv' if service else 'msg'}/{name}"


def _build_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
