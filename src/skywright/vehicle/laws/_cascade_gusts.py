"""A platform under the cascade, with or without a hanging link, as two planar linear systems.

Along the swing, with x of B, theta the platform's lean and psi the link's angle in W (d: joint
below B, b and J: the link's moments about it, M: moment of the drag on it):

    m x'' - m_l d theta'' - b psi'' = m g theta + F
    -b x'' + b d theta'' + J psi'' + c (psi' - theta') + b g psi = -M

theta follows its command through the lag of the attitude loop (models/floating.py).

Across the swing the link bends on its spring k, with its angle gamma and the platform's phi in W:

    m y'' + m_l d phi'' + b gamma'' = -m g phi + F
    m_l d y'' + (I_p + m_l d^2) phi'' + b d gamma'' + m_l g d phi + k (phi - gamma) = t + d F_l
    b y'' + b d phi'' + J gamma'' + b g gamma + k (gamma - phi) = M

The rate loop, its lead and the rotors produce t. In both planes the law commands the force
m (k_v (k_x e - v) - k_s psi') - f, with the estimated external force f (external_wrench.py).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_continuous_lyapunov

from skywright.core.rotations import rot_z
from skywright.description.robot.limbs import list_limbs
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import Wind
from skywright.description.world.wind import compute_direction, compute_gust_scales, compute_speed
from skywright.models.nominal import Nominal
from skywright.models.part_masses import link_direction
from skywright.models.rigid_body import compute_kinematics
from skywright.vehicle.arms.external_wrench import SWING_BANDWIDTH
from skywright.vehicle.gusts import GustMotion

Array = NDArray[np.float64]

FREQUENCIES = np.geomspace(0.3, 60.0, 120)  # rad/s
RELEASED, RELEASE_STEP = 4.0, 0.02  # s
SLOPE = 0.01  # m/s, step of the finite difference of the drag
RIGID = 100.0  # rad/s, bending frequency of a link without lateral stiffness in the robot file


class Masses(NamedTuple):
    """Platform and link in one plane."""

    mass: float  # kg, whole robot
    gravity: float  # m/s^2
    below: float  # m, d: depth of the joint below B
    carried: float  # kg, m_l: mass that hangs on the joint
    first: float  # kg m, b: first moment about the joint
    second: float  # kg m^2, J: inertia about the joint
    platform: float  # kg m^2, I_p: inertia of the platform
    inertia: float  # kg m^2, I_eff: effective inertia in the law
    stiffness: float  # N m/rad, of the bending
    damping: float  # N m s/rad, across: of the bending; along the swing: of the bearing


class Loops(NamedTuple):
    """Gains in one plane."""

    position: float  # 1/s
    velocity: float  # 1/s
    swing: float  # m/s
    force: float  # rad/s, of the estimated force
    attitude: float  # 1/s
    rate: float  # 1/s
    integral: float  # 1/s
    lead: float  # s
    lag: float  # s, of the rotors
    delay: float  # s


class System(NamedTuple):
    """x' = free x + enter u + drag w, u = asked . x: u is the commanded tilt.

    The inputs w are the drag on the platform (N), that on the link (N), and its moment about the
    joint (N m, positive forward or to the left).
    """

    free: Array  # (n, n)
    enter: Array  # (n,)
    asked: Array  # (n,)
    drag: Array  # (n, 3)
    delay: float

    @property
    def closed(self) -> Array:
        """The closed loop (n, n); the position is its first state."""
        return self.free + np.outer(self.enter, self.asked)

    def is_stable(self) -> bool:
        """Whether all poles of the closed loop have a negative real part."""
        return bool(np.linalg.eigvals(self.closed).real.max() < 0.0)

    def compute_sensitivity(self, w: Array = FREQUENCIES) -> float:
        """Return the largest |S| of the loop opened at the commanded tilt."""
        s = 1j * w[:, None, None]
        inner = np.linalg.solve(s * np.eye(len(self.free)) - self.free, self.enter[None, :, None])
        loop = -(inner[:, :, 0] @ self.asked) * np.exp(-1j * w * self.delay)
        return float(np.max(1.0 / np.abs(1.0 + loop)))

    def compute_settling(self, share: float) -> float:
        """Return the settling time (s) of a released link to `share` of its angle."""
        step, state = expm(RELEASE_STEP * self.closed), np.zeros(len(self.free))
        state[2], outside = 1.0, 0
        for i in range(round(RELEASED / RELEASE_STEP)):
            if abs(state[2] - state[4]) > share:
                outside = i
            state = step @ state
        return outside * RELEASE_STEP

    def compute_variance(self, drag: Array, sigma: float, time: float, along: bool) -> Array:
        """Return the variances (2,) of position (m^2) and joint (rad^2) in Dryden gusts of `sigma`
        (m/s) and `time` (s).

        `drag` (3,) are the inputs of a gust of 1 m/s; `along`: along the mean wind, or across it.
        """
        if along:
            a, b, c = np.array([[-1.0]]), np.array([math.sqrt(2.0)]), np.array([sigma])
        else:
            a, b = np.array([[0.0, 1.0], [-1.0, -2.0]]), np.array([0.0, 1.0])
            c = sigma * np.array([1.0, math.sqrt(3.0)])
        n, k = len(self.free), len(a)
        whole, noise = np.zeros((n + k, n + k)), np.zeros(n + k)
        whole[:n, :n], whole[n:, n:] = self.closed, a / time
        whole[:n, n:], noise[n:] = np.outer(self.drag @ drag, c), b / math.sqrt(time)
        covariance = solve_continuous_lyapunov(whole, -np.outer(noise, noise))
        seen = np.zeros((2, n + k))
        seen[0, 0], seen[1, 2], seen[1, 4] = 1.0, 1.0, -1.0
        return np.asarray(np.diag(seen @ covariance @ seen.T))


def build_along(m: Masses, k: Loops) -> System:
    """Return the system along the swing: x, x', psi, psi', theta and two rates, f, two torques."""
    X, V, PSI, W, THETA, Q1, Q2, F, S, SLOW = range(10)
    one = np.eye(10)
    free, drag = np.zeros((10, 10)), np.zeros((10, 3))
    free[X, V] = free[PSI, W] = free[THETA, Q1] = free[Q1, Q2] = 1.0
    push = m.mass * m.gravity * one[THETA] + m.carried * m.below * one[Q2]
    turn = -m.first * m.gravity * one[PSI] - m.first * m.below * one[Q2]
    turn -= m.damping * (one[W] - one[Q1])
    inverse = np.linalg.inv([[m.mass, -m.first], [-m.first, m.second]])
    for row, (f, t) in zip((V, W), inverse, strict=True):
        free[row], drag[row] = f * push + t * turn, [f, f, -t]
    free[F, F], drag[F] = -k.force, [k.force, k.force, 0.0]
    free[S, S], drag[S, 2] = -SWING_BANDWIDTH, -SWING_BANDWIDTH
    free[SLOW, S], free[SLOW, SLOW] = SWING_BANDWIDTH, -SWING_BANDWIDTH
    gain = k.attitude * k.rate
    free[Q2] = -(gain * one[THETA] + k.rate * one[Q1] + one[Q2]) / k.lead
    rate = one[W] - free[SLOW] / (m.first * m.gravity)
    wanted = -k.velocity * (k.position * one[X] + one[V]) - k.swing * rate
    asked = (wanted - one[F] / m.mass) / m.gravity
    return System(free, gain / k.lead * one[Q2], asked, drag, k.delay)


def build_across(m: Masses, k: Loops) -> System:
    """Return that across the swing: y, y', phi, phi', gamma, gamma', lead, torque, integral, f."""
    Y, V, PHI, W, GAMMA, BEND, LEAD, T, SUM, F = range(10)
    one = np.eye(10)
    free, drag = np.zeros((10, 10)), np.zeros((10, 3))
    free[Y, V] = free[PHI, W] = free[GAMMA, BEND] = 1.0
    bend = m.stiffness * (one[PHI] - one[GAMMA]) + m.damping * (one[W] - one[BEND])
    right = np.array([
        -m.mass * m.gravity * one[PHI],
        one[T] - m.carried * m.gravity * m.below * one[PHI] - bend,
        bend - m.first * m.gravity * one[GAMMA],
    ])  # fmt: skip
    lever = m.carried * m.below
    inverse = np.linalg.inv([
        [m.mass, lever, m.first],
        [lever, m.platform + lever * m.below, m.first * m.below],
        [m.first, m.first * m.below, m.second],
    ])  # fmt: skip
    push = np.array([[1.0, 1.0, 0.0], [0.0, m.below, 0.0], [0.0, 0.0, 1.0]])
    free[[V, W, BEND]], drag[[V, W, BEND]] = inverse @ right, inverse @ push
    # the momentum in the observer is that of a rigid link
    free[F] = k.force * (-m.first * (free[BEND] - free[W]) - one[F])
    drag[F] = k.force * ([1.0, 1.0, 0.0] - m.first * (drag[BEND] - drag[W]))
    ahead = k.lag / k.lead
    turn, lean = -(k.attitude * one[PHI] + one[W]) * k.rate * m.inertia, np.zeros(10)
    free[LEAD] = (turn - one[LEAD]) / k.lead
    free[SUM] = k.integral * turn
    still = (1.0 - ahead) * one[LEAD] + one[SUM] - one[T] + (lever + m.first) / m.mass * one[F]
    free[T] = (ahead * turn + still) / k.lag
    lean[[LEAD, SUM, T]] = 1.0 / k.lead, k.integral, ahead / k.lag
    enter = k.attitude * k.rate * m.inertia * lean
    asked = (k.velocity * (k.position * one[Y] + one[V]) + one[F] / m.mass) / m.gravity
    return System(free, enter, asked, drag, k.delay)


