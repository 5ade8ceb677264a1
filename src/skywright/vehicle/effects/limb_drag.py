"""Forces of the wind and of the rotors' downwash on a robot's link and arms.

Every link is a cylinder in SEGMENTS pieces. By the independence principle only the velocity of the
air across the cylinder matters: f = rho/2 C_D d |v_n| v_n per length (Hoerner, Fluid-Dynamic Drag,
1965, chapter 3: C_D of a circular cylinder 1.0 to 1.2 below the critical Reynolds number).

Downwash: momentum theory gives a rotor's wake the radius R / sqrt 2 and the speed 2 v_i,
v_i = sqrt(T / (2 rho A)) (Leishman, Principles of Helicopter Aerodynamics, 2nd ed., section 2.2);
further down it spreads as a free jet. The momentum fluxes of the wakes add (Reichardt's hypothesis,
in Rajaratnam, Turbulent Jets, 1976, chapter 1), each with the profile

    rho v^2 = T / (pi b^2) exp(-r^2 / b^2),   b^2 = R^2 / 2 + (C z)^2,

which carries the thrust T at every distance z below the rotor and has 2 v_i on its axis at the
rotor. Wakes follow -z_B below the rotors; neither wind nor limbs deflect them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import mujoco

from skywright.core.record import Array, Integers, Record, Vec3
from skywright.core.rotations import cross, mat_t_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_ROTORS
from skywright.description.robot.bar import Bar
from skywright.description.robot.limbs import list_limbs
from skywright.models.body_records import MAX_LINKS
from skywright.models.part_masses import link_direction
from skywright.vehicle.bus import Clock, MuJoCo, Truth
from skywright.vehicle.component import Component, Effect, InOut, helper, table
from skywright.vehicle.plant import AirForce, RotorState, Wind

SEGMENTS = 3  # of a link
SPREAD = 0.075  # width of a round free jet over its length (Reichardt)
FAR = 16.0  # r^2 / b^2 beyond which a wake is ignored: exp(-16) = 1e-7 of its momentum flux


class LimbDrag(Effect):
    """Adds the air's forces on all links to MuJoCo's external forces and to AirForce."""

    class Me(Record):
        n: int  # links
        ready: int
        body: Annotated[Integers, MAX_LINKS]  # index in MuJoCo
        com: Annotated[Array, MAX_LINKS, 3]  # m, centre of mass in the link's frame
        point: Annotated[Array, MAX_LINKS, SEGMENTS, 3]  # m, middles of the pieces, link frame
        along: Annotated[Array, MAX_LINKS, 3]
        coefficient: Annotated[Array, MAX_LINKS]  # kg/m, rho/2 C_D d l of a piece
        density: float  # kg/m^3
        wake: float  # m, radius of the contracted wake
        before: Annotated[Array, MAX_LINKS, SEGMENTS, 3]  # m, the points one tick ago
        rotor_p: Annotated[Array, MAX_ROTORS, 3]  # m, in B
        f_W: Vec3  # N, sum

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with an arm that has a drag coefficient have this effect."""
        arm = context.robot.arm
        if arm is not None and arm.drag_coefficient != 0.0:
            yield cls("limb drag")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Divide the links into pieces."""
        robot, model, rotors = context.robot, context.scene.model, context.rotors
        density = context.world.air_density_kg_m3
        limbs = list_limbs(robot)
        me.n, me.density = len(limbs), density
        me.wake = robot.rotors.propeller_radius_m / math.sqrt(2.0)
        me.rotor_p[: len(rotors.position)] = rotors.position
        for i, limb in enumerate(limbs):
            link, way = limb.link, link_direction(limb.link)
            me.body[i] = model.body(limb.name).id
            me.com[i] = model.body(limb.name).ipos
            me.along[i] = way
            piece = link.length_m / SEGMENTS
            for s in range(SEGMENTS):
                me.point[i, s] = (s + 0.5) * piece * way
            area = 2.0 * link.radius_m * piece
            me.coefficient[i] = 0.5 * density * robot.arm.drag_coefficient * area
        if robot.arm.bar is not None:
            add_bar(me, robot.arm.bar, 0.5 * density * robot.arm.drag_coefficient, model)

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        truth: Truth,
        wind: Wind,
        rotors: RotorState,
        mj: MuJoCo,
        force: InOut[AirForce],
    ) -> None:
        for a in range(3):
            me.f_W[a] = 0.0
        for i in range(me.n):
            push_link(me, i, truth, wind, rotors, mj, clock.dt)
        me.ready = 1
        for a in range(3):
            force.f_W[a] += me.f_W[a]


def add_bar(me: Any, bar: Bar, factor: float, model: mujoco.MjModel) -> None:
    """Add a bar between the arms as a further link."""
    i, piece = me.n, bar.length_m / SEGMENTS
    me.n, me.body[i] = i + 1, model.body("bar").id
    me.along[i] = [0.0, 1.0, 0.0]
    for s in range(SEGMENTS):
        me.point[i, s] = [0.0, (s + 0.5) * piece - 0.5 * bar.length_m, 0.0]
    me.coefficient[i] = factor * bar.diameter_m * piece


@helper
def push_link(me: Any, i: int, truth: Any, wind: Any, rotors: Any, mj: Any, dt: float) -> None:
    """Add the forces on the pieces of link `i`, about its centre of mass."""
    xfrc = table(mj.xfrc, mj.nbody, 6)
    xpos, xmat = table(mj.body_xpos, mj.nbody, 3), table(mj.body_xmat, mj.nbody, 9)
    p, air, way = local(3), local(3), local(3)
    force, arm, torque = local(3), local(3), local(3)
    body, R_WB = me.body[i], truth.R_WB
    for a in range(3):
        way[a] = 0.0
        for c in range(3):
            way[a] += xmat[body, 3 * a + c] * me.along[i, c]
    for s in range(SEGMENTS):
        for a in range(3):
            p[a] = xpos[body, a]
            arm[a] = 0.0
            for c in range(3):
                p[a] += xmat[body, 3 * a + c] * me.point[i, s, c]
                arm[a] += xmat[body, 3 * a + c] * (me.point[i, s, c] - me.com[i, c])
            force[a] = p[a] - truth.p_WB[a]
        mat_t_vec(R_WB, force, torque)  # the point in B
        down = downwash(me.density, me.wake, me.rotor_p, rotors.thrust, rotors.n, torque)
        along = 0.0
        for a in range(3):
            speed = (p[a] - me.before[i, s, a]) / dt if me.ready else 0.0
            air[a] = wind.body_W[a] - down * R_WB[a, 2] - speed
            along += air[a] * way[a]
            me.before[i, s, a] = p[a]
        size = 0.0
        for a in range(3):
            air[a] -= along * way[a]
            size += air[a] * air[a]
        size = me.coefficient[i] * math.sqrt(size)
        for a in range(3):
            force[a] = size * air[a]
        cross(arm, force, torque)
        for a in range(3):
            xfrc[body, a] += force[a]
            xfrc[body, 3 + a] += torque[a]
            me.f_W[a] += force[a]


@helper
def downwash(density: float, wake: float, rotor_p: Any, thrust: Any, n: int, p_B: Any) -> float:
    """Return the speed (m/s) along -z_B of the wakes of `n` rotors at p_B (3,) m in B."""
    flux, last, inverse = 0.0, 0.0, 0.0
    for k in range(n):
        z = rotor_p[k, 2] - p_B[2]
        if z <= 0.0 or thrust[k] <= 0.0:
            continue
        if z != last:  # rotors mostly share one plane
            last, inverse = z, 1.0 / (wake * wake + (SPREAD * z) ** 2)
        x, y = p_B[0] - rotor_p[k, 0], p_B[1] - rotor_p[k, 1]
        ratio = (x * x + y * y) * inverse
        if ratio < FAR:
            flux += thrust[k] * inverse * math.exp(-ratio)
    return math.sqrt(flux / (math.pi * density))
