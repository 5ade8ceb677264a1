"""The scene: one MjSpec from robot and world, compiled as nominal model or as plant.

`build_scene(robot, world)` is the nominal model: rigid arm, released probe spring, no contacts;
planners use its geometry and distances. `build_scene(robot, world, deviation)` is the plant:
structural flexibility, sprung probe, servos, contacts, and every error of the root `plant`. Both
come from the same code, so geometry has one source.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.rotations import quat_from_rot
from skywright.core.types import MAX_HANDS
from skywright.description.robot.limbs import list_limbs
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import World
from skywright.description.world.surface import Cylinder, build_cylinder
from skywright.description.world.thing import Fixture
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.models.airframe import pick_airframe_geoms
from skywright.models.arm_body import FEET, OWN, PEN, ROBOT, WORLD, Deviation, add_arm
from skywright.models.bar_body import BAR, add_bar
from skywright.models.docking_body import NOSLIP_ITERATIONS, add_docking, set_foot_stiffness
from skywright.models.fixed_body import add_fixed
from skywright.models.gauges import add_gauges, has_gauges
from skywright.models.nominal import Nominal
from skywright.models.part_masses import platform_inertia, set_inertia
from skywright.models.rigid_body import joint_names, posture
from skywright.models.rotors import RotorSet
from skywright.models.self_contact import add_propeller_pairs, exclude_neighbours
from skywright.models.structure_body import add_structure, list_structure
from skywright.models.things._build import OBJECT, add_things, find_offsets
from skywright.models.timestep import find_stiff_contact

TIMESTEP = 0.001
"""s, the default physics step (`mission.timestep_ms`)."""
SUPPORT_RADIUS = 0.03
SUPPORT_INSET = 0.05  # m, from the pipe's end to the support's axis


class SceneIndex(NamedTuple):
    """Indices into the arrays of the compiled model."""

    joint_qpos: Ints  # (n_joints,)
    joint_dof: Ints
    flex_qpos: Ints  # -1 for a joint without flexibility
    slider_qpos: int  # -1 without a probe
    platform_body: int
    tip_site: int  # -1 without an arm
    robot_geoms: Ints
    world_geoms: Ints
    probe_geoms: Ints  # geoms that may be near the pipe while scanning
    feet_geoms: Ints
    object_qpos: Ints  # of each movable thing, in the order of the world file
    hand_sites: Ints  # (n_hands,)
    hand_bodies: Ints  # (n_hands,), -1 if a hand is no separate body
    sensor_tip_force: int  # address of the tip's net contact force, -1 without
    sensor_hand_force: Ints  # (n_hands,) likewise of each hand
    sensor_collision: Ints  # addresses of net contact forces that must be zero
    sensor_docking: int = -1  # address of the docking feet's net contact force, -1 without


class Scene(NamedTuple):
    """A compiled model with its index."""

    model: mujoco.MjModel
    places: SceneIndex
    n_joints: int


def build_scene(
    robot: Robot,
    world: World,
    deviation: Deviation | None = None,
    extend: Iterable[Callable[[mujoco.MjSpec], None]] = (),
    error: Array | None = None,
    nominal: Nominal | None = None,
    timestep: float = TIMESTEP,
) -> Scene:
    """Compile the nominal model, or with `deviation` the plant.

    The functions `extend` receive the MjSpec before compilation and may add to it. `error` (6,) m,
    rad, moves tracked things in a nominal model as `Deviation.socket_error` does. `nominal` avoids
    a second computation of rotors, rigid body and surfaces. Raises InputError if a contact is too
    stiff for `timestep` (s).
    """
    spec = build_spec(robot, world, deviation, error, nominal)
    spec.option.timestep = timestep
    for add in extend:
        add(spec)
    model = compile_spec(spec, robot, world)
    stiff = find_stiff_contact(model, timestep) if timestep > TIMESTEP else None
    if stiff is not None:
        raise InputError(
            f"mission.timestep_ms = {1e3 * timestep:g} is too long for {robot.name!r} in "
            f"{world.name!r}: {stiff}"
        )
    return Scene(model, _build_index(model, robot, deviation is not None), len(joint_names(robot)))


def compile_spec(spec: mujoco.MjSpec, robot: Robot, world: World) -> mujoco.MjModel:
    """Compile a spec and set the stiffness of docking feet, in the model and in the spec.

    Raises InputError for sizes that MuJoCo refuses.
    """
    try:
        model = spec.compile()
    except ValueError as error:  # sizes that no earlier check covers, in MuJoCo's words
        what = " ".join(str(error).split())
        raise InputError(f"robot {robot.name!r} in world {world.name!r}: {what}") from None
    if robot.docking is not None:
        set_foot_stiffness(model, robot.docking, spec)
    return model


def build_spec(
    robot: Robot,
    world: World,
    deviation: Deviation | None = None,
    error: Array | None = None,
    nominal: Nominal | None = None,
) -> mujoco.MjSpec:
    """Build the MjSpec of `build_scene`; `compile_spec` sets the stiffness of docking feet."""
    nominal = nominal or Nominal(robot, world)
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # 4.0.0's sparse factorisation is faulty
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    # with a handful of contacts, finding their islands takes longer than it saves
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
    # bounding-volume trees help only with a structure's long boxes, whose spheres overlap
    # everything
    if world.structure is None:
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    spec.option.gravity = [0.0, 0.0, -world.gravity_mps2]
    spec.compiler.degree = False
    spec.visual.headlight.ambient = [0.4, 0.4, 0.4]
    plant = deviation is not None
    _add_robot(spec, robot, nominal.rotors, deviation or Deviation(), plant)
    add_propeller_pairs(spec)
    _add_world(spec, world, nominal, plant)
    if deviation is not None:
        error = deviation.socket_error
    offsets = {} if error is None else find_offsets(world.things, error)
    add_things(spec, world.things, plant, offsets)
    if plant and has_gauges(world.things):
        add_gauges(spec, robot)
    if plant:
        _add_contacts(spec, robot, world)
        exclude_neighbours(spec, robot)
    return spec


def _add_world(spec: mujoco.MjSpec, world: World, nominal: Nominal, plant: bool) -> None:
    # the pipe itself collides with the probe's tip only, through an explicit pair
    pipe: dict[str, Any] = {"contype": WORLD, "conaffinity": ROBOT | FEET, "mass": 0.0}
    kwargs: dict[str, Any] = {**pipe, "conaffinity": ROBOT | FEET | PEN}
    spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10, 10, 0.1],
        rgba=[0.75, 0.77, 0.8, 1], friction=[0.8, 0.005, 0.0001], **kwargs,
    )  # fmt: skip
    cyl = nominal.cylinder
    if world.pipe is not None and cyl is not None:
        body = add_fixed(spec, "pipe", plant)
        y, x, z = cyl.R_WP[:, 1], cyl.R_WP[:, 0], cyl.R_WP[:, 2]
        quat = quat_from_rot(np.column_stack([z, x, y]))  # MuJoCo cylinders run along z
        body.add_geom(
            name="pipe", type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[cyl.radius, cyl.half_length, 0], pos=cyl.p_WP, quat=quat,
            rgba=[0.55, 0.57, 0.6, 1], **pipe,
        )  # fmt: skip
        if world.pipe.supports:
            for i, p in enumerate(support_posts(world, cyl)):
                half = 0.5 * p[2]
                body.add_geom(
                    name=f"support{i}", type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                    size=[SUPPORT_RADIUS, half, 0], pos=[p[0], p[1], half],
                    rgba=[0.35, 0.37, 0.4, 1], **kwargs,
                )  # fmt: skip
    add_structure(spec, world, nominal.surface, pipe, plant)
    for name, tube in get_structures(world).tubes.items():
        add_fixed(spec, f"tube {name}", plant).add_geom(
            name=f"tube {name}", type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[tube.diameter_m / 2, 0, 0],
            fromto=[tube.x_m, tube.y_m, tube.z_m, tube.to_x_m, tube.to_y_m, tube.to_z_m],
            rgba=[0.85, 0.7, 0.15, 1], **kwargs,
        )  # fmt: skip


def support_posts(world: World, cyl: Cylinder | None = None) -> list[Array]:
    """Return the upper ends (3,) of the pipe's posts: near the ends of `cyl`, up to its axis."""
    assert world.pipe is not None
    cyl = cyl or build_cylinder(world.pipe)
    reach = max(cyl.half_length - SUPPORT_INSET, 0.0)
    if abs(world.pipe.inclination_deg) > 75.0:  # an upright pipe has one post below it
        lower = cyl.p_WP - math.copysign(cyl.half_length, cyl.R_WP[2, 1]) * cyl.R_WP[:, 1]
        return [lower] if lower[2] > 0.02 else []
    posts = [cyl.p_WP + sign * reach * cyl.R_WP[:, 1] for sign in (-1.0, 1.0)]
    return [p for p in posts if p[2] > 0.02]


