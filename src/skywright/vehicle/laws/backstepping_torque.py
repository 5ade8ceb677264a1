"""Sanchez-Cuevas 2020, (27), (30), (31): inverse dynamics of the arm as torques of its servos.

The platform is controlled as in `backstepping`. The printed (27) counts the contact twice: at the
desired force, -J^T F_d - F_C balances twice this force if F_d and F_C are both forces on the robot,
and none if F_d is the force of the tip. In this law J^T F_d, with F_d the force of the tip,
replaces both terms (E004-12 in docs/papers/sanchez-cuevas-2020.md):

    U = M (q''_d + e) + C + G + M_QM^T [p''; eta''] + J^T F_d,   F_d = F + k_f (F - F_s)

with F along the probe. At the tip this leaves Lambda x'' = (1 + k_f) (F - F_s) - Lambda k_v x'.
One pass of recursive Newton-Euler computes all terms except J^T F_d. M includes the rotors of the
servos, and the acceleration of the platform is that of its reference. (30) is evaluated in joint
space, which is the same to first order for an invertible J. While the tip presses, (30) acts across
the probe only: J^T Lambda e_x = M J^-1 (e_x - J' q').

The gains are k_p = w^2 and k_v = 2 w. w is 1 / T_v of the servos, so that the loop is as fast as
the speed loop that it replaces. If |S| then exceeds 2 with the dead time and the filter of the
joint speeds, w is the largest value with |S| <= 2. k_f is the largest value with |S| <= 2 in
contact.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from skywright.core.record import Array
from skywright.core.rotations import cross, mat_t_vec
from skywright.core.scratch import local
from skywright.core.spec import NonNegative
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.errors import InputError
from skywright.models.body_records import MAX_LINKS, BodyModel, Kinematics
from skywright.models.link_motion import (
    Motion,
    compute_joint_inertia,
    fill_joint_torque,
    fill_motion,
)
from skywright.models.rigid_body import compute_kinematics, posture
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Context, Out, helper
from skywright.vehicle.follower import Press
from skywright.vehicle.laws._tip_motion import fill_tip_rows, invert_tip
from skywright.vehicle.laws.backstepping import (
    REACH,
    TIP_SPEED,
    TOUCHING,
    Backstepping,
    command_platform,
    find_approach,
    find_extension,
    find_offset,
)
from skywright.vehicle.loops import LoopsTable, choose_bandwidths, compute_delay, rest
from skywright.vehicle.sensors.encoders import compute_speed_bandwidth

SENSITIVITY = 2.0
"""Largest |S|: a modulus margin of a half."""
FREQUENCIES = np.geomspace(0.3, 3000.0, 2000)
FORCE_GAINS = np.geomspace(0.02, 20.0, 400)


class TorqueLoop(NamedTuple):
    """Parameters of the arm's torque loop."""

    w: float  # rad/s
    speed: float  # rad/s, bandwidth of the measured joint speeds
    delay: float  # s, from the encoders to the torques
    mass: float  # kg, effective mass of the arm at the tip along the probe
    spring: float  # N/m, of the probe; 0: none


