"""Arms with springs in their joints, as the controller believes them (record `ARMS`).

Suarez 2020: a servo's shaft theta turns the output link q through a spring, theta - q being the
deflection (14). Where no encoder measures it, the deflection is that of the arm's weight.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import cross, mat_t_vec, mat_vec
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_limbs, list_servos
from skywright.description.robot.spec import Robot
from skywright.models.arm_inverse_kinematics import has_arm_chain
from skywright.models.rigid_body import (
    compute_kinematics,
    fill_gravity_torque,
    fill_hands,
    fill_kinematics,
    fill_point_jacobian,
    find_tip,
)
from skywright.models.springs import joint_deflection

Array = Any
Record = Any

STOP_HARDENING = 10.0
"""Stiffness of a stop over that of its spring, as controllers believe it."""
SWING_BANDWIDTH = 40.0  # rad/s, of the rate estimate of a passive joint
DEFLECTION_STEPS, DEFLECTION_TOLERANCE = 20, 2e-4  # a tick at most; rad: encoders have 0.2 deg

NEVER = 1e3  # s, age of a marker that was not seen yet


def is_compliant(robot: Robot) -> bool:
    """Whether the robot's arms are commanded by shaft angles (record `ARMS` is in use)."""
    return any(servo.mode == "position" for _, servo in list_servos(robot))


def count_command_ticks(robot: Robot) -> int:
    """Return the control ticks between commands to position servos, nearest to their period.

    Of two counts that are equally near it is the longer one (24 ms rather than 16 ms of the 20 ms
    asked for at 125 Hz): a servo takes no command before the last one's period is over.
    """
    period = list_servos(robot)[0][1].command_period_s * robot.control.rate_hz
    return max(math.floor(period + 0.5 + 1e-9), 1)


def fill_arms_parameters(arms: Record, robot: Robot) -> None:
    """Write the parameters of an ARMS record from the robot's description."""
    if not is_compliant(robot):
        return
    assert robot.arm is not None
    joints, servo = list_joints(robot), list_servos(robot)[0][1]
    arms["on"], arms["dt"] = 1, count_command_ticks(robot) / robot.control.rate_hz
    arms["n_hands"], arms["swing"] = robot.arm.sides, -1
    arms["servo_tau"], arms["speed_max"] = servo.position_time_constant_s, servo.no_load_speed_rad_s
    arms["chain"] = int(has_arm_chain(robot))
    _fill_gains(arms, robot)
    arms["R_WM"], arms["marker_age"] = np.eye(3), NEVER
    arms["marker_mocap"], arms["R_WP"] = float(robot.camera is None), np.eye(3)
    for side in range(robot.arm.sides):
        mine = [j for j, limb in enumerate(joints) if limb.side == side]
        arms["first"][side], arms["n"] = mine[0], len(mine)
        links = [joints[j].link for j in mine]
        arms["upper"] = max(link.length_m for link in links[:-1])
        arms["fore"] = links[-1].length_m + robot.arm.hand.length_m
        limbs = list_limbs(robot)
        first = next(limb for limb in limbs if limb.side == side)
        arms["p_BS"][side] = first.offset
        hand = robot.arm.hand
        if hand.kind == "ball" and hand.mass_kg > 0.0:
            arms["pad"][side] = hand.radius_m
        if robot.probe is not None and limbs[find_tip(robot, limbs)].side == side:
            arms["pad"][side] = 0.0
            arms["fore"] = links[-1].length_m + robot.probe.length_m
    for j, limb in enumerate(joints):
        link = limb.link
        arms["q_min"][j], arms["q_max"][j] = (
            math.radians(link.joint_min_deg), math.radians(link.joint_max_deg)
        )  # fmt: skip
        if link.passive:
            arms["swing"] = j
            arms["sensed"][j] = 1.0
        if link.flex_stiffness_nm_per_rad is not None:
            arms["k"][j] = link.flex_stiffness_nm_per_rad
            arms["d"][j] = link.flex_damping_nms_per_rad or 0.0
            arms["sensed"][j] = float(link.deflection_encoder)
            if limb.servo >= 0:
                drive = list_servos(robot)[limb.servo][1]
                arms["slack"][j] = 0.5 * math.radians(drive.backlash_deg)
                arms["stall"][j] = drive.stall_torque_nm
            arms["linear"][j] = math.radians(link.flex_linear_deg or 0.0)
            stop = link.flex_beyond == "stop"
            arms["hardening"][j] = STOP_HARDENING if stop else link.flex_hardening


def find_swing(model: Any, q: Any) -> Any:
    """Return q (n_joints,) with the passive first joint where it hangs at rest (level platform).

    `model` is a (1,) array of BODY_MODEL. Without gravity's torque about the joint there is
    nothing to find: it is found by bisection between -90 and 90 deg.
    """
    q = np.array(q, dtype=float)
    if model[0]["joint"][0] != 0 or model[0]["motor_speed_max"][0] > 0.0:
        return q
    low, high = -0.5 * math.pi, 0.5 * math.pi
    for _ in range(60):
        q[0] = 0.5 * (low + high)
        if compute_gravity_torque(model, q)[0] > 0.0:  # gravity pulls it back: too far
            high = q[0]
        else:
            low = q[0]
    return q


