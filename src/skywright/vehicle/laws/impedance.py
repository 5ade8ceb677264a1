"""Axis-selective impedance: along the normal the tip acts as a chosen mass, damper and spring.

Bodie et al. 2019 (An omnidirectional aerial manipulation platform for contact-based inspection,
RSS), section IV: an impedance whose parameters are chosen for each axis of the surface frame.
Attitude, arm, free flight and both directions along the surface are laws (2) to (4) of Tognon 2018,
which are this impedance with the robot's own mass. Along the normal n, in contact, the desired
behaviour under the force F n of the surface

    m_v (a - a^d).n = D (v^d - v).n + K (p^d - p).n + F

requires the rotor force

    f.n = m a^d.n + (m / m_v) (D (v^d - v) + K (p^d - p)).n + (m / m_v - 1) F + sigma.n

with D = 2 zeta sqrt(K m_v). By default K is half of law (4)'s m w^2, and m_v = m. F is then not
needed, and the law flies on every robot that law (4) flies. Another m_v requires a measured force,
because a force estimated from the motion of the platform does not separate wind from contact
(docs/adr/0026).

A reference at the depth e inside the surface presses with K e. The depth of a plan is chosen for
law (4). Half of the stiffness therefore halves the push, and the change of the push by an error of
the map. A steady gust acts on the contact in full, as under law (4). sigma is the integral
of law (4), with its dead zone.

The rotors lag. A stiffness or mass is refused if the sensitivity |S| of the loop

    L = ((m / m_v) (D s + K) + (m / m_v - 1) k) e^{-s tau} / (1 + T s) / (m s^2 + k)

exceeds 2, with the probe's spring k free or at an end of its travel (_press_model.py).
"""

from __future__ import annotations

import math
from typing import Any

from pydantic import Field

from skywright.core.scratch import local
from skywright.core.spec import Positive
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_body, posture
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out, helper
from skywright.vehicle.laws._press_model import SENSITIVITY, build_contact, compute_peak
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.loops import (
    SLOW,
    LoopsTable,
    arm_velocity,
    choose_bandwidths,
    hold_attitude,
    position_force,
    rest,
    to_body,
)
from skywright.vehicle.tip_force import find_tip_sensor

SOFTER = 0.5
"""Ratio of the default stiffness along the normal to that of law (4)."""


class Impedance(ThreeLoops):
    """Laws (2) to (4) with a chosen impedance along the normal in contact."""

    needs_full_actuation = True

    class Table(LoopsTable):
        """Bandwidths of the loops, and the impedance along the normal."""

        normal_stiffness_n_per_m: Positive | None = None  # K; None: half of law (4)'s
        # zeta; None: that of the position loop
        normal_damping: float | None = Field(default=None, ge=0.01, le=100.0)
        normal_mass: float = Field(default=1.0, ge=0.01, le=100.0)  # m_v over the robot's mass

    class Me(ThreeLoops.Me):
        stiffness: float  # N/m
        damper: float  # N s/m
        share: float  # m / m_v

    def check_robot(self, robot: Robot) -> None:
        """Raise InputError if the table sets another mass and the robot has no force sensor."""
        if self.table.normal_mass != 1.0 and find_tip_sensor(robot) is None:
            raise InputError(
                f"mission.law.normal_mass = {self.table.normal_mass:g} requires a measured probe "
                f"force; {robot.name!r} has no force sensor there: use 1, robot 'othex-force', or "
                "add [robot.sensors.NAME] kind = 'force_torque', at = 'probe'"
            )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gains; raise InputError if the rotors are too slow for them."""
        super().build(me, table, context)
        mass, told = context.mass, table.normal_stiffness_n_per_m
        zeta = me.zeta_p if table.normal_damping is None else table.normal_damping
        me.stiffness = SOFTER * mass * me.wn_p**2 if told is None else told
        me.damper = 2.0 * zeta * math.sqrt(me.stiffness * table.normal_mass * mass)
        me.share = 1.0 / table.normal_mass
        if context.robot.probe is None:
            return
        c = build_contact(context.robot, context.world, table, context.dt, context.h)
        K, D, share = float(me.stiffness), float(me.damper), float(me.share)
        worst = compute_peak(c, lambda s, k: share * (D * s + K) + (share - 1.0) * k, air=False)
        if worst > SENSITIVITY:
            raise InputError(
                f"mission.law: normal_stiffness_n_per_m = {K:.4g}, normal_damping = {zeta:.3g} and "
                f"normal_mass = {table.normal_mass:g} have a sensitivity of {worst:.2g} behind a "
                f"rotor lag of {1000.0 * c.lag:.0f} ms and a dead time of "
                f"{1000.0 * c.delay:.0f} ms; valid: at most 2 (less stiffness, or a mass nearer 1)"
            )

    def compute_push_share(self, nominal: Nominal) -> float:
        """Return the ratio of K to the stiffness of law (4)."""
        w = nominal.robot.control.position_bandwidth_rad_s
        own = choose_bandwidths(self.table, nominal).position_bandwidth_rad_s
        told = self.table.normal_stiffness_n_per_m
        if told is None:
            return SOFTER * (own / w) ** 2
        mass = compute_body(nominal.model, posture(nominal.robot, "working"))[0]
        return float(told / (mass * w**2))

    @staticmethod
    def step(
        me: Me,
        ref: Reference,
        est: Estimate,
        body: Body,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:
        arm_velocity(me, ref, est, body, cmd.qd)
        if ref.active < 0.5:
            rest(me, cmd)
            return
        f_W = local(3)
        position_force(me, ref, est, body, allocated.saturated, f_W)
        if ref.dead_zone > 0.0 and ref.track_tip > 0.5:
            soften(me, ref, est, body, f_W)
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)


@helper
def soften(me: Any, ref: Any, est: Any, body: Any, f_W: Any) -> None:
    """Replace law (4)'s spring, damper and friction feed-forward of the normal in f_W (3,) N."""
    kp = body.mass * me.wn_p * me.wn_p
    kd = 2.0 * me.zeta_p * body.mass * me.wn_p
    e_n = v_n = 0.0
    for i in range(3):
        e_n += ref.R_WS[i, 2] * (ref.p_WT[i] - est.p_WT[i])
        v_n += ref.R_WS[i, 2] * (ref.v_WB[i] - est.v_WB[i])
    stiffness, damper = me.share * me.stiffness, me.share * me.damper
    change = (stiffness - kp) * e_n + (damper - kd) * v_n
    if me.share != 1.0:
        change += (me.share - 1.0) * max(est.f_tip, 0.0)
    speed = math.sqrt(ref.v_WT[0] ** 2 + ref.v_WT[1] ** 2 + ref.v_WT[2] ** 2 + SLOW**2)
    push = min(e_n, 0.0) * (me.stiffness - kp)  # the friction is that of the remaining push
    for i in range(3):
        f_W[i] += change * ref.R_WS[i, 2] - me.friction * push * ref.v_WT[i] / speed