def _add_robot(
    spec: mujoco.MjSpec, robot: Robot, rotors: RotorSet, dev: Deviation, plant: bool
) -> None:
    p = robot.platform
    height = p.gear_height_m
    base = spec.worldbody.add_body(name="platform", pos=[0, 0, height])
    base.add_freejoint(name="free")
    base.mass = p.mass_kg * dev.mass_factor
    base.ipos = np.array([p.com_x_m, p.com_y_m, p.com_z_m]) + dev.com_error
    set_inertia(base, dev.inertia_factor * platform_inertia(p))
    kwargs: dict[str, Any] = {"contype": ROBOT, "conaffinity": WORLD, "mass": 0.0}
    own = kwargs | {"contype": ROBOT | OWN, "conaffinity": WORLD | OWN}
    base.add_geom(
        name="hub", type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[p.body_radius_m, p.height_m / 2, 0], rgba=[0.15, 0.2, 0.3, 1], **kwargs,
    )  # fmt: skip
    gains = dev.rotor_gain if len(dev.rotor_gain) else np.ones(len(rotors.position))
    for i, (pos, axis) in enumerate(zip(rotors.position, rotors.axis, strict=True)):
        x = np.cross([0.0, 1.0, 0.0], axis)
        x /= np.linalg.norm(x)
        quat = quat_from_rot(np.column_stack([x, np.cross(axis, x), axis]))
        base.add_geom(
            name=f"propeller{i}", type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[robot.rotors.propeller_radius_m, 0.01, 0], pos=pos, quat=quat,
            rgba=[0.2, 0.5, 0.9, 0.35], **own,
        )  # fmt: skip
        base.add_geom(
            name=f"boom{i}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.01, 0, 0],
            fromto=[0, 0, 0, *pos], rgba=[0.15, 0.2, 0.3, 1], **kwargs,
        )  # fmt: skip
        if plant:
            base.add_site(name=f"rotor{i}", pos=pos)
            torque = -rotors.spin[i] * robot.rotors.torque_per_thrust_m * axis
            gear = gains[i] * np.concatenate([axis, torque])
            act = spec.add_actuator(
                name=f"thrust{i}", target=f"rotor{i}", trntype=mujoco.mjtTrn.mjTRN_SITE, gear=gear
            )
            act.set_to_motor()
    for i in range(4):
        angle = math.pi / 4 + i * math.pi / 2
        foot = [p.gear_radius_m * math.cos(angle), p.gear_radius_m * math.sin(angle)]
        base.add_geom(
            name=f"leg{i}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.008, 0, 0],
            fromto=[0.5 * foot[0], 0.5 * foot[1], 0, *foot, -height + 0.012],
            rgba=[0.3, 0.3, 0.3, 1], **kwargs,
        )  # fmt: skip
    gear_body = base.add_body(name="gear")
    for i in range(4):
        angle = math.pi / 4 + i * math.pi / 2
        gear_body.add_geom(
            name=f"foot{i}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.012, 0, 0],
            pos=[
                p.gear_radius_m * math.cos(angle), p.gear_radius_m * math.sin(angle),
                0.012 - height,
            ],
            rgba=[0.1, 0.1, 0.1, 1], contype=FEET, conaffinity=WORLD, mass=0.0,
            friction=[0.8, 0.005, 0.0001],
        )  # fmt: skip
    if robot.docking is not None:
        spec.option.noslip_iterations = NOSLIP_ITERATIONS
        gear = robot.docking.model_copy(update={"mass_kg": robot.docking.mass_kg * dev.mass_factor})
        feet = {"contype": FEET, "conaffinity": WORLD}
        add_docking(base, gear, 0.7 * p.body_radius_m, kwargs, feet)
    if robot.arm is not None:
        if robot.arm.hand.mass_kg > 0.0:  # a hand held by friction must not creep
            spec.option.noslip_iterations = NOSLIP_ITERATIONS
        add_arm(spec, base, robot, dev, plant)
        if robot.arm.bar is not None:
            add_bar(spec, robot, dev.mass_factor, plant)


