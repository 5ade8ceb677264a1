"""Motion capture of the platform and of the probe: rate, latency, noise, drop-outs, artefacts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import exp_so3, mat_mat, mat_vec
from skywright.core.scratch import local
from skywright.description.world.spec import Mocap
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import (
    Component,
    Normal,
    Out,
    Recorded,
    Sensor,
    Streamed,
    Uniform,
    helper,
)
from skywright.vehicle.readings import MocapSample
from skywright.vehicle.topics import MAP

QUEUE = 64
"""Largest number of samples in transit."""
SMALLEST = 0.01
"""m, size of an artefact."""


class MotionCapture(Sensor):
    """Fills MocapSample with the samples that arrive in a tick; their rate is `rate_hz`."""

    Table = Mocap

    class Me(Record):
        period: float  # s
        latency: float  # s
        sigma_p: float  # m
        sigma_R: float  # rad
        dropout: float  # fraction
        outlier: float  # fraction
        outlier_size: float  # m, largest
        marker_T: Vec3  # m, calibration error of the probe's markers, in T
        next: float  # s, next exposure
        last: float  # s, exposure of the last delivered sample
        head: int
        tail: int
        t: Annotated[Array, QUEUE]
        p: Annotated[Array, QUEUE, 3]
        R: Annotated[Array, QUEUE, 3, 3]
        tip: Annotated[Array, QUEUE, 3]
        axis: Annotated[Array, QUEUE, 3]

    class Noise(Normal):
        stream = "mocap"
        p: Vec3
        tip: Vec3
        R: Vec3
        axis: Vec3

    class Chance(Uniform):
        stream = "dropout"
        drop: float

    class Artefact(Uniform):
        stream = "outlier"
        body: float
        probe: float
        reach: float
        way: Vec3
        turn: Vec3

    columns = (
        Recorded("meas_p_WT", MocapSample, "p_WT", "m", "tip as motion capture measured it"),
        Recorded("meas_axis_W", MocapSample, "axis_W", "", "measured probe axis, out of the robot"),
    )

    streams = (
        Streamed(
            (
                Recorded("p_WB", MocapSample, "p_WB", "m", "platform"),
                Recorded("q_WB", MocapSample, "R_WB", "", "platform", rotation=True),
            ),
            "geometry_msgs/PoseStamped", MAP,
            {"pose.position": "p_WB", "pose.orientation": "q_WB"}, name="platform",
        ),
        Streamed(
            (Recorded("p_WT", MocapSample, "p_WT", "m", "tip"),),
            "geometry_msgs/PointStamped", MAP, {"point": "p_WT"}, name="tip",
        ),
        Streamed(
            (Recorded("axis_W", MocapSample, "axis_W", "", "probe axis, out of the robot"),),
            "geometry_msgs/Vector3Stamped", MAP, {"vector": "axis_W"}, name="probe_axis",
        ),
    )  # fmt: skip

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read rates and noise from the table, the markers' error from the deviation."""
        me.period, me.latency = 1.0 / table.rate_hz, table.latency_s
        me.sigma_p, me.sigma_R = table.position_noise_m, table.attitude_noise_rad
        me.dropout, me.last = table.dropout_fraction, -1.0 / table.rate_hz
        me.outlier, me.outlier_size = table.outlier_fraction, table.outlier_m
        me.marker_T[:] = context.deviation.marker_error

    def get_period(self, step: str, context: Any) -> float:
        """Called every tick: the step checks whether an exposure is due."""
        return 0.0

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        truth: Truth,
        noise: Noise,
        chance: Chance,
        artefact: Artefact,
        out: Out[MocapSample],
    ) -> None:
        t = clock.t
        if t >= me.next - 1e-9:
            me.next += me.period
            if chance.drop >= me.dropout:
                expose(me, truth, t, noise, artefact)
        while me.tail != me.head and t - me.t[me.tail] >= me.latency - 1e-9:
            i = me.tail
            out.fresh = 1.0
            out.t = me.t[i]
            out.period = me.t[i] - me.last
            me.last = me.t[i]
            for a in range(3):
                out.p_WB[a] = me.p[i, a]
                out.p_WT[a] = me.tip[i, a]
                out.axis_W[a] = me.axis[i, a]
                for b in range(3):
                    out.R_WB[a, b] = me.R[i, a, b]
            me.tail = (me.tail + 1) % QUEUE

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds with motion capture have one."""
        if context.world.localisation == "mocap":
            yield cls("mocap", context.world.mocap)


@helper
def expose(me: Any, truth: Any, t: float, noise: Any, artefact: Any) -> None:
    """Add one sample to the queue."""
    i = me.head
    following = (i + 1) % QUEUE
    if following == me.tail:  # full: the oldest is lost, as in a real link
        me.tail = (me.tail + 1) % QUEUE
    turn, rot, along = local(3), local(3, 3), local(3)
    for a in range(3):
        me.p[i, a] = truth.p_WB[a] + me.sigma_p * noise.p[a]
        me.tip[i, a] = truth.p_WT[a] + me.sigma_p * noise.tip[a]
        for c in range(3):
            me.tip[i, a] += truth.R_WT[a, c] * me.marker_T[c]
        turn[a] = me.sigma_R * noise.R[a]
    exp_so3(turn, rot)
    mat_mat(truth.R_WB, rot, me.R[i])
    for a in range(3):
        turn[a] = me.sigma_R * noise.axis[a]
        along[a] = truth.R_WT[a, 2]
    exp_so3(turn, rot)
    mat_vec(rot, along, me.axis[i])
    if me.outlier > 0.0:
        spoil(me, truth, i, artefact)
    me.t[i] = t
    me.head = following


@helper
def spoil(me: Any, truth: Any, i: int, u: Any) -> None:
    """Convert a sample of the platform, of the probe, or of both to an artefact."""
    turn, rot = local(3), local(3, 3)
    size = SMALLEST * (me.outlier_size / SMALLEST) ** u.reach
    if u.body < me.outlier:
        for a in range(3):
            me.p[i, a] += size * (2.0 * u.way[a] - 1.0)
            turn[a] = math.pi * (2.0 * u.turn[a] - 1.0)
        exp_so3(turn, rot)
        mat_mat(truth.R_WB, rot, me.R[i])
    if u.probe < me.outlier:
        for a in range(3):
            me.tip[i, a] -= size * (2.0 * u.way[a] - 1.0)
            me.axis[i, a] = -me.axis[i, a]


@helper
def capture_body(me: Any, p: Any, R: Any, noise: Any, p_seen: Any, R_seen: Any) -> None:
    """Fill p_seen, R_seen with a sample of a body; `me` has sigma_p and sigma_R.

    `noise` has unit normal numbers p and R, (3,) each.
    """
    turn, rot = local(3), local(3, 3)
    for a in range(3):
        p_seen[a] = p[a] + me.sigma_p * noise.p[a]
        turn[a] = me.sigma_R * noise.R[a]
    exp_so3(turn, rot)
    mat_mat(R, rot, R_seen)