def build_rigid(mass: float, gravity: float, k: Loops) -> System:
    """Return the system of a platform without a hanging link: x, x', tilt and two rates, f."""
    X, V, THETA, Q1, Q2, F = range(6)
    one = np.eye(6)
    free, drag = np.zeros((6, 6)), np.zeros((6, 3))
    free[X, V] = free[THETA, Q1] = free[Q1, Q2] = 1.0
    free[V, THETA], free[F, F] = gravity, -k.force
    drag[V, :2], drag[F, :2] = 1.0 / mass, k.force
    gain = k.attitude * k.rate
    free[Q2] = -(gain * one[THETA] + k.rate * one[Q1] + one[Q2]) / k.lead
    asked = -(k.velocity * (k.position * one[X] + one[V]) + one[F] / mass) / gravity
    return System(free, gain / k.lead * one[Q2], asked, drag, k.delay)


def build_masses(robot: Robot, body: Any, floating: Any, platform: Array) -> tuple[Masses, Masses]:
    """Return the masses along the swing and across it.

    `body` and `floating` are those of the working posture; `platform` (3,) kg m^2 is the inertia
    above all resonances, that of the platform alone.
    """
    link = robot.pendulum
    assert link is not None and link.z_m is not None
    about = int(abs(floating["axis"][0]) < 0.5)  # axis of B about which the link swings
    bends = 1 - about
    mass, below = float(body["mass"]), -link.z_m
    first, carried = float(np.linalg.norm(floating["L_s"])), mass - robot.platform.mass_kg
    lever = carried * below**2 + 2.0 * below * first
    second = float(body["I_B"][bends, bends]) - float(platform[bends]) - lever
    along = Masses(
        mass, float(body["gravity"]), below, carried, first, float(floating["M_ss"]),
        float(platform[about]), float(floating["I_eff"][about, about]), 0.0,
        link.damping_nms_per_rad,
    )  # fmt: skip
    k = link.lateral_stiffness_nm_per_rad
    k = second * RIGID**2 if k is None else k
    return along, along._replace(
        second=second, platform=float(platform[bends]), stiffness=k,
        inertia=float(floating["I_eff"][bends, bends]),
        damping=2.0 * (link.lateral_damping_ratio or 0.0) * math.sqrt(k * second),
    )  # fmt: skip


