"""Gains of the cascade, from the bandwidths in the robot file.

- Rate loop: attitude bandwidth times the loop separation. A lead keeps the phase margin in spite of
  the rotors' lag and of the sampling: k / (s (lead s + 1)) e^(-T s) crosses over near k.
- Above a resonance (a link that bends, arms on springs) the inertia of the loop is `I_free`, less
  than `I_eff`. The gain is limited so that FREE_MARGIN remains there; the attitude loop of the axis
  and the motion of the platform along it are slower by the same factor.
- Velocity loop: position bandwidth times the separation.
- A link on a joint without a servo: position, velocity and swing gain follow together from the
  planar model of platform and link, `place_swing_poles`. With `motion_sensitivity` the motion is as
  fast as this bound allows, along the swing and across it, `_quicken`.
"""

from __future__ import annotations

import math
from copy import deepcopy
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Control, Robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.body_records import Body, Kinematics
from skywright.models.floating import compute_free_inertia, fill_floating
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import fill_body, fill_kinematics, posture
from skywright.vehicle.arms.ports import Floating
from skywright.vehicle.gusts import GustModel
from skywright.vehicle.laws._cascade_gusts import (
    Loops,
    Masses,
    build_across,
    build_along,
    build_masses,
    build_rigid,
    compute_gust_motion,
)
from skywright.vehicle.loops import compute_delay

Array = NDArray[np.float64]

FREE_MARGIN = math.radians(35.0)  # rad, of the rate loop above a resonance
YAW = 0.4  # of roll and pitch: yaw has little torque (PX4's default weight of yaw, MC_YAW_WEIGHT)
SLOWEST_SWING, FASTEST_SWING = 0.8, 2.0  # search range of the swing poles / natural frequency
BANDWIDTHS = np.geomspace(0.4, 4.0, 93)  # rad/s, candidates of a motion, 2.5 % apart
DAMPINGS = np.linspace(1.0, 0.5, 6)  # candidates of the swing, over the requested damping
SETTLED, SETTLING = 0.035, 1.6  # share of the release angle (0.7 deg of 20), s
WAYS = "forward", "to the left"
SLOWEST_HUNG = 0.3  # a link swings slower below a fixed platform than below a free one


class SwingModel(NamedTuple):
    """Platform and link in the plane of the swing."""

    mass: float  # kg, whole robot
    first: float  # kg m, first moment of the link about its joint
    second: float  # kg m^2, inertia about it
    gravity: float  # m/s^2

    @property
    def natural(self) -> float:
        """Frequency (rad/s) with the platform free to move."""
        reduced = self.mass * self.second - self.first**2
        return math.sqrt(self.gravity * self.first * self.mass / reduced)

    @property
    def pull(self) -> float:
        """Force of the link on a fixed platform, per mass and per angle (m/s^2)."""
        return self.gravity * self.first**2 / (self.mass * self.second)


class SwingGains(NamedTuple):
    """Gains of the acceleration: a = -(position x + velocity v + swing psi')."""

    position: float  # 1/s^2
    velocity: float  # 1/s
    swing: float  # m/s
    poles: Array  # (2,) complex: one of the platform's motion, one of the swing


class CascadeGains(NamedTuple):
    """All gains; (3,) along the platform's axes forward, left, up, or about those of B."""

    k_position: Array  # 1/s, velocity per position error
    k_velocity: Array  # 1/s, acceleration per velocity error
    k_swing: float  # m/s, acceleration against the swing rate of a passive joint
    k_attitude: Array  # 1/s, rate per attitude error
    k_rate: Array  # 1/s, angular acceleration per rate error
    k_integral: Array  # 1/s, integral gain of the torque
    lead: float  # s, rotor lag that remains after the lead
    rotor_tau: float  # s, nominal rotor lag
    wrench: Array  # rad/s, bandwidth of the estimated external force
    pose: float = 0.0  # rad/s, low-pass of the arms' pose; 0: the pose is not used


