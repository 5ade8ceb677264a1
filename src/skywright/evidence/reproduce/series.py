"""Evaluation of stored missions: phases, errors, smoothing, spectra."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt, welch
from scipy.spatial.transform import Rotation

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.evidence.reproduce.cache import Record

RATE = 100.0  # Hz, of samples


def cut(record: Record, *phases: str) -> dict[str, NDArray[Any]]:
    """Return the samples in phases of these names. Raises InputError if there are none."""
    wanted = [i for i, p in enumerate(record.info["phases"]) if p["name"] in phases]
    keep = np.isin(record.arrays["phase"], wanted)
    if not np.any(keep):
        reason = record.info.get("reason") or record.info["outcome"]
        raise InputError(f"the flight has no phase {' or '.join(phases)}: {reason}")
    return {k: v[keep] for k, v in record.arrays.items() if k != "watched"}


def read_metric(records: Sequence[Record], name: str) -> list[float]:
    """Return a metric of every flight. Raises InputError if a flight lacks it."""
    for record in records:
        if name not in record.info["metrics"]:
            reason = record.info.get("reason") or "not reached"
            raise InputError(f"a flight has no {name}: {reason}")
    return [float(record.info["metrics"][name]) for record in records]


def phase_time(record: Record, name: str) -> tuple[float, float]:
    """Return start and end (s) of the last phase of this name."""
    found = [p for p in record.info["phases"] if p["name"] == name]
    if not found:
        raise InputError(f"the flight has no phase {name}")
    return float(found[-1]["start_s"]), float(found[-1]["end_s"])


def along_surface(error: Array, normal: Array) -> Array:
    """Return the component (n, 3) of an error along the surface."""
    return np.asarray(error - np.sum(error * normal, axis=1)[:, None] * normal)


def tangential(s: dict[str, NDArray[Any]], what: str) -> Array:
    """Return the error (n, 3) m of `WT` or `WB` along the surface."""
    return along_surface(s[f"p_{what}"] - s[f"ref_p_{what}"], s["ref_normal_W"])


def attitude_error(s: dict[str, NDArray[Any]]) -> Array:
    """Return the rotation vector (n, 3) rad from the nominal to the actual platform attitude."""
    actual = Rotation.from_quat(np.roll(s["q_WB"], -1, axis=1))
    nominal = Rotation.from_quat(np.roll(s["ref_q_WB"], -1, axis=1))
    return np.asarray((nominal.inv() * actual).as_rotvec())


def smooth(values: Array, seconds: float) -> Array:
    """Return a moving mean over a duration, along the first axis, ends included."""
    n = max(round(seconds * RATE), 1)
    pad = [(n // 2, n - 1 - n // 2), *[(0, 0)] * (values.ndim - 1)]
    wide = np.pad(values, pad, mode="edge")
    total = np.cumsum(np.concatenate([np.zeros((1, *values.shape[1:])), wide]), axis=0)
    return np.asarray((total[n:] - total[:-n]) / n)


def spectrum(values: Array) -> tuple[Array, Array]:
    """Return frequencies (Hz) and power density of (n, 3), summed over axes (Welch, 2.56 s
    windows)."""
    found = welch(values - values.mean(axis=0), RATE, nperseg=min(256, len(values)), axis=0)
    frequency: Array = np.asarray(found[0], dtype=np.float64)
    power: Array = np.asarray(found[1], dtype=np.float64).sum(axis=1)
    return frequency, power


def band_rms(values: Array, low: float, high: float) -> float:
    """Return the rms of (n, 3) within a band (Hz)."""
    f, power = spectrum(values)
    inside = (f >= low) & (f < high)
    return float(np.sqrt(np.sum(power[inside]) * (f[1] - f[0])))


def ring_envelope(tip: Array, low: float, high: float) -> tuple[Array, Array]:
    """Return times and amplitude (m, rms over 0.25 s) of the tip's vibration within a band (Hz)."""
    sos = butter(2, [low, high], "band", fs=RATE, output="sos")
    size = np.linalg.norm(sosfiltfilt(sos, tip, axis=0), axis=1)
    n = 25
    starts = np.arange(0, len(size) - n + 1, 10)
    envelope: Array = np.array([np.sqrt(np.mean(size[i : i + n] ** 2)) for i in starts])
    times: Array = (starts + n / 2).astype(np.float64) / RATE
    return times, envelope


def ring_remaining(tip: Array, low: float, high: float) -> float:
    """Return the vibration (n, 3) at the end of a record relative to that at its start.

    The rms within a band (Hz) over the last 0.5 s relative to the first 0.5 s, without 0.05 s at
    the start and 0.2 s at the end (effects of the filter); inf: robot lost. A vibration that limits
    sustain does not grow, but remains.
    """
    if np.any(np.isnan(tip)):
        return float("inf")
    sos = butter(2, [low, high], "band", fs=RATE, output="sos")
    size = np.linalg.norm(sosfiltfilt(sos, tip, axis=0), axis=1)[5:-20]  # without end effects
    first, last = (np.sqrt(np.mean(part**2)) for part in (size[:50], size[-50:]))
    return float(last / first)


def ring_growth(tip: Array, low: float, high: float) -> float:
    """Return the growth rate (1/s) of the tip's vibration (n, 3); negative decays, inf: robot lost.

    It is the slope of the logarithm of the envelope from its peak to a twentieth of it; below, slow
    motion of the platform leaks through the filter. For a growing envelope it uses the whole time.
    """
    if np.any(np.isnan(tip)):
        return float("inf")
    t, envelope = ring_envelope(tip, low, high)
    t, envelope = t[:-3], envelope[:-3]  # the filter's end effects
    if envelope[-1] >= envelope[0]:
        return float(np.log(envelope[-1] / envelope[0]) / (t[-1] - t[0]))
    peak = int(np.argmax(envelope))
    t, envelope = t[peak:], envelope[peak:]
    faded = envelope < 0.05 * envelope[0]
    last = max(int(np.argmax(faded)), 3) if np.any(faded) else len(envelope)
    return float(np.polyfit(t[:last], np.log(np.maximum(envelope[:last], 1e-9)), 1)[0])
