"""The force of a probe's tip from its force sensor.

The sensor sits behind the slider: its spring carries the contact force and, upright, the slider's
own weight (0.03 kg are 0.29 N), which is taken off with the nominal mass and the estimated
attitude. What the slider's inertia adds while it moves stays in.
"""

from __future__ import annotations

from typing import Any

from numba import njit

Record = Any


@njit(cache=True, error_model="numpy")
def estimate_tip_force(b: Record) -> None:
    """Fill `est.f_tip` (N) from `meas.force`, the joints and the attitude."""
    up = 0.0
    for i in range(3):
        up += b.est.R_WB[2, i] * b.body.R_BT[i, 2]
    b.est.f_tip = b.meas.force - b.par.slider * b.body.gravity * up
