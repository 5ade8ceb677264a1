"""The nominal rigid body: platform and arm for controllers and planners.

One record (`BodyModel`) describes the link tree; `fill_kinematics` and `fill_body` compute from
joint angles the tip pose, the tip Jacobian and the composite mass, centre of mass and inertia. A
test compares all of them with MuJoCo's mass matrix and Jacobians.

Frames: B body (FLU), link frames at the joints with the link along x or -z, T tip with z out of the
robot along the probe and y along the link's y, H hands likewise.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import helper
from skywright.core.record import Array
from skywright.core.rotations import mat_mat, mat_vec, rot_about
from skywright.core.scratch import local
from skywright.core.types import MAX_JOINTS
from skywright.core.user_code import njit
from skywright.description.robot.arm import Link
from skywright.description.robot.docking import Docking
from skywright.description.robot.limbs import (
    Limb,
    end_of,
    list_joints,
    list_limbs,
    list_servos,
    turn_of,
)
from skywright.description.robot.spec import Probe, Robot
from skywright.models.bar import check_bar_span, compute_bar_share, compute_span
from skywright.models.body_records import MAX_LINKS, Body, BodyModel, Kinematics
from skywright.models.part_masses import (
    SLIDER_INERTIA,
    build_docking_parts,
    build_hand_body,
    build_probe_parts,
    link_com,
    link_direction,
    link_inertia,
    platform_inertia,
    rod_inertia,
    tip_rotation,
)


def joint_names(robot: Robot) -> list[str]:
    """Return the names of the moving joints, passive ones included, in the order of q."""
    return [limb.name for limb in list_joints(robot)]


def find_tip(robot: Robot, limbs: list[Limb]) -> int:
    """Return the index of the link that carries the probe, or else of the (left) arm's end."""
    if robot.probe is not None and robot.probe.on is not None:
        return [limb.name for limb in limbs].index(robot.probe.on)
    return max(i for i, limb in enumerate(limbs) if limb.side == 0)


def posture(robot: Robot, which: str) -> Array:
    """Return q (n_joints,) of the `folded`, `working` or `landed` posture.

    `landed` is folded on the ground. Only there a passive link has a set angle (its `folded_deg`);
    in flight it hangs straight down.
    """
    key = "folded" if which == "landed" else which
    q = [limb.link.rest(key) for limb in list_joints(robot)]
    if robot.pendulum is not None and which != "landed":
        q[0] = 0.0
    return np.array(q)


def build_body_model(robot: Robot, gravity: float = 9.81) -> NDArray[Any]:
    """Return the robot's rigid-body description as a (1,) array of `BodyModel`."""
    out = np.zeros(1, BodyModel.dtype)
    m = out[0]
    p = robot.platform
    com = np.array([p.com_x_m, p.com_y_m, p.com_z_m])
    m["gravity"], m["mass0"], m["com0"] = gravity, p.mass_kg, com
    m["inertia0"] = platform_inertia(p) + (p.mass_kg * (com @ com * np.eye(3) - np.outer(com, com)))
    if robot.docking is not None:
        _add_docking(m, robot.docking)
    m["tip_link"], m["tip_rot"] = -1, np.eye(3)
    m["belt"] = m["belt_inv"] = np.eye(MAX_JOINTS)
    m["parent"] = m["joint"] = -1
    if robot.arm is None:
        return out
    limbs = list_limbs(robot)
    assert len(limbs) <= MAX_LINKS
    joint = 0
    for i, limb in enumerate(limbs):
        link = limb.link
        m["parent"][i], m["offset"][i], m["turn"][i] = limb.parent, limb.offset, turn_of(link)
        if link.joint != "fixed":
            m["joint"][i] = joint
            m["q_min"][joint], m["q_max"][joint] = link.reach
            joint += 1
        m["slide"][i] = link.joint == "slide"
        m["axis"][i] = "xyz".index(link.axis)
        m["mass"][i], m["com"][i] = link.mass_kg, link_com(link)
        m["inertia"][i] = link_inertia(link)
    m["n_links"], m["n_joints"] = len(limbs), joint
    if robot.arm.belt is not None:
        m["belt"][:joint, :joint] = robot.arm.belt
        m["belt_inv"][:joint, :joint] = np.linalg.inv(np.array(robot.arm.belt))
    servos = list_servos(robot)
    for i, limb in enumerate(list_joints(robot)):
        if limb.servo >= 0:
            m["motor_speed_max"][i] = servos[limb.servo][1].no_load_speed_rad_s
    tip = find_tip(robot, limbs)
    _set_hands(m, robot, limbs)
    link = limbs[tip].link
    if robot.probe is not None:
        _add_probe(m, tip, link, robot.probe)
        if limbs[tip].side >= 0:  # the probe is at the end of this arm
            m["hand_link"][limbs[tip].side] = tip
            m["hand_offset"][limbs[tip].side] = m["tip_offset"]
            m["hand_rot"][limbs[tip].side] = m["tip_rot"]
    else:
        m["tip_offset"], m["tip_rot"] = m["hand_offset"][0], m["hand_rot"][0]
    m["tip_link"] = tip
    if robot.arm.bar is not None:
        poses = [compute_kinematics(out, posture(robot, which)) for which in ("working", "folded")]
        check_bar_span(robot.name, *poses)
        mass, inertia = compute_bar_share(robot.arm.bar, compute_span(poses[0]))
        for i, place in zip(m["hand_link"], m["hand_offset"][:2], strict=False):
            _weld(m, i, [(mass, place, inertia)])
    return out


