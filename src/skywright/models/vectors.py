"""Cross products of arrays of vectors: `np.cross` takes several times as long for a few of them.

Compiled code calls `core.rotations.cross`.
"""

import numpy as np

from skywright.core.arrays import Array


def compute_cross(a: Array, b: Array) -> Array:
    """Return a x b (..., 3) of vectors (..., 3), whose shapes may broadcast."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0], out[..., 1], out[..., 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return out


def build_cross_matrix(a: Array) -> Array:
    """Return S (..., 3, 3) with S b = a x b of vectors a (..., 3)."""
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -a[..., 2], a[..., 1]
    out[..., 1, 0], out[..., 1, 2] = a[..., 2], -a[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -a[..., 1], a[..., 0]
    return out
