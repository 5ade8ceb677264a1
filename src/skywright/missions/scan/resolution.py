"""Welds that a probe cannot resolve: too close to another one, or without contrast."""

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.spec import Pipe, Weld
from skywright.inspection.calibration import robust_std
from skywright.inspection.spikes import FOOTPRINT
from skywright.inspection.weld import SIGNIFICANCE, WeldResult
from skywright.models.eddy_current import compute_weld_signal

SURE = 2.0
"""Standard deviations of the base metal's texture by which a weld exceeds the threshold to be
detected at every crossing."""


def is_faint(pipe: Pipe, weld: Weld, result: WeldResult) -> bool:
    """Return whether a weld's signal in contact may be lost in the texture of the base metal."""
    cal = result.calibration
    noise = robust_std(result.weld[result.contact & (np.abs(result.weld) < cal.weld_threshold)])
    across = abs((compute_weld_signal(pipe, weld) * cal.lift_off_axis.conjugate()).imag)
    return across < max(cal.weld_threshold, SIGNIFICANCE * noise) + SURE * noise


def is_merged(k: int, welds: list[Weld], crossings: list[Array], radius: float) -> bool:
    """Return whether all `crossings` (n, 2) s, c m of weld `k` are too close to another weld.

    The signal returns to base metal between welds further apart than both half-widths and the
    coil's footprint.
    """
    free = np.ones(len(crossings[k]), bool)
    for weld, other in zip(welds, crossings, strict=True):
        if weld is not welds[k] and len(other):
            apart = crossings[k][:, None] - other[None]
            around = radius * np.angle(np.exp(1j * apart[..., 1] / radius))
            least = weld.half_width_m + welds[k].half_width_m + FOOTPRINT
            free &= np.min(np.hypot(apart[..., 0], around), axis=1) >= least
    return len(free) > 0 and not free.any()
