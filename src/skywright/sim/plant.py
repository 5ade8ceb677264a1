"""The plant's side of a control tick: sensors, rotors, wind, and the truth that is recorded.

`PLANT` holds what the controller side must never see. The functions run once a control tick, in
compiled code; random draws come from blocks that the back end fills from one stream a sensor.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import cross, exp_so3, mat_mat, mat_t_vec, mat_vec, quat_to_rot
from skywright.core.types import MAX_HANDS, MAX_JOINTS, MAX_OBJECTS, MAX_ROTORS
from skywright.models.force_sensor import Converter, measure_force
from skywright.models.rotors import step_rotor_speed
from skywright.sim.camera import (
    CAMERA,
    CAMERA_NOISE,
    PIPE_NOISE,
    capture_body,
    place_marker,
    take_image,
)
from skywright.sim.friction import FRICTION
from skywright.sim.gnss import GNSS, GNSS_NOISE, sense_gnss
from skywright.sim.limb_drag import LIMBS
from skywright.sim.loads import LOADS
from skywright.sim.localisation import LOCALISATION, sense_localisation
from skywright.sim.surface_effects import SURFACE, find_gains, measure_surface
from skywright.sim.tape import TAPE
from skywright.sim.wind import FAN, NOISE, WIND

Array = NDArray[np.float64]
Record = Any

BLOCK = 1000  # control ticks of noise drawn at a time, at least one mission tick
QUEUE = 64  # motion-capture samples under way
MAX_CONTACTS = 16
DEFLECTION_RATE = 200.0  # Hz (Suarez 2020, section III-B)
DEFLECTION_ERROR = math.radians(0.2)  # rad, accuracy of the AS5047 (same)
DEFLECTION_NOISE = math.radians(0.05)  # rad, 1 sigma
DEFLECTION_LSB = 2.0 * math.pi / 2**14  # rad

f8, i8 = np.float64, np.int64

PLANT = np.dtype(
    [
        ("tick", i8),  # control ticks since the start
        ("block", i8),  # index into the noise block
        # rotors
        ("n_rotors", i8),
        ("rotor_p", f8, (MAX_ROTORS, 3)),
        ("rotor_axis", f8, (MAX_ROTORS, 3)),
        ("k_f", f8),
        ("rotor_tau", f8),
        ("rotor_drag", f8),
        ("watt_per_n15", f8),
        ("avionics", f8),
        ("rotor_speed", f8, MAX_ROTORS),
        # aerodynamics
        ("half_rho_area", f8, 3),  # kg/m, rho/2 C_D A along the body axes
        ("wind", WIND),
        ("noise_wind", f8, (BLOCK, NOISE)),
        ("f_wind_W", f8, 3),  # N, drag now
        ("limbs", LIMBS),
        # addresses in MuJoCo's arrays
        ("n_joints", i8),
        ("joint_qpos", i8, MAX_JOINTS),
        ("joint_dof", i8, MAX_JOINTS),
        ("motor_from_joint", f8, (MAX_JOINTS, MAX_JOINTS)),  # inverse of the belt
        ("servo_lag", f8, MAX_JOINTS),  # rad, command ahead of the motor at the stall torque
        ("joint_servo", i8, MAX_JOINTS),  # index of the servo, -1: passive
        # position servos and compliant joints
        ("positioned", i8),  # 1: servos take angles
        ("servo_every", i8),  # control ticks between commands and readings
        ("servo_lsb", f8, MAX_JOINTS),  # rad, of a command; 0: exact
        ("servo_speed", f8, MAX_JOINTS),  # rad/s
        ("servo_tau", f8, MAX_JOINTS),  # s, lag of the way to a command, before the inner loop's
        ("servo_held", f8, MAX_JOINTS),  # rad, last command
        ("servo_now", f8, MAX_JOINTS),  # rad, on its way there
        ("flex_qpos", i8, MAX_JOINTS),  # -1: rigid
        ("deflection_on", i8, MAX_JOINTS),  # 1: has an encoder
        ("deflection_slot", i8),  # period of the encoders in which they were last read
        ("deflection_wave", f8, MAX_JOINTS),  # rad, phase of the encoder's error over a turn
        ("noise_deflection", f8, (BLOCK, MAX_JOINTS)),
        ("n_hands", i8),
        ("hand_site", i8, MAX_HANDS),
        ("hand_force", i8, MAX_HANDS),  # address of the contact sensor, -1: none
        ("n_objects", i8),
        ("object_qpos", i8, MAX_OBJECTS),
        ("slider_qpos", i8),
        ("platform", i8),
        ("tip_site", i8),
        ("tip_force", i8),
        ("n_collision", i8),
        ("collision", i8, MAX_CONTACTS),
        ("com_B", f8, 3),  # true centre of mass of the platform body, where drag is applied
        # sensors
        ("enc_offset", f8, MAX_JOINTS),
        ("enc_lsb", f8, MAX_JOINTS),
        ("mocap_period", f8),
        ("mocap_latency", f8),
        ("mocap_sigma_p", f8),
        ("mocap_sigma_R", f8),
        ("mocap_dropout", f8),
        ("mocap_outlier", f8),  # fraction
        ("mocap_outlier_size", f8),  # m, largest
        ("mocap_next", f8),  # s, next exposure
        ("mocap_last", f8),  # s, exposure of the last delivered sample
        ("queue_head", i8),
        ("queue_tail", i8),
        ("queue_t", f8, QUEUE),
        ("queue_p", f8, (QUEUE, 3)),
        ("queue_R", f8, (QUEUE, 3, 3)),
        ("queue_tip", f8, (QUEUE, 3)),
        ("queue_axis", f8, (QUEUE, 3)),
        ("marker_T", f8, 3),  # m, calibration error of the probe's markers, in T
        ("noise_mocap", f8, (BLOCK, 12)),
        ("noise_outlier", f8, (BLOCK, 9)),  # uniform
        ("noise_drop", f8, BLOCK),  # uniform
        ("noise_ec", f8, (BLOCK, 2)),
        ("gnss", GNSS),
        ("noise_gnss", f8, (BLOCK, GNSS_NOISE)),
        ("localisation", LOCALISATION),  # instead of motion capture
        ("camera", CAMERA),
        ("noise_camera", f8, (BLOCK, CAMERA_NOISE)),
        ("noise_pipe", f8, (BLOCK, PIPE_NOISE)),
        # surface and tip
        ("has_pipe", i8),
        ("p_WP", f8, 3),
        ("R_WP", f8, (3, 3)),
        ("radius", f8),
        ("half_length", f8),
        ("tip_radius", f8),
        ("friction", FRICTION),
        # truth of this tick
        ("p_WB", f8, 3),
        ("R_WB", f8, (3, 3)),
        ("v_WB", f8, 3),
        ("w_WB_B", f8, 3),
        ("p_WT", f8, 3),
        ("R_WT", f8, (3, 3)),
        ("gap", f8),
        ("gap_max", f8),  # since the last sample
        ("tilt", f8),
        ("normal", f8, 3),
        ("s", f8),
        ("phi", f8),
        ("f_contact", f8, 3),
        ("f_collision", f8),  # since the last sample
        ("p_WH", f8, (MAX_HANDS, 3)),
        ("R_WH", f8, (MAX_HANDS, 3, 3)),
        ("f_WH", f8, (MAX_HANDS, 3)),  # N, force that each hand exerts
        ("tape", TAPE),
        ("loads", LOADS),
        # structure, force sensor, docking gear
        ("surface", SURFACE),
        ("force_on", i8),  # 1: the probe has a force sensor
        ("force_sensor", Converter.dtype),
        ("force_spring", f8),  # N/m
        ("force_preload", f8),  # N
        ("noise_force", f8, BLOCK),
        ("docking_force", i8),  # address of the feet's contact sensor, -1: none
        ("f_docking_W", f8, 3),  # N, force of the structure on the feet
    ]
)


@njit(cache=True, error_model="numpy")
def observe(
    pl: Record, qpos: Array, qvel: Array, sensordata: Array, site_xpos: Array, site_xmat: Array
) -> None:
    """Read the truth of this tick from MuJoCo's arrays (tip and forces are one step old)."""
    for i in range(3):
        pl.p_WB[i] = qpos[i]
        pl.v_WB[i] = qvel[i]
        pl.w_WB_B[i] = qvel[3 + i]
    quat_to_rot(qpos[3:7], pl.R_WB)
    if pl.tip_site < 0:
        for i in range(3):
            pl.p_WT[i] = pl.p_WB[i]
            for j in range(3):
                pl.R_WT[i, j] = pl.R_WB[i, j]
    else:
        for i in range(3):
            pl.p_WT[i] = site_xpos[pl.tip_site, i]
            for j in range(3):
                pl.R_WT[i, j] = site_xmat[pl.tip_site, 3 * i + j]
    pl.gap = 1e3
    if pl.has_pipe and pl.tip_site >= 0:
        _observe_surface(pl)
    if pl.surface.on and pl.tip_site >= 0:
        _observe_structure(pl)
    pl.gap_max = max(pl.gap_max, pl.gap)
    if pl.docking_force >= 0:
        for i in range(3):
            pl.f_docking_W[i] = -sensordata[pl.docking_force + i]
    if pl.tip_force >= 0:
        for i in range(3):
            pl.f_contact[i] = -sensordata[pl.tip_force + i]  # MuJoCo: force of the tip on the pipe
    for h in range(pl.n_hands):
        for i in range(3):
            pl.p_WH[h, i] = site_xpos[pl.hand_site[h], i]
            pl.f_WH[h, i] = sensordata[pl.hand_force[h] + i] if pl.hand_force[h] >= 0 else 0.0
            for j in range(3):
                pl.R_WH[h, i, j] = site_xmat[pl.hand_site[h], 3 * i + j]
    if pl.tape.on:  # tension counts as a force that the hand exerts
        for i in range(3):
            pl.f_WH[pl.tape.hand, i] -= pl.tape.pull * pl.tape.normal_W[i]
    for k in range(pl.n_collision):
        a = pl.collision[k]
        f = math.sqrt(sensordata[a] ** 2 + sensordata[a + 1] ** 2 + sensordata[a + 2] ** 2)
        pl.f_collision = max(pl.f_collision, f)


