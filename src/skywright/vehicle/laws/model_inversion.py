"""Distributed model inversion for a platform whose arms hang on a passive link (Caballero 2018).

The paper shows a block diagram (figure 4) and states that the laws "make use of nonlinear
strategies based on model inversion"; it prints no equation and no gain. This law is one
interpretation for the model (3). It has one part for each subsystem, and each part inverts the rows
of the model that it commands:

- Platform: loops on position and velocity command the accelerations u1', u3' (and the same across
  the plane). With this acceleration of the platform, the passive row of (3) gives the angular
  acceleration of the free link,

    M_ss q'' = L_s . (g - v') + s_ext,

  and the translational rows give the required force, including the reaction of the link:

    f = m (v' - g) + L_s q'' + L_s' q' - f_ext.

  The platform then moves as if nothing hung on it: its mass is m - |L_s|^2 / M_ss, and the swing
  does not pull it.
- Attitude: the thrust points along f. The rotational rows give the torque for the commanded angular
  acceleration with a free joint (the same inversion as in the cascade).
- Passive joint: it has no motor. The platform damps it: part of v' opposes the rate of the link.
- Arms: their servos hold angles; the law of the arms inverts the statics of the joints.

The rows are inverted one after the other, the translational ones at the present attitude, which
follows within a tenth of a second. Accelerations of the arm joints are part of the estimated
external force; a transport moves these joints at a few tenths of rad/s.

In the cascade the placed poles include the pull of the link. In this law a given gain produces less
force, because it acts on the smaller mass, and the law cancels the pull of the swinging link, which
would bring platform and link back together. docs/papers/caballero-2018.md compares both laws in
gusts.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from skywright.core.rotations import cross, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.vehicle.arms.ports import Floating, Hands, Wrench
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out, helper
from skywright.vehicle.laws.cascade import Cascade, acceleration_for_motion, apply_force, begin


class ModelInversion(Cascade):
    """Fills f_B = (0, 0, T), t_B and qd."""

    inverted: ClassVar[bool] = True

    @staticmethod
    def step(
        me: Cascade.Me,
        ref: Reference,
        est: Estimate,
        body: Body,
        floating: Floating,
        wrench: Wrench,
        hands: Hands | None,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:
        if begin(me, ref, est, body, cmd):
            a_W, f_W = local(3), local(3)
            acceleration_for_motion(me, ref, est, body, floating, wrench, hands, a_W)
            invert_translation(me, est, body, floating, wrench, a_W, f_W)
            apply_force(me, ref, est, body, floating, wrench, allocated.saturated, cmd, f_W)


@helper
def invert_translation(
    me: Any, est: Any, body: Any, floating: Any, wrench: Any, a_W: Any, f_W: Any
) -> None:
    """Fill f_W (3,) N: the rotors' force for the acceleration a_W (3,) m/s^2 of the platform.

    At constant attitude; the passive joint turns freely, all other joints are fixed.
    """
    f_ext, size = local(3), 0.0
    for i in range(3):
        f_ext[i] = wrench.f_hands_W[i] + wrench.f_rest_W[i]
        size += f_ext[i] * f_ext[i]
    size = min(1.0, me.f_external_max / max(math.sqrt(size), 1e-9))
    for i in range(3):
        f_W[i] = body.mass * a_W[i] - size * f_ext[i]
    f_W[2] += body.mass * body.gravity
    if floating.swing < 0:
        return
    fall, fall_B, pull, pull_W = local(3), local(3), local(3), local(3)
    for i in range(3):
        fall[i] = -a_W[i]
    fall[2] -= body.gravity
    mat_t_vec(est.R_WB, fall, fall_B)
    acc, rate = wrench.s_hands + wrench.s_rest, est.qd[floating.swing]
    for i in range(3):
        acc += floating.L_s[i] * fall_B[i]
        rate += floating.axis[i] * est.w_WB_B[i]
    acc /= floating.M_ss
    cross(floating.axis, floating.L_s, pull)  # d L_s / dq
    for i in range(3):
        pull[i] = floating.L_s[i] * acc + pull[i] * rate * rate
    mat_vec(est.R_WB, pull, pull_W)
    for i in range(3):
        f_W[i] += pull_W[i]