def compute_lead(k_rate: float, rotor_tau: float, delay: float, margin: float) -> float:
    """Return the lag (s) that may remain of `rotor_tau` after the lead for a phase margin (rad).

    Raises InputError if the delay alone uses up the margin.
    """
    spare = 0.5 * math.pi - margin - k_rate * delay
    if spare <= 0.0:
        raise InputError(
            f"robot.control: a rate loop of {k_rate:.3g} rad/s (attitude_bandwidth_rad_s "
            f"times loop_separation) has a phase margin below {math.degrees(margin):.3g} "
            "deg with rate_hz and world.link; valid: below "
            f"{(0.5 * math.pi - margin) / delay:.3g} rad/s"
        )
    return min(math.tan(spare) / k_rate, rotor_tau)


def compute_free_factor(k_rate: float, lead: float, delay: float) -> float:
    """Return the factor by which the gain of the rate loop may rise until FREE_MARGIN is left."""
    lo, hi = 0.0, 1e4
    for _ in range(60):
        mid = 0.5 * (lo + hi)
        spare = 0.5 * math.pi - math.atan(lead * mid) - delay * mid - FREE_MARGIN
        lo, hi = (mid, hi) if spare > 0.0 else (lo, mid)
    return max(lo * math.hypot(1.0, lead * lo) / k_rate, 1.0)


def attitude_lag(s: complex, k_attitude: float, k_rate: float, lead: float) -> complex:
    """Return the transfer function of the closed attitude loop at `s` (rad/s)."""
    gain = k_attitude * k_rate
    return gain / (s * s * (lead * s + 1.0) + k_rate * s + gain)


def place_swing_poles(
    m: SwingModel, lag: Any, k_position: float, k_velocity: float, damping: float,
    angle: float = 0.0,
) -> SwingGains:  # fmt: skip
    """Place the poles of platform and swing through the attitude loop's lag.

    Planar model, psi the link's angle in W: m x'' - b psi'' = f, -b x'' + J psi'' + b g psi = 0,
    f = -lag(s) m (k_x x + k_v v + k_s psi'). Each pole s requires 1 + lag k . z(s) = 0, which is
    linear in the gains. Two poles are those of the platform's motion, s^2 + k_v s + k_v k_x, and
    two those of the swing with `damping`. The swing frequency is chosen so that the gain on the
    angle psi is `angle` (m/s^2); with zero, a link held at an angle does not move the platform.
    Raises InputError if no such frequency exists.
    """
    found = _find_swing(m, lag, k_position, k_velocity, damping, angle)
    if found is None:
        dampings = np.linspace(0.02, damping, 50)
        within = [
            d for d in dampings if _find_swing(m, lag, k_position, k_velocity, float(d), angle)
        ]
        most = f"at most {within[-1]:.2f} is" if within else "no damping is"
        raise InputError(
            f"robot.control.swing_damping = {damping:g}: {most} within reach of this "
            "attitude_bandwidth_rad_s and position_bandwidth_rad_s"
        )
    return found


