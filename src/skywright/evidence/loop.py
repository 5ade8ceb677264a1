"""Stability margins of a scan's loops, and the motion of the tip in gusts.

`python -m skywright.evidence.loop` prints them. The linear model describes a fully actuated robot
under laws (3) and (4) of Tognon 2018: the nominal rigid body in its working posture, pressed on a
surface by its spring, rotors with a first-order lag, and the dead time of sampling. Angles are
small, so B and W have the same axes; the arm is rigid, and the estimate is exact.

    m p'' = f + f_gust + f_contact            f = -Kp p_T - Kd v_B - Ki int(trim p_T)
    I th'' = t + t_gust + p_CT x f_contact    t = -(K th + D th' + J int th)
    rotors: lag w' = u - w, u = (f, t) delayed

Friction opposes the sliding. Along the passes only its variation with the normal force acts; across
them it damps small motions with mu F / v at the sliding speed v. This damping grows without bound
where the sliding slows down (corners, stops). The describing function of Coulomb friction covers
every value, so a loop without limit cycles must be well damped for all of them.

Margins are those of the loop broken at one component of the wrench, with the other five closed. The
tip's rms follows from the spectrum of Dryden turbulence (MIL-F-8785C) through the closed loop.
"""

import math
from typing import NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.description.loader import Description, load_description
from skywright.description.world.wind import compute_dryden_scales, compute_speed
from skywright.errors import InputError
from skywright.evidence.command import Command
from skywright.models.capability import compute_capability
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip, posture
from skywright.models.vectors import build_cross_matrix
from skywright.models.wind import compute_drag

Complex = NDArray[np.complex128]

NAMES = ("x", "y", "z", "roll", "pitch", "yaw")
NORMAL, ALONG, ACROSS = 0, 1, 2  # the robot faces the surface; passes run along y
DEAD_TICKS = 1.5
"""Dead time in control ticks: one from a measurement to the thrust that it causes, and half a tick
as the mean hold time of a command."""
BRAKES = (0.0, 20.0, 40.0, 80.0, 160.0, 320.0)
"""N s/m: friction of 0.3 N (push 2 N, friction 0.15) over 15 to 1 mm/s, and none."""
FREQUENCIES = np.geomspace(0.02, 250.0, 4000)
"""rad/s"""


class Gains(NamedTuple):
    """Bandwidths (rad/s) and damping ratios, as in `robot.control`."""

    position: float
    position_damping: float
    position_integral: float
    attitude: float
    attitude_damping: float
    attitude_integral: float


class LoopModel(NamedTuple):
    """All parameters except the gains. SI; about the centre of mass, in B."""

    mass: float
    inertia: Array  # (3, 3)
    p_CB: Array  # (3,) from the centre of mass to B's origin
    p_CT: Array  # (3,) and to the tip
    stiffness: float  # N/m of probe spring along the normal
    friction: float  # coefficient: the sliding friction changes with the normal force
    friction_damping: float  # N s/m across the sliding
    lag: float  # s, rotors
    delay: float  # s
    drag: Array  # (6, 3) force and torque per m/s of gust
    sigma: Array  # (3,) m/s of the gusts along x, y, z; 0 without turbulence
    time: Array  # (3,) s, their time scales L / V
    along: int  # axis of the mean wind


class Margin(NamedTuple):
    """Margin of one loop: crossover, phase margin, and the largest peak of S."""

    name: str
    crossover: float  # rad/s
    phase_deg: float
    sensitivity: float


def read_gains(description: Description) -> Gains:
    """Return the gains in the robot file."""
    c = description.robot.control
    return Gains(
        c.position_bandwidth_rad_s, c.position_damping, c.position_integral_rad_s,
        c.attitude_bandwidth_rad_s, c.attitude_damping, c.attitude_integral_rad_s,
    )  # fmt: skip


