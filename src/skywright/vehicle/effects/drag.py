"""Drag of body and rotors in the wind, applied to the platform at its centre of mass.

Body: -rho/2 C_D A |v| v along the body axes, at the origin of B. Rotors: -c w v in the disc plane,
at the hub. v is relative to the air; if the wind varies over the robot, to the air at each hub.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import cross, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_ROTORS
from skywright.vehicle.bus import MuJoCo, Truth
from skywright.vehicle.component import Component, Effect, Out, Recorded, table
from skywright.vehicle.plant import AirForce, RotorState, Wind


class Drag(Effect):
    """Fills AirForce and pushes the platform."""

    class Me(Record):
        platform: int  # body
        com_B: Vec3  # m, true centre of mass of the platform
        half_rho_area: Vec3  # kg/m, rho/2 C_D A along the axes of B
        rotor_drag: float  # N/(rad/s)/(m/s)
        rotor_p: Annotated[Array, MAX_ROTORS, 3]  # m
        rotor_axis: Annotated[Array, MAX_ROTORS, 3]

    columns = (Recorded("f_wind_W", AirForce, "f_W", "N", "aerodynamic drag on the robot"),)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read areas and rotors; the deviation scales all drag."""
        rotors, p, dev = context.rotors, context.robot.platform, context.deviation
        n = len(rotors.thrust_min)
        areas = np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2])
        me.half_rho_area[:] = 0.5 * context.world.air_density_kg_m3 * areas * dev.drag_factor
        me.rotor_drag = rotors.drag_coefficient * dev.drag_factor
        me.rotor_p[:n], me.rotor_axis[:n] = rotors.position, rotors.axis
        me.platform = context.scene.places.platform_body
        me.com_B[:] = context.scene.model.body_ipos[me.platform]

    @staticmethod
    def step(
        me: Me, truth: Truth, wind: Wind, rotors: RotorState, mj: MuJoCo, out: Out[AirForce]
    ) -> None:
        xfrc = table(mj.xfrc, mj.nbody, 6)
        v, va, rel, fb, tb = local(3), local(3), local(3), local(3), local(3)
        arm, force, turn = local(3), local(3), local(3)
        for i in range(3):
            rel[i] = truth.v_WB[i] - wind.body_W[i]
        mat_t_vec(truth.R_WB, rel, va)
        speed = math.sqrt(va[0] * va[0] + va[1] * va[1] + va[2] * va[2])
        for i in range(3):
            fb[i] = -me.half_rho_area[i] * speed * va[i]
            tb[i] = 0.0
            v[i] = va[i]
        for n in range(rotors.n):
            if wind.varies:
                for i in range(3):
                    rel[i] = truth.v_WB[i] - wind.rotor_W[n, i]
                mat_t_vec(truth.R_WB, rel, va)
            for i in range(3):
                arm[i] = me.rotor_p[n, i]
            cross(truth.w_WB_B, arm, turn)
            along = 0.0
            for i in range(3):
                turn[i] += va[i]
                along += turn[i] * me.rotor_axis[n, i]
            for i in range(3):
                force[i] = (
                    -me.rotor_drag * rotors.speed[n] * (turn[i] - along * me.rotor_axis[n, i])
                )
                fb[i] += force[i]
                arm[i] -= me.com_B[i]
            cross(arm, force, turn)
            for i in range(3):
                tb[i] += turn[i]
        for i in range(3):  # body drag acts at the origin of B
            arm[i] = -me.com_B[i]
            force[i] = -me.half_rho_area[i] * speed * v[i]
        cross(arm, force, turn)
        for i in range(3):
            tb[i] += turn[i]
        mat_vec(truth.R_WB, fb, out.f_W)
        mat_vec(truth.R_WB, tb, turn)
        for i in range(3):
            xfrc[me.platform, i] += out.f_W[i]
            xfrc[me.platform, 3 + i] += turn[i]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every robot has this effect."""
        yield cls("drag")
