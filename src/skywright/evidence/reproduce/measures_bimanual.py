"""Measures of the compliant dual arm without flights: reach, clearance, statics of a force."""

import math
from functools import lru_cache

import numpy as np

from skywright.analysis.compare.compare import MISSION, measure
from skywright.analysis.compare.comparison import Side
from skywright.analysis.compare.geometry import PipeDistance
from skywright.analysis.compare.table import HOLDS, build_rows, judge_statements
from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.loader import load_description
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.loader import load_robot
from skywright.description.world.surface import build_cylinder, level_axes
from skywright.evidence.reproduce.figures import Bars, ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.flights_arms import load_arms
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.models.compliant_arms import find_hands, find_swing
from skywright.models.geometry import FAR, build_clearance, query_clearance
from skywright.models.reach import ARM_MARGIN, sample_postures, split_query
from skywright.models.rigid_body import build_body_model
from skywright.models.scene import build_scene
from skywright.models.tip_force import Loaded

NAMES = ("bimanual", "bimanual-longreach")
SHORT = ("standard", "long reach")
FORCE = 2.0  # N, of the paper's trials
RADIUS = 0.1  # m, of its pipe
WAYS = np.arange(-90.0, 91.0, 5.0)  # deg above level
STATICS = "Statics: platform level and held, the link free."


@lru_cache(maxsize=1)
def load_sides() -> tuple[Side, Side]:
    """Return the results of `skywright compare` without flights."""
    a, b = [measure(load_description(MISSION, name), lambda _: None) for name in NAMES]
    return a, b


def judge_statement(text: str, flown: dict[str, tuple[float, float]] | None = None) -> float:
    """Return the verdict of `skywright compare` on a statement of table 3: 1 holds, 0.5 partly, 0
    not.

    `flown` are rows (values of both robots) from flights. NaN if nothing was measured.
    """
    a, b = load_sides()
    for row, pair in (flown or {}).items():
        a, b = (
            a._replace(values=a.values | {row: pair[0]}),
            b._replace(values=b.values | {row: pair[1]}),
        )
    found = judge_statements((a, b), build_rows(a, b))
    return next(HOLDS.get(s.verdict, math.nan) for s in found if s.text == text)


def measure_separation(records: Records) -> Measured:
    """Maximum distance between platform and pipe while a hand touches it; figure 32."""
    near, far = (_most_room(name) for name in NAMES)
    sides = load_sides()
    assert sides[0].way is not None and sides[1].way is not None
    bars = Bars(
        "Distance to the pipe while a hand touches it, most", "m", ["propellers", "landing gear"],
        SHORT, np.array([near, far]).T,
    )  # fmt: skip
    way = sides[1].way
    left = way.distance[-1] - way.distance
    panel = Panel(
        "Long reach, on the way under the pipe", "way left to the contact (m)", "m",
        [Curve("propellers, hub", left, way.propellers), Curve("landing gear", left, way.gear)],
        low=0.0,
    )  # fmt: skip
    values = {
        "holds": judge_statement("propellers and landing gear may collide"),
        "gain": min(far) / min(near), "near_m": min(near), "far_m": min(far),
        "near_propellers_m": near[0], "near_gear_m": near[1],
        "far_propellers_m": far[0], "far_gear_m": far[1],
        "far_least_m": float(min(np.min(way.propellers), np.min(way.gear))),
        "overlap_m": -float(np.min(sides[0].way.propellers)),
    }  # fmt: skip
    caption = "Left: the postures and places on the pipe that leave the platform most room."
    return Measured(values, ClaimFigure([bars, panel], caption))


def _most_room(name: str) -> tuple[float, float]:
    """Return distances (m) of propellers and gear for the touch with the largest clearance."""
    d = load_description(MISSION, name)
    assert d.world.pipe is not None and d.robot.arm is not None
    cylinder = build_cylinder(d.world.pipe)
    ahead, _, up = level_axes(cylinder.R_WP).T
    R = rot_z(math.atan2(ahead[1], ahead[0]))
    query, ask = build_clearance(build_scene(d.robot, d.world)), PipeDistance(d)
    _, carrier, last = split_query(d.robot, query)
    model = build_body_model(d.robot)
    r = cylinder.radius + d.robot.arm.hand.radius_m
    best = (-math.inf, -math.inf)
    for q in sample_postures(d.robot, query):
        hand = R @ find_hands(model, q)[0]
        for a in np.radians(np.arange(0.0, 360.0, 15.0)):
            p = cylinder.p_WP - r * math.cos(a) * ahead + r * math.sin(a) * up - hand
            room = ask(p, R, q)
            if min(room) <= min(best):
                continue
            if query_clearance(carrier, p, R, q, 0.0, FAR)[0] < ARM_MARGIN:
                continue
            if query_clearance(last, p, R, q, 0.0, FAR)[0] >= 0.0:
                best = room
    return best


