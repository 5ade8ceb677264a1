"""Common functions of the oracle's judges: intervals of a recording, rotations, contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ON_GROUND = ("start", "take_off", "land")
SATURATED_S = 0.5


def list_spans(told: dict[str, Any], *names: str, starts: str = "") -> list[tuple[float, float]]:
    """Return (from, to) s of the phases with these names, or whose name begins with `starts`."""
    return [
        (p["start_s"], p["end_s"])
        for p in told["phases"]
        if p["name"] in names or (starts and p["name"].startswith(starts))
    ]


def pick(s: Any, spans: list[tuple[float, float]]) -> Mask:
    """Return the mask (n,) of the samples within any of these intervals."""
    out = np.zeros(len(s), dtype=bool)
    for a, b in spans:
        out |= (s["t"] >= a) & (s["t"] < b)
    return out


def turn(q: Array, v: Any) -> Array:
    """Return v (3,) rotated by quaternions (n, 4), w first: (n, 3)."""
    w, u = q[:, :1], q[:, 1:]
    v = np.broadcast_to(np.asarray(v, float), u.shape)
    c = 2.0 * np.cross(u, v)
    return np.asarray(v + w * c + np.cross(u, c))


def find_tilt(q: Array) -> Array:
    """Return the angle (n,) rad between the body's z and the vertical."""
    return np.asarray(np.arccos(np.clip(turn(q, [0.0, 0.0, 1.0])[:, 2], -1.0, 1.0)))


def find_heading(q: Array) -> Array:
    """Return the heading (n,) rad of the body's x."""
    ahead = turn(q, [1.0, 0.0, 0.0])
    return np.asarray(np.arctan2(ahead[:, 1], ahead[:, 0]))


def rms(x: Array) -> float:
    """Return the rms of values (n,) or of the norms of rows (n, 3)."""
    squares = x**2 if x.ndim == 1 else np.sum(x**2, axis=1)
    return float(np.sqrt(np.mean(squares)))


def find_longest(on: Mask, dt: float) -> float:
    """Return the longest time (s) without a break in `on`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    return dt * float(np.max(edges[1::2] - edges[::2], initial=0))


def tell_touches(told: dict[str, Any], s: Any) -> list[str]:
    """Return a failure if an unintended contact occurred in flight."""
    flying = ~pick(s, list_spans(told, *ON_GROUND))
    return ["touched something"] if np.any(s["f_collision"][flying] > 0.0) else []


def tell_saturation(told: dict[str, Any], s: Any) -> list[str]:
    """Return a failure if rotors were saturated for longer than gusts and touch-downs take.

    A robot that stands on its arms does not fly.
    """
    standing = pick(s, list_spans(told, *ON_GROUND)) & (s["f_collision"] > 0.0)
    dt = float(np.median(np.diff(s["t"])))
    spell = find_longest((s["saturated"] > 0.0) & ~standing, dt)
    return [f"saturated for {spell:.2f} s"] if spell > SATURATED_S else []


def tell_stall(s: Any) -> list[str]:
    """Return a failure if a servo had its stall torque for longer than SATURATED_S."""
    if "servo_load" not in s.dtype.names:  # old recordings have no servo torques
        return []
    spell = find_longest(s["servo_load"] > 0.995, float(np.median(np.diff(s["t"]))))
    return [f"a servo stalled for {spell:.2f} s"] if spell > SATURATED_S else []