def _find_swing(
    m: SwingModel, lag: Any, k_position: float, k_velocity: float, damping: float, wanted: float
) -> SwingGains | None:
    """Return `place_swing_poles` at the frequency with the gain `wanted` on the angle, or None."""
    motion = np.roots([1.0, k_velocity, k_velocity * k_position]).astype(complex)
    both = [motion[0]] if abs(motion[0].imag) > 1e-9 else list(motion)
    reduced = m.mass * m.second - m.first**2

    def demand(s: Any) -> tuple[Array, Any]:
        angle = m.first / (reduced * s * s + m.mass * m.first * m.gravity)
        x = (m.second - m.first**2 * m.gravity * angle) / (reduced * s * s)
        return m.mass * np.array([x, s * x, angle, s * angle]), -1.0 / lag(s)

    rows: list[Array] = []
    right: list[float] = []
    for s in both:
        row, value = demand(s)
        parts = ("real", "imag") if abs(s.imag) > 1e-9 else ("real",)  # a pair of poles: two
        rows += [getattr(row, part) for part in parts]
        right += [getattr(value, part) for part in parts]

    def gains(frequency: float) -> tuple[Array, complex]:
        swing = frequency * complex(-damping, math.sqrt(1.0 - damping**2))
        row, value = demand(swing)
        equations = np.array([*rows, row.real, row.imag])
        return np.linalg.solve(equations, np.array([*right, value.real, value.imag])), swing

    slowest = SLOWEST_SWING if wanted == 0.0 else SLOWEST_HUNG
    grid = m.natural * np.linspace(slowest, FASTEST_SWING, 61)
    row, value = demand(grid * complex(-damping, math.sqrt(1.0 - damping**2)))
    equations, values = np.empty((61, 4, 4)), np.empty((61, 4, 1))
    equations[:, :2], values[:, :2, 0] = rows, right
    equations[:, 2], equations[:, 3] = row.real.T, row.imag.T
    values[:, 2, 0], values[:, 3, 0] = value.real, value.imag
    angle_gain = np.linalg.solve(equations, values)[:, 2, 0] - wanted
    changes = [i for i in range(60) if angle_gain[i] * angle_gain[i + 1] <= 0.0]
    if not changes:
        return None
    lo, hi = grid[changes[0]], grid[changes[0] + 1]
    rising = angle_gain[changes[0]] < 0.0
    for _ in range(50):
        mid = 0.5 * (lo + hi)
        lo, hi = (mid, hi) if (gains(mid)[0][2] < wanted) == rising else (lo, mid)
    k, swing = gains(0.5 * (lo + hi))
    return SwingGains(float(k[0]), float(k[1]), float(k[3]), np.array([motion[0], swing]))


def compute_cascade_gains(
    c: Control, robot: Robot, world: World, model: Any, inverted: bool = False
) -> CascadeGains:
    """Return the gains that follow from the bandwidths `c`; `model` is a BodyModel record.

    `inverted`: for the law `model_inversion`, whose gains act on the mass of the platform beside a
    free link, and which adds the pull of the link: in this model a gain of -b^2 g / (m J) on psi.
    Results are cached, because plan, law and observer of a vehicle need the same gains.

    Raises InputError if a loop has no phase margin, or no poles of the swing exist.
    """
    case = repr((c, robot, world, inverted, np.asarray(model).tobytes()))
    if case not in _FOUND:
        if len(_FOUND) >= MOST_KEPT:
            _FOUND.clear()
        _FOUND[case] = _compute_gains(c, robot, world, model, inverted)
    return deepcopy(_FOUND[case])


_FOUND: dict[str, CascadeGains] = {}
MOST_KEPT = 32