def measure_underside(records: Records) -> Measured:
    """Share of the pipe's circumference that a hand can touch."""
    sides = load_sides()
    values: dict[str, float] = {}
    curves = []
    for side, key, name in zip(sides, ("near", "far"), SHORT, strict=True):
        m = side.reach
        assert m is not None
        bottom = int(np.argmin(np.abs(m.angle - 1.5 * math.pi)))
        values |= {
            f"{key}_bottom": float(m.touched[bottom]), f"{key}_below": m.below_share,
            f"{key}_around": m.surface_share, f"{key}_area_m2": m.area_below,
        }  # fmt: skip
        r = 1.0 + (0.12 if key == "near" else 0.3)
        dots = m.radius * r * np.column_stack([-np.cos(m.angle), np.sin(m.angle)])[m.touched]
        curves.append(Curve(f"{name} touches", dots[:, 0], dots[:, 1], "points"))
    t = np.linspace(0.0, 2.0 * math.pi, 100)
    curves.append(Curve("pipe", 0.1 * np.cos(t), 0.1 * np.sin(t), color="#8a8f98"))
    panel = Panel(
        "Places on the pipe that a hand reaches from the left", "ahead of the axis (m)",
        "above the axis (m)", curves, equal=True,
    )  # fmt: skip
    assert sides[0].way is not None
    values["overlap_m"] = -float(np.min(sides[0].way.propellers))
    values["holds"] = judge_statement("larger workspace")
    values["area_ratio"] = values["far_area_m2"] / values["near_area_m2"]
    caption = "Level platform that faces the pipe; 0.1 m kept by the platform, 0.02 m by the arms."
    return Measured(values, ClaimFigure([panel], caption, across=1))


@lru_cache(maxsize=1)
def compute_statics() -> dict[str, float]:
    """Return the wrench on the platform under a push forward, and the motion of link and
    springs."""
    near, far = load_arms(NAMES[0]), load_arms(NAMES[1])
    push = np.array([-FORCE, 0.0, 0.0])  # on the hand
    a, b = near.compute_reaction(push), far.compute_reaction(push)
    assert a is not None and b is not None and far.robot.pendulum is not None
    ideal = far.robot.pendulum.model_copy(update={"z_m": 0.0, "friction_nm": 0.0})
    centred = Loaded(far.robot.model_copy(update={"pendulum": ideal}), far.q).compute_reaction(push)
    assert centred is not None
    friction = far.robot.pendulum.friction_nm or 0.0
    weight = float(sum(x.link.mass_kg for x in far.joints)) + 2.0 * _hand_mass(far)
    link = far.q[0] + b.swing  # rad from straight down, towards -x
    whole = push + weight * np.array([0.0, 0.0, -9.81])  # on the platform, at the joint
    along = np.array([-math.sin(link), 0.0, -math.cos(link)])
    angle_change = math.degrees(math.acos(abs(push @ along) / FORCE))
    angle_whole = math.degrees(math.acos(min(whole @ along / float(np.linalg.norm(whole)), 1.0)))
    shoulder, recoil = _shoulder_torque(near), far.compute_recoil(push)
    assert recoil is not None
    upward = far.compute_recoil(np.array([0.0, 0.0, -FORCE]))
    assert upward is not None
    arm = near.joints[-1].link.length_m + max(x.link.length_m for x in near.joints)
    spare = math.sqrt(arm**2 - 0.25**2) - 0.25
    values = {
        "near_pitch_nm": abs(float(a.t[1])), "far_pitch_nm": abs(float(b.t[1])),
        "left": abs(float(b.t[1] / a.t[1])), "friction_nm": friction,
        "centred": abs(float(centred.t[1] / a.t[1])),
        "hinge_m": abs(far.robot.pendulum.z_m or 0.0),
        "near_roll_m": near_max(near, 1, 0), "far_roll_m": near_max(far, 1, 0),
        "change_deg": angle_change, "whole_deg": angle_whole,
        "sideways_n": abs(float(push[0])), "weight_n": 9.81 * weight,
        "rest_deg": math.degrees(float(far.q[0])), "swing_deg": math.degrees(abs(b.swing)),
        "up_swing_deg": math.degrees(abs(upward.swing)),
        "away_mm": 1e3 * abs(float(recoil.moved[0])), "spare_mm": 1e3 * spare,
        "shoulder": shoulder[0] / abs(float(a.t[1])), "shoulder_nm": shoulder[0],
        "shoulder_up": shoulder[1],
    }  # fmt: skip
    return values