def build_loop_model(description: Description) -> LoopModel:
    """Build the model of a weld scan's robot and world; kinds of wind: still, steady, dryden."""
    d, robot = description, description.robot
    if robot.probe is None or d.world.pipe is None:
        raise InputError(
            f"robot {robot.name!r} in world {d.world.name!r}: a probe and a pipe are required"
        )
    model = build_body_model(robot, d.world.gravity_mps2)
    q = posture(robot, "working")
    mass, p_BC, inertia = compute_body(model, q)
    p_BT, _ = compute_tip(model, q)
    inertia = inertia - mass * (p_BC @ p_BC * np.eye(3) - np.outer(p_BC, p_BC))
    k = compute_capability(
        robot, gravity=d.world.gravity_mps2, air_density=d.world.air_density_kg_m3,
        directions_deg=[0.0],
    )  # fmt: skip
    wind, speed = d.world.wind, compute_speed(d.world.wind)
    toward = math.radians(wind.toward_deg)
    along = int(abs(math.sin(toward)) > abs(math.cos(toward)))
    mean = np.zeros(3)
    mean[along] = speed
    steps = np.vstack([mean + 0.1 * np.eye(3), mean - 0.1 * np.eye(3)])
    hover = np.tile(k.hover_thrust, (6, 1))
    force, torque = compute_drag(k.layout, k.body, steps, hover)
    torque = torque - np.cross(p_BC, force)
    wrench = np.hstack([force, torque])
    sigma, time = np.zeros(3), np.ones(3)
    if wind.kind == "dryden":
        scales = compute_dryden_scales(wind)
        order = [along, 1 - along, 2]
        sigma[order], time[order] = scales.sigma, scales.length / speed
    drag = d.world.pipe.friction * robot.probe.force_n
    return LoopModel(
        mass, inertia, -p_BC, p_BT - p_BC, robot.probe.spring_n_per_m,
        d.world.pipe.friction, drag / d.mission.task.speed_mps,
        robot.rotors.time_constant_s, DEAD_TICKS / robot.control.rate_hz,
        (wrench[:3] - wrench[3:]).T / 0.2, sigma, time, along,
    )  # fmt: skip


class Matrices(NamedTuple):
    """M q'' + C q' + K q = wrench for q = (p_C, theta); wrench = -(P + D s + I / s) q."""

    M: Array
    C: Array
    K: Array
    P: Array
    D: Array
    I: Array  # noqa: E741
    tip: Array  # (3, 6)


def build_matrices(m: LoopModel, g: Gains) -> Matrices:
    """Build the matrices of body and contact, and of the laws (4) and (3)."""
    tip = np.hstack([np.eye(3), -build_cross_matrix(m.p_CT)])
    base = np.hstack([np.eye(3), -build_cross_matrix(m.p_CB)])
    inertia, damper, spring = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    inertia[:3, :3], inertia[3:, 3:] = m.mass * np.eye(3), m.inertia
    damper[:] = m.friction_damping * np.outer(tip[ACROSS], tip[ACROSS])
    spring[:] = m.stiffness * np.outer(tip[NORMAL] + m.friction * tip[ALONG], tip[NORMAL])
    kp, stiff = m.mass * g.position**2, g.attitude**2 * m.inertia
    trim = np.diag([0.0, 1.0, 1.0])  # dead zone: no integral action along the normal
    turn = np.hstack([np.zeros((3, 3)), np.eye(3)])
    proportional = np.vstack([kp * tip, stiff @ turn])
    rate = np.vstack([
        2.0 * g.position_damping * m.mass * g.position * base,
        2.0 * g.attitude_damping / g.attitude * stiff @ turn,
    ])  # fmt: skip
    integral = np.vstack(
        [g.position_integral * kp * trim @ tip, g.attitude_integral * stiff @ turn]
    )
    return Matrices(inertia, damper, spring, proportional, rate, integral, tip)


def compute_response(m: LoopModel, g: Gains, w: Array) -> tuple[Complex, Complex]:
    """Return the plant's inverse and the laws with lag and delay, (n, 6, 6) each, at w (n,)."""
    k = build_matrices(m, g)
    s = 1j * w[:, None, None]
    lag = np.exp(-s * m.delay) / (1.0 + m.lag * s)
    plant = np.asarray(k.M * s**2 + k.C * s + k.K, dtype=np.complex128)
    return plant, np.asarray((k.P + k.D * s + k.I / s) * lag, dtype=np.complex128)


