"""Where the datum mark is, as the robot believes: the mean of what the probe's camera saw of it.

Each image is put into W with the estimated pose of the tip, by which the surface is found and
worked on too: what that pose is off by for good shifts mark, touches and work alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Vec3
from skywright.core.rotations import mat_vec
from skywright.core.scratch import local
from skywright.models.things.datum import find_datum
from skywright.vehicle.bus import Clock, Estimate
from skywright.vehicle.component import Component, Out, Output, Recorded
from skywright.vehicle.readings import DatumImage
from skywright.vehicle.targets import LOST, NEVER


class DatumMark(Output):
    """Where the datum mark is; the mean begins anew after LOST seconds without an image."""

    p_WM: Vec3  # m
    age: float  # s, since it was last seen
    images: float  # in the mean, 0: none came yet


class DatumEstimate(Component):
    """Fills DatumMark."""

    slot = "estimate"

    columns = (
        Recorded("datum_p_WM", DatumMark, "p_WM", "m", "datum mark, as the robot believes"),
        Recorded("datum_images", DatumMark, "images", "", "images of the datum in its mean"),
    )

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for a robot with a camera at its probe, where there is a datum."""
        probe = context.robot.probe
        if probe is not None and probe.camera is not None and find_datum(context.world):
            yield cls("datum")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """No image came yet."""
        context.records[DatumMark, ""][0]["age"] = NEVER

    @staticmethod
    def step(clock: Clock, est: Estimate, image: DatumImage, mark: Out[DatumMark]) -> None:
        mark.age += clock.dt
        if image.fresh == 0.0:
            return
        if mark.age > LOST:
            mark.images = 0.0
        mark.age = 0.0
        mark.images += 1.0
        p = local(3)
        mat_vec(est.R_WT, image.p_TM, p)
        for a in range(3):
            mark.p_WM[a] += (est.p_WT[a] + p[a] - mark.p_WM[a]) / mark.images
