"""Trials of compliant arms that measure claims: pressing on a bench, hovering, pulling the link.

Suarez 2020. Only small results are stored; see `flights.py` for whole missions.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.analysis.compare.flown import hover_in
from skywright.description.loader import Description
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.loader import load_robot
from skywright.evidence.force_estimators import measure
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.spec import Case
from skywright.missions.sensor_install.plan import build_pose
from skywright.models.compliant_arms import find_swing
from skywright.models.rigid_body import build_body_model
from skywright.models.tip_force import Loaded
from skywright.run.backends import build_vehicle
from skywright.vehicle.arms_interface import Arms
from skywright.vehicle.rest_to_rest import quintic

RADIUS = 0.1  # m, of the paper's pipe; sets the pose of the arms
RAMP, REST, MEAN = 4.0, 6.0, 4.0  # s: the link's period is 1.9 s


def fly_press(case: Case, description: Description) -> Record:
    """Close the force loop at 2 N on a bench; store the fields of `force_estimators.Row`."""
    found = measure(
        case.pose, case.direction, description.robot.control.force_estimator, False,
        description.robot.name, description.mission.seed,
    )  # fmt: skip
    return Record(dict(found._asdict()), {})


def fly_hover(case: Case, description: Description) -> Record:
    """Hold the position of the tip at each wind speed.

    `tip` and `platform` (winds,) m are rms distances from their references, `deflection` (winds,
    n_joints) rad is the mean.
    """
    d = description
    q = build_pose(d.robot, "L", RADIUS)
    found = [
        hover_in(case.robot, q, wind, d.mission.seed, dict(case.sets)) for wind in case.winds_mps
    ]
    return Record(
        {"winds_mps": case.winds_mps},
        {
            "tip": np.array([s.tip for s in found]),
            "platform": np.array([s.platform for s in found]),
            "deflection": np.array([s.deflection for s in found]),
        },
    )


def load_arms(name: str, elbow: float | None = None) -> Loaded:
    """Load the paper's L pose (upper arm hanging, forearm level), or set the elbow angle (rad).

    The mission's L pose leans forward with a raised forearm, to keep distance from the pipe.
    """
    robot, _ = load_robot(name)
    q = build_pose(robot, "L", RADIUS)
    for j, limb in enumerate(list_joints(robot)):
        if limb.name.endswith("elbow_pitch"):
            q[j] = -0.5 * math.pi if elbow is None else elbow
        elif limb.name.endswith("shoulder_pitch"):
            q[j] = 0.0 if elbow is None else -0.5 * math.pi - 0.5 * elbow
    return Loaded(robot, find_swing(build_body_model(robot), q))


def fly_lean(case: Case, description: Description) -> Record:
    """Pull the left hand back, arms in the paper's L, platform clamped; the passive link is free.

    `goal` (n_joints,) rad is the posture without force, `q` (forces, n_joints) rad the encoder
    angles under each force, averaged over four seconds.
    """
    d = description
    goal = load_arms(d.robot.name).q
    vehicle = build_vehicle(d)
    arms = Arms(vehicle)
    arms.move_to(goal)
    while not vehicle.tick().arrived:
        pass
    rows, last = [], 0.0
    for force in case.forces_n:
        start, told = vehicle.t, []
        while (t := vehicle.t - start) < RAMP + REST + MEAN - 1e-9:
            share = float(quintic(np.array([min(t / RAMP, 1.0)]))[0][0])
            vehicle.devices.helper.push(
                "hand0", np.array([-(last + share * (force - last)), 0.0, 0.0])
            )
            vehicle.tick()
            if t >= RAMP + REST:
                told.append(np.array(vehicle.estimate["q"][: len(goal)]))
        rows.append(np.mean(told, axis=0))
        last = force
    kept: dict[str, NDArray[Any]] = {"q": np.array(rows), "goal": goal}
    return Record({"forces_n": case.forces_n}, kept)
