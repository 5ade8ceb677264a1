"""Moment of the contact force of law (4) about the centre of mass."""

from __future__ import annotations

import math
from typing import Any

from skywright.core.rotations import cross, mat_t_vec
from skywright.core.scratch import local
from skywright.vehicle.component import helper
from skywright.vehicle.loops import SLOW


@helper
def subtract_moment(me: Any, ref: Any, est: Any, body: Any, push: float, t_B: Any) -> None:
    """Subtract (p_T - c) x f from t_B (3,) N m; f is the modelled force of the surface on the tip.

    f is the friction that law (4) feeds forward plus `push` times its normal force. Without contact
    f is zero.
    """
    normal, f_W, f_B, arm, moment = 0.0, local(3), local(3), local(3), local(3)
    for i in range(3):
        if ref.track_tip > 0.5:
            normal += ref.R_WS[i, 2] * (ref.p_WT[i] - est.p_WT[i])
        else:
            normal += ref.R_WS[i, 2] * (ref.p_WB[i] - est.p_WB[i])
    if ref.dead_zone <= 0.0 or normal >= 0.0:
        return
    force = -body.mass * me.wn_p * me.wn_p * normal
    speed = math.sqrt(ref.v_WT[0] ** 2 + ref.v_WT[1] ** 2 + ref.v_WT[2] ** 2 + SLOW**2)
    for i in range(3):
        f_W[i] = force * (push * ref.R_WS[i, 2] - me.friction * ref.v_WT[i] / speed)
        arm[i] = body.p_BT[i] - body.p_BC[i]
    mat_t_vec(est.R_WB, f_W, f_B)
    cross(arm, f_B, moment)
    for i in range(3):
        t_B[i] -= moment[i]