def _add_contacts(spec: mujoco.MjSpec, robot: Robot, world: World) -> None:
    """The one intended contact (tip on pipe) as an explicit pair, and force sensors."""
    if world.pipe is not None and robot.probe is not None:
        mu = max(world.pipe.friction, 1e-4)
        pair = spec.add_pair(name="touch", geomname1="tip", geomname2="pipe", condim=3)
        pair.friction = [mu, mu, 0.005, 0.0001, 0.0001]
        # soft enough for sliding without chatter (about 70 Hz at the default stiffness)
        pair.solref = [0.008, 0.5]
        pair.solimp = [0.9, 0.9, 0.001, 0.5, 2.0]
        _add_contact_sensor(spec, "touch force", "tip", mujoco.mjtObj.mjOBJ_GEOM)
    if world.structure is not None and robot.probe is not None:
        mu = max(world.structure.friction, 1e-4)
        for name in list_structure(spec):
            pair = spec.add_pair(name=f"touch {name}", geomname1="tip", geomname2=name, condim=3)
            pair.friction = [mu, mu, 0.005, 0.0001, 0.0001]
            pair.solref, pair.solimp = [0.008, 0.5], [0.9, 0.9, 0.001, 0.5, 2.0]
        _add_contact_sensor(spec, "touch force", "tip", mujoco.mjtObj.mjOBJ_GEOM)
    # contact sensors of whole bodies; the gear is a separate body, so landing is no collision
    for body in [
        "platform",
        *(limb.name for limb in list_limbs(robot)),
        *(["holder"] if robot.probe else []),
        *([BAR] if robot.arm is not None and robot.arm.bar is not None else []),
    ]:
        _add_contact_sensor(spec, f"collision {body}", body, mujoco.mjtObj.mjOBJ_BODY)
    if robot.probe is not None:
        _add_contact_sensor(spec, "collision pen", "pen", mujoco.mjtObj.mjOBJ_GEOM)
    for side in range(MAX_HANDS):
        if spec.body(f"hand{side}") is not None:
            _add_contact_sensor(spec, f"touch hand{side}", f"hand{side}", mujoco.mjtObj.mjOBJ_XBODY)
    if robot.docking is not None:
        _add_contact_sensor(spec, "docking force", "docking", mujoco.mjtObj.mjOBJ_BODY)