def compute_hands_apart(robot: Robot) -> float:
    """Return the distance (m) of the two hands in the working posture."""
    return compute_span(compute_kinematics(build_body_model(robot), posture(robot, "working")))


def _set_hands(m: Any, robot: Robot, limbs: list[Limb]) -> None:
    """Set the hands at the ends of the arms; their mass is welded onto the last links."""
    assert robot.arm is not None
    hand = robot.arm.hand
    m["n_hands"] = robot.arm.sides
    carried = limbs[find_tip(robot, limbs)].side if robot.probe is not None else -1
    for side in range(robot.arm.sides):
        i = max(n for n, limb in enumerate(limbs) if limb.side == side)
        link, way = limbs[i].link, link_direction(limbs[i].link)
        m["hand_link"][side] = i
        m["hand_offset"][side] = (link.length_m + hand.length_m) * way
        m["hand_rot"][side] = tip_rotation(link)
        if side != carried and hand.mass_kg > 0.0:
            com, inertia = build_hand_body(hand)
            R = m["hand_rot"][side]
            _weld(m, i, [(hand.mass_kg, m["hand_offset"][side] + R @ com, R @ inertia @ R.T)])


def _add_docking(m: Any, docking: Docking) -> None:
    """Weld the docking gear onto the platform."""
    mass, com, inertia = build_docking_parts(docking)
    total = m["mass0"] + mass
    m["com0"] = (m["mass0"] * m["com0"] + mass * com) / total
    m["inertia0"] += inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    m["mass0"] = total


def _add_probe(m: Any, i: int, link: Link, probe: Probe) -> None:
    """Weld holder and slider (spring released) onto link `i` and set the tip."""
    parts = build_probe_parts(probe)
    rot = tip_rotation(link, probe.pitch_deg)
    axis = rot[:, 2]
    end = np.array(end_of(link))
    m["tip_offset"], m["tip_rot"] = end + probe.length_m * axis, rot
    # the holder's rod is along z_T; rod_inertia is along x of (z_T, y_T, -x_T)
    along = np.column_stack([axis, rot[:, 1], -rot[:, 0]])
    rod = along @ rod_inertia(parts.holder_mass, parts.holder_length, probe.radius_m) @ along.T
    _weld(m, i, [
        (parts.holder_mass, end + 0.5 * parts.holder_length * axis, rod),
        (parts.slider_mass, end + parts.slider_com * axis, SLIDER_INERTIA * np.eye(3)),
    ])  # fmt: skip


def _weld(m: Any, i: int, parts: list[tuple[float, Array, Array]]) -> None:
    """Add bodies (mass, centre, inertia about it; all in the link's frame) to link `i`."""
    bodies = [(float(m["mass"][i]), m["com"][i].copy(), m["inertia"][i].copy()), *parts]
    mass = sum(b[0] for b in bodies)
    com = sum(b[0] * b[1] for b in bodies) / mass
    inertia = np.zeros((3, 3))
    for b_mass, b_com, b_inertia in bodies:
        d = b_com - com
        inertia += b_inertia + b_mass * (d @ d * np.eye(3) - np.outer(d, d))
    m["mass"][i], m["com"][i], m["inertia"][i] = mass, com, inertia


