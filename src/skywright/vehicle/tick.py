"""The mission tick: sense, estimate, control, allocate, actuate, step, in compiled code.

Both ways of running call the same functions. Fast: `mission_tick` runs all control ticks of one
mission tick in one call. Interactive: the back end calls `before_law`, the law, `after_law`, then
MuJoCo's step, from Python. Everything a control tick needs sits in two records (`BELIEF` for the
controller side, `PLANT` for the truth) and in MuJoCo's own arrays.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.pointers import call_pointer
from skywright.core.rotations import orthonormalise, rot_to_quat
from skywright.core.types import MAX_JOINTS
from skywright.estimation.contact_force import estimate_contact_force
from skywright.estimation.marker import estimate_marker, estimate_pipe
from skywright.estimation.tip_force import estimate_tip_force
from skywright.estimation.wrench import estimate_wrench
from skywright.inspection.eddy_current import ec_signal
from skywright.models.allocation import allocate, thrust_to_speed
from skywright.models.compliant_arms import estimate_joints, fill_arms
from skywright.models.floating import fill_floating
from skywright.models.rigid_body import fill_body, fill_kinematics
from skywright.models.rotors import compute_power
from skywright.sim.friction import rub
from skywright.sim.inertial import read_inertial, sense_inertial
from skywright.sim.limb_drag import drag_limbs
from skywright.sim.link import receive_measurement, send_command, send_measurement
from skywright.sim.loads import sample_loads, watch_loads
from skywright.sim.physics import step_physics
from skywright.sim.plant import actuate, blow, hold_stalled_servos, observe, sense
from skywright.sim.tape import step_tape
from skywright.sim.wind import step_wind
from skywright.vehicle.frame import open_frame
from skywright.vehicle.guard import (
    COLLISION,
    CONTACT_LOST,
    CONTACT_MADE,
    ERROR_MAX,
    FIX_AGE_MAX,
    LOST_CONTROL,
    NOT_FINITE,
    UP_MIN,
)

Record = Any
Array = Any


@njit(cache=True, error_model="numpy")
def interpolate_reference(b: Record, table: Array) -> None:
    """Write the row of `table` at the tick's time into `b.ref`, linear between rows."""
    t = b.t - b.table_t0
    n = table.shape[0]
    i = b.cursor
    while i < n - 2 and table[i + 1].t <= t:
        i += 1
    b.cursor = i
    lo = table[i]
    hi = table[min(i + 1, n - 1)]
    span = hi.t - lo.t
    u = 0.0 if span <= 0.0 else min(max((t - lo.t) / span, 0.0), 1.0)
    w = 1.0 - u
    ref = b.ref
    ref.t = b.t
    ref.track_tip, ref.active = lo.track_tip, lo.active
    ref.dead_zone = hi.dead_zone if u >= 1.0 else lo.dead_zone
    for a in range(3):
        ref.p_WB[a] = w * lo.p_WB[a] + u * hi.p_WB[a]
        ref.v_WB[a] = w * lo.v_WB[a] + u * hi.v_WB[a]
        ref.a_WB[a] = w * lo.a_WB[a] + u * hi.a_WB[a]
        ref.w_WB_B[a] = w * lo.w_WB_B[a] + u * hi.w_WB_B[a]
        ref.wd_WB_B[a] = w * lo.wd_WB_B[a] + u * hi.wd_WB_B[a]
        ref.p_WT[a] = w * lo.p_WT[a] + u * hi.p_WT[a]
        ref.v_WT[a] = w * lo.v_WT[a] + u * hi.v_WT[a]
        for c in range(3):
            ref.R_WB[a, c] = w * lo.R_WB[a, c] + u * hi.R_WB[a, c]
            ref.R_WT[a, c] = w * lo.R_WT[a, c] + u * hi.R_WT[a, c]
            ref.R_WS[a, c] = w * lo.R_WS[a, c] + u * hi.R_WS[a, c]
    for j in range(MAX_JOINTS):
        ref.q[j] = w * lo.q[j] + u * hi.q[j]
        ref.qd[j] = w * lo.qd[j] + u * hi.qd[j]
    ref.tare = lo.tare
    ref.press, ref.docked, ref.mode = lo.press, lo.docked, lo.mode
    ref.force = w * lo.force + u * hi.force
    for a in range(3):
        ref.f_feet_B[a] = w * lo.f_feet_B[a] + u * hi.f_feet_B[a]
        ref.t_feet_B[a] = w * lo.t_feet_B[a] + u * hi.t_feet_B[a]
    for j in range(MAX_JOINTS):
        ref.tau[j], ref.delta[j] = w * lo.tau[j] + u * hi.tau[j], lo.delta[j]
    for h in range(b.arms.n_hands):
        ref.load[h] = w * lo.load[h] + u * hi.load[h]
        ref.task[h], ref.gamma[h] = lo.task[h], lo.gamma[h]
        for a in range(3):
            ref.p_WH[h, a] = w * lo.p_WH[h, a] + u * hi.p_WH[h, a]
            ref.v_WH[h, a] = w * lo.v_WH[h, a] + u * hi.v_WH[h, a]
            ref.f_WH[h, a] = w * lo.f_WH[h, a] + u * hi.f_WH[h, a]
    orthonormalise(ref.R_WB)
    orthonormalise(ref.R_WT)
    orthonormalise(ref.R_WS)


