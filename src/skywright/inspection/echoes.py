"""Find echoes in an A-scan: time, height and distance between them."""

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import hilbert

from skywright.core.arrays import Array, Mask
from skywright.errors import InputError
from skywright.inspection.calibration import robust_std
from skywright.models.peaks import find_vertex
from skywright.models.ultrasonic import compute_pulse_width

SIDE = 1.5
"""Half width of the correlation window of an echo, in pulse lengths (2 Pulse.width)."""


class Pulse(NamedTuple):
    """Properties of probe and instrument that the processing uses."""

    frequency: float  # Hz
    bandwidth: float  # at -6 dB, divided by the frequency
    rate: float  # Hz, of the samples
    gate_start: float  # s, after the transmitter's pulse
    full_scale: float  # FSH, at which the converter saturates

    @property
    def width(self) -> float:
        """Standard deviation (s) of the pulse's envelope."""
        return compute_pulse_width(self.frequency, self.bandwidth)

    @property
    def first_sample(self) -> int:
        """Index of the first sample in the gate."""
        return math.ceil(self.gate_start * self.rate)

    @property
    def rms_frequency(self) -> float:
        """Rms frequency (Hz), which determines the timing uncertainty."""
        return math.hypot(self.frequency, 0.5 / math.pi / self.width)


class FoundEchoes(NamedTuple):
    """Echoes in one A-scan, in order of time."""

    times: tuple[float, ...]  # s, of the envelope's peaks
    amplitudes: tuple[float, ...]  # FSH
    noise: float  # FSH, robust standard deviation of the samples outside the echoes
    saturated: bool  # a sample from the gate on reaches the converter's full scale
    envelope: Array  # (n,) FSH, of the A-scan


def find_echoes(ascan: Array, pulse: Pulse, threshold: float, most: int = 4) -> FoundEchoes:
    """Return the first `most` peaks of the envelope (at least `threshold`, FSH) from the gate on.

    `ascan` is (n,) FSH. Raises InputError if it is shorter than its gate or not finite.
    """
    x = np.asarray(ascan, float)
    first = pulse.first_sample
    if x.ndim != 1 or x.size <= first + 8 or not np.all(np.isfinite(x)):
        raise InputError(
            f"A-scan: {x.size} samples; valid: finite ones, more than the {first} before the gate"
        )
    envelope = np.abs(hilbert(x))
    times, heights, taken = _list_peaks(envelope, pulse, threshold, most)
    rest = x[~taken]
    noise = robust_std(rest) if rest.size > 8 else 0.0
    saturated = bool(np.any(np.abs(x[first:]) >= 0.995 * pulse.full_scale))
    return FoundEchoes(times, heights, noise, saturated, envelope)


def list_more_times(found: FoundEchoes, pulse: Pulse, threshold: float, most: int) -> list[float]:
    """Return the times (s) of the first `most` echoes above another `threshold` (FSH).

    `found` is the result of `find_echoes` for the same A-scan, whose envelope it contains.
    """
    return list(_list_peaks(found.envelope, pulse, threshold, most)[0])


def _list_peaks(
    envelope: Array, pulse: Pulse, threshold: float, most: int
) -> tuple[tuple[float, ...], tuple[float, ...], Mask]:
    """Return times (s) and heights of the first `most` peaks, and the mask of samples in peaks.

    The samples before the gate count as taken.
    """
    n, first, reach = envelope.size, pulse.first_sample, max(int(2.0 * pulse.width * pulse.rate), 1)
    left = envelope.copy()
    left[:first] = 0.0
    times, heights, taken = [], [], np.zeros(n, bool)
    taken[:first] = True
    for _ in range(2 * most):
        i = int(np.argmax(left))
        if left[i] < threshold:
            break
        a, b = max(i - 2 * reach, 0), min(i + 2 * reach + 1, n)
        left[a:b] = 0.0
        taken[a:b] = True
        inside = 0 < i < n - 1
        # the flank of a larger echo or the transmitter's tail is not a peak
        if not inside or envelope[i] < envelope[i - 1] or envelope[i] < envelope[i + 1]:
            continue
        times.append((i + find_vertex(envelope, i)) / pulse.rate)
        heights.append(float(envelope[i]))
    order = sorted(range(len(times)), key=times.__getitem__)[:most]
    return tuple(times[i] for i in order), tuple(heights[i] for i in order), taken


def measure_delay(ascan: Array, pulse: Pulse, first: float, second: float) -> float:
    """Return the delay (s) from the echo at `first` (s) to the echo at `second` (s).

    The delay is that of the largest correlation of the two echoes, to a fraction of a sample. The
    autocorrelation of a pulse has its next maximum one period away, at half the height: only the
    largest is used.
    """
    half = max(round(SIDE * 2.0 * pulse.width * pulse.rate), 4)
    a, b = round(first * pulse.rate), round(second * pulse.rate)
    lag = math.ceil(0.75 * pulse.rate / pulse.frequency)
    x = np.asarray(ascan, float)
    one = _cut(x, a - half, a + half + 1)
    two = _cut(x, b - half - lag, b + half + 1 + lag)
    correlation = np.correlate(two, one, "valid")
    i = int(np.argmax(correlation))
    return (b - a + i - lag + find_vertex(correlation, i)) / pulse.rate


def compare_shapes(ascan: Array, pulse: Pulse, first: float, delay: float, noise: float) -> float:
    """Return the correlation coefficient of the echo at `first` (s) and the one `delay` (s) later.

    The energy of `noise` (FSH, rms) is subtracted from that of the echoes. Echoes of one wall have
    the same shape and give 1. If two walls differ by about half a wavelength, parts of their echoes
    cancel in one echo and add in the next.
    """
    half = max(round(SIDE * 2.0 * pulse.width * pulse.rate), 4)
    x = np.asarray(ascan, float)
    cuts = [_cut(x, i - half, i + half + 1) for i in
            (round(first * pulse.rate), round((first + delay) * pulse.rate))]  # fmt: skip
    still = noise**2 * (2 * half + 1)
    energies = [max(float(c @ c) - still, 1e-30) for c in cuts]
    return float(cuts[0] @ cuts[1]) / math.sqrt(energies[0] * energies[1])


def compute_timing_std(pulse: Pulse, amplitude: float, noise: float) -> float:
    """Return the standard deviation (s) of one echo's time in white noise: the Cramer-Rao bound.

    sigma = 1 / (2 pi f_rms sqrt(E / s^2)), with E the sum of the pulse's squared samples and s the
    `noise`. `amplitude` and `noise` have the same unit.
    """
    energy = 0.5 * amplitude**2 * math.sqrt(math.pi) * pulse.width * pulse.rate
    return noise / (2 * math.pi * pulse.rms_frequency * math.sqrt(max(energy, 1e-30)))


def _cut(x: Array, a: int, b: int) -> Array:
    """Return x[a:b], with zeros outside x."""
    out = np.zeros(b - a)
    low, high = max(a, 0), min(b, x.size)
    if low < high:
        out[low - a : high - a] = x[low:high]
    return out
