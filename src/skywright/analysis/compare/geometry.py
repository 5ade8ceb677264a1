"""Geometric measures without flights: clearance along the path, access, height, balance."""

import math

import numpy as np

from skywright.analysis.compare.comparison import Way
from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.loader import Description
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.missions.sensor_install.plan import InstallPlan, list_legs
from skywright.models.airframe import pick_airframe_geoms
from skywright.models.extents import compute_extents, compute_swing_period
from skywright.models.geometry import ClearanceCore, build_clearance, query_clearance
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.rotors import build_rotors
from skywright.models.scene import build_scene
from skywright.models.statics import UP, build_layout, wrench_at
from skywright.run.planning import plan_mission

STEP = 0.02  # m, along the path
FAR = 10.0  # m, beyond which distances are not resolved
SHAFT = 0.5  # m, width of the shaft for `measure_access`


class PipeDistance:
    """Distances (m) of propellers with hub and booms, and of landing gear, to the world's pipe."""

    def __init__(self, d: Description) -> None:
        self._query = build_clearance(build_scene(d.robot, d.world))
        self._groups = (self._pick("propeller", "hub", "boom"), self._pick("leg", "foot"))

    def _pick(self, *starts: str) -> ClearanceCore:
        core, names = self._query.core, self._query.names
        picked = pick_airframe_geoms(self._query.model, *starts)
        keep = [i for i, (a, b) in enumerate(core.pairs[: core.n_world])
                if a in picked and names[b] == "pipe"]  # fmt: skip
        pairs = np.ascontiguousarray(core.pairs[keep])
        return core._replace(pairs=pairs, n_world=len(pairs), probe=np.zeros(len(pairs)))

    def __call__(self, p_WB: Array, R_WB: Array, q: Array) -> tuple[float, float]:
        """Return both distances for the platform at p (3,) m, R (3, 3) and joints q (n_joints,)
        rad."""
        near, gear = (query_clearance(g, p_WB, R_WB, q, 0.0, FAR)[0] for g in self._groups)
        return near, gear


def measure_way(d: Description) -> Way:
    """Compute the distances along the planned legs of sensor-install, feasible or not.

    Raises InputError if the robot does not fit the mission.
    """
    plan = plan_mission(d)
    way = plan.way
    assert isinstance(way, InstallPlan)
    ask = PipeDistance(d)
    R = rot_z(way.yaw)
    p_contact = way.p_near + (way.contact - _hand_below(way, d))
    legs = [(a, b, q) for _, a, b, q in list_legs(way)]
    legs.append((way.p_near, p_contact, way.q))
    flown, rows = 0.0, []
    for a, b, q in legs:
        length = float(np.linalg.norm(b - a))
        for u in np.linspace(0.0, 1.0, max(math.ceil(length / STEP), 1) + 1):
            p = a + u * (b - a)
            rows.append([flown + u * length, *ask(p, R, q)])
        flown += length
    table = np.array(rows)
    return Way(table[:, 0], table[:, 1], table[:, 2], plan.blocked_by or "", way.q, p_contact)


def _hand_below(way: InstallPlan, d: Description) -> Array:
    """Return the position of the hand at the stand-off, (3,) m."""
    return np.asarray(way.contact - d.mission.task.stand_off_m * way.normal)


def measure_access(robot: Robot, hang: Array) -> float:
    """Return the depth (m) that the lowest hand reaches in a shaft of width SHAFT, arms hanging.

    The robot is centred above the shaft; wider parts stay above its rim.
    """
    _, low, high = compute_extents(robot, hang)
    wide = np.max(np.maximum(-low[:, :2], high[:, :2]), axis=1) > 0.5 * SHAFT
    return float(np.min(low[wide, 2]) - np.min(low[:, 2])) if np.any(wide) else math.inf


def measure_height(robot: Robot, q: Array) -> float:
    """Return the height (m) of the rotor plane above the lowest part at q."""
    _, low, _ = compute_extents(robot, q)
    return float(build_rotors(robot.rotors).position[:, 2].mean() - np.min(low[:, 2]))


def hang(robot: Robot) -> Array:
    """Return q (n_joints,) rad at which links along -z hang straight down."""
    q = posture(robot, "working")
    for j, limb in enumerate(list_joints(robot)):
        if limb.link.along == "-z":
            q[j] = 0.0
    return q


def measure_take_off(robot: Robot) -> tuple[float, float]:
    """Return the horizontal offset (m) of the centre of mass on the ground, and the rotor load.

    The rotor load is the thrust of the most loaded rotor over its maximum when the rotors carry the
    whole weight in the landed posture. Above 1 the robot cannot lift off level; a passive link must
    first swing under the robot.
    """
    model = build_body_model(robot)
    mass, p_BC, _ = compute_body(model, posture(robot, "landed"))
    layout = build_layout(build_rotors(robot.rotors), 1.0)
    thrust = layout.P @ wrench_at(mass * 9.81 * UP, p_BC)
    return float(math.hypot(p_BC[0], p_BC[1])), float(np.max(thrust / layout.rotors.thrust_max))


def measure_agility(robot: Robot, q: Array, torque: Array) -> dict[str, float]:
    """Return the angular accelerations (rad/s^2) from the rotors, and the link's period (s).

    `torque` (v, 3) N m are the vertices of the attainable torques at hover. A passive link does not
    rotate with the platform about its joint axis; about that axis the platform's own inertia
    counts.
    """
    model = build_body_model(robot)
    mass, p, inertia = compute_body(model, q)
    about = inertia - mass * (p @ p * np.eye(3) - np.outer(p, p))
    own = robot.platform.inertia_yy_kgm2
    out = {
        "control.roll_radps2": _largest(torque, 0) / float(about[0, 0]),
        "control.pitch_radps2": _largest(torque, 1)
        / (own if robot.pendulum is not None else float(about[1, 1])),
    }
    if robot.pendulum is not None:
        out["control.swing_period_s"] = compute_swing_period(robot, q)
    return out


def _largest(torque: Array, axis: int) -> float:
    """Return the largest torque (N m) about an axis that is attainable in both directions."""
    return float(min(np.max(torque[:, axis]), -np.min(torque[:, axis])))
