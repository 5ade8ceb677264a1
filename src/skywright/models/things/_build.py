"""Adds the things of a world to the scene, in the order of the world file.

Only this module converts things to MuJoCo elements. In the nominal scene every thing has the pose
of the file. In the plant movable things have a free joint, jointed parts have their joints, and a
fixed tracked thing has its true pose. Movable things are bodies `object NAME`. All others are
geometries of the movable thing that carries them, or of a fixed body (models/fixed_body.py).

Contacts have Coulomb friction on an elliptic cone. Where something can be carried, MuJoCo's no-slip
solver is used, since its soft friction creeps by millimetres a second under a load.
"""

import copy
import itertools
import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import quat_from_rot, rot_x, rot_y, rot_z
from skywright.description.world.thing import Frame, Part, Placed, Solid, Thing, Things, build_frame
from skywright.description.world.things import find_carrier, list_movers, locate_thing
from skywright.errors import InputError
from skywright.models.arm_body import FEET, LIMITED, PEN, ROBOT, WORLD
from skywright.models.docking_body import NOSLIP_ITERATIONS
from skywright.models.fixed_body import add_fixed

OBJECT = "object "
"""Prefix of the names of movable things' bodies and joints."""
PULL = "pull "
"""Names of sensors of held things start with it."""
IMPACT = "impact "
"""Prefix of the names of gauged parts' sensors."""
FAR = 2.0  # m, upper bound of reported distances

_SHAPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}
_JOINTS = {"slide": mujoco.mjtJoint.mjJNT_SLIDE, "hinge": mujoco.mjtJoint.mjJNT_HINGE}


def find_offsets(things: Things, error: Array) -> dict[str, Frame]:
    """Return the pose errors of tracked things that are fixed, in their own frames.

    `error` (6,) is `Deviation.socket_error`: m, and rad about x, y, z.
    """
    turn = rot_z(float(error[5])) @ rot_y(float(error[4])) @ rot_x(float(error[3]))
    return {
        name: Frame(error[:3], turn)
        for name, thing in things.items()
        if isinstance(thing, Placed) and thing.tracked and not thing.movable
        and find_carrier(things, name) is None
    }  # fmt: skip


def add_things(spec: mujoco.MjSpec, things: Things, plant: bool, offsets: dict[str, Frame]) -> None:
    """Add all things to a scene that already contains the robot."""
    movers = list_movers(things)
    if movers:
        spec.option.noslip_iterations = NOSLIP_ITERATIONS
    if movers and plant:
        _let_sleep(spec)
    bodies = {}
    for name in movers:
        frame = locate_thing(things, name, offsets=offsets)
        bodies[name] = spec.worldbody.add_body(
            name=OBJECT + name, pos=frame.p, quat=quat_from_rot(frame.R)
        )
    for name, thing in things.items():
        carrier = find_carrier(things, name)
        parts, frame = thing.list_parts(), build_frame()
        if name not in bodies and isinstance(thing, Placed):
            frame = locate_thing(things, name, carrier, offsets)
        moving = name in bodies or carrier is not None
        with _refuse_taken_names(name):
            if moving:
                body = bodies[name if carrier is None else carrier]
            else:
                body = add_fixed(spec, name, plant and any(part.solids for part in parts))
            for part in parts:
                _add_part(spec, body, name, part, frame.at(part.frame), moving, plant)
            if plant and name in bodies:
                body.add_freejoint(name=OBJECT + name)
                _hold(spec, name, thing, locate_thing(things, name, offsets=offsets).p)
            if plant:
                thing.extend_plant(spec, name)


@contextmanager
def _refuse_taken_names(name: str) -> Iterator[None]:
    """Raise InputError if MuJoCo refuses a name of the thing `name` because another part has it."""
    try:
        yield
    except ValueError as error:
        if "repeated name" not in str(error):
            raise
        raise InputError(
            f"world.things.{name}: {name!r} or one of its shapes has the name of another part of "
            "the robot or the world; choose another name"
        ) from error


def _let_sleep(spec: mujoco.MjSpec) -> None:
    """Enable MuJoCo's sleeping of things at rest until a moving body touches them.

    A thing on its rack has up to 24 contacts, which would otherwise be computed in every step.
    """
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.body("platform").sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER


