"""Thrust direction of a platform that tilts to accelerate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.core.record import Record
from skywright.core.rotations import cross, norm
from skywright.core.scratch import local
from skywright.core.spec import Positive, Spec
from skywright.vehicle.component import Context, helper
from skywright.vehicle.loops import choose_bandwidths


class ThrustTable(Spec):
    """Tilt limit of the platform; None: that of [robot.control]."""

    tilt_max_deg: Positive | None = None


class Thrust(Record):
    """Limits of `aim_thrust`."""

    tilt_max: float  # rad
    thrust_max: float  # N, all rotors together along z_B


def fill_thrust(me: Any, table: Spec, context: Context) -> None:
    """Fill the Thrust of a law's `Me`."""
    rotors = context.rotors
    me.tilt_max = math.radians(choose_bandwidths(table, context).tilt_max_deg)
    me.thrust_max = float(np.sum(rotors.thrust_max * rotors.axis[:, 2]))


@helper
def aim_thrust(me: Any, ref: Any, est: Any, body: Any, f_W: Any, R_des: Any) -> float:
    """Limit the desired force f_W (3,) N in place, fill R_des with z along it; return the thrust.

    The thrust (N) is the component of f_W along the present z_B, within the limits.
    """
    # tilt limit: lateral force at most tan(tilt) times the vertical one, which stays positive
    f_W[2] = min(max(f_W[2], 0.3 * body.mass * body.gravity), me.thrust_max)
    lateral = math.sqrt(f_W[0] * f_W[0] + f_W[1] * f_W[1])
    limit = f_W[2] * math.tan(me.tilt_max)
    if lateral > limit:
        f_W[0] *= limit / lateral
        f_W[1] *= limit / lateral
    z, y, x, heading = local(3), local(3), local(3), local(3)
    length = norm(f_W)
    for i in range(3):
        z[i] = f_W[i] / length
        heading[i] = ref.R_WB[i, 0]
    cross(z, heading, y)
    length = norm(y)
    for i in range(3):
        y[i] /= length
    cross(y, z, x)
    thrust = 0.0
    for i in range(3):
        R_des[i, 0], R_des[i, 1], R_des[i, 2] = x[i], y[i], z[i]
        thrust += f_W[i] * est.R_WB[i, 2]
    return float(min(max(thrust, 0.0), me.thrust_max))
