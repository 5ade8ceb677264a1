"""Validation of a page's requests to the station: each message is one JSON object.

Pages are untrusted clients: their messages are validated like those of a stranger.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from typing import Any, NamedTuple

from skywright.core.keys import parse_assignment
from skywright.core.toml_files import parse_value
from skywright.ground.disturb import DISTURBANCES
from skywright.ground.feed import SPEED_FASTEST, SPEEDS
from skywright.ground.link import read_flight
from skywright.ground.steering import MODES, ORDERS
from skywright.links.pair import parse, read_number
from skywright.run.backends import PHYSICS

LARGEST = 4096  # bytes, largest message
PLAIN = ("take", "release", "here", "invite", "stop")
"""Messages without content."""
NAME = re.compile(r"[\w.-]{1,64}")
LONGEST_SET, MOST_SETS = 300, 40


class Order(NamedTuple):
    """A valid message."""

    kind: str
    content: dict[str, Any]


def parse_order(text: str) -> Order | None:
    """Return a page's request; None if the message is unknown or invalid."""
    if len(text) > LARGEST:
        return None
    found = parse(text)
    if found is None:
        return None
    kind = found.pop("k")
    content = {} if kind in PLAIN else _read(kind, found)
    return None if content is None else Order(kind, content)


def _read(kind: str, found: dict[str, Any]) -> dict[str, Any] | None:
    if kind == "ping":
        stamp = read_number(found.get("w"), 0.0, 1e15)
        return None if stamp is None else {"w": stamp}
    if kind == "pause":
        return {"on": found["on"]} if isinstance(found.get("on"), bool) else None
    if kind == "speed":
        x = read_number(found.get("x"), 0.0, SPEEDS[1])
        return None if x is None or SPEED_FASTEST < x < SPEEDS[0] else {"x": x}
    if kind == "order":
        return _choose(found, ORDERS)
    if kind == "mode":
        return _choose(found, MODES)
    if kind == "disturb":
        return _choose(found, DISTURBANCES)
    if kind == "stick":
        return _read_stick(found)
    if kind == "start":
        return _read_start(found)
    if kind == "choose":
        number, wish = read_number(found.get("n"), 0, 2**53), _read_start(found)
        return None if number is None or wish is None else {**wish, "n": int(number)}
    return None


def _choose(found: dict[str, Any], known: Container[str]) -> dict[str, Any] | None:
    what = found.get("what")
    return {"what": what} if isinstance(what, str) and what in known else None


def _read_stick(found: dict[str, Any]) -> dict[str, Any] | None:
    seq, stamp = read_number(found.get("s"), 0, 2**53), read_number(found.get("w"), 0.0, 1e15)
    axes = found.get("v")
    if seq is None or stamp is None or not isinstance(axes, list) or len(axes) != 3:
        return None
    values = [read_number(x, -1.0, 1.0) for x in axes]
    if any(x is None for x in values):
        return None
    held, button = found.get("d"), found.get("b")
    if not isinstance(held, bool) or not isinstance(button, bool):
        return None
    flight = read_flight(found.get("f"))
    if flight is None:
        return None
    return {"s": int(seq), "w": stamp, "v": values, "d": held, "b": button, "f": flight}


def _read_start(found: dict[str, Any]) -> dict[str, Any] | None:
    """Return mission, robot, world and back end by name: a page names no files and no addresses."""
    out: dict[str, Any] = {"mission": found.get("mission")}
    if not isinstance(out["mission"], str) or not NAME.fullmatch(out["mission"]):
        return None
    for name in ("robot", "world"):
        value = found.get(name)
        if value is not None and (not isinstance(value, str) or not NAME.fullmatch(value)):
            return None
        out[name] = value
    seed = found.get("seed")
    if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int) or seed < 0):
        return None
    if seed is not None and seed > 2**53:
        return None
    sets = found.get("sets", [])
    if not isinstance(sets, list) or len(sets) > MOST_SETS:
        return None
    if not all(isinstance(s, str) and 0 < len(s) <= LONGEST_SET for s in sets):
        return None
    operated, backend = found.get("operated", False), found.get("backend", PHYSICS)
    if not isinstance(operated, bool) or not isinstance(backend, str):
        return None
    return {**out, "seed": seed, "sets": sets, "operated": operated, "backend": backend}


def names_code(text: str) -> bool:
    """Whether a `--set` would load a Python file, which a page must not do.

    It checks the value as the loader reads it, because TOML has several encodings of a letter.
    Raises InputError if it is not KEY=VALUE.
    """
    read = parse_value(parse_assignment(text)[1])
    return any(".py" in word.lower() for word in (text, *_list_texts(read)))


def _list_texts(value: object) -> Iterator[str]:
    """Return every text in a value, keys of tables included."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | dict):
        for inner in value:
            yield from _list_texts(inner)
            if isinstance(value, dict):
                yield from _list_texts(value[inner])
