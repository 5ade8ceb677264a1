"""A trajectory: positions and optional orientations at irregular times."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from skywright.core.arrays import Array, Mask
from skywright.errors import InputError
from skywright.recordings.period import compute_period

MAX_DROPPED = 0.5
MAX_TIME = 1e11  # s, from any origin
MAX_SPAN = 1e5  # s, of a recording: 28 h
MAX_POSITION = 1e8
"""m; larger values are no positions on Earth."""


class Trajectory(NamedTuple):
    """A cleaned trajectory of a point or body in its own frame and clock, in order of time."""

    name: str
    t: Array  # (n,) s, strictly increasing
    p: Array  # (n, 3) m
    q: Array | None = None  # (n, 4) wxyz, unit: the body's orientation in the same frame
    notes: tuple[str, ...] = ()

    @property
    def rate(self) -> float:
        """Number of samples per second outside of gaps; 0 for one sample."""
        return 1.0 / compute_period(self.t) if len(self.t) > 1 else 0.0

    @property
    def duration(self) -> float:
        """Time (s) from the first to the last sample."""
        return float(self.t[-1] - self.t[0])

    def cut(self, start: float, stop: float) -> Trajectory:
        """Return the samples from `start` to `stop` (s), ends included."""
        keep = (self.t >= start) & (self.t <= stop)
        q = None if self.q is None else self.q[keep]
        return self._replace(t=self.t[keep], p=self.p[keep], q=q)


def find_gap_limit(t: Array, least: float = 0.0) -> float:
    """Return the interval (s) above which a pause is a gap: three times the usual one, at least
    `least`.

    The usual one is the 90th percentile: a total station's intervals vary.
    """
    return max(3.0 * float(np.quantile(np.diff(t), 0.9)), least) if len(t) > 1 else least


def interpolate_position(traj: Trajectory, t: Array, max_gap: float) -> Array:
    """Return positions (m, 3) at times `t`, linear; NaN outside and within gaps longer than
    `max_gap`."""
    out = np.stack([np.interp(t, traj.t, traj.p[:, i]) for i in range(3)], axis=1)
    out[~find_covered(traj.t, t, max_gap)] = np.nan
    return out


def find_covered(samples: Array, t: Array, max_gap: float) -> Mask:
    """Whether each of `t` is on a sample or between two at most `max_gap` apart."""
    after = np.clip(np.searchsorted(samples, t, side="left"), 1, max(len(samples) - 1, 1))
    if len(samples) < 2:
        return np.asarray(np.isin(t, samples))
    step = samples[after] - samples[after - 1]
    on = (t == samples[after]) | (t == samples[after - 1])
    inside = (t >= samples[0]) & (t <= samples[-1])
    return np.asarray(inside & ((step <= max_gap) | on))


def interpolate_rotation(traj: Trajectory, t: Array) -> Array | None:
    """Return rotation matrices (m, 3, 3) of the nearest orientations in time; None without
    orientations.

    The orientations are not interpolated: at a camera's rate the difference is negligible, and a
    flip of the quaternion's sign or a lost sample has no effect.
    """
    if traj.q is None:
        return None
    after = np.clip(np.searchsorted(traj.t, t), 1, max(len(traj.t) - 1, 1))
    near = np.where(t - traj.t[after - 1] < traj.t[after] - t, after - 1, after)
    return np.asarray(Rotation.from_quat(np.roll(traj.q[near], -1, axis=1)).as_matrix())


def drop_repeats(traj: Trajectory) -> Trajectory:
    """Return the trajectory without samples whose position and orientation equal the previous
    ones.

    A program that writes faster than the sensor measures repeats the last sample. A repeated sample
    is no measurement at its time.
    """
    new = np.any(np.diff(traj.p, axis=0) != 0.0, axis=1)
    if traj.q is not None:
        new |= np.any(np.diff(traj.q, axis=0) != 0.0, axis=1)
    keep = np.concatenate([[True], new])
    q = None if traj.q is None else traj.q[keep]
    return traj._replace(t=traj.t[keep], p=traj.p[keep], q=q)


def compute_velocity(traj: Trajectory, window: float, max_gap: float) -> tuple[Array, Array]:
    """Return times (m,) and velocities (m, 3) from displacements over about `window` seconds.

    Each velocity is the mean over the samples nearest to `window` apart, stamped in the middle.
    """
    ahead = np.searchsorted(traj.t, traj.t + window)
    first = np.flatnonzero(ahead < len(traj.t))
    last = ahead[first]
    span = traj.t[last] - traj.t[first]
    good = (span > 0) & (span <= window + max_gap)
    first, last, span = first[good], last[good], span[good]
    v = (traj.p[last] - traj.p[first]) / span[:, None]
    return 0.5 * (traj.t[first] + traj.t[last]), v


def remove_spikes(traj: Trajectory, least: float = 0.05) -> Trajectory:
    """Return the trajectory without samples that deviate implausibly from the line between their
    neighbours.

    The limit is eight times the usual distance, `least` (m) at least. Of a run of such samples the
    worst is removed first, because it makes its neighbours look wrong too.
    """
    for _ in range(10):
        t, p = traj.t, traj.p
        if len(t) < 8:
            return traj
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        off = np.linalg.norm(p[1:-1] - p[:-2] - share * (p[2:] - p[:-2]), axis=1)
        limit = max(8.0 * float(np.median(off)), least)
        wide = np.concatenate([[0.0, 0.0], off, [0.0, 0.0]])
        peak = (off > limit) & (off >= wide[1:-3]) & (off >= wide[3:-1])
        peak &= (off >= wide[:-4]) & (off >= wide[4:])
        if not peak.any():
            return traj
        keep = np.concatenate([[True], ~peak, [True]])
        q = None if traj.q is None else traj.q[keep]
        traj = traj._replace(t=t[keep], p=p[keep], q=q)
    return traj


def clean(
    path: Path, t: Array, p: Array, q: Array | None, notes: list[str], lines: list[int] | None
) -> Trajectory:
    """Drop invalid samples, sort, drop duplicate times; note each, or raise InputError."""
    with np.errstate(invalid="ignore", over="ignore"):
        good = (np.abs(t) < MAX_TIME) & np.all(np.abs(p) < MAX_POSITION, axis=1)
        if q is not None:
            norm = np.linalg.norm(q, axis=1)
            upright = (norm > 0.5) & (norm < 2.0)
            if 2 * int(np.count_nonzero(good & upright)) < max(int(np.count_nonzero(good)), 1):
                notes.append("orientation columns contain no valid quaternions: ignored")
                q = None
            else:
                good &= upright
    bad = int(np.count_nonzero(~good))
    if bad > MAX_DROPPED * len(t) or len(t) - bad < 2:
        where = ""
        if bad and lines is not None:
            where = f" (line {lines[int(np.argmax(~good))]} is the first that is not)"
        raise InputError(
            f"{path}: {len(t) - bad} of {len(t)} rows hold a time and a position{where}; at least "
            "2 and half of them must"
        )
    if bad:
        at = f" (line {lines[int(np.argmax(~good))]} first)" if lines is not None else ""
        notes.append(f"{bad} rows without a number in every column dropped{at}")
    t, p = t[good], p[good]
    q = None if q is None else q[good] / np.linalg.norm(q[good], axis=1, keepdims=True)
    if np.any(np.diff(t) < 0):
        notes.append("times were not in order: sorted")
        order = np.argsort(t, kind="stable")
        t, p, q = t[order], p[order], None if q is None else q[order]
    keep = np.concatenate([[True], np.diff(t) > 0])
    if not keep.all():
        notes.append(f"{int(np.count_nonzero(~keep))} rows with a duplicate time dropped")
        t, p, q = t[keep], p[keep], None if q is None else q[keep]
    if len(t) < 2:
        raise InputError(f"{path}: all rows have the same time {t[0]:g} s; at least 2 are needed")
    if t[-1] - t[0] > MAX_SPAN:
        raise InputError(
            f"{path}: its times span {t[-1] - t[0]:.3g} s ({t[0]:.10g} to {t[-1]:.10g} s); at most "
            f"{MAX_SPAN:g} s are possible: see the column's unit, or cut the file"
        )
    return Trajectory(path.name, t, p, q, tuple(notes))