@njit(cache=True, error_model="numpy")
def _observe_surface(pl: Record) -> None:
    """Gap of the tip's sphere to the cylinder, tilt of the probe, unrolled coordinates."""
    x = y = z = 0.0
    for i in range(3):
        d = pl.p_WT[i] - pl.tip_radius * pl.R_WT[i, 2] - pl.p_WP[i]  # centre of the tip's sphere
        x += pl.R_WP[i, 0] * d
        y += pl.R_WP[i, 1] * d
        z += pl.R_WP[i, 2] * d
    rho = math.sqrt(x * x + z * z)
    pl.s, pl.phi = y, math.atan2(z, -x)
    pl.gap = rho - pl.radius - pl.tip_radius
    c = 0.0
    for i in range(3):
        pl.normal[i] = (pl.R_WP[i, 0] * x + pl.R_WP[i, 2] * z) / max(rho, 1e-9)
        c -= pl.normal[i] * pl.R_WT[i, 2]
    pl.tilt = math.acos(min(max(c, -1.0), 1.0))


@njit(cache=True, error_model="numpy")
def _observe_structure(pl: Record) -> None:
    """Gap of the tip's sphere to the structure, tilt of the probe, normal."""
    centre = np.empty(3)
    for i in range(3):
        centre[i] = pl.p_WT[i] - pl.tip_radius * pl.R_WT[i, 2]
    pl.gap = measure_surface(pl.surface, centre, pl.normal) - pl.tip_radius
    c = 0.0
    for i in range(3):
        c -= pl.normal[i] * pl.R_WT[i, 2]
    pl.tilt = math.acos(min(max(c, -1.0), 1.0))