@njit(cache=True, error_model="numpy")
def before_law(
    b: Record,
    pl: Record,
    im: Record,
    lk: Record,
    g: Record,
    model: Record,
    kin: Record,
    stiff: Record,
    table: Array,
    qpos: Array,
    qvel: Array,
    sensordata: Array,
    site_xpos: Array,
    site_xmat: Array,
    estimator: int,
    arms_law: int,
    belief: int,
) -> None:
    """Observe the plant, sense, estimate, update the nominal body, and look up the reference."""
    observe(pl, qpos, qvel, sensordata, site_xpos, site_xmat)
    if lk.on:
        read_inertial(im, lk.sent)
        sense(pl, b.t, lk.sent, qpos, qvel)
        send_measurement(lk, b.t)
        receive_measurement(lk, b.t, b.meas)
    else:
        read_inertial(im, b.meas)
        sense(pl, b.t, b.meas, qpos, qvel)
    estimate_joints(b)
    fill_kinematics(model, b.est.q, kin)
    fill_body(model, kin, b.body)
    call_pointer(estimator, belief)
    if g.truth_estimator:
        _take_truth(b, pl)
    if b.par.spring > 0.0:
        estimate_tip_force(b)
    interpolate_reference(b, table)
    if b.arms.on:
        estimate_marker(b)
        estimate_pipe(b)
    if b.arms.on and pl.tick % pl.servo_every == 0:
        fill_arms(b, model, kin, stiff)
        estimate_contact_force(b)
        call_pointer(arms_law, belief)
    if b.wrench.on:
        fill_floating(model, kin, b.body, b.wrench)
        estimate_wrench(b)


@njit(cache=True, error_model="numpy")
def _take_truth(b: Record, pl: Record) -> None:
    """estimator = "truth": an explicit choice, said so in the report."""
    est = b.est
    for a in range(3):
        est.p_WB[a] = pl.p_WB[a]
        est.v_WB[a] = pl.v_WB[a]
        est.w_WB_B[a] = pl.w_WB_B[a]
        est.p_WT[a] = pl.p_WT[a]
        for c in range(3):
            est.R_WB[a, c] = pl.R_WB[a, c]
            est.R_WT[a, c] = pl.R_WT[a, c]


