"""Numbers of an imported robot that rest on a mass or inertia which its file does not state.

SDF gives a link without these values 1 kg and 1 kg m^2, and a shape without a density 1000 kg/m^3.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping

import mujoco

from skywright.errors import InputError
from skywright.models.importing.tables import Tables

SHARES = (1e-3, 0.9, 1.1, 2.0)
"""Assumed masses and inertias relative to the defaults. The ends are their range; the others are
for models that are refused there."""


def mark_assumed(
    tables: Tables,
    model: mujoco.MjModel,
    assumed: Mapping[str, frozenset[str]],
    rebuild: Callable[[mujoco.MjModel], Tables],
) -> Tables:
    """Return the tables with the source `assumed` for numbers that change with assumed values.

    `assumed` names links, and what of "mass" and "inertia" their file does not state. `rebuild`
    returns the tables of a model with other values: those of `SHARES` give the ranges.
    """
    if not assumed:
        return tables
    values = dict(tables.values)
    note = f"rests on SDF's defaults for {', '.join(sorted(assumed))}"
    for share in SHARES:
        other = copy.copy(model)
        for name, missing in assumed.items():
            body = other.body(name).id
            other.body_mass[body] *= share if "mass" in missing else 1.0
            other.body_inertia[body] *= share if "inertia" in missing else 1.0
        mujoco.mj_setConst(other, mujoco.MjData(other))
        try:
            changed = rebuild(other).values
        except InputError:  # a gripper that these masses do not allow
            continue
        for key, value in values.items():
            end = changed[key].value if key in changed else value.value
            if value.source not in ("imported", "assumed") or end == tables.values[key].value:
                continue
            if not isinstance(end, float) or not isinstance(value.value, float):
                continue
            low, high = value.range or (value.value, value.value)
            span = (min(low, end), max(high, end))
            said = value.note if note in value.note else f"{value.note}; {note}"
            values[key] = value._replace(source="assumed", note=said, range=span)
    return tables._replace(values=values)
