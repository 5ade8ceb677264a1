"""Plan of a transport problem as the rows of a plan file: path, times, swing, joints."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.streams import build_stream
from skywright.description.robot.limbs import list_servos
from skywright.description.robot.spec import Robot
from skywright.errors import InfeasibleError, InputError
from skywright.models.kinematic_tree import PlanningScene
from skywright.models.planar import PlanarLrm, build_planar_lrm
from skywright.models.scene import build_scene
from skywright.planning.motion.bound import choose_slices, compute_lower_bound
from skywright.planning.motion.kinematics import fill_motion
from skywright.planning.motion.passages import list_passages
from skywright.planning.motion.plan_file import PlanFile
from skywright.planning.motion.planner import Path, plan_path
from skywright.planning.motion.space import JOINT0, build_scratch
from skywright.planning.motion.swing import add_bar, build_swing, compute_period
from skywright.planning.motion.timing import Timed, TimeLimits, assign_times
from skywright.planning.motion.transit import describe_blocked, describe_pair, measure_clearance
from skywright.planning.motion.transport import HANDS, TransportProblem

MARGIN_KEY = "mission.task.margin_m"
SERVO_SHARE = 0.8
"""Fraction of a servo's speed without load that a plan uses; the rest is for load and control.
The value is chosen, not measured."""

RESOLUTION = 1e-3  # spacing in cost (6) of the samples of the reported clearance


class TransportPlan(NamedTuple):
    """A transport's path, its time parametrisation, and the rows of its plan file."""

    path: Path
    timed: Timed
    file: PlanFile
    clearance_m: float  # smallest distance to obstacles, ground and the area's limits
    lower_bound: float


def build_swing_model(robot: Robot, problem: TransportProblem) -> PlanarLrm:
    """Return the planar model with the bar in its hands."""
    model = build_planar_lrm(build_scene(robot, problem.world), robot)
    t = problem.transport
    return add_bar(model, t.bar_mass if t.bar_length > 0 else 0.0, find_hand(problem.scene))


def find_hand(scene: PlanningScene) -> float:
    """Return the distance (m) of a hand from its elbow, along z of the forearm."""
    tree, distance = scene.tree, 0.0
    body = scene.bodies.index(HANDS[0])
    while tree.joint[body] < 0:
        distance -= float(tree.pos[body, 2])
        body = int(tree.parent[body])
    return distance


def build_time_limits(robot: Robot, problem: TransportProblem) -> TimeLimits:
    """Return the limits of a robot file, with the load on board.

    A joint moves at most at `SERVO_SHARE` of the speed of its servo without load. The motion is
    averaged over the period of the passive joint at the start, so that no residual swing remains.
    """
    c, rotors = robot.control, robot.rotors
    space = problem.space[0]
    mass = float(np.sum(space["mass"][: int(space["nb"])]))
    # the thrust of each rotor is bounded; all share a lifting force equally
    thrust = len(rotors.azimuth_deg) * rotors.thrust_max_n * rotors.thrust_fraction
    servos = [SERVO_SHARE * servo.no_load_speed_rad_s for _, servo in list_servos(robot)]
    return TimeLimits(
        joint_rate=min(TimeLimits().joint_rate, *servos),
        speed=c.speed_max_mps, acceleration=c.acceleration_max_mps2,
        tilt=math.radians(c.tilt_max_deg), thrust=thrust, mass=mass,
        gravity=problem.world.gravity_mps2,
        smooth=compute_period(
            build_swing_model(robot, problem), float(problem.start[2]), float(problem.start[3]),
            problem.world.gravity_mps2,
        ),
    )  # fmt: skip


def plan_transport(
    robot: Robot,
    problem: TransportProblem,
    seed: int = 1,
    time_s: float = 1.0,
    duration: float | None = None,
    *,
    slices: int | None = None,
    limits: TimeLimits | None = None,
) -> TransportPlan:
    """Plan and time a transport within `limits` (default: `build_time_limits`).

    `slices` ends the search by work instead of by `time_s`: the same plan on every machine.

    Raises InputError if an end is blocked, InfeasibleError if no path is found within `time_s`; its
    message names the narrowest passage.
    """
    # the first call of a process loads compiled code, which is not planning time
    plan_path(problem.space, problem.start, problem.goal, np.random.default_rng(0), slices=1)
    path = plan_path(
        problem.space, problem.start, problem.goal, build_stream(seed, "planner"), time_s,
        slices=slices,
    )  # fmt: skip
    if path.blocked >= 0:
        ends = np.array([problem.start, problem.goal])
        raise InputError(
            describe_blocked(problem.space, problem.scene, ends, path.blocked, MARGIN_KEY)
        )
    if not len(path.rows):
        raise InfeasibleError(
            f"no path within {path.plan_s:.3g} s; {describe_narrowest(problem, path)}", "passage"
        )
    pendulum = robot.pendulum
    assert pendulum is not None
    swing = build_swing(
        build_swing_model(robot, problem), problem.world.gravity_mps2,
        pendulum.damping_nms_per_rad,
    )  # fmt: skip
    timed = assign_times(
        problem.space, path.rows, limits or build_time_limits(robot, problem), duration=duration,
        swing=swing,
    )  # fmt: skip
    bound = compute_lower_bound(
        problem.space, problem.start, problem.goal, choose_slices(path.rows), 0.03
    )
    clearance, _ = measure_clearance(problem.space, timed.c, RESOLUTION)
    metrics = {
        "plan.cost": path.cost, "plan.lower_bound": bound,
        "plan.first_solution_s": path.first_s, "plan.clearance_min_m": clearance,
        "plan.swing_max_deg": math.degrees(timed.swing), "plan.duration_s": timed.duration,
    }  # fmt: skip
    file = build_plan_file(robot.name, problem, timed, seed, metrics)
    return TransportPlan(path, timed, file, clearance, bound)


def build_plan_file(
    robot: str, problem: TransportProblem, timed: Timed, seed: int, metrics: dict[str, float]
) -> PlanFile:
    """Expand coordinates to platform and joints, with the passive joint in equilibrium."""
    nj = len(problem.scene.joints)
    u, du = np.zeros((len(timed.t), JOINT0 + nj)), np.zeros((len(timed.t), JOINT0 + nj))
    fill_motion(problem.space, build_scratch(problem.space), timed.c, timed.cd, u, du)
    acceleration = timed.cdd @ problem.space[0]["map"][:JOINT0, : timed.c.shape[1]].T
    return PlanFile(
        robot, problem.world.name, seed, problem.scene.joints, timed.t, u[:, :4], du[:, :4],
        acceleration, u[:, 4:], du[:, 4:], metrics, problem.world.scenario_seed,
        problem.world.difficulty,
    )  # fmt: skip


def describe_narrowest(problem: TransportProblem, path: Path) -> str:
    """Return the narrowest passage, or without passages the most frequent obstacle."""
    t = problem.transport
    widths = list_passages(problem.world, problem.space, t.bar_length, t.margin)
    if widths:
        w = widths[0]
        fits = "fits" if w.ratio >= 1.0 else "does not fit"
        return (
            f"the narrowest passage is {w.name!r}: {w.opening:.2f} m wide; the {w.what} "
            f"requires {w.needs:.2f} m with a margin of {t.margin:g} m on each side "
            f"({MARGIN_KEY}): it {fits}"
        )
    if path.hits.any():
        often = describe_pair(problem.space, problem.scene, int(np.argmax(path.hits)), MARGIN_KEY)
        return f"most frequent obstacle: {often}"
    return "no obstacle blocked the search"