@njit(cache=True, error_model="numpy")
def after_law(
    b: Record,
    pl: Record,
    lk: Record,
    g: Record,
    B: Array,
    P: Array,
    t_min: Array,
    t_max: Array,
    full: int,
    thrust: Array,
    ctrl: Array,
    xfrc: Array,
    body_xpos: Array,
    body_xmat: Array,
    pair_friction: Array,
) -> None:
    """Check and allocate the command, drive rotors and servos, apply wind and friction."""
    cmd, par = b.cmd, b.par
    n_joints = b.body.n_joints
    total = 0.0
    for i in range(3):
        total += cmd.f_B[i] + cmd.t_B[i]
    for j in range(n_joints):
        total += cmd.qd[j] + cmd.theta[j]
    for i in range(7):
        total += pl.p_WB[i % 3] + pl.v_WB[i % 3] + pl.w_WB_B[i % 3]
    if not math.isfinite(total):  # NaN never reaches a command
        g.fired |= NOT_FINITE
        return
    if b.ref.active > 0.5:
        error = 0.0
        for i in range(3):
            error += (b.ref.p_WB[i] - b.est.p_WB[i]) ** 2
        if error > ERROR_MAX * ERROR_MAX or b.est.R_WB[2, 2] < UP_MIN:
            g.fired |= LOST_CONTROL
        if b.t - g.last_fix > FIX_AGE_MAX:
            g.fired |= LOST_CONTROL
    if b.meas.mocap_fresh + b.meas.fix_fresh + b.meas.odo_fresh > 0.0:
        g.last_fix = b.t
    if b.ref.active < 0.5:
        for i in range(thrust.shape[0]):
            thrust[i] = 0.0
        cmd.saturated = 0.0
    else:
        flag = allocate(
            B, P, t_min, t_max, full, cmd.f_B, cmd.t_B, b.est.R_WB[2], b.body.p_BC, thrust
        )
        cmd.saturated = float(flag)
    for r in range(3):
        f = 0.0
        t = 0.0
        for i in range(thrust.shape[0]):
            f += B[r, i] * thrust[i]
            t += B[r + 3, i] * thrust[i]
        cmd.f_B_alloc[r] = f
        cmd.t_B_alloc[r] = t
    thrust_to_speed(thrust, thrust.shape[0], pl.k_f, cmd.rotor_speed)
    motor = np.empty(MAX_JOINTS)
    for j in range(n_joints):
        v = 0.0
        for i in range(n_joints):
            v += par.belt_inv[j, i] * cmd.qd[i]
        motor[j] = cmd.theta[j] if pl.positioned else v
    if lk.on:
        send_command(lk, b.t, cmd.rotor_speed, motor)
        actuate(pl, lk.speed, lk.motor, par.dt, ctrl)
    else:
        actuate(pl, cmd.rotor_speed, motor, par.dt, ctrl)
    step_wind(
        pl.wind, pl.noise_wind[pl.block], b.t, par.dt, pl.p_WB, pl.R_WB, pl.rotor_p, pl.n_rotors
    )
    blow(pl, xfrc)
    if pl.tape.on:
        step_tape(pl.tape, pl.p_WH[pl.tape.hand], pl.f_WH[pl.tape.hand], par.dt, xfrc)
    if pl.limbs.n > 0:
        _blow_limbs(pl, par.dt, body_xpos, body_xmat, xfrc)
    rub(pl.friction, pl.s, pl.radius * pl.phi, pl.gap, pair_friction)
    pl.tick += 1
    pl.block += 1
    b.t = pl.tick * par.dt


@njit(cache=True, error_model="numpy")
def _blow_limbs(pl: Record, dt: float, body_xpos: Array, body_xmat: Array, xfrc: Array) -> None:
    """Wind and downwash on link and arms."""
    thrust = np.empty(pl.n_rotors)
    for i in range(pl.n_rotors):
        thrust[i] = pl.k_f * pl.rotor_speed[i] * pl.rotor_speed[i]
    drag_limbs(
        pl.limbs, pl.wind.body_W, pl.p_WB, pl.R_WB, pl.rotor_p, thrust, dt, body_xpos, body_xmat,
        xfrc,
    )  # fmt: skip
    for a in range(3):
        pl.f_wind_W[a] += pl.limbs.f_W[a]


