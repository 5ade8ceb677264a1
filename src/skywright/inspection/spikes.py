"""Spikes of electrical interference in a probe's signal, told from what a probe can measure.

A coil averages over its FOOTPRINT, so a sample of a real signal resembles its neighbours as long as
several are taken within one footprint. A spike differs from the neighbours on both sides: the
median of three on either side is the expected value (a Hampel filter, Hampel, J. Am. Stat. Assoc.
69, 383 (1974)), which a passing ramp, an edge or another spike nearby does not move.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from skywright.core.arrays import Array, Mask
from skywright.errors import InputError

FOOTPRINT = 0.0035
"""m, over which a coil averages."""
LEAST_SAMPLES = 4.0
"""Samples a footprint from which a single deviating one is a spike: an edge of the signal takes
two of them."""
SIDE = 3
"""Samples on either side; a median of six bears two spikes among them."""
LASTING = 0.5
"""s; what a probe reads in air or in contact lasts longer than a burst of interference."""
MOST = 0.1
"""Share of spikes in a signal above which what is left is not trusted."""
SIGMAS = 6.0
"""Least deviation of a spike, in standard deviations of what samples deviate from neighbours."""
SPREAD = 3.0
"""Least deviation of a spike, in deviations of the neighbours among themselves."""


def find_spikes(x: NDArray[Any]) -> Mask:
    """Flag (n,) the one or two successive samples of `x` that stand out of their neighbours.

    `x` is (n,) complex or (n, k), of a signal or of positions. What is found is taken away and the
    rest looked at again, as spikes may lie close together.
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
    # of a narrow peak both of the next samples are high as well, of a spike one is not
    spread = np.maximum(
        np.sort(apart, axis=1)[:, SIDE], np.minimum(apart[:, SIDE - 1], apart[:, SIDE])
    )
    steps = np.abs(np.diff(x, axis=0))
    resolution = float(np.min(steps, where=steps > 0, initial=np.max(steps)))
    noise = SIGMAS * max(1.4826 * float(np.median(off)), 0.5 * resolution)
    return np.asarray(off > np.maximum(noise, SPREAD * spread))


def count_per_footprint(t: Array, p: Array) -> float:
    """Return how many samples are taken while the probe moves by its footprint, at its fastest.

    `t` (n,) s, `p` (n, 3) m; the speed is that over half a second, as a tracker's noise is faster.
    """
    step = float(np.median(np.diff(t))) if t.size > 1 else 0.0
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
    """Return the spikes (n,) to leave out of a scan, and a note.

    `t` (n,) s, `w` (n,), `p` (n, 3) m; `lifted` (n,) flags the samples that lift-off explains,
    which are none: a probe that hops for one sample is in the air indeed. Where too few samples
    are taken within a footprint, none is left out.
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
    """Raise InputError where spikes are too many, or too long, to be left out of a file's signal.

    `t` (n,) s, `w` (n,). Longer ones are told by their size: three times what the signal keeps for
    LASTING. Those that are smaller cannot be told from a weld.
    """
    spikes = find_spikes(w)
    rest = np.abs(w[~spikes] - np.median(w[~spikes].real) - 1j * np.median(w[~spikes].imag))
    size = min(2 * int(LASTING / max(float(np.median(np.diff(t))), 1e-9)) + 1, rest.size)
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
