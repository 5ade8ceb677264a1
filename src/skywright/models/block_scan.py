"""Signals of an eddy-current instrument while an inspector moves its probe over a notch block."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.models.crack_signal import Metal, compute_display_gain, compute_long_crack
from skywright.models.eddy_current import (
    Coil,
    Instrument,
    compute_coil_height,
    compute_impedance_change,
)

Complex = NDArray[np.complex128]
LIFT = 0.001
"""m, height of the lift that shows the lift-off signal."""
REACH = 0.008
"""m, distance scanned to both sides of a notch."""


class BlockScan(NamedTuple):
    """One visit to a block: on sound metal, lifted off, and slid across one notch.

    Signals are (n,) complex in display units.
    """

    sound: Complex  # at rest on metal without a notch
    lift: Complex  # lifted by LIFT, from contact
    notch: Complex  # across the notch
    notch_depth: float  # m


def simulate_block_scan(
    metal: Metal, coil: Coil, instrument: Instrument, rng: np.random.Generator, *,
    notch_depth: float = 1e-3, gain: complex = 1.0, samples: int = 200, paint: float = 0.0,
) -> BlockScan:  # fmt: skip
    """Simulate a visit to a block of `metal` with a long notch of `notch_depth` (m).

    `gain` (complex) is the gain of the instrument's display, including drift; `paint` (m) is a shim
    under the probe. The instrument is nulled in air, and not on the metal as on the part.
    """
    scale = compute_display_gain(coil, metal, instrument)
    frequency = instrument.frequency
    gaps: Array = paint + np.linspace(0.0, LIFT, samples)
    heights = compute_coil_height(coil, gaps, 0.0)
    lift = compute_impedance_change(coil, heights, frequency, *metal)
    x = np.linspace(0.0, REACH, samples // 2)
    half = np.array([
        compute_long_crack(coil, metal, frequency, np.array([notch_depth]), a, paint)[0]
        for a in x[::4].tolist()
    ])  # fmt: skip
    across = np.interp(x, x[::4], half.real) + 1j * np.interp(x, x[::4], half.imag)
    notch = lift[0] + np.concatenate([across[::-1], across])

    def show(z: Complex) -> Complex:
        noise = instrument.noise * (rng.standard_normal(z.size) + 1j * rng.standard_normal(z.size))
        return np.asarray(gain * (scale * z + noise))

    return BlockScan(show(np.full(samples, lift[0])), show(lift), show(notch), notch_depth)


def compute_true_gain(
    gain_db: float, phase_deg: float, drift_db: float, drift_deg: float, seconds: float
) -> complex:
    """Return the display's complex factor after `seconds` of drift; the drift is given per hour."""
    db = gain_db + drift_db * seconds / 3600.0
    turn = math.radians(phase_deg + drift_deg * seconds / 3600.0)
    return complex(10 ** (db / 20) * np.exp(1j * turn))
