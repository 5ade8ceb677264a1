"""The onboard camera: it measures the pose of a marker, with noise, in its field of view.

Frame C: z along the optical axis, x to the right, y down. What a marker detector makes of an image
is modelled, not the image: bearings with a noise of angle, the distance with one in proportion to
it, the attitude with its own; and nothing outside the field of view, beyond the range, or seen too
much from the side. What stands in between is not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from skywright.core.record import Mat3, Record, Vec3
from skywright.core.rotations import exp_so3, mat_mat, mat_t_mat, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.description.robot.camera import Camera
from skywright.description.world.things import find_marker
from skywright.vehicle.arms.ports import MarkerImage
from skywright.vehicle.bus import Clock, MuJoCo, Truth
from skywright.vehicle.component import Component, Normal, Out, Recorded, Sensor, Streamed, helper
from skywright.vehicle.sensors._target_place import TargetPlace, fill_place, move_place
from skywright.vehicle.topics import BODY


class MarkerNoise(Normal):
    """Draws of one image of the marker."""

    stream = "camera"
    bearing: Vec3  # two bearings and the distance
    attitude: Vec3


class MarkerCamera(Sensor):
    """Fills MarkerImage at its own rate."""

    Table = Camera

    class Me(Record):
        place: TargetPlace
        p_BC: Vec3  # m
        R_BC: Mat3
        edge: float  # tangent of half the field of view
        range_max: float  # m
        side_min: float  # cosine of the slant beyond which the marker is not read
        sigma_bearing: float  # rad
        sigma_range: float  # of the distance
        sigma_R: float  # rad
        period: float  # s
        next: float  # s, next image

    streams = (
        Streamed(
            (
                Recorded("p_BM", MarkerImage, "p_BM", "m", "marker"),
                Recorded("q_BM", MarkerImage, "R_BM", "", "marker", rotation=True),
            ),
            "geometry_msgs/PoseStamped", BODY,
            {"pose.position": "p_BM", "pose.orientation": "q_BM"},
        ),
    )  # fmt: skip

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with a camera have one where there is a marker."""
        if context.robot.camera is not None and find_marker(context.world.things):
            yield cls("camera", context.robot.camera)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the camera's data and the marker's position."""
        fill_place(me.place, context, find_marker(context.world.things))
        me.p_BC[:], me.R_BC[:] = [table.x_m, table.y_m, table.z_m], table.rotation
        me.edge = math.tan(0.5 * math.radians(table.field_of_view_deg))
        me.range_max = table.range_max_m
        me.side_min = math.cos(math.radians(table.slant_max_deg))
        me.sigma_bearing, me.sigma_range = table.bearing_noise_rad, table.range_noise_fraction
        me.sigma_R, me.period = table.attitude_noise_rad, 1.0 / table.rate_hz

    def get_period(self, step: str, context: Any) -> float:
        """Called every tick: the step checks whether an image is due."""
        return 0.0

    @staticmethod
    def step(
        me: Me, clock: Clock, mj: MuJoCo, truth: Truth, draw: MarkerNoise, out: Out[MarkerImage]
    ) -> None:
        move_place(me.place, mj)
        if clock.t < me.next - 1e-9:
            return
        me.next += me.period
        d, p_B, p_C = local(3), local(3), local(3)
        R_WC, R_CM = local(3, 3), local(3, 3)
        for a in range(3):
            d[a] = me.place.p_WO[a] - truth.p_WB[a]
        mat_t_vec(truth.R_WB, d, p_B)
        for a in range(3):
            d[a] = p_B[a] - me.p_BC[a]
        mat_t_vec(me.R_BC, d, p_C)
        mat_mat(truth.R_WB, me.R_BC, R_WC)
        mat_t_mat(R_WC, me.place.R_WO, R_CM)
        if is_seen(me, p_C, R_CM):
            spoil_image(me, p_C, R_CM, draw, out)


@helper
def is_seen(me: Any, p_CM: Any, R_CM: Any) -> bool:
    """Whether a marker at p_CM (3,) m, z of R_CM its normal, is in view and not too slanted."""
    x, y, z = p_CM[0], p_CM[1], p_CM[2]
    if z <= 0.02 or abs(x) > me.edge * z or abs(y) > me.edge * z:
        return False
    distance = math.sqrt(x * x + y * y + z * z)
    facing = -(x * R_CM[0, 2] + y * R_CM[1, 2] + z * R_CM[2, 2]) / distance
    return distance <= me.range_max and facing >= me.side_min


@helper
def spoil_place(me: Any, p_C: Any, draw: Any) -> None:
    """Add the noise of two bearings and the distance, `draw` (3,), to a position p_C (3,) m."""
    distance = math.sqrt(p_C[0] * p_C[0] + p_C[1] * p_C[1] + p_C[2] * p_C[2])
    share = 1.0 + me.sigma_range * draw[2]
    p_C[0] = share * (p_C[0] + distance * me.sigma_bearing * draw[0])
    p_C[1] = share * (p_C[1] + distance * me.sigma_bearing * draw[1])
    p_C[2] = share * p_C[2]


@helper
def spoil_image(me: Any, p_C: Any, R_CM: Any, draw: Any, out: Any) -> None:
    """Fill the image of a marker at p_C (3,) m with its noise; p_C changes."""
    turn, rot, noisy, p_B = local(3), local(3, 3), local(3, 3), local(3)
    spoil_place(me, p_C, draw.bearing)
    for a in range(3):
        turn[a] = me.sigma_R * draw.attitude[a]
    exp_so3(turn, rot)
    mat_mat(R_CM, rot, noisy)
    mat_vec(me.R_BC, p_C, p_B)
    for a in range(3):
        out.p_BM[a] = me.p_BC[a] + p_B[a]
    mat_mat(me.R_BC, noisy, out.R_BM)
    out.fresh = 1.0