@njit(cache=True, error_model="numpy")
def sense(pl: Record, t: float, meas: Record, qpos: Array, qvel: Array) -> None:
    """Joint encoders, force sensor, and what localises the robot.

    Motion capture comes with rate, latency, noise, drop-outs and artefacts.
    """
    k = pl.block
    meas.t = t
    if pl.positioned:
        _sense_compliant(pl, t, meas, qpos)
    for j in range(0 if pl.positioned else pl.n_joints):
        lsb = pl.enc_lsb[j]
        raw = qpos[pl.joint_qpos[j]] + pl.enc_offset[j]
        meas.q[j] = lsb * math.floor(raw / lsb + 0.5)
        meas.qd[j] = qvel[pl.joint_dof[j]]
    if pl.force_on:  # the potentiometer reads the spring's travel
        spring = pl.force_preload - pl.force_spring * qpos[pl.slider_qpos]
        meas.force = measure_force(pl.force_sensor, spring, pl.noise_force[k])
    if pl.gnss.on:
        sense_gnss(pl.gnss, t, pl.p_WB, pl.R_WB, pl.noise_gnss[k], pl.noise_drop[k], meas)
    elif pl.localisation.on:
        sense_localisation(pl.localisation, t, pl.p_WB, pl.R_WB, meas)
    elif t >= pl.mocap_next - 1e-9:
        pl.mocap_next += pl.mocap_period
        if pl.noise_drop[k] >= pl.mocap_dropout:
            _expose(pl, t, k)
    meas.mocap_fresh = 0.0
    while (
        pl.queue_tail != pl.queue_head and t - pl.queue_t[pl.queue_tail] >= pl.mocap_latency - 1e-9
    ):
        i = pl.queue_tail
        meas.mocap_fresh = 1.0
        meas.mocap_t = pl.queue_t[i]
        meas.mocap_age = t - pl.queue_t[i]
        meas.mocap_period = pl.queue_t[i] - pl.mocap_last
        pl.mocap_last = pl.queue_t[i]
        for a in range(3):
            meas.p_WB[a] = pl.queue_p[i, a]
            meas.p_WT[a] = pl.queue_tip[i, a]
            meas.axis_W[a] = pl.queue_axis[i, a]
            for b in range(3):
                meas.R_WB[a, b] = pl.queue_R[i, a, b]
        pl.queue_tail = (pl.queue_tail + 1) % QUEUE
    if pl.camera.marker:
        draw = pl.noise_camera[k]
        place_marker(pl.camera, qpos)
        take_image(pl.camera, t, pl.p_WB, pl.R_WB, draw, meas)
        if meas.mocap_fresh > 0.0:
            capture_body(
                pl.camera.p_WM, pl.camera.R_WM, pl.mocap_sigma_p, pl.mocap_sigma_R, draw[6:],
                meas.p_WM, meas.R_WM,
            )  # fmt: skip
    if pl.camera.pipe and meas.mocap_fresh > 0.0:
        capture_body(
            pl.camera.p_WP, pl.camera.R_WP, pl.mocap_sigma_p, pl.mocap_sigma_R, pl.noise_pipe[k],
            meas.p_WP, meas.R_WP,
        )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _sense_compliant(pl: Record, t: float, meas: Record, qpos: Array) -> None:
    """Shaft encoders at the servos' rate, passive joints every tick, deflections at 200 Hz.

    A deflection is read through a 14-bit magnetic encoder whose error follows the angle
    (DEFLECTION_ERROR) and which is noisy.
    """
    k = pl.block
    slot = math.floor(t * DEFLECTION_RATE + 1e-6)
    fresh = slot != pl.deflection_slot
    pl.deflection_slot = slot
    for j in range(pl.n_joints):
        if pl.joint_servo[j] < 0 or pl.tick % pl.servo_every == 0:
            lsb = pl.enc_lsb[j]
            raw = qpos[pl.joint_qpos[j]] + pl.enc_offset[j]
            meas.q[j] = lsb * math.floor(raw / lsb + 0.5)
        if pl.deflection_on[j] and fresh:
            true = -qpos[pl.flex_qpos[j]]
            raw = true + DEFLECTION_ERROR * (
                math.sin(true + pl.deflection_wave[j]) - math.sin(pl.deflection_wave[j])
            )
            raw += DEFLECTION_NOISE * pl.noise_deflection[k, j]
            meas.deflection[j] = DEFLECTION_LSB * math.floor(raw / DEFLECTION_LSB + 0.5)