@njit(cache=True, error_model="numpy")
def take_sample(
    b: Record, pl: Record, g: Record, ps: Any, qpos: Array, qvel: Array, row: Record
) -> None:
    """Write one sample and let the contact guards look at the instrument."""
    est, ref, cmd = b.est, b.ref, b.cmd
    row.t, row.phase = b.t, g.phase
    quat = np.empty(4)
    rot_to_quat(pl.R_WB, quat)
    row.q_WB[:] = quat
    rot_to_quat(pl.R_WT, quat)
    row.q_WT[:] = quat
    rot_to_quat(est.R_WB, quat)
    row.est_q_WB[:] = quat
    rot_to_quat(ref.R_WB, quat)
    row.ref_q_WB[:] = quat
    rot_to_quat(ref.R_WT, quat)
    row.ref_q_WT[:] = quat
    pushing = 1.0 if ref.dead_zone > 0.0 else 0.0
    for a in range(3):
        row.p_WB[a], row.v_WB[a], row.w_WB_B[a] = pl.p_WB[a], pl.v_WB[a], pl.w_WB_B[a]
        row.p_WT[a] = pl.p_WT[a]
        row.f_contact[a] = pl.f_contact[a]
        row.f_wind_W[a] = pl.f_wind_W[a]
        row.est_p_WB[a], row.est_v_WB[a] = est.p_WB[a], est.v_WB[a]
        row.est_w_WB_B[a], row.est_p_WT[a] = est.w_WB_B[a], est.p_WT[a]
        row.est_f_ext_W[a] = est.f_ext_W[a]
        row.ref_p_WB[a], row.ref_p_WT[a] = ref.p_WB[a], ref.p_WT[a]
        row.ref_normal_W[a] = pushing * ref.R_WS[a, 2]
        row.cmd_f_B[a], row.cmd_t_B[a] = cmd.f_B[a], cmd.t_B[a]
        row.meas_p_WT[a], row.meas_axis_W[a] = b.meas.p_WT[a], b.meas.axis_W[a]
        row.operator_stick[a] = g.stick[a]
    row.operator_button = g.button
    for j in range(MAX_JOINTS):
        row.ref_q[j], row.cmd_qd[j] = ref.q[j], cmd.qd[j]
        row.q[j], row.qd[j] = 0.0, 0.0
    for j in range(pl.n_joints):
        row.q[j], row.qd[j] = qpos[pl.joint_qpos[j]], qvel[pl.joint_dof[j]]
    if pl.positioned:
        _sample_arms(b, pl, qpos, row)
    _sample_objects(pl, qpos, row)
    if pl.loads.on:
        sample_loads(pl.loads, row)
    if pl.force_on:
        row.force_meas, row.ref_force = est.f_tip, ref.force
        row.pressing, row.docked = ref.press, ref.docked
        for a in range(3):
            row.f_docking_W[a] = pl.f_docking_W[a]
    if pl.localisation.on:
        row.fix_age = b.t - b.fus.last_fix
        row.pose_std = math.sqrt(max(b.fus.P[0, 0], b.fus.P[1, 1], b.fus.P[2, 2]))
    thrust = np.zeros(pl.n_rotors)
    for i in range(pl.n_rotors):
        thrust[i] = pl.k_f * pl.rotor_speed[i] * pl.rotor_speed[i]
        row.rotor_thrust[i], row.rotor_speed[i] = thrust[i], pl.rotor_speed[i]
    row.power = compute_power(thrust, pl.n_rotors, pl.watt_per_n15) + pl.avionics
    row.spring = -qpos[pl.slider_qpos] if pl.slider_qpos >= 0 else 0.0
    row.gap, row.gap_max, row.tilt = pl.gap, pl.gap_max, pl.tilt
    normal = 0.0
    for a in range(3):
        normal += pl.normal[a] * pl.f_contact[a]
    row.f_normal = normal
    row.f_collision = pl.f_collision
    row.saturated = cmd.saturated
    if pl.has_pipe:
        k = pl.block
        re, im = ec_signal(
            ps, pl.s, pl.radius * pl.phi, pl.gap, pl.tilt, pl.noise_ec[k, 0], pl.noise_ec[k, 1]
        )
        row.ec[0], row.ec[1] = re, im
        lift = g.lift_axis[0] * re + g.lift_axis[1] * im
        touching = 1 if lift < g.lift_threshold else 0
        if touching and not g.in_contact:
            g.fired |= g.mask & CONTACT_MADE
        if g.in_contact and not touching:
            g.fired |= g.mask & CONTACT_LOST
        g.in_contact = touching
    if pl.f_collision > g.collision_limit:
        g.fired |= g.mask & COLLISION
    pl.gap_max = pl.gap
    pl.f_collision = 0.0


