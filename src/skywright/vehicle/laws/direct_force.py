"""Direct force control: position along the surface, PI on the measured force along its normal.

This law is not taken from the papers that Skywright reproduces. It is hybrid position and force
control at the tip of a fully actuated platform after Bodie et al. 2020 (Active interaction force
control for contact-based inspection with a fully actuated aerial vehicle, IEEE T-RO 37(3)), with a
measured force in place of an estimated one. Attitude, arm, free flight and both directions along
the surface are laws (2) to (4) of Tognon 2018 (loops.py). Along the normal n, while the plan
requests a force F^d (port Press) and the reference is inside the surface,

    f.n = m a^d.n + D (v^d - v).n - (F^d + k_P (F^d - F) + sigma_F)      sigma_F' = k_I (F^d - F)

Derivation of the gains. The tip is a spring k between robot and surface: F = k x with x inward, so

    m x'' + D x' + k x = F^d + k_P (F^d - F) + sigma_F + gust
    s^3 + 2 zeta w s^2 + w^2 s + w_i w^2 = 0    with   D = 2 zeta m w,
                                                       1 + k_P = m w^2 / k,  k_I = w_i m w^2 / k

- k is the probe's spring in series with the compliance of the robot: the attitude loop, I w_R^2
  over the squared lever of the tip about the centre of mass, and joint springs and servos over
  their squared levers. With the slider at an end of its travel only the compliance of the robot is
  left (`Contact.k_hard`), and k_P k grows with it.
- zeta = 1 and w_i = w / 4. The pair of poles that the integral creates then has a damping ratio of
  0.7.
- k_P >= 0. If w is below the frequency sqrt(k / m) of the bare spring, k_P = 0.
- w is the largest bandwidth for which the sensitivity |S| stays below 2, in contact with either
  stiffness and in the air. The loop contains the rotor lag T and a dead time tau of 1.5 control
  periods (as in evidence/loop.py), a physics step, half a period of the sensor, and the link both
  ways. Opened at the rotors it is

    L = (D s + k_P k + k_I k / s) e^{-s tau} / (1 + T s) / (m s^2 + k)

Anti-windup: the integral is held while the rotors are saturated and while no force is measured. It
shares one vector sigma in W, and its bound, with the position integral, so the transitions at
touch-down and lift-off are bumpless. At the loss of contact the component of sigma along the normal
contains the force of the wind.

Loss of contact, and the time before contact: F^d (1 + k_P) accelerates a free mass with the damper
D. The tip therefore returns at a speed of F^d (1 + k_P) / D at most, and `approach_speed_mps`
limits this speed further. Its default is the speed whose impact on the spring, v sqrt(k m), causes
half of F^d. If the tip is deeper than its reference by REACH (3 cm), the law assumes that there is
no surface, and the position loop takes over.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.scratch import local
from skywright.core.spec import Bandwidth, NonNegative, Positive
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out, helper
from skywright.vehicle.follower import Press
from skywright.vehicle.laws._press_model import (
    FREQUENCIES,
    SENSITIVITY,
    Contact,
    build_contact,
    compute_gust_share,
    compute_peak,
)
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.loops import (
    SLOW,
    LoopsTable,
    arm_velocity,
    hold_attitude,
    position_force,
    rest,
    to_body,
)
from skywright.vehicle.tip_force import find_tip_sensor

INTEGRAL = 0.25  # w_i / w
REACH = 0.03  # m, depth of the tip beyond its reference at which no surface is assumed
TOUCH, RELEASE = 0.2, 0.1  # N, measured force at which contact begins and ends
BANDWIDTHS = np.geomspace(0.5, 60.0, 240)  # rad/s, candidates, 2 % apart


class Gains(NamedTuple):
    """Gains of the loop along the normal."""

    w: float  # rad/s
    damper: float  # N s/m
    kp: float
    ki: float  # 1/s


class DirectForce(ThreeLoops):
    """Laws (2) to (4) with control of the measured force along the normal."""

    needs_full_actuation = True

    class Table(LoopsTable):
        """Bandwidths of all loops; None: the values derived in the module docstring."""

        force_bandwidth_rad_s: Bandwidth | None = None
        force_damping: Positive = 1.0
        force_integral_rad_s: NonNegative | None = None
        approach_speed_mps: Positive | None = None

    class Me(ThreeLoops.Me):
        damper: float  # N s/m
        kp_force: float
        ki_force: float  # 1/s
        approach: float  # m/s per newton of the desired force
        approach_max: float  # m/s
        touching: float  # 1: the tip is in contact

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gains; raise InputError if the delay of the loop leaves no bandwidth."""
        super().build(me, table, context)
        contact = build_contact(context.robot, context.world, table, context.dt, context.h)
        gains = compute_gains(contact, table)
        me.damper, me.kp_force, me.ki_force = gains.damper, gains.kp, gains.ki
        told = table.approach_speed_mps
        me.approach_max = math.inf if told is None else told
        me.approach = math.inf if told is not None else 0.5 / math.sqrt(contact.k * contact.mass)

    def check_robot(self, robot: Robot) -> None:
        """Raise InputError for a robot that does not measure the force of its tip."""
        if find_tip_sensor(robot) is None:
            raise InputError(
                f"control law 'direct_force' requires a measured probe force; {robot.name!r} "
                "has no force sensor there: use robot 'othex-force', or add "
                "[robot.sensors.NAME] kind = 'force_torque', at = 'probe'"
            )

    def compute_gust_response(
        self, robot: Robot, world: World, frequencies: Array, h: float
    ) -> Array | None:
        """Return the contact force (n,) per newton of a gust along the normal; see Law."""
        contact = build_contact(robot, world, self.table, 1.0 / robot.control.rate_hz, h)
        return compute_gust_response(contact, compute_gains(contact, self.table), frequencies)

    @staticmethod
    def step(
        me: Me,
        ref: Reference,
        press: Press,
        est: Estimate,
        body: Body,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:
        arm_velocity(me, ref, est, body, cmd.qd)
        if ref.active < 0.5:
            rest(me, cmd)
            me.touching = 0.0
            return
        me.touching = 1.0 if est.f_tip > (RELEASE if me.touching > 0.5 else TOUCH) else 0.0
        f_W = local(3)
        deep = 0.0
        for i in range(3):
            deep += ref.R_WS[i, 2] * (ref.p_WT[i] - est.p_WT[i])
        if press.force > 0.0 and ref.dead_zone > 0.0 and deep < REACH:
            press_force(me, ref, press.force, est, body, allocated.saturated, f_W)
        else:
            position_force(me, ref, est, body, allocated.saturated, f_W)
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)


