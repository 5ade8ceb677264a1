"""The gyroscope's noise that a mission may ask the attitude loop to bear."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.models.capability import build_drag_body
from skywright.models.rigid_body import compute_body, posture
from skywright.models.statics import build_layout
from skywright.models.wind import compute_hold
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.loops import choose_bandwidths


def find_noisy_gyroscope(setup: Setup[Any]) -> str | None:
    """Say that the gyroscope's noise makes the attitude loop drive the rotors to their limits, or
    return None.

    A rate averaged over a control period T is off by N / sqrt(T); roll and pitch answer it with the
    torque of `Law.compute_rate_torque` (I 2 zeta w of an attitude loop) times that, which the
    allocation shares among the rotors. (Yaw is slower where it costs much, and is reduced first.)
    `mission.noise_sigmas` of a rotor's share must fit between the thrust of hovering and its nearer
    limit. Nothing is said of laws that tell no torque.
    """
    d, world, robot = setup.description, setup.world, setup.robot
    noise = robot.sensors.gyro_noise_rad_s_sqrthz
    q, layout = posture(robot, "working"), build_layout(setup.rotors, 1.0, setup.allocator)
    mass, c, I_B = compute_body(setup.model, q)
    I_C = I_B - mass * (c @ c * np.eye(3) - np.outer(c, c))
    rate = noise * math.sqrt(robot.control.rate_hz)
    law = build_law(d, setup)
    torque = law.compute_rate_torque(setup, I_C)
    if torque is None or noise == 0.0:
        return None
    share = layout.P[:, 3:] @ torque * rate
    asked = np.linalg.norm(share, axis=1)
    body = build_drag_body(robot, setup.model, q, world.gravity_mps2, world.air_density_kg_m3)
    hover = compute_hold(layout, body, np.zeros((1, 3)))[0][0]
    room = np.minimum(hover - layout.t_min, layout.t_max - hover)
    k = int(np.argmin(room / asked))
    sigmas, most = d.mission.noise_sigmas, max(float(room[k] / asked[k]), 0.0) * noise
    if sigmas * noise <= most:
        return None
    bandwidth = choose_bandwidths(law.table, setup).attitude_bandwidth_rad_s
    return (
        f"robot.sensors.gyro_noise_rad_s_sqrthz = {noise:.3g}: the attitude loop "
        f"(robot.control.attitude_bandwidth_rad_s = {bandwidth:g}) answers it with "
        f"{asked[k]:.2f} N rms a rotor, {sigmas:g} times that (mission.noise_sigmas) exceeds the "
        f"{room[k]:.2f} N between hovering and the rotor's limit; at most "
        f"{most / sigmas:.2g}, or a slower loop"
    )