def compute_gravity_torque(model: Any, q: Any) -> Any:
    """Return the torques (MAX_JOINTS,) N m that hold the arms at rest, platform level."""
    torque = np.zeros(MAX_JOINTS)
    fill_gravity_torque(
        model[0], compute_kinematics(model, q), np.array([0.0, 0.0, -model[0]["gravity"]]), torque
    )
    return torque


def find_hands(model: Any, q: Any) -> Any:
    """Return the hands' places p_BH (n_hands, 3) m in B at joints q."""
    return compute_kinematics(model, q)["p_BH"][: model[0]["n_hands"]].copy()


def _fill_gains(arms: Record, robot: Robot) -> None:
    """Gains of the arms' law, from the servos' lag T_s, their period T and the robot's keys.

    Torque, (19) in (22) on (17): theta' = dtheta/T_s and tau' = k theta' with the link held, so
    Kp = w T_s / k gives the bandwidth w; Ki = Kp w / 4 makes the double integrator that (22)
    becomes critically damped. `kp_torque` is w T_s, `ki_torque` w^2 T_s / 4 (over k at each joint).
    Position, (21): the free link rings on its spring, weakly damped, and the encoder sits beyond
    it; `kp_position` and `ki_position` are of a bandwidth (rad/s) that is slow against it.
    Force: displacement = integral of w C (f_ref - f) with C the arm's own compliance, so that f
    answers at w; its phase margin is 60 deg with the lag T_s and 1.5 T of sampling.
    """
    lag, period = float(arms["servo_tau"]), float(arms["dt"])
    c = robot.control
    arms["kp_torque"] = c.torque_bandwidth_rad_s * lag
    arms["ki_torque"] = 0.25 * c.torque_bandwidth_rad_s**2 * lag
    arms["kp_position"] = c.deflection_bandwidth_rad_s * lag
    arms["ki_position"] = 0.25 * c.deflection_bandwidth_rad_s**2 * lag
    arms["ki_force"] = (math.pi / 6.0) / (lag + 1.5 * period)
    arms["ki_hold"] = c.deflection_bandwidth_rad_s
    arms["speed_hand"] = c.hand_speed_max_mps
    arms["estimator"] = float(c.force_estimator == "torque")


@njit(cache=True, error_model="numpy")
def estimate_joints(b: Record) -> None:
    """Fill est.q (output links) and est.qd from shaft encoders and deflections; every tick.

    The rate of a passive joint is a filtered difference of its encoder; the controller holds the
    servos' own rate for zero between their slow readings.
    """
    meas, est, arms = b.meas, b.est, b.arms
    if arms.on == 0:
        for j in range(MAX_JOINTS):
            est.q[j] = meas.q[j]
            est.qd[j] = meas.qd[j]
        return
    gain = 1.0 - math.exp(-SWING_BANDWIDTH * b.par.dt)
    for j in range(MAX_JOINTS):
        if j == arms.swing:  # a first-order tracker: rate = bandwidth * lag
            est.qd[j] = (meas.q[j] - est.q[j]) * gain / b.par.dt
            est.q[j] += est.qd[j] * b.par.dt
        else:
            if arms.sensed[j] > 0.0:
                arms.deflection[j] = meas.deflection[j]
            est.q[j] = meas.q[j] - arms.deflection[j]
            est.qd[j] = 0.0


@njit(cache=True, error_model="numpy")
def _add_load(b: Record, k: Record) -> None:
    """Add what a weight that hangs on the hands asks of the joints to `t_gravity`: J^T f.

    All that knows the arms' own weight (feed-forward, estimates of deflection and force) then knows
    the load's.
    """
    arms = b.arms
    for h in range(arms.n_hands):
        if b.ref.load[h] == 0.0:
            continue
        for j in range(arms.first[h], arms.first[h] + arms.n):
            for a in range(3):  # row z of R_WB: what is up, in B
                arms.t_gravity[j] += k.J_BH[h, a, j] * b.est.R_WB[2, a] * b.ref.load[h]


@njit(cache=True, error_model="numpy")
def fill_weight_stiffness(b: Record, m: Record, k: Record, stiffness: Array) -> None:
    """Fill `stiffness` (MAX_JOINTS,) N m/rad: change of t_gravity_j with q_j, load included.

    Of a weight w at r from the axis a it is w . r - (a . w) (a . r): positive where it hangs.
    """
    r, up = np.empty(3), b.est.R_WB[2]  # row z: what is up, in B
    for j in range(MAX_JOINTS):
        stiffness[j] = 0.0
    for n in range(m.n_links + b.arms.n_hands):
        h = n - m.n_links
        if h < 0:
            i, weight = n, m.mass[n] * m.gravity
            mat_vec(k.R[n], m.com[n], r)
            px, py, pz = k.p[n, 0] + r[0], k.p[n, 1] + r[1], k.p[n, 2] + r[2]
        else:
            i, weight = m.hand_link[h], b.ref.load[h]
            px, py, pz = k.p_BH[h, 0], k.p_BH[h, 1], k.p_BH[h, 2]
        wx, wy, wz = -weight * up[0], -weight * up[1], -weight * up[2]
        while i >= 0:
            joint, axis = m.joint[i], m.axis[i]
            if joint >= 0 and not m.slide[i]:
                ax, ay, az = k.R[i, 0, axis], k.R[i, 1, axis], k.R[i, 2, axis]
                rx, ry, rz = px - k.p[i, 0], py - k.p[i, 1], pz - k.p[i, 2]
                stiffness[joint] += wx * rx + wy * ry + wz * rz
                stiffness[joint] -= (ax * wx + ay * wy + az * wz) * (ax * rx + ay * ry + az * rz)
            i = m.parent[i]


