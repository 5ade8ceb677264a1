"""Guards: what ends a mission tick early."""

from __future__ import annotations

import numpy as np

NOT_FINITE, CONTACT_MADE, CONTACT_LOST, COLLISION, LOST_CONTROL = 1, 2, 4, 8, 16

ERROR_MAX = 0.8  # m between estimate and nominal pose: the robot no longer follows
FIX_AGE_MAX = 1.0  # s without a sample of the localisation: nobody knows where the robot is
UP_MIN = 0.3  # cosine of the tilt below which it has tipped over

GUARD = np.dtype(
    [
        ("mask", np.int64),  # which of the above end a mission tick
        ("fired", np.int64),
        ("phase", np.int64),  # written into samples
        ("sample_every", np.int64),  # control ticks
        ("truth_estimator", np.int64),
        # lift-off channel of the eddy-current instrument: w_l = axis . (w - contact point)
        ("lift_axis", np.float64, 2),
        ("lift_threshold", np.float64),
        ("last_fix", np.float64),  # s, when the localisation was last heard of
        ("in_contact", np.int64),  # by the instrument
        ("collision_limit", np.float64),  # N
        ("stick", np.float64, 3),  # operator's input, written into samples
        ("button", np.float64),
    ]
)
"""Which guards are armed and which fired, and how samples are taken."""