@njit(cache=True, error_model="numpy")
def fill_kinematics(m: BodyModel, q: Array, k: Kinematics) -> None:
    """Fill link frames, tip pose p_BT, R_BT and the tip Jacobians (all in B) at joints `q`."""
    rot, base, vec = local(3, 3), local(3, 3), local(3)
    for i in range(m.n_links):
        parent, joint = m.parent[i], m.joint[i]
        if parent < 0:
            for a in range(3):
                k.p[i, a] = m.offset[i, a]
                for b in range(3):
                    k.R[i, a, b] = m.turn[i, a, b]
        else:
            mat_vec(k.R[parent], m.offset[i], vec)
            for a in range(3):
                k.p[i, a] = k.p[parent, a] + vec[a]
            mat_mat(k.R[parent], m.turn[i], k.R[i])
        if joint >= 0:
            axis = m.axis[i]
            if m.slide[i]:
                for a in range(3):
                    k.p[i, a] += k.R[i, a, axis] * q[joint]
            else:
                rot_about(axis, q[joint], rot)
                for a in range(3):
                    for b in range(3):
                        base[a, b] = k.R[i, a, b]
                mat_mat(base, rot, k.R[i])
    tip = m.tip_link
    if tip < 0:
        for a in range(3):
            k.p_BT[a] = 0.0
            for b in range(3):
                k.R_BT[a, b] = 1.0 if a == b else 0.0
    else:
        mat_vec(k.R[tip], m.tip_offset, vec)
        for a in range(3):
            k.p_BT[a] = k.p[tip, a] + vec[a]
        mat_mat(k.R[tip], m.tip_rot, k.R_BT)
    fill_point_jacobian(m, k, tip, k.p_BT, k.J_BT)
    for a in range(3):
        for j in range(MAX_JOINTS):
            k.Jw_BT[a, j] = 0.0
    i = tip
    while i >= 0:
        joint = m.joint[i]
        if joint >= 0 and not m.slide[i]:
            for a in range(3):
                k.Jw_BT[a, joint] = k.R[i, a, m.axis[i]]
        i = m.parent[i]


@njit(cache=True, error_model="numpy")
def fill_hands(m: BodyModel, k: Kinematics) -> None:
    """Fill the hands' poses p_BH, R_BH and Jacobians J_BH from `fill_kinematics`' link frames."""
    vec = local(3)
    for h in range(m.n_hands):
        i = m.hand_link[h]
        mat_vec(k.R[i], m.hand_offset[h], vec)
        for a in range(3):
            k.p_BH[h, a] = k.p[i, a] + vec[a]
        mat_mat(k.R[i], m.hand_rot[h], k.R_BH[h])
        fill_point_jacobian(m, k, i, k.p_BH[h], k.J_BH[h])


@helper
def fill_point_jacobian(m: BodyModel, k: Kinematics, link: int, p_B: Array, J: Array) -> None:
    """Fill J (3, MAX_JOINTS) m/rad of a point of `link` at p_B (3,) m, in B."""
    for a in range(3):
        for j in range(MAX_JOINTS):
            J[a, j] = 0.0
    i = link
    while i >= 0:
        joint, axis = m.joint[i], m.axis[i]
        if joint >= 0:
            ax, ay, az = k.R[i, 0, axis], k.R[i, 1, axis], k.R[i, 2, axis]
            if m.slide[i]:
                J[0, joint], J[1, joint], J[2, joint] = ax, ay, az
            else:
                dx, dy, dz = p_B[0] - k.p[i, 0], p_B[1] - k.p[i, 1], p_B[2] - k.p[i, 2]
                J[0, joint] = ay * dz - az * dy
                J[1, joint] = az * dx - ax * dz
                J[2, joint] = ax * dy - ay * dx
        i = m.parent[i]


