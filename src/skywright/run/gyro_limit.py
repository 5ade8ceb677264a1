"""The gyroscope noise that the attitude loop of a mission tolerates."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.models.capability import build_drag_body
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_body, posture
from skywright.models.statics import build_layout
from skywright.models.wind import compute_hold
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.interface import Backend
from skywright.vehicle.loops import choose_bandwidths
from skywright.vehicle.rate_torque import measure_rate_torque
from skywright.vehicle.simulated import SimulatedVehicle


class Strain(NamedTuple):
    """Load of the gyroscope's noise on the rotor with the least margin for it."""

    asked: float  # N rms, thrust of the rotor due to noise
    room: float  # N, between hovering and the rotor's nearer limit

    def exceeds(self, sigmas: float) -> bool:
        """Whether `sigmas` standard deviations exceed the margin."""
        return sigmas * self.asked > self.room

    def describe(self, noise: float, sigmas: float) -> str:
        """Return the part of a refusal that states load, margin and the largest valid noise."""
        most = max(self.room / self.asked, 0.0) * noise / sigmas
        return (
            f"into {self.asked:.2f} N rms per rotor; {sigmas:g} times that (mission.noise_sigmas) "
            f"exceeds the {self.room:.2f} N between hovering and the rotor's limit; valid: at most "
            f"{most:.2g}"
        )


def compute_strain(nominal: Nominal, torque: Array) -> Strain:
    """Compute the load on the rotors of a law that answers rates with `torque` (3, 2) N m s.

    The error of a rate averaged over a control period T is N / sqrt(T). The allocation distributes
    the torque over the rotors.
    """
    robot, world = nominal.robot, nominal.world
    q, layout = posture(robot, "working"), build_layout(nominal.rotors, 1.0, nominal.allocator)
    rate = robot.sensors.gyro_noise_rad_s_sqrthz * math.sqrt(robot.control.rate_hz)
    asked = np.linalg.norm(layout.P[:, 3:] @ torque * rate, axis=1)
    body = build_drag_body(robot, nominal.model, q, world.gravity_mps2, world.air_density_kg_m3)
    hover = compute_hold(layout, body, np.zeros((1, 3)))[0][0]
    room = np.minimum(hover - layout.t_min, layout.t_max - hover)
    k = int(np.argmin(room / np.maximum(asked, 1e-12)))
    return Strain(float(asked[k]), float(room[k]))


def find_noisy_gyroscope(setup: Setup[Any]) -> str | None:
    """Return a message if the gyroscope's noise drives the rotors to their limits, else None.

    In roll and pitch, the law answers a rate with the torque of `Law.compute_rate_torque` (I 2 zeta
    w of an attitude loop). (Yaw is slower where it is costly, and is reduced first.)
    `mission.noise_sigmas` of a rotor's share must fit between the hover thrust and its nearer
    limit. Laws that do not provide the torque are checked in flight by `explain_noise`.
    """
    d, robot = setup.description, setup.robot
    noise = robot.sensors.gyro_noise_rad_s_sqrthz
    mass, c, I_B = compute_body(setup.model, posture(robot, "working"))
    law = build_law(d, setup)
    torque = law.compute_rate_torque(setup, I_B - mass * (c @ c * np.eye(3) - np.outer(c, c)))
    if torque is None or noise == 0.0:
        return None
    strain, sigmas = compute_strain(setup, torque), d.mission.noise_sigmas
    if not strain.exceeds(sigmas):
        return None
    bandwidth = choose_bandwidths(law.table, setup).attitude_bandwidth_rad_s
    return (
        f"robot.sensors.gyro_noise_rad_s_sqrthz = {noise:.3g}: the attitude loop "
        f"(robot.control.attitude_bandwidth_rad_s = {bandwidth:g}) converts it "
        f"{strain.describe(noise, sigmas)}, or a lower bandwidth"
    )


def explain_noise(vehicle: Backend, sigmas: float) -> str:
    """Return a message if the law's answer to gyroscope noise exceeds the rotors, else "".

    Measured on the law's own step in flight, so that it holds for laws that do not provide a
    torque.
    """
    if not isinstance(vehicle, SimulatedVehicle):
        return ""
    torque = measure_rate_torque(vehicle.assembly, vehicle.law)
    if torque is None:
        return ""
    strain = compute_strain(vehicle.nominal, torque)
    if not strain.exceeds(sigmas):
        return ""
    noise = vehicle.robot.sensors.gyro_noise_rad_s_sqrthz
    return (
        f"the law converts the gyroscope's noise (robot.sensors.gyro_noise_rad_s_sqrthz = "
        f"{noise:.3g}) {strain.describe(noise, sigmas)}, or a lower rate gain of the law"
    )
