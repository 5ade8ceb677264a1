"""Where the marker is that hands are led to, by the camera's or motion capture's samples of it.

A camera sample is put into W with the estimated platform pose, and averaged there: the marker
stands still or moves slowly. The arm's reference goes back from W with the same pose, so that an
error of localisation does not reach the hand (only its change since the image does).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from skywright.core.rotations import mat_mat, mat_vec
from skywright.core.scratch import local
from skywright.description.world.things import find_marker
from skywright.vehicle.arms.joints import ArmComponent
from skywright.vehicle.arms.ports import Marker, MarkerImage
from skywright.vehicle.bus import Clock, Estimate
from skywright.vehicle.component import Component, Out
from skywright.vehicle.targets import CARRIED, NEVER, Target, take_sample


class MarkerEstimate(ArmComponent):
    """Fills Marker: by the camera, or without one by motion capture."""

    slot = "estimate"

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for a robot with compliant arms; it follows the world's first marker."""
        for component in super().wanted(context):
            name = find_marker(context.world.things)
            component.ports = {"target": f"{name} target"}
            yield component

    def build(self, me: Any, table: Any, context: Any) -> None:
        """No marker has been measured yet."""
        start = context.records[Marker, ""][0]
        start["R_WO"], start["age"] = np.eye(3), NEVER

    @staticmethod
    def step(
        clock: Clock,
        est: Estimate,
        image: MarkerImage | None,
        target: Target | None,
        found: Out[Marker],
    ) -> None:
        found.age += clock.dt
        p, R = local(3), local(3, 3)
        if image is not None:
            if image.fresh > 0.0:
                mat_vec(est.R_WB, image.p_BM, p)
                for a in range(3):
                    p[a] += est.p_WB[a]
                mat_mat(est.R_WB, image.R_BM, R)
                take_sample(found, p, R, CARRIED)
        elif target is not None:
            found.age, found.samples = target.age, target.samples
            for a in range(3):
                found.p_WO[a] = target.p_WO[a]
                for c in range(3):
                    found.R_WO[a, c] = target.R_WO[a, c]
