"""Operations on reference tables for the supervisor's responses to faults."""

from typing import Any

import numpy as np

from skywright.core.arrays import Table
from skywright.vehicle.rest_to_rest import quintic

ROW_PERIOD = 0.02  # s


def build_retreat(row: Any, distance: float, total: float, *, back: bool = False) -> Table:
    """Move from `row` along the surface normal by `distance` (m) in `total` s, rest to rest.

    The dead zone, which indicates contact, is kept only within half of its size from the position
    of `row`; the force falls to zero over the same distance. `back` reverses the motion: from the
    distance to `row`.
    """
    n = max(round(total / ROW_PERIOD), 2)
    u = np.linspace(0.0, 1.0, n + 1)
    s, ds, dds = quintic(u)
    if back:
        s, ds, dds = 1.0 - s, -ds, -dds
    total = n * ROW_PERIOD
    table = np.repeat(np.array(row)[None], n + 1)
    normal = np.array(row["R_WS"])[:, 2]
    shift = (s * distance)[:, None] * normal
    table["t"] = u * total
    table["p_WB"] = row["p_WB"] + shift
    table["p_WT"] = row["p_WT"] + shift
    table["v_WB"] = table["v_WT"] = (ds * distance / total)[:, None] * normal
    table["a_WB"] = (dds * distance / total**2)[:, None] * normal
    for field in ("w_WB_B", "wd_WB_B", "qd"):
        table[field] = 0.0
    way = 0.5 * row["dead_zone"]
    table["dead_zone"] = np.where(s * distance < way, row["dead_zone"], 0.0)
    table["force"] = row["force"] * np.clip(1.0 - s * distance / max(way, 1e-9), 0.0, 1.0)
    return table


def cut_table(table: Table, t: float) -> Table:
    """Return the rest of a table from time `t` (s) on, with its own time from 0."""
    rest = table[table["t"] >= t].copy()
    if len(rest) == 0:
        rest = table[-1:].copy()
    rest["t"] -= rest["t"][0]
    return rest


def reverse_table(table: Table, speed_up: float = 1.0) -> Table:
    """Return the table flown backwards, `speed_up` times as fast."""
    out = table[::-1].copy()
    out["t"] = (table["t"][-1] - out["t"]) / speed_up
    for field in ("v_WB", "w_WB_B", "qd", "v_WT"):
        out[field] *= -speed_up
    for field in ("a_WB", "wd_WB_B"):
        out[field] *= speed_up**2
    return out


def lift_table(table: Table, distance: float) -> Table:
    """Shift a table along its surface normals by `distance` (m), out of contact."""
    out = table.copy()
    shift = distance * table["R_WS"][:, :, 2]
    out["p_WB"] += shift
    out["p_WT"] += shift
    out["dead_zone"] = out["force"] = 0.0
    return out