@njit(cache=True, error_model="numpy")
def _expose(pl: Record, t: float, k: int) -> None:
    """Take one motion-capture sample into the queue."""
    i = pl.queue_head
    nxt = (i + 1) % QUEUE
    if nxt == pl.queue_tail:  # full: the oldest is lost, as in a real link
        pl.queue_tail = (pl.queue_tail + 1) % QUEUE
    turn, rot = np.empty(3), np.empty((3, 3))
    for a in range(3):
        pl.queue_p[i, a] = pl.p_WB[a] + pl.mocap_sigma_p * pl.noise_mocap[k, a]
        pl.queue_tip[i, a] = pl.p_WT[a] + pl.mocap_sigma_p * pl.noise_mocap[k, 3 + a]
        for c in range(3):
            pl.queue_tip[i, a] += pl.R_WT[a, c] * pl.marker_T[c]
        turn[a] = pl.mocap_sigma_R * pl.noise_mocap[k, 6 + a]
    exp_so3(turn, rot)
    mat_mat(pl.R_WB, rot, pl.queue_R[i])
    for a in range(3):
        turn[a] = pl.mocap_sigma_R * pl.noise_mocap[k, 9 + a]
    exp_so3(turn, rot)
    axis = np.empty(3)
    for a in range(3):
        axis[a] = pl.R_WT[a, 2]
    mat_vec(rot, axis, turn)
    for a in range(3):
        pl.queue_axis[i, a] = turn[a]
    if pl.mocap_outlier > 0.0:
        _spoil(pl, i, k)
    pl.queue_t[i] = t
    pl.queue_head = nxt