@njit(cache=True, error_model="numpy")
def fill_gravity_torque(m: BodyModel, k: Kinematics, g_B: Array, torque: Array) -> None:
    """Fill `torque` (MAX_JOINTS,) N m (slides: N) that holds the arm at rest against gravity.

    g_B (3,) m/s^2 is gravity in B (pointing down). It equals MuJoCo's `qfrc_bias` at rest for the
    joints.
    """
    c = local(3)
    for j in range(MAX_JOINTS):
        torque[j] = 0.0
    for n in range(m.n_links):
        mat_vec(k.R[n], m.com[n], c)
        for a in range(3):
            c[a] += k.p[n, a]
        fx, fy, fz = m.mass[n] * g_B[0], m.mass[n] * g_B[1], m.mass[n] * g_B[2]
        i = n
        while i >= 0:
            joint, axis = m.joint[i], m.axis[i]
            if joint >= 0:
                ax, ay, az = k.R[i, 0, axis], k.R[i, 1, axis], k.R[i, 2, axis]
                if m.slide[i]:
                    torque[joint] -= ax * fx + ay * fy + az * fz
                else:
                    dx, dy, dz = c[0] - k.p[i, 0], c[1] - k.p[i, 1], c[2] - k.p[i, 2]
                    torque[joint] -= (
                        ax * (dy * fz - dz * fy) + ay * (dz * fx - dx * fz)
                        + az * (dx * fy - dy * fx)
                    )  # fmt: skip
            i = m.parent[i]


@njit(cache=True, error_model="numpy")
def fill_body(m: BodyModel, k: Kinematics, body: Body) -> None:
    """Fill the composite record from link frames computed by `fill_kinematics`."""
    mass = m.mass0
    for a in range(3):
        body.p_BC[a] = m.mass0 * m.com0[a]
        for b in range(3):
            body.I_B[a, b] = m.inertia0[a, b]
    c, tmp = local(3), local(3, 3)
    for i in range(m.n_links):
        mi = m.mass[i]
        mat_vec(k.R[i], m.com[i], c)
        for a in range(3):
            c[a] += k.p[i, a]
            body.p_BC[a] += mi * c[a]
        mass += mi
        mat_mat(k.R[i], m.inertia[i], tmp)
        cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
        for a in range(3):
            for b in range(3):
                s = 0.0
                for n in range(3):
                    s += tmp[a, n] * k.R[i, b, n]
                s -= mi * c[a] * c[b]
                if a == b:
                    s += mi * cc
                body.I_B[a, b] += s
    body.mass = mass
    body.gravity = m.gravity
    body.n_joints = m.n_joints
    for a in range(3):
        body.p_BC[a] /= mass
        body.p_BT[a] = k.p_BT[a]
        for b in range(3):
            body.R_BT[a, b] = k.R_BT[a, b]
        for j in range(MAX_JOINTS):
            body.J_BT[a, j] = k.J_BT[a, j]


def compute_body(model: NDArray[Any], q: Array) -> tuple[float, Array, Array]:
    """Return (mass kg, p_BC (3,) m, I_B (3, 3) kg m^2 about the origin of B) at joints `q`."""
    body = np.zeros(1, Body.dtype)
    fill_body(model[0], compute_kinematics(model, q), body[0])
    return float(body[0]["mass"]), body[0]["p_BC"].copy(), body[0]["I_B"].copy()


def compute_kinematics(model: NDArray[Any], q: Array) -> Any:
    """Return a Kinematics record, hands included, at joints `q` (n,), n at most MAX_JOINTS."""
    k, full = np.zeros(1, Kinematics.dtype), np.zeros(MAX_JOINTS)
    full[: len(q)] = q
    _fill_all(model[0], full, k[0])
    return k[0]


@njit(cache=True, error_model="numpy")
def _fill_all(m: BodyModel, q: Array, k: Kinematics) -> None:
    fill_kinematics(m, q, k)  # one call: the dispatch on argument types takes longer
    fill_hands(m, k)


def compute_tip(model: NDArray[Any], q: Array) -> tuple[Array, Array]:
    """Return (p_BT (3,) m, R_BT (3, 3)) at joints `q` (n,)."""
    p_BT, R_BT = compute_tips(model, np.asarray(q)[None])
    return p_BT[0], R_BT[0]


def compute_tips(model: NDArray[Any], q: Array) -> tuple[Array, Array]:
    """Return (p_BT (m, 3) m, R_BT (m, 3, 3)) at each row of `q` (m, n)."""
    p_BT, R_BT = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
    full = np.zeros((len(q), MAX_JOINTS))
    full[:, : q.shape[1]] = q
    _fill_tips(model[0], full, np.zeros(1, Kinematics.dtype)[0], p_BT, R_BT)
    return p_BT, R_BT


@njit(cache=True, error_model="numpy")
def _fill_tips(m: BodyModel, q: Array, k: Kinematics, p_BT: Array, R_BT: Array) -> None:
    for i in range(len(q)):
        fill_kinematics(m, q[i], k)
        p_BT[i], R_BT[i] = k.p_BT, k.R_BT