def compute_poles(m: LoopModel, g: Gains) -> Complex:
    """Return the poles (30,) of the closed loop, with a first-order Pade approximation of the
    delay."""
    k, o, e = build_matrices(m, g), np.zeros((6, 6)), np.eye(6)
    mi = np.linalg.inv(k.M)
    # states: q, q', integral of q, rotors' wrench, delay d with output d - u, d' = (4u - 2d) / T
    u = [-k.P, -k.D, -k.I, o, o]
    state = np.block([
        [o, e, o, o, o],
        [-mi @ k.K, -mi @ k.C, o, mi, o],
        [e, o, o, o, o],
        [(-x - e * (i == 3) + e * (i == 4)) / m.lag for i, x in enumerate(u)],
        [(4.0 * x - 2.0 * e * (i == 4)) / m.delay for i, x in enumerate(u)],
    ])  # fmt: skip
    poles = np.linalg.eigvals(state)
    return np.asarray(poles[np.abs(poles) > 1e-6])  # no integral along the normal: one pole is 0


def compute_least_damping(m: LoopModel, g: Gains) -> float:
    """Return the smallest damping ratio of the closed loop over all BRAKES of friction."""
    least = 1.0
    for brake in BRAKES:
        poles = compute_poles(m._replace(friction_damping=brake), g)
        least = min(least, float(np.min(-poles.real / np.abs(poles))))
    return least


def compute_margins(m: LoopModel, g: Gains, w: Array = FREQUENCIES) -> list[Margin]:
    """Return the margin of each component of the wrench with the other five loops closed."""
    plant, control = compute_response(m, g, w)
    sensitivity = np.linalg.inv(np.eye(6) + control @ np.linalg.inv(plant))
    out = []
    for i, name in enumerate(NAMES):
        one = 1.0 / sensitivity[:, i, i] - 1.0  # the open loop at this component
        size, phase = np.abs(one), np.angle(one)
        across = np.flatnonzero(np.diff(np.sign(size - 1.0)) != 0)
        left = np.pi - np.abs(phase[across])
        k = int(np.argmin(left)) if len(across) else 0
        at, rest = (w[across[k]], math.degrees(left[k])) if len(across) else (0.0, 180.0)
        out.append(Margin(name, float(at), rest, float(np.max(np.abs(sensitivity[:, i, i])))))
    return out


def compute_spectrum(m: LoopModel, w: Array) -> Array:
    """Return the one-sided spectra (n, 3) (m/s)^2 per rad/s of the gusts along x, y and z."""
    out = np.zeros((len(w), 3))
    for axis in range(3):
        x = m.time[axis] * w
        longitudinal = axis == m.along
        shape = 1.0 / (1.0 + x**2) if longitudinal else 0.5 * (1 + 3 * x**2) / (1 + x**2) ** 2
        out[:, axis] = 2.0 * m.sigma[axis] ** 2 * m.time[axis] / np.pi * shape
    return out


def compute_tip_rms(m: LoopModel, g: Gains) -> Array:
    """Return the tip's rms (3,) m from gusts: along the normal, along and across the passes."""
    w = np.geomspace(0.005, 250.0, 2000)
    plant, control = compute_response(m, g, w)
    closed = build_matrices(m, g).tip @ np.linalg.inv(plant + control) @ m.drag
    power = np.abs(closed) ** 2 @ compute_spectrum(m, w)[:, :, None]
    return np.asarray(np.sqrt(np.trapezoid(power[:, :, 0], w, axis=0)))


@click.command("loop", cls=Command)
@click.option("--robot", metavar="ROBOT")
@click.option("--set", "sets", multiple=True, metavar="KEY=VALUE")
def main(robot: str | None, sets: tuple[str, ...]) -> None:
    """Print margins and gust response of a scan's loops."""
    d = load_description("pipe-weld-scan", robot=robot, sets=sets)
    m, g = build_loop_model(d), read_gains(d)
    print("  ".join(f"{k} {v:g}" for k, v in g._asdict().items()))
    print(f"slowest pole {np.max(compute_poles(m, g).real):.2f} 1/s")
    print(f"least damping ratio while friction brakes the tip {compute_least_damping(m, g):.2f}")
    print("loop   crossover  phase margin  largest |S|")
    for x in compute_margins(m, g):
        print(f"{x.name:6} {x.crossover:5.1f} rad/s {x.phase_deg:8.0f} deg {x.sensitivity:12.2f}")
    if np.any(m.sigma):
        rms = 1e3 * compute_tip_rms(m, g)
        print(f"tip in these gusts: {rms[1]:.2f} mm rms along the passes, {rms[2]:.2f} mm across")


if __name__ == "__main__":
    main()
