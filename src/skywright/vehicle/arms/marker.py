"""Where marker and pipe are, from the camera's or motion capture's samples of them.

A camera sample is put into W with the estimated platform pose, and averaged there: the marker
stands still or moves slowly. The arm's reference goes back from W with the same pose, so that an
error of localisation does not reach the hand (only its change since the image does).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.core.rotations import mat_mat, mat_vec, orthonormalise
from skywright.core.scratch import local
from skywright.vehicle.arms.joints import ArmComponent
from skywright.vehicle.arms.ports import (
    Marker,
    MarkerCapture,
    MarkerImage,
    PipeCapture,
    TrackedPipe,
)
from skywright.vehicle.bus import Clock, Estimate
from skywright.vehicle.component import Out, helper

AVERAGE = 0.15
"""s, over which samples are averaged."""
PIPE_SAMPLES = 100.0
"""Of a pipe: it stands still, and should it not, the mean has followed it after some seconds."""
NEVER = 1e3  # s, age of a marker that was not seen yet


class MarkerEstimate(ArmComponent):
    """Fills Marker: by the camera, or without one by motion capture."""

    slot = "estimate"

    def build(self, me: Any, table: Any, context: Any) -> None:
        """No marker was seen yet."""
        marker = context.records[Marker, ""][0]
        marker["R_WM"], marker["marker_age"] = np.eye(3), NEVER

    @staticmethod
    def step(
        clock: Clock,
        est: Estimate,
        image: MarkerImage | None,
        capture: MarkerCapture | None,
        marker: Out[Marker],
    ) -> None:
        marker.marker_age += clock.dt
        p, R = local(3), local(3, 3)
        if image is not None:
            if image.fresh > 0.0:
                mat_vec(est.R_WB, image.p_BM, p)
                for a in range(3):
                    p[a] += est.p_WB[a]
                mat_mat(est.R_WB, image.R_BM, R)
                take_marker(marker, p, R)
        elif capture is not None and capture.fresh > 0.0:
            take_marker(marker, capture.p_WM, capture.R_WM)


@helper
def take_marker(marker: Any, p: Any, R: Any) -> None:
    """Average a sample; the first one after a while is taken as it is."""
    gain = 1.0 if marker.marker_age > 1.0 else 1.0 - math.exp(-marker.marker_age / AVERAGE)
    marker.marker_age = 0.0
    for a in range(3):
        marker.p_WM[a] += gain * (p[a] - marker.p_WM[a])
        for c in range(3):
            marker.R_WM[a, c] += gain * (R[a, c] - marker.R_WM[a, c])
    orthonormalise(marker.R_WM)


class PipeEstimate(ArmComponent):
    """Fills TrackedPipe: the running mean of the samples of a tracked pipe."""

    slot = "estimate"

    def build(self, me: Any, table: Any, context: Any) -> None:
        """No sample came yet."""
        context.records[TrackedPipe, ""]["R_WP"] = np.eye(3)

    @staticmethod
    def step(sample: PipeCapture | None, pipe: Out[TrackedPipe]) -> None:
        if sample is None or sample.fresh == 0.0:
            return
        pipe.pipe_samples = min(pipe.pipe_samples + 1.0, PIPE_SAMPLES)
        for a in range(3):
            pipe.p_WP[a] += (sample.p_WP[a] - pipe.p_WP[a]) / pipe.pipe_samples
            for c in range(3):
                pipe.R_WP[a, c] += (sample.R_WP[a, c] - pipe.R_WP[a, c]) / pipe.pipe_samples
        orthonormalise(pipe.R_WP)
