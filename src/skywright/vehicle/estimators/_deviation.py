"""What a filter states of its position: standard deviations now, from those at its horizon."""

from __future__ import annotations

import math
from typing import Any

from skywright.core.scratch import local
from skywright.vehicle.component import helper
from skywright.vehicle.estimators._strapdown import BA_, N_STATE, P_, R_, V_


@helper
def tell_deviation(me: Any, P: Any, gravity: float, state: Any) -> None:
    """Fill the standard deviations of the position now; `P` (15 or more) is that of the horizon.

    `me` is a Strapdown. Within the T seconds since the horizon the error of the position grows to

        dp + T dv - [s] dtheta - T^2/2 R db_a,    s = double integral of R f,

    and the accelerometer's noise adds q_v T^3 / 3; slow errors of the localisation pass into the
    estimate as they are. What p has moved beyond T v and gravity is s.
    The gyroscope's share is left out: its bias makes g T^3 / 6 of a position, 0.2 mm of 1 mrad/s in
    the longest T (0.5 s).
    """
    row, s = local(N_STATE), local(3)
    T = me.h * (me.n - me.n_f)
    for i in range(3):
        s[i] = me.p[i] - me.p_f[i] - T * me.v_f[i]
    s[2] += 0.5 * gravity * T * T
    state.pose_std = 0.0
    for i in range(3):
        for j in range(N_STATE):
            row[j] = 0.0
        row[P_ + i], row[V_ + i] = 1.0, T
        row[R_ + (i + 1) % 3], row[R_ + (i + 2) % 3] = s[(i + 2) % 3], -s[(i + 1) % 3]
        for j in range(3):
            row[BA_ + j] = -0.5 * T * T * me.R_f[i, j]
        variance = me.q_v * T * T * T / 3.0 + me.p_slow[i] * me.p_slow[i]
        for j in range(N_STATE):
            if row[j] != 0.0:
                for k in range(N_STATE):
                    variance += row[j] * P[j, k] * row[k]
        state.p_std[i] = math.sqrt(max(variance, 0.0))
        state.pose_std = max(state.pose_std, state.p_std[i])