@helper
def press_force(
    me: Any, ref: Any, asked: float, est: Any, body: Any, saturated: float, f_W: Any
) -> None:
    """Fill f_W (3,) N: law (4) along the surface, control of the force `asked` (N) across it."""
    mass, n = body.mass, local(3)
    kp, kd = mass * me.wn_p * me.wn_p, 2.0 * me.zeta_p * mass * me.wn_p
    e_n = v_n = 0.0
    for i in range(3):
        n[i] = ref.R_WS[i, 2]
        e_n += n[i] * (ref.p_WT[i] - est.p_WT[i])
        v_n += n[i] * (ref.v_WB[i] - est.v_WB[i])
    push = asked * (1.0 + me.kp_force)
    if me.touching > 0.5:
        push -= me.kp_force * est.f_tip
    else:
        push = min(push, me.damper * min(me.approach * asked, me.approach_max))
    speed = math.sqrt(ref.v_WT[0] ** 2 + ref.v_WT[1] ** 2 + ref.v_WT[2] ** 2 + SLOW**2)
    for i in range(3):
        v = ref.v_WB[i] - est.v_WB[i] - v_n * n[i]
        e = ref.p_WT[i] - est.p_WT[i] - e_n * n[i]
        f_W[i] = mass * ref.a_WB[i] + kd * v + kp * e + me.sigma[i]
        f_W[i] += (me.damper * v_n - push) * n[i] + me.friction * asked * ref.v_WT[i] / speed
    f_W[2] += mass * body.gravity
    if saturated > 0.0:
        return
    wind_up = me.ki_force * (asked - est.f_tip) if me.touching > 0.5 else 0.0
    total = 0.0
    for i in range(3):
        e = ref.p_WT[i] - est.p_WT[i] - e_n * n[i]
        me.sigma[i] += me.dt * (me.wi_p * kp * e - wind_up * n[i])
        total += me.sigma[i] * me.sigma[i]
    if total > me.f_integral_max * me.f_integral_max:
        scale = me.f_integral_max / math.sqrt(total)
        for i in range(3):
            me.sigma[i] *= scale


def compute_gains(contact: Contact, table: DirectForce.Table) -> Gains:
    """Return the gains of the given bandwidth, by default the largest with |S| <= SENSITIVITY.

    Raises InputError if no bandwidth satisfies this bound.
    """
    if table.force_bandwidth_rad_s is not None:
        return _build_gains(contact, table, table.force_bandwidth_rad_s)
    best = None
    for w in BANDWIDTHS:
        gains = _build_gains(contact, table, float(w))
        if compute_sensitivity(contact, gains) > SENSITIVITY:
            break
        best = gains
    if best is None:
        raise InputError(
            f"control law 'direct_force': with a dead time of {1000.0 * contact.delay:.0f} "
            "ms (sensor, control, link both ways) and a rotor lag of "
            f"{1000.0 * contact.lag:.0f} ms no force bandwidth has a sensitivity below 2: "
            "reduce the delay, jitter or loss of world.link, or use mission.law = 'push_and_slide'"
        )
    return best


def _build_gains(c: Contact, table: DirectForce.Table, w: float) -> Gains:
    told = table.force_integral_rad_s
    wi = INTEGRAL * w if told is None else told
    over = max(c.mass * w**2 / c.k, 1.0)
    return Gains(w, 2.0 * table.force_damping * c.mass * w, over - 1.0, wi * over)


def compute_sensitivity(c: Contact, g: Gains, w: Array = FREQUENCIES) -> float:
    """Return the largest |S| at the rotors: spring free, spring at an end, in the air."""
    return compute_peak(c, lambda s, k: g.damper * s + (g.kp + g.ki / s) * k, w)


def compute_gust_response(c: Contact, g: Gains, w: Array) -> Array:
    """Return |F / gust| (n,) at w (n,) rad/s, the spring free or at an end: the larger."""
    return compute_gust_share(c, lambda s, k: g.damper * s + (g.kp + g.ki / s) * k, w)
