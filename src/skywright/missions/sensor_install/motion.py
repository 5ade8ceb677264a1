"""Duration of the moves of a sensor's installation, as planned on the map."""

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skywright.core.arrays import Array
from skywright.missions.skills.ways import compute_slide_s, compute_way_s, reverse_way
from skywright.run.setup import Setup
from skywright.vehicle.arms_interface import compute_joints_s
from skywright.vehicle.interface import build_limits

if TYPE_CHECKING:
    from skywright.missions.sensor_install.plan import InstallPlan
    from skywright.missions.sensor_install.task import SensorInstall

CALM = 0.3  # fraction of the speed and acceleration limits, near the pipe


def sum_moves(setup: "Setup[SensorInstall]", way: "InstallPlan") -> float:
    """Return the duration (s) of the flights and of the arms' motions there and back."""
    limits, yaw = build_limits(setup.robot), float(setup.hover[3])
    far, below = (
        compute_joints_s(b - a) for a, b in ((way.folded, way.q_good), (way.q_good, way.q))
    )
    there = compute_way_s(way.to_far, limits, 1.0, yaw, way.q_good)
    there += compute_way_s(way.to_below, limits, CALM, way.yaw, way.q)
    home, back = reverse_way(way.to_far), reverse_way(way.to_below)
    there += compute_way_s(back, limits, CALM, way.yaw, way.q)
    there += compute_way_s(home, limits, 1.0, way.yaw, way.q_good)
    approach = compute_slide_s(limits, CALM, _measure(way.p_near - way.p_below))
    return 2.0 * (far + below + approach) + there + _sum_survey(setup, way)


def _sum_survey(setup: "Setup[SensorInstall]", way: "InstallPlan") -> float:
    """Return the duration (s) of the moves from touch to touch, 0 without a survey."""
    survey = way.survey
    if survey is None:
        return 0.0
    touches = range(len(survey.travels))
    stops = [way.p_below, *(survey.start(i)[0] for i in touches), way.p_below]
    moves = pairwise(stops)
    limits, bend = build_limits(setup.robot), compute_joints_s(way.q_survey - way.q)
    return 2.0 * bend + sum(compute_slide_s(limits, CALM, _measure(b - a)) for a, b in moves)


def _measure(way: Array) -> float:
    return float(np.linalg.norm(way))