def measure_reaction(records: Records) -> Measured:
    """Torque on the platform from a push in both configurations; figure 33."""
    near, far = load_arms(NAMES[0]), load_arms(NAMES[1])
    torque = [_sweep_pitch(arms) for arms in (near, far)]
    panel = Panel(
        "Pitch torque on the platform, 2 N in the arms' plane", "push above level (deg)", "N m",
        [Curve(n, WAYS, t) for n, t in zip(SHORT, torque, strict=True)],
    )  # fmt: skip
    values = compute_statics()
    table = np.array([
        [values["near_roll_m"], values["far_roll_m"]],
        [values["near_pitch_nm"] / FORCE, values["far_pitch_nm"] / FORCE],
    ])  # fmt: skip
    bars = Bars(
        "For a newton", "N m/N", ["roll, push to the side", "pitch, push forward"], SHORT, table
    )
    return Measured(values, ClaimFigure([panel, bars], STATICS))


def measure_direction(records: Records) -> Measured:
    """Direction of the force that the link transmits; figure 33, below."""
    values = compute_statics()
    angle = math.radians(values["rest_deg"] + values["swing_deg"])  # of the link, leaning back
    whole = np.array([FORCE, values["weight_n"]])
    scale = 0.05  # m/N

    def line(name: str, x: float, down: float, style: str = "line") -> Curve:
        return Curve(name, np.array([0.0, -x]), np.array([0.0, -down]), style)

    panel = Panel(
        "On the platform, at the joint (20 N/m)", "ahead (m)", "up (m)",
        [
            line("link", 0.8 * math.sin(angle), 0.8 * math.cos(angle)),
            line("whole load, weight included", scale * whole[0], scale * whole[1], "dashed"),
            line("what the push adds", scale * FORCE, 0.0),
        ], equal=True,
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], STATICS, across=1))


def measure_recoil(records: Records) -> Measured:
    """Motion of link and hand under a push forward and upward."""
    far = load_arms(NAMES[1])
    forces = np.arange(0.0, 4.01, 0.5)
    turned: list[list[float]] = [[], []]
    back = []
    for force in forces:
        for out, way in zip(turned, (np.array([-1.0, 0, 0]), np.array([0, 0, -1.0])), strict=True):
            found = far.compute_reaction(force * way)
            out.append(math.nan if found is None else abs(math.degrees(found.swing)))
        gave = far.compute_recoil(np.array([-force, 0.0, 0.0]))
        back.append(math.nan if gave is None else -1e3 * float(gave.moved[0]))
    values = compute_statics()
    panels = [
        Panel(
            "Link turns", "push (N)", "deg",
            [Curve(n, forces, np.array(c)) for n, c in zip(("forward", "upward"), turned,
                                                           strict=True)], low=0.0,
        ),
        Panel(
            "Hand goes back under a push forward", "push (N)", "mm",
            [Curve("link and springs", forces, np.array(back))],
            [(values["spare_mm"], "arm straight")], low=0.0,
        ),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, STATICS))


def measure_shoulder(records: Records) -> Measured:
    """Torque of the shoulder compared with that on the platform, over the direction of the push."""
    near = load_arms(NAMES[0])
    _, J, _ = near.hand(near.q)
    pitch = next(j for j, x in enumerate(near.joints) if x.name == "left_shoulder_pitch")
    e = np.radians(WAYS)
    shoulder = FORCE * (np.cos(e) * J[0, pitch] + np.sin(e) * J[2, pitch])
    panel = Panel(
        "2 N in the arms' plane, standard configuration", "push above level (deg)", "N m",
        [Curve("on the platform", WAYS, np.abs(_sweep_pitch(near))),
         Curve("at the shoulder", WAYS, np.abs(shoulder))], low=0.0,
    )  # fmt: skip
    return Measured(compute_statics(), ClaimFigure([panel], STATICS, across=1))


def _sweep_pitch(arms: Loaded) -> Array:
    """Return the pitch torque (n,) N m under a push of 2 N at elevations WAYS."""
    out = []
    for e in np.radians(WAYS):
        found = arms.compute_reaction(-FORCE * np.array([math.cos(e), 0.0, math.sin(e)]))
        out.append(math.nan if found is None else float(found.t[1]))
    return np.array(out)


def near_max(arms: Loaded, axis: int, about: int) -> float:
    """Return the torque (N m/N) about axis `about` from a force along `axis`."""
    f = np.zeros(3)
    f[axis] = FORCE
    found = arms.compute_reaction(f)
    return math.nan if found is None else abs(float(found.t[about])) / FORCE