@njit(cache=True, error_model="numpy")
def _spoil(pl: Record, i: int, k: int) -> None:
    """Turn a sample of the platform, of the probe, or of both into an artefact."""
    u = pl.noise_outlier[k]
    size = 0.01 * (pl.mocap_outlier_size / 0.01) ** u[2]
    if u[0] < pl.mocap_outlier:
        turn, rot = np.empty(3), np.empty((3, 3))
        for a in range(3):
            pl.queue_p[i, a] += size * (2.0 * u[3 + a] - 1.0)
            turn[a] = math.pi * (2.0 * u[6 + a] - 1.0)
        exp_so3(turn, rot)
        mat_mat(pl.R_WB, rot, pl.queue_R[i])
    if u[1] < pl.mocap_outlier:
        for a in range(3):
            pl.queue_tip[i, a] -= size * (2.0 * u[3 + a] - 1.0)
            pl.queue_axis[i, a] = -pl.queue_axis[i, a]


@njit(cache=True, error_model="numpy")
def actuate(pl: Record, rotor_speed: Array, motor_speed: Array, dt: float, ctrl: Array) -> None:
    """Advance the rotor speeds by one control tick and write MuJoCo's controls.

    `motor_speed` (MAX_JOINTS,) is rad/s, or for position servos the shaft's angle in rad.

    Thrust is k_f w^2 at the end of the exact first-order lag, held until the next tick; errors of
    the rotor gains sit in the plant's actuator gears.
    """
    step_rotor_speed(pl.rotor_speed, rotor_speed, pl.n_rotors, dt, pl.rotor_tau)
    for i in range(pl.n_rotors):
        ctrl[i] = pl.k_f * pl.rotor_speed[i] * pl.rotor_speed[i]
    if pl.surface.on:
        find_gains(pl.surface, pl.p_WB, pl.R_WB, pl.rotor_p, pl.rotor_axis, pl.n_rotors)
        for i in range(pl.n_rotors):
            ctrl[i] *= pl.surface.gain[i]
    if not pl.positioned:
        for j in range(pl.n_joints):
            if pl.joint_servo[j] >= 0:
                ctrl[pl.n_rotors + pl.joint_servo[j]] = motor_speed[j]
        return
    # a position servo takes a command at its own rate, rounded, and goes there with a first-order
    # lag, no faster than its no-load speed: theta + T_s theta_dot = theta_ref (Suarez 2020, 17)
    for j in range(pl.n_joints):
        if pl.joint_servo[j] < 0:
            continue
        if pl.tick % pl.servo_every == 0:
            lsb = pl.servo_lsb[j]
            cmd = motor_speed[j]
            pl.servo_held[j] = lsb * math.floor(cmd / lsb + 0.5) if lsb > 0.0 else cmd
        reach = pl.servo_speed[j] * dt
        step = (pl.servo_held[j] - pl.servo_now[j]) * (1.0 - math.exp(-dt / pl.servo_tau[j]))
        pl.servo_now[j] += min(max(step, -reach), reach)
        ctrl[pl.n_rotors + pl.joint_servo[j]] = pl.servo_now[j]


