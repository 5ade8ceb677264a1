"""Estimated position of the datum mark, from the images of the probe's camera.

Each image is transformed to W with the estimated pose of the tip. The surface is found and worked
on with the same pose, so a constant error of it shifts mark, touches and work alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Vec3
from skywright.core.rotations import mat_vec
from skywright.core.scratch import local
from skywright.description.world.datum import find_seen_datum
from skywright.vehicle.bus import Estimate
from skywright.vehicle.component import Component, Out, Output, Recorded
from skywright.vehicle.readings import DatumImage


class DatumMark(Output):
    """Sums over the images of the datum mark; a difference gives the mean over an interval."""

    sum_W: Vec3  # m, sum of the measured positions
    images: float


class DatumEstimate(Component):
    """Fills DatumMark."""

    slot = "estimate"

    columns = (
        Recorded("datum_sum_W", DatumMark, "sum_W", "m", "sum of where images had the datum mark"),
        Recorded("datum_images", DatumMark, "images", "", "number of images of the datum mark"),
    )

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with a camera at the probe have it, in worlds with a datum."""
        if find_seen_datum(context.robot, context.world):
            yield cls("datum")

    @staticmethod
    def step(est: Estimate, image: DatumImage, mark: Out[DatumMark]) -> None:
        if image.fresh == 0.0:
            return
        mark.images += 1.0
        p = local(3)
        mat_vec(est.R_WT, image.p_TM, p)
        for a in range(3):
            mark.sum_W[a] += est.p_WT[a] + p[a]
