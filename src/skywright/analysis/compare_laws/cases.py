"""The cases in which laws are compared: the unchanged mission, and one deviation at a time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from skywright.description.loader import Description, split_assignments
from skywright.errors import InputError

NOMINAL = "nominal"
FRICTION = 1.5
"""Factor on the surface's friction in the case `friction`."""


class Case(NamedTuple):
    """One condition in which all laws fly."""

    name: str
    sets: tuple[str, ...]  # assignments, KEY=VALUE


class LeftOut(NamedTuple):
    """A built-in case that is not flown, because its keys vary."""

    case: Case
    keys: tuple[str, ...]


def list_law_sets(law: str) -> list[str]:
    """Return the assignments that select a law: NAME or FILE.py:CLASS, then any :KEY=VALUE."""
    kind, *options = re.split(r":(?=\w+(?:\.\w+)*=)", law)
    return [f"mission.law={kind}", *(f"mission.law.{option}" for option in options)]


def list_cases(base: Description[Any]) -> list[Case]:
    """List the built-in cases of a mission: nominal, mass, delay, wind, gusts, friction."""
    cases = [
        Case(NOMINAL, ()),
        Case("mass", ("plant.mass_error=0.1",)),
        Case("delay", (f"world.link.delay_s={base.world.link.delay_s + 0.005:g}",)),
        Case("wind", ("world.wind.kind=steady", "world.wind.mean_mps=3")),
        Case("gusts", ("world.wind.kind=dryden", "world.wind.mean_mps=2")),
    ]
    for name in ("pipe", "structure"):
        surface = getattr(base.world, name)
        if surface is not None:
            key = f"world.{name}.friction={FRICTION * surface.friction:g}"
            return [*cases, Case("friction", (key,))]
    return cases


def choose_cases(base: Description[Any], texts: Sequence[str]) -> list[Case]:
    """Return the nominal case and those that `--case` names or defines; all cases without `texts`.

    A text is the name of a built-in case, or NAME:KEY=VALUE; assignments with the same NAME form
    one case. If NAME is also given alone, the built-in case of that name comes first in it. Raises
    InputError on any other text.
    """
    known = {c.name: c for c in list_cases(base)}
    if not texts:
        return list(known.values())
    own: dict[str, list[str]] = {NOMINAL: []}  # in the order of their first texts
    named = {NOMINAL}
    for text in texts:
        name, colon, assignment = text.partition(":")
        name = name.strip()
        if not colon:
            if name not in known:
                raise InputError(
                    f"--case {text}: no such case; valid: {', '.join(known)}, or NAME:KEY=VALUE"
                )
            own.setdefault(name, [])
            named.add(name)
            continue
        if not name or name == NOMINAL:
            raise InputError(f"--case {text}: a name other than {NOMINAL!r} is needed before ':'")
        if not re.fullmatch(r"[\w-][\w.-]*", name):
            raise InputError(
                f"--case {text}: a name of letters, digits, '_', '-' and '.' is needed"
            )
        split_assignments([assignment])
        own.setdefault(name, []).append(assignment)
    return [
        Case(name, (*(known[name].sets if name in named else ()), *sets))
        for name, sets in own.items()
    ]


def check_varied(
    cases: Sequence[Case], laws: Sequence[str], varied: Sequence[str], given: bool
) -> tuple[list[Case], list[LeftOut]]:
    """Return the cases that set no varied key, and those that are left out.

    `given`: `--case` names the cases. Raises InputError if a case so named, or a law, sets a key
    that `--vary` draws.
    """
    for law in laws:
        if keys := _find_common(list_law_sets(law), varied):
            raise InputError(
                f"--vary {keys[0]}: not valid here, because the law {law} sets it; leave it out"
            )
    flown, left_out = [], []
    for case in cases:
        keys = _find_common(case.sets, varied)
        if keys and given:
            raise InputError(
                f"--case {case.name} sets {', '.join(keys)}, which --vary draws for each run; "
                "leave out the case or that --vary"
            )
        if keys:
            left_out.append(LeftOut(case, keys))
        else:
            flown.append(case)
    return flown, left_out


def tell_left_out(left_out: Sequence[LeftOut]) -> str:
    """Return a statement which cases are not flown, and why; "" if there is none."""
    if not left_out:
        return ""
    told = ", ".join(f"{x.case.name} ({', '.join(x.keys)})" for x in left_out)
    return f"left out, because --vary draws a key that the built-in case sets: {told}"


def _find_common(sets: Iterable[str], varied: Sequence[str]) -> tuple[str, ...]:
    """Return the varied keys that assignments set, or that are tables of keys that they set."""
    keys = [key for key, _ in split_assignments(tuple(sets))]
    return tuple(one for one in varied if any(f"{key}.".startswith(f"{one}.") for key in keys))