def compute_gust_motion(
    nominal: Nominal, wind: Wind, q: Array, systems: tuple[System, System], swings: int,
    yaw: float,
) -> GustMotion:  # fmt: skip
    """Return the motion in the gusts of a wind at the heading `yaw` (rad) of the platform.

    `systems`: along the swing, which is along axis `swings` of the platform, and across it.
    """
    speed, hangs = compute_speed(wind), nominal.robot.pendulum is not None
    sigma, time = compute_gust_scales(wind, speed)
    mean = speed * (rot_z(yaw).T @ compute_direction(wind))[:2]
    ahead = mean / max(float(np.linalg.norm(mean)), 1e-9)
    total = np.zeros((2, 2))  # along the swing and across: position, joint
    for i, gust in enumerate((ahead, np.array([-ahead[1], ahead[0]]))):
        high, low = (_drag(nominal, q, mean + sign * SLOPE * gust) for sign in (1.0, -1.0))
        slope = (high - low) / (2.0 * SLOPE)  # (3, 2)
        for k, system in enumerate(systems):
            drag = slope[:, swings if k == 0 else 1 - swings]
            total[k] += system.compute_variance(drag, float(sigma[i]), float(time[i]), i == 0)
    return GustMotion(
        math.sqrt(float(total[:, 0].sum())), math.sqrt(float(total[0, 1])) if hangs else 0.0,
        systems[0].compute_settling if hangs else lambda share: 0.0,
    )  # fmt: skip


