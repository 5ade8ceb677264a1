"""Where marker and pipe are, from the camera's or motion capture's samples of them.

A camera sample is put into W with the estimated platform pose, and averaged there: the marker
stands still or moves slowly. The arm's reference goes back from W with the same pose, so that an
error of localisation does not reach the hand (only its change since the image does).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import mat_mat, mat_vec, orthonormalise

Record = Any

AVERAGE = 0.15
"""s, over which samples are averaged."""
PIPE_SAMPLES = 100.0
"""Of a pipe: it stands still, and should it not, the mean has followed it after some seconds."""


@njit(cache=True, error_model="numpy")
def estimate_marker(b: Record) -> None:
    """Fill arms.p_WM, R_WM and marker_age (s) from what was measured this tick."""
    arms, meas = b.arms, b.meas
    arms.marker_age += b.par.dt
    p, R = np.empty(3), np.empty((3, 3))
    if meas.marker_fresh > 0.0:
        mat_vec(b.est.R_WB, meas.p_BM, p)
        for a in range(3):
            p[a] += b.est.p_WB[a]
        mat_mat(b.est.R_WB, meas.R_BM, R)
    elif arms.marker_mocap > 0.0 and meas.mocap_fresh > 0.0:
        for a in range(3):
            p[a] = meas.p_WM[a]
            for c in range(3):
                R[a, c] = meas.R_WM[a, c]
    else:
        return
    # the first sample after a while is taken as it is
    gain = 1.0 if arms.marker_age > 1.0 else 1.0 - math.exp(-arms.marker_age / AVERAGE)
    arms.marker_age = 0.0
    for a in range(3):
        arms.p_WM[a] += gain * (p[a] - arms.p_WM[a])
        for c in range(3):
            arms.R_WM[a, c] += gain * (R[a, c] - arms.R_WM[a, c])
    orthonormalise(arms.R_WM)


@njit(cache=True, error_model="numpy")
def estimate_pipe(b: Record) -> None:
    """Fill arms.p_WP and R_WP, the running mean of the samples of a tracked pipe."""
    arms, meas = b.arms, b.meas
    if arms.pipe_mocap == 0.0 or meas.mocap_fresh == 0.0:
        return
    arms.pipe_samples = min(arms.pipe_samples + 1.0, PIPE_SAMPLES)
    for a in range(3):
        arms.p_WP[a] += (meas.p_WP[a] - arms.p_WP[a]) / arms.pipe_samples
        for c in range(3):
            arms.R_WP[a, c] += (meas.R_WP[a, c] - arms.R_WP[a, c]) / arms.pipe_samples
    orthonormalise(arms.R_WP)
