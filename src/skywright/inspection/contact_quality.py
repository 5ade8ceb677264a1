"""Contact quality of the probe: limits, and a map over the unrolled surface."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.errors import InputError

GAP_LIMIT = 1e-3
"""m, largest air gap of a valid reading (Tognon 2018)."""
TILT_LIMIT = math.radians(10.0)
"""rad, largest tilt of a valid reading (Tognon 2018)."""
REACH = 0.006
"""m; points this close to the probe's path count as inspected; a coil senses a few millimetres."""


class ContactMap(NamedTuple):
    """Worst contact per cell of the unrolled surface; NaN in cells without samples."""

    s_edges: Array  # (n_s + 1,) m
    c_edges: Array  # (n_c + 1,) m
    gap: Array  # (n_s, n_c) m, largest
    tilt: Array  # (n_s, n_c) rad, largest
    lift_off: Array  # (n_s, n_c) instrument units, largest
    samples: Ints  # (n_s, n_c)


def compute_contact_map(
    s: Array, c: Array, gap: Array, tilt: Array, lift_off: Array, cell: float = 0.005
) -> ContactMap:
    """Bin samples (n,) (m, m, m, rad, units) into cells of size `cell` (m).

    Samples with NaN are left out. Raises InputError if no valid sample is left, if `cell` is not
    above 0, or if there are more than 4 million cells.
    """
    data = np.stack([np.asarray(x, float).ravel() for x in (s, c, gap, tilt, lift_off)])
    data = data[:, np.all(np.isfinite(data), axis=0)]
    if not cell > 0 or data.shape[1] == 0:
        raise InputError(f"contact map: {data.shape[1]} valid samples, cell {cell} m; both above 0")
    low = np.floor(data[:2].min(axis=1) / cell).astype(int)
    size = np.floor(data[:2].max(axis=1) / cell).astype(int) - low + 1
    if int(size[0]) * int(size[1]) > 4_000_000:
        raise InputError(f"contact map: {size[0]} x {size[1]} cells; choose a larger cell")
    i, j = (np.floor(data[:2] / cell).astype(int) - low[:, None]).tolist()
    count = np.zeros(size, np.int64)
    np.add.at(count, (i, j), 1)
    worst = []
    for values in data[2:]:
        grid = np.full(size, -math.inf)
        np.maximum.at(grid, (i, j), values)
        worst.append(np.where(count > 0, grid, np.nan))
    s_edges = (low[0] + np.arange(size[0] + 1)) * cell
    c_edges = (low[1] + np.arange(size[1] + 1)) * cell
    return ContactMap(s_edges, c_edges, worst[0], worst[1], worst[2], count)
