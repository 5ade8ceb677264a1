"""Gap under the middle of a rounded nose that slides over the cap of a weld.

The nose is a sphere and rests at its first point of contact. Its height over x is the dilation of
the profile, h(x) = max_u [z(u) + sqrt(R^2 - (u - x)^2)] - R, and the gap under its middle is h(x) -
z(x). The cap is a parabola over the weld's width.
"""

import numpy as np

from skywright.core.arrays import Array

STEP = 0.00025
"""m, spacing of the table."""


def compute_cap_gap(height: float, half_width: float, nose_radius: float) -> Array:
    """Return the gap (m) at distances from the weld's middle in steps of STEP; the last entry is 0.

    `height` (m) of the cap, `half_width` (m) of the weld, `nose_radius` (m).
    """
    n = int((half_width + nose_radius) / STEP) + 2
    x = np.arange(n) * STEP
    u = np.arange(-n, 2 * n) * STEP
    z = height * np.maximum(1.0 - (u / half_width) ** 2, 0.0)
    under = nose_radius**2 - (u[None, :] - x[:, None]) ** 2
    reach = np.where(under > 0, z[None, :] + np.sqrt(np.maximum(under, 0.0)), -1.0)
    top = np.max(reach, axis=1) - nose_radius
    return np.maximum(top - height * np.maximum(1.0 - (x / half_width) ** 2, 0.0), 0.0)
