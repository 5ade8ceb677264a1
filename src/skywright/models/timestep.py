"""Checks a physics step for settings that MuJoCo would silently change or integrate unstably."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco

STEPS_A_TIME_CONSTANT = 2.0
"""MuJoCo raises `solref`'s time constant to this many steps (option refsafe), which softens a
contact."""


def find_stiff_contact(model: mujoco.MjModel, timestep: float) -> str | None:
    """Return the contact or limit with the shortest time constant if `timestep` (s) is too long for
    it."""
    found = min(list_time_constants(model), default=None)
    if found is None or found[0] >= STEPS_A_TIME_CONSTANT * timestep * (1.0 - 1e-9):
        return None
    return (
        f"{found[1]} has a time constant of {1e3 * found[0]:.2g} ms, which needs a step of at most "
        f"{1e3 * found[0] / STEPS_A_TIME_CONSTANT:.2g} ms"
    )


def list_time_constants(model: mujoco.MjModel) -> Iterator[tuple[float, str]]:
    """Yield (time constant s, name) of all elements with their own `solref`.

    The direct form (-k, -b) acts with b / d_max (MuJoCo, solver parameters). No MuJoCo option
    guards it: a step multiplies the slip velocity by 1 - h b / d_max, which diverges beyond h b /
    d_max = 2. Its time constant is therefore 4 d_max / b, which two steps must not exceed.
    """
    kinds: list[tuple[int, Any, Any, Any, str]] = [
        (model.ngeom, model.geom_solref, model.geom_solimp, mujoco.mjtObj.mjOBJ_GEOM, "contact of"),
        (model.npair, model.pair_solref, model.pair_solimp, mujoco.mjtObj.mjOBJ_PAIR, "contact"),
        (model.njnt, model.jnt_solref, model.jnt_solimp, mujoco.mjtObj.mjOBJ_JOINT, "end stop of"),
        (model.neq, model.eq_solref, model.eq_solimp, mujoco.mjtObj.mjOBJ_EQUALITY, "hold"),
    ]
    for n, solref, solimp, kind, what in kinds:
        for i in range(n):
            if kind == mujoco.mjtObj.mjOBJ_JOINT and not model.jnt_limited[i]:
                continue
            time, damping = float(solref[i][0]), -float(solref[i][1])
            if time <= 0.0:
                time = 4.0 * float(solimp[i][1]) / max(damping, 1e-9)
            yield time, f"{what} {mujoco.mj_id2name(model, kind, i) or i}"
