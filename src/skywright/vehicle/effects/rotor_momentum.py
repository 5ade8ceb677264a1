"""Angular momentum of the rotors: the gyroscopic torque, and that of a rotor that speeds up.

Relative to the platform the rotors carry h = J sum_i s_i w_i n_i (J inertia about the axis, s spin,
w speed, n axis; the inertia of rotors at rest is part of the platform's). What drives them reacts
on the platform with -d(h)/dt in W, in B: -dh/dt - w_WB x h. The propellers' drag torque, which the
motors also pass on, is in the thrust actuators (models/scene.py).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import cross, mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_ROTORS
from skywright.vehicle.bus import Clock, MuJoCo, Truth
from skywright.vehicle.component import Component, Effect, table
from skywright.vehicle.plant import RotorState


class RotorMomentum(Effect):
    """Applies the reaction torque of the rotors' angular momentum to the platform."""

    class Me(Record):
        platform: int  # body
        momentum: Annotated[Array, MAX_ROTORS, 3]  # kg m^2, in B: momentum over speed
        before: Vec3  # kg m^2/s, in B, momentum one tick ago

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots whose rotors have an inertia."""
        if context.rotors.inertia > 0.0:
            yield cls("rotor momentum")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Take the rotors' axes."""
        rotors = context.rotors
        n = len(rotors.spin)
        me.platform = context.scene.places.platform_body
        me.momentum[:n] = rotors.inertia * rotors.spin[:, None] * rotors.axis

    @staticmethod
    def step(me: Me, clock: Clock, truth: Truth, rotors: RotorState, mj: MuJoCo) -> None:
        xfrc = table(mj.xfrc, mj.nbody, 6)
        h, torque, turned = local(3), local(3), local(3)
        for a in range(3):
            h[a] = 0.0
            for i in range(rotors.n):
                h[a] += me.momentum[i, a] * rotors.speed[i]
        cross(truth.w_WB_B, h, turned)
        for a in range(3):
            torque[a] = -turned[a] - (h[a] - me.before[a]) / clock.dt
            me.before[a] = h[a]
        mat_vec(truth.R_WB, torque, turned)
        for a in range(3):
            xfrc[me.platform, 3 + a] += turned[a]