def _compute_gains(
    c: Control, robot: Robot, world: World, model: Any, inverted: bool
) -> CascadeGains:
    body, floating = compute_bodies(robot, model)
    inertia = np.diag(floating["I_eff"])
    free = compute_free_inertia(robot, world, posture(robot, "working"))
    lead, tau, scale = _scale_rate_loop(c, robot, world, inertia, free)
    k_rate = c.attitude_bandwidth_rad_s * c.loop_separation * scale
    k_attitude = c.attitude_bandwidth_rad_s * scale
    # tilting about the left axis moves forward, tilting about the forward axis moves left
    share = np.array([k_attitude[1], k_attitude[0], c.attitude_bandwidth_rad_s])
    share /= c.attitude_bandwidth_rad_s
    found = CascadeGains(
        k_position=share * c.position_bandwidth_rad_s,
        k_velocity=share * c.position_bandwidth_rad_s * c.loop_separation,
        k_swing=0.0,
        k_attitude=k_attitude,
        k_rate=k_rate,
        k_integral=c.attitude_integral_rad_s * k_attitude / c.attitude_bandwidth_rad_s,
        lead=lead,
        rotor_tau=tau,
        # The platform tilts against a level force. Its estimate is one separation slower than the
        # attitude loop, because the momentum model is rigid. Thrust cancels a vertical force fast.
        wrench=share * c.attitude_bandwidth_rad_s / [c.loop_separation, c.loop_separation, 1],
    )
    if floating["swing"] < 0:
        return found
    along = int(abs(floating["axis"][0]) > 0.5)  # 0: swings forward, 1: to the side
    turn = 1 - along
    first = float(np.linalg.norm(floating["L_s"]))
    m = SwingModel(float(body["mass"]), first, float(floating["M_ss"]), float(world.gravity_mps2))
    if c.motion_sensitivity > 0.0 and not inverted:
        masses = build_masses(robot, body, floating, free)
        return _quicken(found, c, m, masses, along, compute_delay(c, world))
    gains = place_swing_poles(
        m,
        lambda s: attitude_lag(s, float(k_attitude[turn]), float(k_rate[turn]), lead),
        float(found.k_position[along]),
        float(found.k_velocity[along]),
        c.swing_damping,
        -m.pull if inverted else 0.0,
    )
    if inverted:
        beside = 1.0 - m.pull / m.gravity  # effective mass of the platform over the total mass
        gains = SwingGains(
            gains.position / beside, gains.velocity / beside, gains.swing / beside, gains.poles
        )
    found.k_velocity[along] = gains.velocity
    found.k_position[along] = gains.position / gains.velocity
    return found._replace(k_swing=gains.swing)


def compute_bodies(robot: Robot, model: Any) -> tuple[Any, Any]:
    """Return the records Body and Floating of the working posture."""
    q = posture(robot, "working")
    floating, body = np.zeros(1, Floating.dtype)[0], np.zeros(1, Body.dtype)[0]
    floating["swing"] = -1
    for j, limb in enumerate(list_joints(robot)):
        if limb.servo < 0:
            floating["swing"] = j
    full, k = np.zeros(MAX_JOINTS), np.zeros(1, Kinematics.dtype)[0]
    full[: len(q)] = q
    fill_kinematics(model, full, k)
    fill_body(model, k, body)
    fill_floating(model, k, body, floating)
    return body, floating


def build_gust_model(c: Control, g: CascadeGains, nominal: Nominal, yaw: float) -> GustModel | None:
    """Return the motion in gusts (Law.build_gust_model); None for a link that hands hold."""
    robot, world = nominal.robot, nominal.world
    body, floating = compute_bodies(robot, nominal.model[0])
    q, delay = posture(robot, "working"), compute_delay(c, world)
    if robot.pendulum is None:
        mass, g_0 = float(body["mass"]), float(body["gravity"])
        rigid = [build_rigid(mass, g_0, build_loops(g, delay, axis, -1)) for axis in (0, 1)]
        return lambda wind: compute_gust_motion(nominal, wind, q, (rigid[0], rigid[1]), 0, yaw)
    if floating["swing"] < 0:
        return None
    masses = build_masses(robot, body, floating, compute_free_inertia(robot, world, q))
    along = int(abs(floating["axis"][0]) > 0.5)
    loops = [build_loops(g, delay, axis, along) for axis in (along, 1 - along)]
    systems = build_along(masses[0], loops[0]), build_across(masses[1], loops[1])
    return lambda wind: compute_gust_motion(nominal, wind, q, systems, along, yaw)


def build_loops(g: CascadeGains, delay: float, axis: int, swings: int) -> Loops:
    """Return the gains of the motion along `axis` of the platform (0: forward, 1: to the left);
    `swings` is the axis along which the link swings.
    """
    turn = 1 - axis
    return Loops(
        float(g.k_position[axis]), float(g.k_velocity[axis]), g.k_swing if axis == swings else 0.0,
        float(g.wrench[axis]), float(g.k_attitude[turn]), float(g.k_rate[turn]),
        float(g.k_integral[turn]), g.lead, g.rotor_tau, delay,
    )  # fmt: skip


