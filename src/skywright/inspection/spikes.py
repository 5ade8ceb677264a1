"""Detect spikes of electrical interference in a probe's signal.

A coil averages over its FOOTPRINT. A sample of a real signal therefore resembles its neighbours if
several samples are taken within one footprint. A spike differs from its neighbours on both sides.
The expected value is the median of three samples on either side (a Hampel filter, Hampel, J. Am.
Stat. Assoc. 69, 383 (1974)). A ramp, an edge or another spike nearby does not change that median.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from skywright.core.arrays import Array, Mask
from skywright.errors import InputError
from skywright.recordings.period import compute_period

FOOTPRINT = 0.0035
"""m; length over which a coil averages."""
LEAST_SAMPLES = 4.0
"""Least number of samples per footprint at which a single deviating sample is a spike: an edge of
the signal covers two samples."""
SIDE = 3
"""Samples on either side; the median of six samples tolerates two spikes among them."""
LASTING = 0.5
"""s; a reading in air or in contact lasts longer than this, a burst of interference does not."""
MOST = 0.1
"""Largest share of spikes in a signal; above it the remaining samples are not trusted."""
SIGMAS = 6.0
"""Least deviation of a spike, in standard deviations of the samples from their neighbours."""
SPREAD = 3.0
"""Least deviation of a spike, in multiples of the spread among its neighbours."""


def find_spikes(x: NDArray[Any]) -> Mask:
    """Flag (n,) spikes: one or two successive samples of `x` that differ from their neighbours.

    `x` is (n,) complex or (n, k): a signal or positions. The search removes the spikes found and
    repeats on the remaining samples, because spikes may be close together.
    """
    x = np.stack([x.real, x.imag], axis=1) if np.iscomplexobj(x) else x
    left = np.arange(len(x))
    while left.size > 2 * SIDE:
        found = _stand_out(x[left])
        if not found.any():
            break
        left = left[~found]
    return np.asarray(np.isin(np.arange(len(x)), left, invert=True))


def _stand_out(x: Array) -> Mask:
    around = np.pad(x, ((SIDE, SIDE), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(around, 2 * SIDE + 1, axis=0)
    near = np.delete(windows, SIDE, axis=2)  # (n, k, 2 SIDE)
    middle = np.median(near, axis=2)
    off = np.linalg.norm(x - middle, axis=1)
    apart = np.linalg.norm(near - middle[:, :, None], axis=1)
    # both neighbours of a narrow peak are high too; at least one neighbour of a spike is not
    spread = np.maximum(
        np.sort(apart, axis=1)[:, SIDE], np.minimum(apart[:, SIDE - 1], apart[:, SIDE])
    )
    steps = np.abs(np.diff(x, axis=0))
    resolution = float(np.min(steps, where=steps > 0, initial=np.max(steps)))
    noise = SIGMAS * max(1.4826 * float(np.median(off)), 0.5 * resolution)
    return np.asarray(off > np.maximum(noise, SPREAD * spread))


def count_per_footprint(t: Array, p: Array) -> float:
    """Return the number of samples while the probe moves by its footprint, at high speed.

    `t` (n,) s, `p` (n, 3) m. The speed is the 90 % quantile of the mean speeds over 0.5 s, an
    interval longer than the tracker's noise.
    """
    step = compute_period(t)
    lag = max(int(0.5 / step), 1) if step > 0 else 1
    if t.size <= lag:
        return np.inf
    smooth = median_filter(p, size=(5, 1), mode="nearest")
    way = np.linalg.norm(smooth[lag:] - smooth[:-lag], axis=1)
    speed = float(np.quantile(way / (t[lag:] - t[:-lag]), 0.9))
    return FOOTPRINT / (speed * step) if speed > 0 else np.inf


def reject_spikes(
    t: Array, w: NDArray[np.complex128], p: Array, lifted: Mask
) -> tuple[Mask, str | None]:
    """Return the mask (n,) of spikes to leave out of a scan, and a note.

    `t` (n,) s, `w` (n,), `p` (n, 3) m. `lifted` (n,) flags the samples that lift-off explains.
    These are not spikes: a probe that hops for one sample is in the air. If there are too few
    samples within a footprint, no spike is left out.
    """
    spikes = find_spikes(w) & ~lifted
    if not spikes.any():
        return spikes, None
    note = (
        f"{np.count_nonzero(spikes)} spikes of one or two samples in the signal, the first at "
        f"{t[spikes][0]:.2f} s: "
    )
    taken = count_per_footprint(t, p)
    if taken >= LEAST_SAMPLES:
        return spikes, note + "left out"
    return np.zeros(t.size, bool), note + (
        f"kept, because {taken:.2g} samples within a coil's footprint of {FOOTPRINT * 1e3:g} mm do "
        f"not distinguish interference from a weld (needed: {LEAST_SAMPLES:g}; scan slower, or "
        "sample faster)"
    )


def check_interference(path: Path, t: Array, w: NDArray[np.complex128]) -> None:
    """Raise InputError if spikes are too many, or too long, to be left out of a file's signal.

    `t` (n,) s, `w` (n,). Longer bursts are detected by size: more than three times the largest
    value that the signal keeps for LASTING. Smaller bursts cannot be distinguished from a weld.
    """
    spikes = find_spikes(w)
    rest = np.abs(w[~spikes] - np.median(w[~spikes].real) - 1j * np.median(w[~spikes].imag))
    size = min(2 * int(LASTING / max(compute_period(t), 1e-9)) + 1, rest.size)
    burst = np.zeros(t.size, bool)
    burst[~spikes] = rest > 3.0 * np.max(median_filter(rest, size=size, mode="nearest"))
    count, bursts = int(np.count_nonzero(spikes)), int(np.count_nonzero(burst))
    if bursts or count > MOST * t.size:
        raise InputError(
            f"{path}: the signal contains {count + bursts} spikes, the first at "
            f"{t[spikes | burst][0]:.2f} s, {bursts} of them in bursts of three samples or more; "
            f"valid: single ones in at most {MOST:.0%} of the {t.size} samples, which are left "
            "out; shield the probe's cable, filter the signal in the instrument, or remove these "
            "rows"
        )