def _drag(nominal: Nominal, q: Array, wind_B: Array) -> Array:
    """Return the drag (3, 2) in a level wind (2,) m/s: on the platform, on the links (N), and the
    moment of the latter about the joint (N m).
    """
    robot, world, rotors = nominal.robot, nominal.world, nominal.rotors
    p, n = robot.platform, len(rotors.position)
    mass = p.mass_kg + sum(limb.link.mass_kg for limb in list_limbs(robot))
    omega = math.sqrt(mass * world.gravity_mps2 / n / rotors.k_f)
    areas = 0.5 * world.air_density_kg_m3 * np.array([p.drag_area_x_m2, p.drag_area_y_m2])
    platform = (areas * np.linalg.norm(wind_B) + n * rotors.drag_coefficient * omega) * wind_B
    if robot.pendulum is None:
        return np.array([platform, np.zeros(2), np.zeros(2)])
    return np.array([platform, *compute_link_drag(
        robot, nominal.model, q, world.air_density_kg_m3, wind_B
    )])  # fmt: skip


def compute_link_drag(
    robot: Robot, model: NDArray[Any], q: Array, air_density: float, wind_B: Array
) -> tuple[Array, Array]:
    """Return (force (2,) N, moment about the joint (2,) N m) of a level wind (2,) m/s on the links.

    The links are cylinders as in the plant (vehicle/effects/limb_drag.py), without downwash.
    """
    assert robot.arm is not None and robot.pendulum is not None
    k, force, moment = compute_kinematics(model, q), np.zeros(2), np.zeros(2)
    air = np.array([*wind_B, 0.0])
    for i, limb in enumerate(list_limbs(robot)):
        link, way = limb.link, k["R"][i] @ link_direction(limb.link)
        across = air - (air @ way) * way
        area = 2.0 * link.radius_m * link.length_m
        f = 0.5 * air_density * robot.arm.drag_coefficient * area * np.linalg.norm(across) * across
        middle = k["p"][i] + 0.5 * link.length_m * way
        force += f[:2]
        moment += (k["p"][0, 2] - middle[2]) * f[:2]
    return force, moment