@njit(cache=True, error_model="numpy")
def _sample_arms(b: Record, pl: Record, qpos: Array, row: Record) -> None:
    """Shafts, springs and hands; q becomes the angle of the output link."""
    arms, ref = b.arms, b.ref
    for j in range(pl.n_joints):
        row.theta[j] = qpos[pl.joint_qpos[j]]
        row.cmd_theta[j] = pl.servo_held[j]
        row.deflection[j] = 0.0
        if pl.flex_qpos[j] >= 0:
            row.deflection[j] = -qpos[pl.flex_qpos[j]]
        row.q[j] = row.theta[j] - row.deflection[j]
    for a in range(3):
        row.left_p_WH[a], row.left_f_W[a] = pl.p_WH[0, a], pl.f_WH[0, a]
        row.left_est_p_WH[a], row.left_est_f_W[a] = arms.p_WH[0, a], arms.f_WH[0, a]
        row.left_ref_p_WH[a], row.left_ref_f_W[a] = ref.p_WH[0, a], ref.f_WH[0, a]
    rot_to_quat(pl.R_WH[0], row.left_q_WH)
    if pl.n_hands < 2:
        return
    for a in range(3):
        row.right_p_WH[a], row.right_f_W[a] = pl.p_WH[1, a], pl.f_WH[1, a]
        row.right_est_p_WH[a], row.right_est_f_W[a] = arms.p_WH[1, a], arms.f_WH[1, a]
        row.right_ref_p_WH[a], row.right_ref_f_W[a] = ref.p_WH[1, a], ref.f_WH[1, a]
    rot_to_quat(pl.R_WH[1], row.right_q_WH)


@njit(cache=True, error_model="numpy")
def _sample_objects(pl: Record, qpos: Array, row: Record) -> None:
    """Poses of the world's movable things."""
    if pl.n_objects > 0:
        _copy_pose(qpos, pl.object_qpos[0], row.object0_p_WO, row.object0_q_WO)
    if pl.n_objects > 1:
        _copy_pose(qpos, pl.object_qpos[1], row.object1_p_WO, row.object1_q_WO)
    if pl.n_objects > 2:
        _copy_pose(qpos, pl.object_qpos[2], row.object2_p_WO, row.object2_q_WO)
    if pl.n_objects > 3:
        _copy_pose(qpos, pl.object_qpos[3], row.object3_p_WO, row.object3_q_WO)


@njit(cache=True, error_model="numpy")
def _copy_pose(qpos: Array, at: int, p: Array, q: Array) -> None:
    for a in range(3):
        p[a] = qpos[at + a]
    for a in range(4):
        q[a] = qpos[at + 3 + a]


# The entries from Python: one argument, the frame.