def _add_contact_sensor(spec: mujoco.MjSpec, name: str, obj: str, kind: mujoco.mjtObj) -> None:
    force_only = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
    net_force = 3  # reduce: sum of all matching contacts, in W
    spec.add_sensor(
        name=name, type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=kind, objname=obj,
        intprm=[force_only, net_force, 1],
    )  # fmt: skip


def _build_index(model: mujoco.MjModel, robot: Robot, plant: bool) -> SceneIndex:
    names = joint_names(robot)

    def qpos(name: str) -> int:
        i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        return int(model.jnt_qposadr[i]) if i >= 0 else -1

    def dof(name: str) -> int:
        i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        return int(model.jnt_dofadr[i])

    geom_names = [model.geom(i).name for i in range(model.ngeom)]
    platform = model.body("platform").id
    root = model.body_rootid[model.geom_bodyid]
    robot_geoms = np.flatnonzero(root == platform)
    fixed = np.flatnonzero(root != platform)
    probe = [i for i in robot_geoms if geom_names[i] in ("tip", "pen", "holder shell")]
    objects = [n for i in range(model.njnt) if (n := model.joint(i).name).startswith(OBJECT)]
    sites = {model.site(i).name for i in range(model.nsite)}
    hands = [f"hand{side}" for side in range(MAX_HANDS) if f"hand{side}" in sites]
    sensors = {model.sensor(i).name: int(model.sensor_adr[i]) for i in range(model.nsensor)}
    return SceneIndex(
        joint_qpos=np.array([qpos(n) for n in names], dtype=np.int64),
        joint_dof=np.array([dof(n) for n in names], dtype=np.int64),
        flex_qpos=np.array([qpos(f"{n} flex") for n in names], dtype=np.int64),
        slider_qpos=qpos("spring"),
        platform_body=model.body("platform").id,
        tip_site=mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tip"),
        robot_geoms=robot_geoms.astype(np.int64),
        world_geoms=fixed.astype(np.int64),
        probe_geoms=np.array(probe, dtype=np.int64),
        feet_geoms=np.array(pick_airframe_geoms(model, "leg", "foot"), dtype=np.int64),
        object_qpos=np.array([qpos(n) for n in objects], dtype=np.int64),
        hand_sites=np.array([model.site(name).id for name in hands], dtype=np.int64),
        hand_bodies=np.array(
            [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in hands],
            dtype=np.int64,
        ),
        sensor_tip_force=sensors.get("touch force", -1),
        sensor_hand_force=np.array(
            [sensors.get(f"touch {name}", -1) for name in hands], dtype=np.int64
        ),
        sensor_collision=np.array(
            [a for n, a in sensors.items() if n.startswith("collision")], dtype=np.int64
        ),
        sensor_docking=sensors.get("docking force", -1),
    )


def set_pose(scene: Scene, data: mujoco.MjData, p_WB: Array, q_WB: Array, q: Array) -> None:
    """Write platform pose (wxyz) and joint angles into `data.qpos`."""
    data.qpos[:3], data.qpos[3:7] = p_WB, q_WB
    data.qpos[scene.places.joint_qpos] = q


def home_pose(
    robot: Robot, world: World, x: float, y: float, yaw: float
) -> tuple[Array, Array, Array]:
    """Return (p_WB, q_WB, q): standing on the feet with the arm folded, or clamped to a bench."""
    bench = find_first(world.things, Fixture)
    if bench is not None:
        place = np.array([bench.x_m, bench.y_m, bench.z_m])
        return place, np.array(bench.q_WB), posture(robot, "folded")
    p = np.array([x, y, robot.platform.gear_height_m])
    quat = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    return p, quat, posture(robot, "landed")
