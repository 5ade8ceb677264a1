"""Wind and the rotors' downwash on a robot's link and arms, as forces on these bodies; compiled.

Every link is a cylinder in SEGMENTS pieces. Independence principle: only the air's velocity across
the cylinder makes a force, f = rho/2 C_D d |v_n| v_n per length (Hoerner, Fluid-Dynamic Drag, 1965,
chapter 3: C_D of a circular cylinder 1.0 to 1.2 below the critical Reynolds number).

Downwash: momentum theory gives a rotor's wake the radius R / sqrt 2 and the speed 2 v_i,
v_i = sqrt(T / (2 rho A)) (Leishman, Principles of Helicopter Aerodynamics, 2nd ed., section 2.2);
further down it spreads as a free jet. The wakes' momentum fluxes add (Reichardt's hypothesis, in
Rajaratnam, Turbulent Jets, 1976, chapter 1), each with the profile

    rho v^2 = T / (pi b^2) exp(-r^2 / b^2),   b^2 = R^2 / 2 + (C z)^2,

which carries the thrust T at every distance z below the rotor and has 2 v_i on its axis at the
rotor. Wakes go straight down the rotors' axis: wind does not bend them, limbs do not block them.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import cross, mat_t_vec
from skywright.description.robot.bar import Bar
from skywright.description.robot.limbs import list_limbs
from skywright.description.robot.spec import Robot
from skywright.models.part_masses import link_direction
from skywright.models.rigid_body import MAX_LINKS

Array = NDArray[np.float64]
Record = Any

SEGMENTS = 3  # of a link
SPREAD = 0.075  # width of a round free jet over its length (Reichardt)
FAR = 16.0  # r^2 / b^2 beyond which a wake is not felt: exp(-16) = 1e-7 of its momentum flux

f8, i8 = np.float64, np.int64

LIMBS = np.dtype(
    [
        ("n", i8),  # links; 0: this robot asks for no such forces
        ("ready", i8),
        ("body", i8, MAX_LINKS),  # index in MuJoCo
        ("com", f8, (MAX_LINKS, 3)),  # m, in the link's frame: where the force is applied
        ("point", f8, (MAX_LINKS, SEGMENTS, 3)),  # m, middles of the pieces, in the link's frame
        ("along", f8, (MAX_LINKS, 3)),
        ("coefficient", f8, MAX_LINKS),  # kg/m, rho/2 C_D d l of a piece
        ("density", f8),  # kg/m^3
        ("wake", f8),  # m, radius of the contracted wake
        ("before", f8, (MAX_LINKS, SEGMENTS, 3)),  # m, the points one tick ago
        ("f_W", f8, 3),  # N, sum
        ("given_W", f8, (MAX_LINKS, 3)),  # N, a disturbance that a mission asked for
    ]
)


def fill_limbs(out: Any, robot: Robot, model: mujoco.MjModel, air_density: float) -> None:
    """Fill a LIMBS record; leaves n = 0 where `robot.arm.drag_coefficient` is 0."""
    if robot.arm is None or robot.arm.drag_coefficient == 0.0:
        return
    limbs = list_limbs(robot)
    out["n"], out["density"] = len(limbs), air_density
    out["wake"] = robot.rotors.propeller_radius_m / math.sqrt(2.0)
    for i, limb in enumerate(limbs):
        link, way = limb.link, link_direction(limb.link)
        out["body"][i] = model.body(limb.name).id
        out["com"][i] = model.body(limb.name).ipos
        out["along"][i] = way
        piece = link.length_m / SEGMENTS
        for s in range(SEGMENTS):
            out["point"][i, s] = (s + 0.5) * piece * way
        area = 2.0 * link.radius_m * piece
        out["coefficient"][i] = 0.5 * air_density * robot.arm.drag_coefficient * area
    if robot.arm.bar is not None:
        _add_bar(out, robot.arm.bar, 0.5 * air_density * robot.arm.drag_coefficient, model)


def _add_bar(out: Any, bar: Bar, factor: float, model: mujoco.MjModel) -> None:
    i, piece = int(out["n"]), bar.length_m / SEGMENTS
    out["n"], out["body"][i] = i + 1, model.body("bar").id
    out["along"][i] = [0.0, 1.0, 0.0]
    for s in range(SEGMENTS):
        out["point"][i, s] = [0.0, (s + 0.5) * piece - 0.5 * bar.length_m, 0.0]
    out["coefficient"][i] = factor * bar.diameter_m * piece


@njit(cache=True, error_model="numpy")
def downwash(density: float, wake: float, rotor_p: Array, thrust: Array, p_B: Array) -> float:
    """Return the speed (m/s) along -z_B of the rotors' wakes at p_B (3,) m in B."""
    flux, last, inverse = 0.0, 0.0, 0.0
    for n in range(thrust.shape[0]):
        z = rotor_p[n, 2] - p_B[2]
        if z <= 0.0 or thrust[n] <= 0.0:
            continue
        if z != last:  # rotors mostly share one plane
            last, inverse = z, 1.0 / (wake * wake + (SPREAD * z) ** 2)
        x, y = p_B[0] - rotor_p[n, 0], p_B[1] - rotor_p[n, 1]
        ratio = (x * x + y * y) * inverse
        if ratio < FAR:
            flux += thrust[n] * inverse * math.exp(-ratio)
    return math.sqrt(flux / (math.pi * density))


@njit(cache=True, error_model="numpy")
def drag_limbs(
    limbs: Record,
    wind_W: Array,
    p_WB: Array,
    R_WB: Array,
    rotor_p: Array,
    thrust: Array,
    dt: float,
    xpos: Array,
    xmat: Array,
    xfrc: Array,
) -> None:
    """Write the forces on all links into xfrc (n_bodies, 6), about their centres of mass.

    wind_W (3,) m/s is the air around the robot, thrust (n_rotors,) N; xpos, xmat are MuJoCo's.
    """
    p, air, way, force, arm, torque = (
        np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    )  # fmt: skip
    for a in range(3):
        limbs.f_W[a] = 0.0
    for i in range(limbs.n):
        body = limbs.body[i]
        for a in range(3):
            way[a] = 0.0
            for c in range(3):
                way[a] += xmat[body, 3 * a + c] * limbs.along[i, c]
        for a in range(3):
            xfrc[body, a] = limbs.given_W[i, a]
            xfrc[body, 3 + a] = 0.0
        for s in range(SEGMENTS):
            for a in range(3):
                p[a] = xpos[body, a]
                arm[a] = 0.0
                for c in range(3):
                    p[a] += xmat[body, 3 * a + c] * limbs.point[i, s, c]
                    arm[a] += xmat[body, 3 * a + c] * (limbs.point[i, s, c] - limbs.com[i, c])
                force[a] = p[a] - p_WB[a]
            mat_t_vec(R_WB, force, torque)  # the point in B
            down = downwash(limbs.density, limbs.wake, rotor_p, thrust, torque)
            along = 0.0
            for a in range(3):
                speed = (p[a] - limbs.before[i, s, a]) / dt if limbs.ready else 0.0
                air[a] = wind_W[a] - down * R_WB[a, 2] - speed
                along += air[a] * way[a]
                limbs.before[i, s, a] = p[a]
            size = 0.0
            for a in range(3):
                air[a] -= along * way[a]
                size += air[a] * air[a]
            size = limbs.coefficient[i] * math.sqrt(size)
            for a in range(3):
                force[a] = size * air[a]
            cross(arm, force, torque)
            for a in range(3):
                xfrc[body, a] += force[a]
                xfrc[body, 3 + a] += torque[a]
                limbs.f_W[a] += force[a]
    limbs.ready = 1
