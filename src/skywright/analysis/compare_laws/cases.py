"""The cases in which laws are compared: the unchanged mission, and one deviation at a time."""

from __future__ import annotations

import re
from collections.abc import Sequence
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
    one case. Raises InputError on any other text.
    """
    known = {c.name: c for c in list_cases(base)}
    if not texts:
        return list(known.values())
    chosen = {NOMINAL: known[NOMINAL]}
    for text in texts:
        name, colon, assignment = text.partition(":")
        name = name.strip()
        if not colon:
            if name not in known:
                raise InputError(
                    f"--case {text}: no such case; valid: {', '.join(known)}, or NAME:KEY=VALUE"
                )
            chosen[name] = known[name]
            continue
        if not name or name == NOMINAL:
            raise InputError(f"--case {text}: a name other than {NOMINAL!r} is needed before ':'")
        if not re.fullmatch(r"[\w-][\w.-]*", name):
            raise InputError(
                f"--case {text}: a name of letters, digits, '_', '-' and '.' is needed"
            )
        split_assignments([assignment])
        own = chosen.get(name, Case(name, ()))
        chosen[name] = Case(name, (*own.sets, assignment))
    return list(chosen.values())