@njit(cache=True, error_model="numpy")
def _step_deflections(b: Record, m: Record, k: Record) -> float:
    """One step towards the deflections of joints without an encoder: D = spring^-1(t_gravity(q)).

    q is the shaft less the deflection, so that the weight's own stiffness G feeds back: to take
    over D whole diverges where G exceeds the spring's k. The step is therefore shortened to
    1 / (1 + 2 trace G / k), the trace of all joints of the arm that are found so: it bounds G's
    largest eigenvalue, and twice allows for the slope of D within the gear's play. What hangs
    converges so however heavy it is. Returns the largest step (rad).
    """
    arms, est = b.arms, b.est
    stiffness = np.empty(MAX_JOINTS)
    fill_weight_stiffness(b, m, k, stiffness)
    largest = 0.0
    for h in range(arms.n_hands):
        trace = 0.0
        for j in range(arms.first[h], arms.first[h] + arms.n):
            if arms.k[j] > 0.0 and arms.sensed[j] == 0.0:
                trace += max(stiffness[j], 0.0)
        for j in range(arms.first[h], arms.first[h] + arms.n):
            if arms.k[j] > 0.0 and arms.sensed[j] == 0.0:
                step = joint_deflection(arms, j, arms.t_gravity[j]) - arms.deflection[j]
                step /= 1.0 + 2.0 * trace / arms.k[j]
                arms.deflection[j] += step
                est.q[j] -= step
                largest = max(largest, abs(step))
    return largest


@njit(cache=True, error_model="numpy")
def fill_arms(b: Record, m: Record, k: Record, stiff: Record) -> None:
    """Fill the arms' state of this tick: gravity torques, deflections, hands; every arms' tick.

    `k` holds the kinematics at est.q; `stiff` is scratch for those at the shafts.
    """
    arms, est = b.arms, b.est
    g_W, g_B = np.zeros(3), np.empty(3)
    g_W[2] = -m.gravity
    mat_t_vec(est.R_WB, g_W, g_B)
    for _ in range(DEFLECTION_STEPS):
        fill_gravity_torque(m, k, g_B, arms.t_gravity)
        fill_hands(m, k)
        _add_load(b, k)
        if _step_deflections(b, m, k) < DEFLECTION_TOLERANCE:
            break
        fill_kinematics(m, est.q, k)
    shafts = np.empty(MAX_JOINTS)
    for j in range(MAX_JOINTS):
        shafts[j] = est.q[j] + arms.deflection[j]
    fill_kinematics(m, shafts, stiff)
    fill_hands(m, stiff)
    vec, spin, rate = np.empty(3), np.empty(3), np.empty(3)
    for a in range(3):
        arms.p_BA[a] = 0.0
        for c in range(3):
            arms.R_BA[a, c] = 1.0 if a == c else 0.0
    if arms.swing >= 0:
        for a in range(3):
            arms.p_BA[a] = k.p[0, a]
            for c in range(3):
                arms.R_BA[a, c] = k.R[0, a, c]
    for h in range(arms.n_hands):
        for a in range(3):
            vec[a] = k.p_BH[h, a] - arms.pad[h] * k.R_BH[h, a, 2]
        fill_point_jacobian(m, k, m.hand_link[h], vec, arms.J_BP[h])
        for a in range(3):
            arms.p_BH[h, a] = k.p_BH[h, a]
            arms.p_BH_stiff[h, a] = stiff.p_BH[h, a]
            rate[a] = 0.0
            for c in range(3):
                arms.R_BH[h, a, c] = k.R_BH[h, a, c]
            for j in range(MAX_JOINTS):
                arms.J_BH[h, a, j] = k.J_BH[h, a, j]
                rate[a] += k.J_BH[h, a, j] * est.qd[j]
        mat_vec(est.R_WB, arms.p_BH[h], vec)
        for a in range(3):
            arms.p_WH[h, a] = est.p_WB[a] + vec[a]
        cross(est.w_WB_B, arms.p_BH[h], spin)
        for a in range(3):
            rate[a] += spin[a]
        mat_vec(est.R_WB, rate, vec)
        for a in range(3):
            arms.v_WH[h, a] = est.v_WB[a] + vec[a]
        elbow = arms.first[h] + arms.n - 1
        arms.manipulability[h] = arms.upper * arms.fore * abs(math.sin(est.q[elbow]))
