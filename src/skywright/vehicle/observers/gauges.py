"""What a collision does to the platform: wrench of arms or link on it, and the force on the pads.

Read after every physics step (1 kHz): a blow lasts milliseconds, and a sample of the recording
(100 Hz) would miss its peak.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Integers, Record, Vec3
from skywright.core.scratch import local
from skywright.models.gauges import find_gauges
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import (
    Component,
    InOut,
    Out,
    Output,
    Recorded,
    helper,
    table,
    words,
)
from skywright.vehicle.plant import SAMPLE_RATE

MAX_MOUNTS = 4
MAX_PADS = 4
TOUCH = 0.1  # N, force above which a pad counts as touched


class Loads(Output):
    """Wrench of what the platform carries, on it; force of the robot on the pads."""

    f_B: Vec3  # N, beyond the wrench that is counted from
    t_B: Vec3  # N m, about the origin of B
    f_peak: float  # N, largest size since the last sample
    t_peak: float  # N m
    pad_f_W: Vec3  # N, contact force on the pads
    pad_peak: float  # N, since the last sample
    impulse_W: Vec3  # N s, given to the pads so far
    touch_s: float  # s, in contact so far


class Gauges(Component):
    """Fills Loads in worlds with pads (models/gauges.py)."""

    side = "plant"
    slots = {"watch": "fast", "rest": "peaks"}

    class Me(Record):
        n_mounts: int
        mount: Annotated[Integers, MAX_MOUNTS, 3]  # site, addresses of force and torque
        origin: int  # site of B
        n_pads: int
        pad: Annotated[Integers, MAX_PADS]
        dt: float  # s, physics step
        zero: int  # 1: tare at the next step
        f_zero_B: Vec3
        t_zero_B: Vec3

    columns = (
        Recorded("load_f_B", Loads, "f_B", "N", "force of arms or link on the platform"),
        Recorded("load_t_B", Loads, "t_B", "N m", "their torque about the origin of B"),
        Recorded("load_f_peak", Loads, "f_peak", "N", "largest size since the last sample"),
        Recorded("load_t_peak", Loads, "t_peak", "N m", "largest size since the last sample"),
        Recorded("pad_f_W", Loads, "pad_f_W", "N", "contact force on the pads"),
        Recorded("pad_f_peak", Loads, "pad_peak", "N", "largest since the last sample"),
        Recorded("pad_impulse_W", Loads, "impulse_W", "N s", "given to the pads so far"),
        Recorded("pad_touch_s", Loads, "touch_s", "s", "in contact so far"),
    )

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Scenes with gauges have one."""
        if find_gauges(context.scene.model)[1] >= 0:
            yield cls("gauges")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up addresses in the scene."""
        self._me = me
        mounts, me.origin, pads = find_gauges(context.scene.model)
        me.dt, me.n_mounts, me.n_pads = context.h, len(mounts), len(pads)
        me.mount[: len(mounts)], me.pad[: len(pads)] = mounts, pads
        me.zero = 1

    def get_period(self, step: str, context: Any) -> float:
        """Peaks last for a sample."""
        return 1.0 / SAMPLE_RATE if step == "rest" else 0.0

    def zero(self) -> None:
        """Tare the wrench on the platform and reset its peaks at the next step."""
        self._me.zero = 1

    @staticmethod
    def watch(me: Me, mj: MuJoCo, loads: Out[Loads]) -> None:
        f_W, t_W = local(3), local(3)
        add_mounts(me, mj, f_W, t_W)
        feel_platform(me, mj, f_W, t_W, loads)
        feel_pads(me, mj, loads)

    @staticmethod
    def rest(loads: InOut[Loads]) -> None:
        loads.f_peak = loads.t_peak = loads.pad_peak = 0.0


@helper
def add_mounts(me: Any, mj: Any, f_W: Any, t_W: Any) -> None:
    """Fill force and torque on the platform, about the origin of B, in W.

    MuJoCo's sensors give what holds the child, in the site's axes; the platform feels the opposite.
    """
    sensordata = words(mj.sensordata, mj.nsensor)
    xpos, xmat = table(mj.site_xpos, mj.nsite, 3), table(mj.site_xmat, mj.nsite, 9)
    f, arm = local(3), local(3)
    f_W[:] = 0.0
    t_W[:] = 0.0
    for m in range(me.n_mounts):
        s, at, about = me.mount[m, 0], me.mount[m, 1], me.mount[m, 2]
        for i in range(3):
            arm[i] = xpos[s, i] - xpos[me.origin, i]
            f[i] = 0.0
            for j in range(3):
                f[i] -= xmat[s, 3 * i + j] * sensordata[at + j]
                t_W[i] -= xmat[s, 3 * i + j] * sensordata[about + j]
            f_W[i] += f[i]
        t_W[0] += arm[1] * f[2] - arm[2] * f[1]
        t_W[1] += arm[2] * f[0] - arm[0] * f[2]
        t_W[2] += arm[0] * f[1] - arm[1] * f[0]


@helper
def feel_platform(me: Any, mj: Any, f_W: Any, t_W: Any, loads: Any) -> None:
    """Fill the tared wrench and its peaks."""
    xmat, o = table(mj.site_xmat, mj.nsite, 9), me.origin
    force = torque = 0.0
    if me.zero:
        loads.f_peak = loads.t_peak = 0.0
    for i in range(3):
        f_B = t_B = 0.0
        for j in range(3):
            f_B += xmat[o, 3 * j + i] * f_W[j]
            t_B += xmat[o, 3 * j + i] * t_W[j]
        if me.zero:
            me.f_zero_B[i], me.t_zero_B[i] = f_B, t_B
        loads.f_B[i], loads.t_B[i] = f_B - me.f_zero_B[i], t_B - me.t_zero_B[i]
        force += loads.f_B[i] ** 2
        torque += loads.t_B[i] ** 2
    me.zero = 0
    loads.f_peak = max(loads.f_peak, math.sqrt(force))
    loads.t_peak = max(loads.t_peak, math.sqrt(torque))


@helper
def feel_pads(me: Any, mj: Any, loads: Any) -> None:
    """Fill force, impulse and time of touch of the pads."""
    sensordata = words(mj.sensordata, mj.nsensor)
    for i in range(3):
        loads.pad_f_W[i] = 0.0
        for p in range(me.n_pads):
            loads.pad_f_W[i] -= sensordata[me.pad[p] + i]  # MuJoCo: force that the pad exerts
        loads.impulse_W[i] += loads.pad_f_W[i] * me.dt
    pressed = math.sqrt(
        loads.pad_f_W[0] ** 2 + loads.pad_f_W[1] ** 2 + loads.pad_f_W[2] ** 2
    )  # fmt: skip
    loads.pad_peak = max(loads.pad_peak, pressed)
    if pressed > TOUCH:
        loads.touch_s += me.dt