def _hand_mass(arms: Loaded) -> float:
    return arms.robot.arm.hand.mass_kg if arms.robot.arm is not None else 0.0


def _shoulder_torque(arms: Loaded) -> tuple[float, float]:
    """Return the shoulder torque (N m) under a push forward, and its ratio to pitch torque
    upward."""
    _, J, _ = arms.hand(arms.q)
    pitch = next(j for j, x in enumerate(arms.joints) if x.name == "left_shoulder_pitch")
    up = arms.compute_reaction(np.array([0.0, 0.0, -FORCE]))
    assert up is not None
    return FORCE * abs(float(J[0, pitch])), FORCE * abs(float(J[2, pitch])) / abs(float(up.t[1]))


def measure_stiffness(records: Records) -> Measured:
    """Cartesian stiffness (27) and load of the servos as the arm stretches; figures 28, 31."""
    bend = np.concatenate([np.arange(90.0, 10.0, -5.0), np.arange(10.0, 0.5, -1.0)])
    robot, _ = load_robot(NAMES[0])
    servos = [s for _, s in list_servos(robot)]
    stall = {x.name: servos[x.servo].stall_torque_nm for x in list_joints(robot)}
    stiffness, worst, upward = [], [], []
    for e in np.radians(bend):
        arms = load_arms(NAMES[0], -float(e))
        _, J, hold = arms.hand(arms.q)
        mine = [j for j, x in enumerate(arms.joints) if x.side == 0 and x.link.axis == "y"]
        J2 = J[np.ix_([0, 2], mine)]
        limit = np.array([stall[arms.joints[j].name] for j in mine])
        k = np.diag([float(arms.joints[j].link.flex_stiffness_nm_per_rad or 0.0) for j in mine])
        inverse = np.linalg.inv(J2)
        stiffness.append(float(np.max(np.linalg.eigvalsh(inverse.T @ k @ inverse))))
        ways = np.radians(np.arange(0.0, 360.0, 5.0))
        f = FORCE * np.column_stack([np.cos(ways), np.sin(ways)])  # on the hand
        worst.append(float(np.max(np.abs(hold[mine] - f @ J2) / limit)))
        upward.append(float(np.max(np.abs(hold[mine] - np.array([0.0, -FORCE]) @ J2) / limit)))
    K, load = np.array(stiffness), np.array(worst)
    panels = [
        Panel(
            "Largest Cartesian stiffness, (27)", "elbow from straight (deg)", "N/m",
            [Curve("", bend, K, "line+points")], log_y=True,
        ),
        Panel(
            "Load of shoulder or elbow for 2 N", "elbow from straight (deg)",
            "torque over stall torque",
            [Curve("worst direction", bend, load), Curve("upward", bend, np.array(upward))],
            [(1.0, "stall")], low=0.0,
        ),
    ]  # fmt: skip
    values = {
        "ratio": float(np.interp(10.0, bend[::-1], K[::-1]) / K[0]), "bent_n_per_m": float(K[0]),
        "ten_n_per_m": float(np.interp(10.0, bend[::-1], K[::-1])),
        "straight_n_per_m": float(K[-1]), "least_deg": float(bend[-1]),
        "load": float(load.max()), "load_up": float(max(upward)),
    }  # fmt: skip
    caption = "Joints that are measured; hand level with the shoulder; arm's weight included."
    return Measured(values, ClaimFigure(panels, caption))


def measure_arm_motion(records: Records) -> Measured:
    """Rotation of the link from motion of the arms without contact."""
    robot, _ = load_robot(NAMES[1])
    model, joints = build_body_model(robot), list_joints(robot)
    lift = np.radians(np.arange(0.0, 91.0, 5.0))
    turned, moved = [], []
    for a in lift:
        q = np.zeros(len(joints))
        for j, x in enumerate(joints):
            if x.name.endswith("shoulder_pitch"):
                q[j] = -a
        held = find_hands(model, q)[0]
        q = find_swing(model, q)
        turned.append(math.degrees(q[0]))
        moved.append(1e3 * float(np.linalg.norm(find_hands(model, q)[0] - held)))
    panels = [
        Panel(
            "Link at rest", "straight arms lifted (deg)", "link leans back (deg)",
            [Curve("", np.degrees(lift), np.array(turned))],
        ),
        Panel(
            "Hand against where it would be with a fixed link", "straight arms lifted (deg)", "mm",
            [Curve("", np.degrees(lift), np.array(moved))],
        ),
    ]  # fmt: skip
    values = {"turn_deg": max(turned), "moved_mm": max(moved)}
    return Measured(values, ClaimFigure(panels, "Weight alone; both arms together."))
