"""Standard deviations of the present position estimate, from the covariance at the horizon."""

from __future__ import annotations

import math
from typing import Any

from skywright.core.scratch import local
from skywright.vehicle.component import helper
from skywright.vehicle.estimators._strapdown import BA_, N_STATE, P_, R_, V_


@helper
def fill_deviation(me: Any, P: Any, gravity: float, state: Any) -> None:
    """Fill the standard deviations of the present position; `P` (15 or more) is at the horizon.

    `me` is a Strapdown. In the T seconds since the horizon the position error grows to

        dp + T dv - [s] dtheta - T^2/2 R db_a,    s = double integral of R f,

    and the accelerometer's noise adds q_v T^3 / 3. Slow errors of the localisation add in full. s
    is the displacement of p minus T v and minus that of gravity.
    The gyroscope's contribution is omitted: a bias b gives a position error of b g T^3 / 6, 0.2 mm
    for 1 mrad/s in the longest T (0.5 s).
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