def _quicken(
    g: CascadeGains, c: Control, m: SwingModel, masses: tuple[Masses, Masses], along: int,
    delay: float,
) -> CascadeGains:  # fmt: skip
    """Return `g` with the fastest motion loops whose |S| stays below c.motion_sensitivity.

    Across the swing, velocity and position loop are one loop separation apart, and the bandwidth of
    the force estimate, which acts as an integral, lies between them. Along the swing, the poles of
    the motion have c.position_damping, and the swing has c.swing_damping or the largest feasible
    damping below it; a released link must settle within SETTLING. There the force estimate is as
    fast as the attitude loop, because the model contains the swing of the link but not its bending.
    Raises InputError if no bandwidth meets the bound.
    """
    most, turn, fast = c.motion_sensitivity, 1 - along, g.k_attitude[1 - along]
    lag = partial(attitude_lag, k_attitude=float(fast), k_rate=float(g.k_rate[turn]), lead=g.lead)
    found: list[Loops | None] = [None, None]
    for w in BANDWIDTHS:
        k = build_loops(g, delay, turn, along)._replace(
            position=w, velocity=c.loop_separation * w, force=math.sqrt(c.loop_separation) * w
        )
        system = build_across(masses[1], k)
        if not system.is_stable() or system.compute_sensitivity() > most:
            break
        found[turn] = k
    separation, settled, asked = 2.0 * c.position_damping, math.inf, math.inf
    for damping, w in product(c.swing_damping * DAMPINGS, BANDWIDTHS[::-1]):
        poles = _find_swing(m, lag, w / separation, w * separation, damping, 0.0)
        if poles is None:
            continue
        k = build_loops(g, delay, along, along)._replace(
            position=poles.position / poles.velocity, velocity=poles.velocity, swing=poles.swing,
            force=float(fast),
        )  # fmt: skip
        system = build_along(masses[0], k)
        settles = system.compute_settling(SETTLED) if system.is_stable() else math.inf
        sharp = system.compute_sensitivity() if settles <= SETTLING else math.inf
        settled, asked = min(settled, settles), min(asked, sharp)
        if sharp <= most:
            found[along] = k
            break
    for axis, kept in enumerate(found):
        if kept is None:
            best = f"asks for {asked:.2f}: lengthen it"
            if settled > SETTLING:
                best = f"settles in {settled:.2f} s at best: shorten it"
            link = f"; a link that swings at {m.natural:.2f} rad/s {best}" if axis == along else ""
            raise InputError(
                f"robot.control.motion_sensitivity = {most:g}: with this attitude_bandwidth_rad_s, "
                f"position_damping and swing_damping no bandwidth of the motion {WAYS[axis]} meets "
                f"it and settles the link within {SETTLING:g} s{link}; 0 separates the loops"
            )
        g.k_position[axis], g.k_velocity[axis] = kept.position, kept.velocity
        g.wrench[axis] = kept.force
        g = g._replace(k_swing=max(g.k_swing, kept.swing), pose=float(fast))
    return g


def _scale_rate_loop(
    c: Control, robot: Robot, world: World, inertia: Array, free: Array
) -> tuple[float, float, Array]:
    """Return lead (s), rotor lag (s) and the gain factors (3,) about the axes of B."""
    k_rate = c.attitude_bandwidth_rad_s * c.loop_separation
    # includes the delay of a control link: 10 ms each way cost 23 deg at 20 rad/s
    delay = compute_delay(c, world)
    tau = robot.rotors.time_constant_s
    lead = compute_lead(k_rate, tau, delay, math.radians(c.phase_margin_deg))
    scale = np.minimum(1.0, compute_free_factor(k_rate, lead, delay) * free / inertia)
    scale[2] *= YAW
    return lead, tau, scale
