"""Validation of a page's requests to the station: each message is one JSON object.

Pages are untrusted clients: their messages are validated like those of a stranger.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from skywright.core.keys import parse_assignment
from skywright.core.toml_files import parse_value
from skywright.errors import InputError
from skywright.ground.disturb import DISTURBANCES
from skywright.ground.link import SPEED_FASTEST, SPEEDS, read_flight
from skywright.ground.steering import MODES, ORDERS
from skywright.links.pair import parse, read_number
from skywright.run.backends import PHYSICS

LARGEST = 16_384
"""Characters of the largest message: a start with MOST_SETS values of LONGEST_SET characters."""
PLAIN = ("take", "release", "here", "invite", "stop")
"""Messages without content."""
NAME = re.compile(r"[^/\x00-\x1f]{1,256}")
NAMES = "a name of up to 256 characters without / and control characters"
LONGEST_SET, MOST_SETS = 300, 40
UNSENDABLE = re.compile(r"[\x00\ud800-\udfff]")
WHOLE = 2**53
"""Largest whole number that JavaScript represents."""


class Order(NamedTuple):
    """A valid message."""

    kind: str
    content: dict[str, Any]


def parse_order(text: str) -> Order:
    """Return a page's request; raises InputError that names the field, its value and valid ones."""
    if len(text) > LARGEST:
        raise InputError(f"a message of {len(text)} characters; valid: up to {LARGEST}")
    found = parse(text)
    if found is None:
        raise InputError("not a JSON object with a text k, the kind of the message")
    kind = found.pop("k")
    if kind in PLAIN:
        return Order(kind, {})
    read = READERS.get(kind)
    if read is None:
        raise InputError(f"{_show(kind)}: no kind of message; valid: {_join((*PLAIN, *READERS))}")
    try:
        return Order(kind, read(found))
    except InputError as error:
        raise InputError(f"{kind}: {error}") from None


def _read_ping(found: dict[str, Any]) -> dict[str, Any]:
    return {"w": _get_number(found, "w", 0.0, 1e15)}


def _read_pause(found: dict[str, Any]) -> dict[str, Any]:
    return {"on": _get_switch(found, "on")}


def _read_speed(found: dict[str, Any]) -> dict[str, Any]:
    x = _get_number(found, "x", 0.0, SPEEDS[1])
    if SPEED_FASTEST < x < SPEEDS[0]:
        raise _wrong("x", x, f"{SPEED_FASTEST:g} (fastest), {SPEEDS[0]:g} to {SPEEDS[1]:g}")
    return {"x": x}


def _build_choice(known: Iterable[str]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return the reader of a message whose field `what` is one of `known`."""
    names = sorted(known)

    def read(found: dict[str, Any]) -> dict[str, Any]:
        what = found.get("what")
        if not isinstance(what, str) or what not in names:
            raise _wrong("what", what, _join(names))
        return {"what": what}

    return read


def _read_stick(found: dict[str, Any]) -> dict[str, Any]:
    axes, flight = found.get("v"), read_flight(found.get("f"))
    if not isinstance(axes, list) or len(axes) != 3:
        raise _wrong("v", axes, "a list of 3 numbers from -1 to 1")
    values = [_get_number({f"v[{i}]": x}, f"v[{i}]", -1.0, 1.0) for i, x in enumerate(axes)]
    if flight is None:
        raise _wrong("f", found.get("f"), "a list of 4 numbers from -1 to 1")
    return {
        "s": int(_get_number(found, "s", 0, WHOLE)), "w": _get_number(found, "w", 0.0, 1e15),
        "v": values, "d": _get_switch(found, "d"), "b": _get_switch(found, "b"), "f": flight,
    }  # fmt: skip


def _read_start(found: dict[str, Any]) -> dict[str, Any]:
    """Return mission, robot, world and back end by name: a page names no files and no addresses."""
    out: dict[str, Any] = {}
    for name in ("mission", "robot", "world"):
        value = out[name] = found.get(name)
        if value is None and name != "mission":
            continue
        if not isinstance(value, str) or not NAME.fullmatch(value):
            raise _wrong(name, value, NAMES)
    seed = found.get("seed")
    if seed is not None and (read_number(seed, 0, WHOLE) is None or not isinstance(seed, int)):
        raise _wrong("seed", seed, f"a whole number from 0 to {WHOLE}")
    operated, backend = found.get("operated", False), found.get("backend", PHYSICS)
    if not isinstance(operated, bool):
        raise _wrong("operated", operated, "true or false")
    if not isinstance(backend, str):
        raise _wrong("backend", backend, "the name of a back end")
    sets = _read_sets(found.get("sets", []))
    return {**out, "seed": seed, "sets": sets, "operated": operated, "backend": backend}


def _read_sets(sets: Any) -> list[str]:
    if not isinstance(sets, list):
        raise _wrong("sets", sets, "a list of KEY=VALUE")
    if len(sets) > MOST_SETS:
        raise InputError(f"sets has {len(sets)} values; valid: up to {MOST_SETS}")
    for i, text in enumerate(sets, start=1):
        if not isinstance(text, str) or not text:
            raise _wrong(f"value {i} of sets", text, "KEY=VALUE")
        if len(text) > LONGEST_SET:
            raise InputError(
                f"value {i} of sets has {len(text)} characters; valid: up to {LONGEST_SET}"
            )
        if UNSENDABLE.search(text):  # no argument of a command can contain it
            raise _wrong(f"value {i} of sets", text, "text without NUL and lone surrogates")
    return sets


def _read_choose(found: dict[str, Any]) -> dict[str, Any]:
    return {**_read_start(found), "n": int(_get_number(found, "n", 0, WHOLE))}


READERS: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "ping": _read_ping, "pause": _read_pause, "speed": _read_speed,
    "order": _build_choice(ORDERS), "mode": _build_choice(MODES),
    "disturb": _build_choice(DISTURBANCES), "stick": _read_stick, "start": _read_start,
    "choose": _read_choose,
}  # fmt: skip
"""Kind of a message with content -> its reader."""


def _get_number(found: dict[str, Any], name: str, low: float, high: float) -> float:
    number = read_number(found.get(name), low, high)
    if number is None:
        raise _wrong(name, found.get(name), f"a number from {low:g} to {high:g}")
    return number


def _get_switch(found: dict[str, Any], name: str) -> bool:
    value = found.get(name)
    if not isinstance(value, bool):
        raise _wrong(name, value, "true or false")
    return value


def _wrong(name: str, value: Any, valid: str) -> InputError:
    return InputError(f"{name} is {_show(value)}; valid: {valid}")


def _show(value: Any) -> str:
    """Return a value of a message for an error, at most some 80 characters."""
    if value is None:
        return "missing"
    if isinstance(value, list | dict):
        return f"a {'list' if isinstance(value, list) else 'table'} of {len(value)}"
    return repr(value[:80] if isinstance(value, str) else value)[:80]


def _join(names: Iterable[str]) -> str:
    return ", ".join(names)


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