def _add_part(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, part: Part, frame: Frame, moving: bool,
    plant: bool,
) -> None:  # fmt: skip
    """Add a part to `body` at `frame`; in the plant a jointed part is a child body."""
    label = f"{name} {part.name}".rstrip()
    if plant and part.joint is not None:
        body = body.add_body(name=label, pos=frame.p, quat=quat_from_rot(frame.R))
        _add_joint(body, label, part)
        frame = build_frame()
    still = not moving and not (plant and part.joint is not None)  # it needs no mass
    for solid in part.solids:
        _add_solid(
            body, label if len(part.solids) == 1 else f"{name} {solid.name}",
            solid._replace(mass_kg=0.0) if still else solid, frame, moving,
        )  # fmt: skip
    if plant and part.gauged:
        _add_contact_sensor(spec, IMPACT + label, body.name)


def _add_solid(body: mujoco.MjsBody, name: str, solid: Solid, frame: Frame, moving: bool) -> None:
    c = solid.contact
    place: dict[str, Any]
    if solid.ends is not None:
        place = {"fromto": np.concatenate([frame.p + frame.R @ np.asarray(e) for e in solid.ends])}
    else:
        at = frame.at(solid.frame)
        place = {"pos": at.p, "quat": quat_from_rot(at.R)}
    body.add_geom(
        name=name, type=_SHAPES[solid.shape], size=[*solid.size, 0.0, 0.0][:3], mass=solid.mass_kg,
        rgba=[*solid.color, 1.0], contype=WORLD,
        conaffinity=ROBOT | FEET | PEN | (WORLD if moving else 0),
        friction=[c.friction, 0.005, 0.0001], condim=4 if c.torsion else 3, priority=c.priority,
        solref=[c.time_constant_s, 1.0], solimp=[c.impedance, 0.95, 0.001, 0.5, 2.0], **place,
    )  # fmt: skip


def _add_joint(body: mujoco.MjsBody, name: str, part: Part) -> None:
    assert part.joint is not None
    j = part.joint
    joint = body.add_joint(
        name=name, type=_JOINTS[j.kind], axis=list(j.axis), limited=LIMITED, range=[j.low, j.high],
        solref_limit=[0.004, 1.0], frictionloss=j.friction,
    )  # fmt: skip
    for key, value in (("stiffness", j.stiffness), ("damping", j.damping)):
        poly = np.ndim(getattr(joint, key)) > 0
        setattr(joint, key, np.array([value, 0.0, 0.0]) if poly else value)


def _hold(spec: mujoco.MjSpec, name: str, thing: Thing, p_WO: Array) -> None:
    """Weld a thing with `frees_at_n` to W, and add a sensor of the pulling force."""
    if thing.frees_at_n is None:
        return
    _add_contact_sensor(spec, PULL + name, OBJECT + name)
    hold = spec.add_equality(
        name=f"hold {name}", type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=OBJECT + name,
    )  # fmt: skip
    hold.solref = [0.01, 1.0]
    # the anchor is at its position: otherwise the constraint would have a long lever
    hold.data = np.array([*p_WO, 0, 0, 0, 0, 0, 0, 0, 1.0, 0])


def _add_contact_sensor(spec: mujoco.MjSpec, name: str, body: str) -> None:
    """Add a sensor of the net contact force on a body, in W."""
    spec.add_sensor(
        name=name, type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=mujoco.mjtObj.mjOBJ_BODY,
        objname=body, intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1],
    )  # fmt: skip


def find_carried_clearance(
    model: mujoco.MjModel, name: str, way: Array, hang: Array, step: float = 0.03
) -> tuple[float, str]:
    """Return the least distance (m) of a carried thing to the world's solids, and the nearest
    solid.

    `way` (n, 4) m, rad are waypoints of the platform, connected by straight lines. `hang` (3,) m is
    the position of the thing's O from the platform in a level frame with its heading. `model` is a
    nominal scene with the thing; the ground is excluded.
    """
    model = copy.copy(model)
    data = mujoco.MjData(model)
    body = model.body(OBJECT + name).id
    assert model.body_weldid[body] == 0, "in a nominal scene nothing has a joint of its own"
    mine = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
    others = [
        g for g in range(model.ngeom)
        if model.geom_bodyid[g] == 0 and model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE
    ]  # fmt: skip
    least, what = FAR, ""
    for a, b in itertools.pairwise(way):
        count = max(math.ceil(float(np.linalg.norm(b[:3] - a[:3])) / step), 1)
        for u in np.linspace(0.0, 1.0, count + 1):
            pose = a + u * (b - a)
            R = rot_z(float(pose[3]))
            model.body_pos[body] = pose[:3] + R @ hang
            model.body_quat[body] = quat_from_rot(R)
            mujoco.mj_kinematics(model, data)
            for g in mine:
                for other in others:
                    distance = mujoco.mj_geomDistance(model, data, g, other, least, None)
                    if distance < least:
                        least, what = distance, model.geom(other).name
    return least, what