class BacksteppingTorque(Backstepping):
    """Fills f_B, t_B and torque."""

    commands_torque = True

    class Table(LoopsTable):
        """Bandwidths of the platform's loops; None: those of [robot.control]."""

        force_gain: NonNegative | None = None  # k_f of (31); None: see compute_force_gain

    class Me(Backstepping.Me):
        stiff: float  # 1/s^2, k_p of (30)
        damp: float  # 1/s, k_v of (30)
        k_f: float  # of (31)
        most: float  # N, force limit before contact: a free tip moves at TIP_SPEED at most
        rotor: Annotated[Array, MAX_JOINTS, MAX_JOINTS]  # kg m^2, of the servo rotors at the joints
        qd_ref: Annotated[Array, MAX_JOINTS]  # rad/s, of the reference at the last step

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gains; raise InputError if no gains are possible with the dead time."""
        super().build(me, table, context)
        n = int(context.model["n_joints"])
        me.rotor[:n, :n] = rotor = compute_rotor_inertia(context)
        loop = build_loop(context, table, rotor)
        me.stiff, me.damp = loop.w**2, 2.0 * loop.w
        me.most = loop.mass * me.damp * TIP_SPEED
        me.k_f = table.force_gain
        if table.force_gain is None:
            me.k_f = compute_force_gain(loop)

    @staticmethod
    def step(  # type: ignore[override]
        me: Me,
        ref: Reference,
        press: Press,
        est: Estimate,
        body: Body,
        model: BodyModel,
        kin: Kinematics,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:
        command_torques(me, ref, press, est, body, model, kin, cmd)
        if ref.active < 0.5:
            rest(me, cmd)
            return
        command_platform(me, ref, press, est, body, allocated.saturated, cmd)


def compute_rotor_inertia(context: Context) -> Array:
    """Return the contribution (n, n) kg m^2 of the servo rotors to the joint mass matrix."""
    joints, servos = list_joints(context.robot), list_servos(context.robot)
    n = len(joints)
    own = [servos[x.servo][1].armature_kgm2 if x.servo >= 0 else 0.0 for x in joints]
    motors = np.asarray(context.model["belt_inv"])[:n, :n]
    return np.asarray(motors.T @ np.diag(own) @ motors)


def build_loop(context: Context, table: Any, rotor: Array) -> TorqueLoop:
    """Return the arm's loop in the working posture, as fast as |S| allows, at most 1 / T_v.

    Raises InputError if this is slower than `arm_bandwidth_rad_s`.
    """
    robot, model = context.robot, context.model.reshape(1)
    c, q = choose_bandwidths(table, context), posture(robot, "working")
    J = compute_kinematics(model, q)
    lever = (J["R_BT"][:, 2] @ J["J_BT"])[: len(q)]
    gives = lever @ np.linalg.solve(compute_joint_inertia(model, q) + rotor, lever)
    probe = robot.probe if robot.force_sensor is not None else None
    loop = TorqueLoop(
        min(1.0 / servo.velocity_time_constant_s for _, servo in list_servos(robot)),
        compute_speed_bandwidth(robot), compute_delay(c, context.world), float(1.0 / gives),
        0.0 if probe is None else context.springs.sensor * probe.spring_n_per_m,
    )  # fmt: skip
    for w in np.linspace(loop.w, c.arm_bandwidth_rad_s, 50):
        slower = loop._replace(w=float(w))
        worst = compute_sensitivity(slower, in_air=True)
        if max(worst, compute_sensitivity(slower)) <= SENSITIVITY:
            return slower
    raise InputError(
        f"control law 'backstepping_torque': with a dead time of {1000.0 * loop.delay:.0f} "
        f"ms from encoders to servo torques, a loop of {c.arm_bandwidth_rad_s:g} rad/s "
        "(arm_bandwidth_rad_s) has a sensitivity above 2: reduce the delay, jitter or loss "
        "of world.link, or use velocity servos"
    )


def compute_sensitivity(loop: TorqueLoop, k_f: float = 0.0, in_air: bool = False) -> float:
    """Return the largest |S| at the torques, in the air or in contact; infinity if unstable.

    The stability is checked separately, because |S| of an unstable loop can be small.
    """
    mass, damp, d = loop.mass, loop.mass * 2.0 * loop.w, loop.delay
    plant = [mass, 0.0, 0.0 if in_air else loop.spring]
    push = mass * loop.w**2 if in_air else k_f * loop.spring
    behind, ahead = ([d * d / 12.0, sign * d / 2.0, 1.0] for sign in (1.0, -1.0))  # Pade
    closed = np.polyadd(
        np.polymul(np.polymul(plant, [1.0 / loop.speed, 1.0]), behind),
        np.polymul([damp + push / loop.speed, push], ahead),
    )
    if np.any(np.roots(closed).real >= 0.0):
        return math.inf
    s = 1j * FREQUENCIES
    late, speed = np.exp(-s * loop.delay), s / (1.0 + s / loop.speed)
    return float(np.max(1.0 / np.abs(1.0 + late * (damp * speed + push) / np.polyval(plant, s))))


def compute_force_gain(loop: TorqueLoop) -> float:
    """Return the largest k_f with |S| in contact below SENSITIVITY; 0 without a sensor."""
    found = 0.0
    for k_f in FORCE_GAINS if loop.spring > 0.0 else ():
        if compute_sensitivity(loop, float(k_f)) > SENSITIVITY:
            break
        found = float(k_f)
    return found


@helper
def command_torques(
    me: Any, ref: Any, press: Any, est: Any, body: Any, model: Any, kin: Any, cmd: Any
) -> None:
    """Fill `cmd.torque` by (27)."""
    n = body.n_joints
    motion = Motion(local(MAX_LINKS, 3), local(MAX_LINKS, 3), local(MAX_LINKS, 3))
    qdd, f_B, g_B = local(MAX_JOINTS), local(3), local(3)
    a_B, w_B, wd_B = local(3), local(3), local(3)
    for j in range(MAX_JOINTS):
        cmd.qd[j] = qdd[j] = 0.0
    for j in range(n):
        qdd[j] = (ref.qd[j] - me.qd_ref[j]) / me.dt + (
            me.damp * (ref.qd[j] - est.qd[j]) + me.stiff * (ref.q[j] - est.q[j])
        )
        me.qd_ref[j] = ref.qd[j]
    for i in range(3):
        f_B[i] = 0.0
    if press.press > 0.5 and me.spring > 0.0:
        force = press_with(me, ref, press, est, body, model, kin, motion, qdd)
        for i in range(3):
            f_B[i] = -force * body.R_BT[i, 2]
    mat_t_vec(est.R_WB, ref.a_WB, a_B)
    for i in range(3):
        g_B[i] = -body.gravity * est.R_WB[2, i]
        w_B[i], wd_B[i] = est.w_WB_B[i], ref.wd_WB_B[i]
    fill_motion(model, kin, w_B, wd_B, a_B, est.qd, qdd, motion)
    fill_joint_torque(model, kin, motion, g_B, f_B, cmd.torque)
    for j in range(n):
        for i in range(n):
            cmd.torque[j] += me.rotor[j, i] * qdd[i]


@helper
def press_with(
    me: Any, ref: Any, press: Any, est: Any, body: Any, model: Any, kin: Any, motion: Any, qdd: Any
) -> float:
    """Add the acceleration (30) of a pressing tip to qdd (MAX_JOINTS,); return F_d (N) of (31).

    Along the probe only the tip's speed is damped, relative to W in flight. Across the probe the
    tip follows its reference relative to the platform until contact; then friction holds it.
    """
    n, ahead = body.n_joints, find_extension(ref, body) - REACH
    force = press.force + me.k_f * (press.force - est.f_tip)
    if est.f_tip < TOUCHING:
        force = min(force, me.most)
    J, bias, none = local(2, MAX_JOINTS), local(3), local(MAX_JOINTS)
    fill_tip_rows(body, J)
    for j in range(MAX_JOINTS):
        none[j] = 0.0
    along = across = 0.0
    for j in range(n):
        along -= me.damp * J[0, j] * est.qd[j]
        across -= me.damp * J[1, j] * est.qd[j]
    if press.docked < 0.5:
        along -= me.damp * find_approach(ref, est, body)
    if ahead > 0.0:  # there is no surface
        force = min(force, 0.0)
        along -= me.stiff * ahead
    if est.f_tip < TOUCHING:
        across += me.stiff * find_offset(ref, body)
    fill_tip_bias(body, model, kin, est.qd, none, motion, bias)
    for i in range(3):
        along -= body.R_BT[i, 2] * bias[i]
        across -= body.R_BT[i, 0] * bias[i]
    for j in range(n):  # the null space of the tip keeps the accelerations of the joint loops
        along -= J[0, j] * qdd[j]
        across -= J[1, j] * qdd[j]
    invert_tip(J, n, along, across, none)
    for j in range(n):
        qdd[j] += none[j]
    return force


@helper
def fill_tip_bias(
    body: Any, model: Any, kin: Any, qd: Any, qdd: Any, motion: Any, out: Any
) -> None:
    """Fill J' q' (3,) m/s^2 of the tip in B; `qdd` must be zero, `motion` is scratch memory."""
    zero, r, turn = local(3), local(3), local(3)
    for i in range(3):
        zero[i] = 0.0
    tip = model.tip_link
    fill_motion(model, kin, zero, zero, zero, qd, qdd, motion)
    for i in range(3):
        r[i] = body.p_BT[i] - kin.p[tip, i]
    cross(motion.w[tip], r, turn)
    cross(motion.w[tip], turn, zero)
    cross(motion.wd[tip], r, turn)
    for i in range(3):
        out[i] = motion.a[tip, i] + zero[i] + turn[i]
