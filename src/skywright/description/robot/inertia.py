"""Inertia tensors of a robot file: six numbers, and the check that they are physical."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PRODUCTS = ("inertia_xy_kgm2", "inertia_xz_kgm2", "inertia_yz_kgm2")
MOMENTS = ("inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2")
TOLERANCE = 1e-9
"""Relative tolerance of the triangle inequality of principal moments: eigenvalues are rounded."""


def build_inertia(
    xx: float, yy: float, zz: float, xy: float = 0.0, xz: float = 0.0, yz: float = 0.0
) -> NDArray[np.float64]:
    """Return the (3, 3) tensor kg m^2. The products are its entries: I_xy = -sum m x y."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def check_inertia(
    xx: float, yy: float, zz: float, xy: float = 0.0, xz: float = 0.0, yz: float = 0.0
) -> None:
    """Raise ValueError if no body has this inertia about its centre of mass."""
    if not (xy or xz or yz):
        if xx + yy < zz or yy + zz < xx or zz + xx < yy:
            raise ValueError(
                f"inertias {xx:g}, {yy:g}, {zz:g} kg m^2 are not physical: each must be "
                "at most the sum of the other two"
            )
        return
    a, b, c = (float(x) for x in np.linalg.eigvalsh(build_inertia(xx, yy, zz, xy, xz, yz)))
    if a <= 0.0 or a + b < c * (1.0 - TOLERANCE):
        raise ValueError(
            f"principal moments of inertia {a:g}, {b:g}, {c:g} kg m^2 (inertia_xx to inertia_yz) "
            "are not physical: each must be above 0 and at most the sum of the other two"
        )
