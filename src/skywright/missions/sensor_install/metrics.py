"""Metrics of the kind "sensor-install": force, hand, swing, platform and bond of the tape."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.core.rotations import rot_from_quat
from skywright.description.robot.limbs import list_joints
from skywright.description.world.spec import World
from skywright.description.world.surface import Cylinder, level_axes
from skywright.description.world.things import find_first
from skywright.missions.sensor_install.plan import SWING_DECAYED, InstallPlan
from skywright.missions.sensor_install.surveyed import BOTTOM
from skywright.missions.sensor_install.task import SensorInstall
from skywright.missions.skills.operated import OPERATED_MEASURES, measure_operated
from skywright.missions.skills.survey import PHASE, get_hand_columns, read_touches
from skywright.missions.skills.surveyed import (
    SURVEY_MEASURES,
    SURVEY_WHERE,
    Surveyed,
    fit_touches,
    judge_survey,
)
from skywright.models.rigid_body import compute_kinematics
from skywright.models.things.tape import Tape
from skywright.recordings.period import compute_period
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.setup import Setup
from skywright.run.where import ALOFT, Where

MEASURES: Measures = {
    "force.estimate_error_n": ("N", "rms error of the estimated force"),
    "platform.excursion_m": ("m", "displacement of the platform during the press"),
    "swing.start_deg": ("deg", "angle at which the passive link was released"),
    "swing.decay_s": ("s", "time until the link stays within 1 deg of rest"),
    **SURVEY_MEASURES,
    **OPERATED_MEASURES,
    "arm.lever_min": (
        "",
        "smallest ratio of a hand's lever arm to the arm's reach in flight, worst direction",
    ),
    "arm.lever_felt_min": ("", "arm.lever_min of the hand that measures a force, while it does"),
    "sensor.bond_n": ("N", "bond strength of the tape after the press"),
    "sensor.around_mm": (
        "mm",
        "largest distance of the sensor from the lowest line of the pipe, around the pipe",
    ),
    "sensor.along_mm": (
        "mm",
        "largest distance of the sensor from the pipe's middle, along the pipe; touches do "
        "not measure this position",
    ),
    "sensor.installed": ("", "1 if the sensor stays at the requested place, otherwise 0"),
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""

BEFORE_S = 2.0  # s before the touch, over which the platform's position is averaged
FORCE, HOLD = Where(("force",)), Where(("force",), whole=True)
HOVER, SWING = Where(("hover check",)), Where(("swing check",))
PRESSED = Where(("press", "leave singularity", "force"))
FELT, TOUCHED = Where(("touch", *PRESSED.phases)), Where((PHASE,))
WHERE = {
    **SURVEY_WHERE,
    "force.": HOLD,
    "contact.lost_s": HOLD,
    "tip.hover": HOVER,
    "platform.hover": HOVER,
    "platform.excursion_m": PRESSED,
    "swing.": SWING,
    "sensor.": ALOFT,
    "sensor.around_mm": FORCE,
    "sensor.along_mm": FORCE,
    "operator.": FELT,
    "arm.lever_min": ALOFT,
    "arm.lever_felt_min": Where((PHASE, *FELT.phases)),
}
PRESSING = 0.02  # N
AROUND_M, ALONG_M = 0.02, 0.03
"""Largest distance of an installed sensor from its place; along the pipe the map's error is added.
"""
LEVER_EVERY = 5  # samples, in which joints turn by a degree


def compute_metrics(run: Flown[SensorInstall, InstallPlan]) -> dict[str, float]:
    """Evaluate the phases that were flown; phases that were not reached yield no metric."""
    out: dict[str, float] = {}
    samples, phases, task, way = run.samples, run.phases, run.task, run.way
    true = run.setup.true.cylinder
    assert true is not None
    up = level_axes(true.R_WP)[:, 2]  # of the true pipe, not of the map
    normal = samples["left_f_W"] @ up
    surveyed = run.once(find_survey)
    if surveyed is not None and way.survey is not None:
        out |= judge_survey(run.setup, surveyed, np.array([[0.0, BOTTOM]]), way.survey.ball)
    hold = HOLD.select(samples, phases)
    if np.any(hold):
        force = normal[hold]
        out["force.mean_n"] = float(np.mean(force))
        out["force.min_n"], out["force.max_n"] = float(np.min(force)), float(np.max(force))
        out["force.mean_error_n"] = abs(out["force.mean_n"] - task.force_n)
        out["force.rms_error_n"] = float(np.sqrt(np.mean((force - task.force_n) ** 2)))
        estimate = samples["left_est_f_W"][hold] @ up
        out["force.estimate_error_n"] = float(np.sqrt(np.mean((estimate - force) ** 2)))
        out["contact.lost_s"] = _duration(samples, hold & (normal <= 0.0))
    hover = HOVER.select(samples, phases)
    if np.any(hover):
        error = samples["left_p_WH"][hover] - samples["left_ref_p_WH"][hover]
        out["tip.hover_rms_mm"] = 1e3 * _rms(error)
        out["tip.hover_max_mm"] = 1e3 * float(np.max(np.linalg.norm(error, axis=1)))
        drift = samples["p_WB"][hover] - samples["ref_p_WB"][hover]
        out["platform.hover_rms_mm"] = 1e3 * _rms(drift)
    swing = SWING.select(samples, phases)
    if np.any(swing):
        out.update(_judge_swing(samples["t"][swing], samples["q"][swing, 0]))
    pressed = PRESSED.select(samples, phases)
    if np.any(pressed):
        first = int(np.argmax(pressed))
        before = (samples["t"] < samples["t"][first]) & (
            samples["t"] > samples["t"][first] - BEFORE_S
        )
        way_off = samples["p_WB"] - samples["ref_p_WB"]
        steady = np.mean(way_off[before], axis=0)
        out["platform.excursion_m"] = float(
            np.max(np.linalg.norm(way_off[pressed] - steady, axis=1))
        )
    felt = FELT.select(samples, phases)
    if np.any(felt):
        out |= measure_operated(samples[felt], np.linalg.norm(samples["left_f_W"][felt], axis=1))
    flown = ALOFT.select(samples, phases)
    out.update(_judge_tape(samples[flown], normal[flown], up, run.setup.world))
    forced = FORCE.select(samples, phases)  # the sensor stays even if the press is interrupted
    if np.any(forced):
        around, along = find_place(find_balls(run.setup, samples[forced]), true)
        out |= {"sensor.around_mm": 1e3 * around, "sensor.along_mm": 1e3 * along}
        room = ALONG_M + run.setup.description.plant.map_error_m
        if "sensor.installed" in out and (around > AROUND_M or along > room):
            out["sensor.installed"] = 0.0
    if np.any(flown):
        out["arm.lever_min"] = _find_least_lever(run.setup, samples["q"][flown])
    survey = run.way.survey
    levers = [
        _find_least_lever(run.setup, samples["q"][feels], [hand])
        for hand, where in ((0, FELT), *([] if survey is None else [(survey.hand, TOUCHED)]))
        if np.any(feels := where.select(samples, phases))
    ]
    if levers:
        out["arm.lever_felt_min"] = min(levers)
    return out


def find_balls(setup: Setup[SensorInstall], samples: NDArray[Any]) -> Array:
    """Return the centres (n, 3) m in W of the left hand's ball, which lies behind the hand's end.

    The ball touches the pipe on the line from its centre to the pipe's axis. If the hand leans, its
    end is beside that line by up to a radius of the ball.
    """
    arm = setup.robot.arm
    assert arm is not None
    axes = np.array([rot_from_quat(q)[:, 2] for q in samples["left_q_WH"]])
    return np.asarray(samples["left_p_WH"] - arm.hand.radius_m * axes)


def find_place(p_W: Array, pipe: Cylinder) -> tuple[float, float]:
    """Return the largest distances (m) of points (n, 3) m from the pipe's lowest line and middle.

    The first is measured around the pipe, the second along it. The lowest line is defined by
    gravity, independent of the pipe's roll.
    """
    local = (p_W - pipe.p_WP) @ level_axes(pipe.R_WP)
    around = pipe.radius * np.abs(np.arctan2(local[:, 0], -local[:, 2]))
    return float(np.max(around)), float(np.max(np.abs(local[:, 1])))


def find_survey(run: Flown[SensorInstall, InstallPlan]) -> Surveyed | None:
    """Fit the pipe to the recorded touches; returns None if there are none."""
    survey = run.way.survey
    if survey is None:
        return None
    touches = read_touches(run.samples, run.phases, get_hand_columns(survey.hand))
    if all(t.reason for t in touches):
        return None
    return fit_touches(run.setup, touches, survey.ball)


def _find_least_lever(
    setup: Setup[SensorInstall], q: Array, hands: Sequence[int] | None = None
) -> float:
    """Return the least singular value of an arm's Jacobian over its reach, q (n, n_joints) rad.

    `hands` are the indices of the arms considered; None means both.

    The value is zero for a stretched arm: no joint motion moves the hand along the arm, and a force
    along it causes no joint torque (vehicle/arms/singularity.py).
    """
    joints, least = list_joints(setup.robot), math.inf
    sides = sorted({limb.side for limb in joints if limb.side >= 0})
    mine = [[j for j, limb in enumerate(joints) if limb.side == side] for side in sides]
    reach = sum(sorted(joints[j].link.length_m for j in mine[0])[-2:])  # upper and forearm
    rows = q[::LEVER_EVERY, : len(joints)]
    J = np.array([compute_kinematics(setup.model, row)["J_BH"] for row in rows])
    for h in range(len(mine)) if hands is None else hands:
        values = np.linalg.svd(J[:, h][:, :, mine[h]], compute_uv=False)
        least = min(least, float(np.min(values[:, -1])))
    return least / reach


def _judge_swing(t: Array, q: Array) -> dict[str, float]:
    """Return the initial angle and the time until the link stays within 1 deg of its rest angle."""
    rest = float(np.mean(q[t > t[-1] - 1.0]))
    out = {"swing.start_deg": math.degrees(abs(float(q[0]) - rest))}
    outside = np.flatnonzero(np.abs(q - rest) > SWING_DECAYED)
    out["swing.decay_s"] = float(t[outside[-1]] - t[0]) if len(outside) else 0.0
    return out


def _judge_tape(samples: NDArray[Any], normal: Array, up: Array, world: World) -> dict[str, float]:
    """Return the bond from the recorded press, and whether the sensor stayed when the hand
    withdrew."""
    tape = find_first(world.things, Tape)
    if tape is None or not len(samples):
        return {}
    t = samples["t"]
    dt = np.diff(t, append=t[-1])
    impulse = float(np.sum(np.where(normal > PRESSING, normal * dt, 0.0)))
    bond = tape.strength_n * (1.0 - math.exp(-impulse / tape.press_n_s))
    last = np.flatnonzero(normal > PRESSING)
    left = False
    if len(last):  # the hand withdrew farther than the tape stretches
        height = samples["left_p_WH"][last[-1] :] @ up
        left = height[0] - float(np.min(height)) > tape.strength_n / tape.stiffness_n_per_m
    return {
        "sensor.bond_n": bond,
        "sensor.installed": float(left and bond >= tape.release_n),
    }


def _duration(samples: NDArray[Any], mask: Mask) -> float:
    return compute_period(samples["t"]) * float(np.count_nonzero(mask))


def _rms(error: Array) -> float:
    """Return the root mean square of the norms of vectors (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