@njit(cache=True, error_model="numpy")
def hold_stalled_servos(pl: Record, qpos: Array, act: Array, ctrl: Array) -> None:
    """Stop the integrated command of a stalled servo: it would leap when it comes free."""
    if pl.positioned:
        return
    for j in range(pl.n_joints):
        ahead = act[j]
        for i in range(pl.n_joints):
            ahead -= pl.motor_from_joint[j, i] * qpos[pl.joint_qpos[i]]
        if abs(ahead) > pl.servo_lag[j] and ahead * ctrl[pl.n_rotors + j] > 0.0:
            ctrl[pl.n_rotors + j] = 0.0


@njit(cache=True, error_model="numpy")
def blow(pl: Record, xfrc: Array) -> None:
    """Drag of body and rotors in the wind, applied to the platform at its centre of mass.

    Body: rho/2 C_D A |v| v along the body axes. Rotors: -c w v in the disc plane, at the hub, in
    the air at that hub where the wind differs over the robot.
    """
    wind = pl.wind
    va, fb, tb = np.empty(3), np.zeros(3), np.zeros(3)
    rel, vb = np.empty(3), np.empty(3)
    for i in range(3):
        rel[i] = pl.v_WB[i] - wind.body_W[i]
    mat_t_vec(pl.R_WB, rel, va)
    speed = math.sqrt(va[0] * va[0] + va[1] * va[1] + va[2] * va[2])
    for i in range(3):
        fb[i] = -pl.half_rho_area[i] * speed * va[i]
    for i in range(3):
        vb[i] = va[i]
    arm, force, turn = np.empty(3), np.empty(3), np.empty(3)
    for n in range(pl.n_rotors):
        if wind.kind == FAN:
            for i in range(3):
                rel[i] = pl.v_WB[i] - wind.rotor_W[n, i]
            mat_t_vec(pl.R_WB, rel, va)
        for i in range(3):
            arm[i] = pl.rotor_p[n, i]
        cross(pl.w_WB_B, arm, turn)
        along = 0.0
        for i in range(3):
            turn[i] += va[i]
            along += turn[i] * pl.rotor_axis[n, i]
        for i in range(3):
            force[i] = -pl.rotor_drag * pl.rotor_speed[n] * (turn[i] - along * pl.rotor_axis[n, i])
            fb[i] += force[i]
            arm[i] -= pl.com_B[i]
        cross(arm, force, turn)
        for i in range(3):
            tb[i] += turn[i]
    for i in range(3):  # body drag acts at the origin of B
        arm[i] = -pl.com_B[i]
        force[i] = -pl.half_rho_area[i] * speed * vb[i]
    cross(arm, force, turn)
    for i in range(3):
        tb[i] += turn[i]
    mat_vec(pl.R_WB, fb, pl.f_wind_W)
    mat_vec(pl.R_WB, tb, turn)
    for i in range(3):
        xfrc[pl.platform, i] = pl.f_wind_W[i]
        xfrc[pl.platform, 3 + i] = turn[i]
