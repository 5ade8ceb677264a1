"""The things of a world: which ones move, their poses, and their consistency."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

import numpy as np

from skywright.core.find import explain
from skywright.core.types import MAX_OBJECTS
from skywright.description.world.thing import Frame, Placed, Thing, Things, build_frame
from skywright.errors import InputError

T = TypeVar("T", bound=Thing)


def list_movers(things: Things) -> list[str]:
    """List the freely movable things in order: `object<i>` in a recording is number i of these."""
    return [name for name, thing in things.items() if thing.movable]


def find_first(things: Things, cls: type[T]) -> T | None:
    """Return the first thing of a class, or None."""
    return next((thing for thing in things.values() if isinstance(thing, cls)), None)


def find_marker(things: Things) -> str:
    """Return the name of the first marker, or ""."""
    return next((name for name, thing in things.items() if thing.is_marker), "")


def find_thing(things: Things, name: str, cls: type[T], world: str) -> T:
    """Return the thing of that name; InputError if it does not exist or is of another class.

    `world` is the world's name, for the message.
    """
    thing = things.get(name)
    if isinstance(thing, cls):
        return thing
    what = cls.__name__.lower()
    valid = ", ".join(n for n, t in things.items() if isinstance(t, cls)) or "none"
    found = f"is a {thing.kind}" if thing is not None else "is not there"
    raise InputError(
        f"world {world!r}: things.{name} {found}; a {what} is required, [world.things.{name}] "
        f"kind = '{what}' (existing: {valid})"
    )


def drop_things(things: Things, *names: str) -> dict[str, Thing]:
    """Return the things without those named and those on them."""
    return {
        name: thing
        for name, thing in things.items()
        if not any(below in names for below in (name, *_list_below(things, name)))
    }


def locate_thing(
    things: Things,
    name: str,
    within: str | None = None,
    offsets: Mapping[str, Frame] | None = None,
) -> Frame:
    """Return O of a thing in W, or in O of `within`, a thing that it is on.

    `offsets` are true poses of O by name, relative to the frame of the file. Raises InputError for
    a thing without a pose.
    """
    thing = things[name]
    if not isinstance(thing, Placed):
        raise InputError(f"world.things.{name}: a {thing.kind} has no pose")
    here = thing.frame
    if thing.on is not None:
        below, frame = split_support(things, thing.on)
        stand = things[below].list_frames().get(frame, build_frame())
        here, up = stand.at(here), thing.foot_m * stand.R[:, 2]
        if below != within:
            base = locate_thing(things, below, within, offsets)
            here, up = base.at(here), base.R @ up
        here = Frame(here.p + up, here.R)
    return here.at(offsets[name]) if offsets and name in offsets else here


def find_carrier(things: Things, name: str) -> str | None:
    """Return the movable thing that carries a thing which does not move by itself, or None."""
    return next((below for below in _list_below(things, name) if things[below].movable), None)


def split_support(things: Things, on: str) -> tuple[str, str]:
    """Split `on` into (thing, frame); the frame is "top" if none is named.

    Raises ValueError for an unknown thing or frame.
    """
    if on in things:
        return on, "top"
    for name, thing in things.items():
        if on.startswith(name + "."):
            frame, frames = on[len(name) + 1 :], thing.list_frames()
            if frame not in frames and frame != "origin":
                raise ValueError(
                    f"on = {on!r}: {name} has no frame {frame!r}; valid: "
                    f"{', '.join(['origin', *frames])}"
                )
            return name, frame
    raise ValueError(
        f"on = {on!r} is not a thing of this world; valid: {', '.join(things) or 'none'}"
    )


def _list_below(things: Things, name: str) -> Iterator[str]:
    """Yield the support of a thing, the support of that, and so on."""
    thing = things[name]
    while isinstance(thing, Placed) and thing.on is not None:
        name = split_support(things, thing.on)[0]
        yield name
        thing = things[name]


def check_things(things: Things) -> None:
    """Raise ValueError if things are inconsistent or do not consist of valid parts."""
    for name, thing in things.items():
        _check_support(things, name)
        try:
            solids = [s for part in thing.list_parts() for s in part.solids]
            numbers = [n for s in solids for n in (*s.size, *s.frame.p, *s.frame.R.flat, s.mass_kg)]
            finite = bool(np.all(np.isfinite(np.array(numbers, dtype=float))))
            thing.list_frames()
        except Exception as error:
            raise ValueError(f"things.{name}: {thing.kind} failed: {explain(error)}") from error
        if not finite:
            raise ValueError(f"things.{name}: a solid of {thing.kind} has non-finite values")
        mass = sum(s.mass_kg for s in solids)
        if thing.movable and not mass > 0.0:
            raise ValueError(
                f"things.{name} is movable and requires a mass above 0; its solids have {mass:g} kg"
            )
    movers = list_movers(things)
    if len(movers) > MAX_OBJECTS:
        raise ValueError(
            f"a world has at most {MAX_OBJECTS} movable things; found: {', '.join(movers)}"
        )


def _check_support(things: Things, name: str) -> None:
    way = [name]
    thing = things[name]
    while isinstance(thing, Placed) and thing.on is not None:
        try:
            below = split_support(things, thing.on)[0]
        except ValueError as error:
            raise ValueError(f"things.{way[-1]}.{error}") from None
        if below in way:
            raise ValueError(f"things.{name} stands on itself: {' on '.join([*way, below])}")
        if not isinstance(things[below], Placed):
            raise ValueError(
                f"things.{way[-1]}.on = {thing.on!r}: a {things[below].kind} has no pose"
            )
        way.append(below)
        thing = things[below]