@njit(cache=True, error_model="numpy")
def tick_before_law(frame: Array) -> None:
    """`before_law` called from Python (interactive way)."""
    v = open_frame(frame)
    before_law(
        v.b[0], v.pl[0], v.im[0], v.lk[0], v.g[0], v.model[0], v.kin[0], v.stiff[0], v.table,
        v.qpos, v.qvel, v.sensordata, v.site_xpos, v.site_xmat, v.estimator_address,
        v.arms_law_address, v.belief_address,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def tick_law(frame: Array) -> None:
    """Call the compiled law (interactive way)."""
    v = open_frame(frame)
    call_pointer(v.law_address, v.belief_address)


@njit(cache=True, error_model="numpy")
def tick_after_law(frame: Array, n_samples: int) -> tuple[int, int]:
    """`take_sample` when one is due, then `after_law`; returns (guards fired, samples written)."""
    v = open_frame(frame)
    if v.pl[0].tick % v.g[0].sample_every == 0 and n_samples < v.samples.shape[0]:
        take_sample(v.b[0], v.pl[0], v.g[0], v.probe, v.qpos, v.qvel, v.samples[n_samples])
        n_samples += 1
    after_law(
        v.b[0], v.pl[0], v.lk[0], v.g[0], v.B, v.P, v.t_min, v.t_max, v.full, v.thrust, v.ctrl,
        v.xfrc, v.body_xpos, v.body_xmat, v.pair_friction,
    )  # fmt: skip
    hold_stalled_servos(v.pl[0], v.qpos, v.act, v.ctrl)
    return v.g[0].fired, n_samples


@njit(cache=True, error_model="numpy")
def tick_inertial(frame: Array) -> None:
    """Take an inertial sample and the gauges after a physics step (interactive way)."""
    v = open_frame(frame)
    sense_inertial(v.im[0], v.qpos, v.qvel, v.pl[0].rotor_speed)
    if v.pl[0].loads.on:
        watch_loads(v.pl[0].loads, v.sensordata, v.site_xpos, v.site_xmat)


@njit(cache=True, nogil=True, error_model="numpy")
def mission_tick(frame: Array, n: int, n_steps: int, n_samples: int) -> int:
    """Run up to `n` control ticks of `n_steps` physics steps each, fewer when a guard fires.

    Samples are written from row `n_samples` on; returns how many rows are filled then.
    """
    v = open_frame(frame)
    for _ in range(n):
        before_law(
            v.b[0], v.pl[0], v.im[0], v.lk[0], v.g[0], v.model[0], v.kin[0], v.stiff[0], v.table,
            v.qpos, v.qvel, v.sensordata, v.site_xpos, v.site_xmat, v.estimator_address,
            v.arms_law_address, v.belief_address,
        )  # fmt: skip
        call_pointer(v.law_address, v.belief_address)
        if v.pl[0].tick % v.g[0].sample_every == 0 and n_samples < v.samples.shape[0]:
            take_sample(v.b[0], v.pl[0], v.g[0], v.probe, v.qpos, v.qvel, v.samples[n_samples])
            n_samples += 1
        after_law(
            v.b[0], v.pl[0], v.lk[0], v.g[0], v.B, v.P, v.t_min, v.t_max, v.full, v.thrust, v.ctrl,
            v.xfrc, v.body_xpos, v.body_xmat, v.pair_friction,
        )  # fmt: skip
        hold_stalled_servos(v.pl[0], v.qpos, v.act, v.ctrl)
        if v.g[0].fired & NOT_FINITE:
            break
        for _ in range(n_steps):
            step_physics(v.mj_model, v.mj_data, 1)
            sense_inertial(v.im[0], v.qpos, v.qvel, v.pl[0].rotor_speed)
            if v.pl[0].loads.on:
                watch_loads(v.pl[0].loads, v.sensordata, v.site_xpos, v.site_xmat)
        if v.g[0].fired:
            break
    return n_samples
