"""Errors of a trajectory against a reference: absolute (ATE) and relative (RPE).

Definitions as in Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012:
the absolute error is the distance after alignment, the relative one that of displacements over a
fixed time.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.localisation.calibration import calibrate
from skywright.models.localisation.frame_alignment import (
    LEAST_POINTS,
    FrameAlignment,
    estimate_similarity,
)
from skywright.models.localisation.time_alignment import LEAST_OVERLAP, estimate_offset
from skywright.models.localisation.trajectory import (
    Trajectory,
    find_gap_limit,
    interpolate_position,
    interpolate_rotation,
)

ALIGNMENTS = ("rigid", "similarity", "none")
FIT_SAMPLES = 3000
"""Maximum number of samples for the refinement of a reference's clock."""


class Statistics(NamedTuple):
    """Statistics of the magnitudes of errors."""

    rms: float
    mean: float
    median: float
    max: float
    samples: int


class TrajectoryError(NamedTuple):
    """Errors of a trajectory against its reference."""

    t: Array  # (n,) s, of the trajectory
    error: Array  # (n,) m, distance after alignment
    p: Array  # (n, 3) m, aligned positions in the reference's frame
    p_ref: Array  # (n, 3) m
    frame: FrameAlignment | None  # None: no alignment
    absolute: Statistics  # m
    relative: Statistics | None  # m over `over` seconds; None if too short
    relative_angle: Statistics | None  # rad; None unless both have orientations
    over: float  # s
    time_offset: float  # s: reference's clock = trajectory's clock + offset


def compute_statistics(sizes: Array) -> Statistics:
    """Return statistics of magnitudes (n,)."""
    return Statistics(
        math.sqrt(float(np.mean(sizes**2))), float(np.mean(sizes)), float(np.median(sizes)),
        float(np.max(sizes)), len(sizes),
    )  # fmt: skip


def compute_error(
    traj: Trajectory,
    reference: Trajectory,
    *,
    time_offset: float = 0.0,
    alignment: str = "rigid",
    over: float = 1.0,
) -> TrajectoryError:
    """Compare a trajectory with a reference at the trajectory's times.

    The reference is interpolated, but not across gaps. `alignment`: rigid (best rotation and
    offset), similarity (also scale), or none. Raises InputError without overlap in time.
    """
    if alignment not in ALIGNMENTS:
        raise InputError(f"unknown alignment {alignment!r}; valid: {', '.join(ALIGNMENTS)}")
    gap = find_gap_limit(reference.t, 0.1)
    at = traj.t + time_offset
    p_ref = interpolate_position(reference, at, gap)
    known = np.isfinite(p_ref[:, 0])
    if known.sum() < max(LEAST_POINTS, 2):
        raise InputError(
            f"{reference.name}: does not overlap {traj.name} in time: {reference.t[0]:.2f} "
            f"to {reference.t[-1]:.2f} s and {at[0]:.2f} to {at[-1]:.2f} s"
        )
    t, p, p_ref = traj.t[known], traj.p[known], p_ref[known]
    frame = None
    if alignment != "none":
        frame = estimate_similarity(p, p_ref, with_scale=alignment == "similarity")
        p = frame.apply(p)
    error = np.linalg.norm(p - p_ref, axis=1)
    ahead = np.searchsorted(t, t + over - 1e-9)
    first = np.flatnonzero(ahead < len(t))
    last = ahead[first]
    close = np.abs(t[last] - t[first] - over) < 0.1 * over
    first, last = first[close], last[close]
    relative = angle = None
    if len(first):
        moved = (p[last] - p[first]) - (p_ref[last] - p_ref[first])
        relative = compute_statistics(np.linalg.norm(moved, axis=1))
        q = None if traj.q is None else traj.q[known]
        turn = interpolate_rotation(traj._replace(t=t, p=p, q=q), t)
        turn_ref = interpolate_rotation(reference, at[known])
        if turn is not None and turn_ref is not None:
            if frame is not None:
                turn = frame.rotation @ turn
            angle = compute_statistics(_relative_angle(turn, turn_ref, first, last))
    return TrajectoryError(
        t, error, p, p_ref, frame, compute_statistics(error), relative, angle, over, time_offset
    )


def _relative_angle(a: Array, b: Array, first: NDArray[Any], last: NDArray[Any]) -> Array:
    """Return relative rotation errors (k,) rad, without a fixed rotation between the bodies."""
    A, B = Rotation.from_matrix(a), Rotation.from_matrix(b)
    mounting = (B.inv() * A)[:: max(1, len(a) // 2000)].mean()
    A = A * mounting.inv()
    return np.asarray(((B[first].inv() * B[last]).inv() * (A[first].inv() * A[last])).magnitude())


def judge(
    traj: Trajectory, reference: Trajectory, compare: str, offset: float | None, notes: list[str]
) -> TrajectoryError:
    """Return errors against a reference; the clock offset is estimated unless given."""
    if offset is None:
        offset = 0.0
        if min(traj.duration, reference.duration) >= LEAST_OVERLAP:
            time = estimate_offset(traj, reference)
            if time.note:
                notes.append(time.note)
            if time.peak > 0.0:
                offset = _refine_offset(traj, reference, time.offset)
    return compute_error(traj, reference, time_offset=offset, alignment=compare)


def _refine_offset(traj: Trajectory, reference: Trajectory, start: float) -> float:
    """Return the clock offset at the middle of the trajectory by the drift-aware alignment.

    Minimizing the absolute error instead would bias the offset if the trajectory drifts.
    """
    every = max(1, len(traj.t) // FIT_SAMPLES)
    q = None if reference.q is None or traj.q is None else reference.q
    thin = traj._replace(t=traj.t[::every], p=traj.p[::every], q=None)
    try:
        c = calibrate(thin, reference._replace(q=q), start)
    except InputError:  # too few samples
        return start
    return c.time_offset + c.skew * (0.5 * float(traj.t[0] + traj.t[-1]) - c.epoch)
