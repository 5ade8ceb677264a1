"""Metrics of the kind "tool-install": final pose of the tool, tracking by the hands."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Samples
from skywright.core.rotations import rot_from_quat, rot_z
from skywright.description.world.surface import level_axes
from skywright.description.world.things import list_movers
from skywright.missions.skills.operated import OPERATED_MEASURES, measure_operated
from skywright.missions.skills.tool_handling import LOW, Place
from skywright.missions.tool_install.plan import ToolPlan, find_places
from skywright.missions.tool_install.task import ToolInstall
from skywright.recordings.columns import has_columns
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.where import WHOLE, Where

MEASURES: Measures = {
    "tool.seat_error_mm": (
        "mm",
        "distance of the tool from its target place on the pipe, after the hands have "
        "withdrawn and the wait",
    ),
    "tool.seat_angle_deg": (
        "deg",
        "angle between the tool and the true pipe at that time",
    ),
    "tool.return_error_mm": (
        "mm",
        "distance of the returned tool from its initial position on the bench",
    ),
    "tool.returned": (
        "",
        "1 if the tool was taken away and then stands upright within 5 cm of its initial position, "
        "otherwise 0",
    ),
    "tool.retries": ("", "grasps that missed"),
    **OPERATED_MEASURES,
    "operator.hand_error_mm": (
        "mm",
        "rms distance of the hands' midpoint from the goal set by the operator's stick, (24)",
    ),
    "operator.retrieval_time_s": ("s", "time under operator control while the tool is retrieved"),
    "operator.retrieval_force_max_n": (
        "N",
        "largest true contact force of a hand under operator control while the tool is retrieved",
    ),
    "platform.drift_max_mm": (
        "mm",
        "largest displacement of the platform since the start of the tracking of grasp points",
    ),
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""

WAIT, RETURN, INSTALL, HOVER, RETRIEVAL = (
    Where(("wait",), "at its end"), Where(("return",), "at its end"), Where(("install",)),
    Where(("hover check",)), Where(("hook", "lift off")),
)  # fmt: skip
WHERE = {
    "tool.seat": WAIT,
    "tool.return": RETURN,
    "tool.retries": WHOLE,
    "operator.": INSTALL,
    "operator.retrieval": RETRIEVAL,
    "tip.": HOVER,
    "platform.": HOVER,
}

RETURNED_M = 0.05
"""m, from its initial position, within which a tool with a smaller angle counts as returned."""
RETURNED_ANGLE = math.radians(9.0)


class Stance(NamedTuple):
    """Pose error of a standing tool."""

    error: Array  # (3,) m, in the goal's frame: ahead, along the pipe, up
    angle: float  # rad, between its attitude and that of the goal


def compute_stance(samples: Samples, at: int, index: int, p_WO: Array, wanted: Array) -> Stance:
    """Return the pose error of thing `index` in sample `at`; the goal is p_WO (3,) m, `wanted`."""
    p, R = samples[f"object{index}_p_WO"][at], rot_from_quat(samples[f"object{index}_q_WO"][at])
    cosine = 0.5 * (float(np.trace(wanted.T @ R)) - 1.0)
    return Stance(wanted.T @ (p - p_WO), math.acos(min(max(cosine, -1.0), 1.0)))


def _left(p_WO: Array, start: Array) -> bool:
    """Whether a thing at p_WO (n, 3) m was ever away from its place `start` (3,) m."""
    return bool(np.max(np.linalg.norm(p_WO - start, axis=1)) > RETURNED_M)


def compute_metrics(run: Flown[ToolInstall, ToolPlan]) -> dict[str, float]:
    """Evaluate the phases that were flown; phases that were not reached yield no metric."""
    out: dict[str, float] = {}
    samples, phases, way, world = run.samples, run.phases, run.way, run.setup.true.world
    i = list_movers(world.things).index(run.task.tool)
    bench, seat = find_places(world, run.task)  # of the true world, not of the map
    pipe = run.setup.true.cylinder
    assert pipe is not None
    wait = np.flatnonzero(WAIT.select(samples, phases))
    if len(wait):
        stance = compute_stance(samples, int(wait[-1]), i, seat.p_WO, level_axes(pipe.R_WP))
        out["tool.seat_error_mm"] = 1e3 * float(np.linalg.norm(stance.error))
        out["tool.seat_angle_deg"] = math.degrees(stance.angle)
    back = np.flatnonzero(RETURN.select(samples, phases))
    out["tool.returned"] = 0.0
    if len(back) and _left(samples[f"object{i}_p_WO"], bench.p_WO):  # not after a failed grasp
        stance = compute_stance(samples, int(back[-1]), i, bench.p_WO, rot_z(bench.yaw))
        out["tool.return_error_mm"] = 1e3 * float(np.linalg.norm(stance.error))
        near = float(np.linalg.norm(stance.error)) < RETURNED_M and stance.angle < RETURNED_ANGLE
        out["tool.returned"] = float(near)
    out["tool.retries"] = float(sum(p.outcome == "retry" for p in phases))
    out |= _judge_operator(samples[INSTALL.select(samples, phases)])
    retrieval = _measure_operated(samples[RETRIEVAL.select(samples, phases)])
    out |= {k.replace("operator.", "operator.retrieval_"): v for k, v in retrieval.items()}
    hover = HOVER.select(samples, phases)
    if np.any(hover):
        out |= _judge_hover(samples[hover], i, way)
    return out


def compute_operated(samples: Samples, index: int, seat: Place) -> dict[str, Array]:
    """Return the motion under operator control in the seat's frame: ahead, left and up, (n, 3) m.

    `goal`: displacement of the midpoint of both hands' goals by (24); `hands`: displacement of the
    hands' midpoint; `tool`: position of thing `index` relative to its seat.
    """
    R = rot_z(seat.yaw)
    goal = 0.5 * (samples["left_ref_p_WH"] + samples["right_ref_p_WH"])
    hands = 0.5 * (samples["left_p_WH"] + samples["right_p_WH"])
    return {
        "goal": (goal - goal[0]) @ R,
        "hands": (hands - goal[0]) @ R,
        "tool": (samples[f"object{index}_p_WO"] - seat.p_WO) @ R,
    }


def _measure_operated(samples: Samples) -> dict[str, float]:
    """Return the time under operator control, and the largest true force (N) of a hand."""
    if not has_columns(samples, "operator_stick"):
        return {}
    force = np.maximum(*(np.linalg.norm(samples[f"{x}_f_W"], axis=1) for x in ("left", "right")))
    return measure_operated(samples, force)


def _judge_operator(samples: Samples) -> dict[str, float]:
    """Return the time under operator control, and the tracking error of (24)."""
    out = _measure_operated(samples)
    if not out:
        return {}
    error = np.zeros((len(samples), 3))
    for side in ("left", "right"):
        error += 0.5 * (samples[f"{side}_p_WH"] - samples[f"{side}_ref_p_WH"])
    return out | {
        "operator.hand_error_mm": 1e3 * float(np.sqrt(np.mean(np.sum(error**2, axis=1)))),
    }


def compute_grasp_errors(samples: Samples, index: int, way: ToolPlan, along: float) -> Array:
    """Return (n, 2, 3) m: error of each tip from its goal, `along` (m) the mouth, in W."""
    out = np.empty((len(samples), 2, 3))
    for k in range(len(samples)):
        R = rot_from_quat(samples[f"object{index}_q_WO"][k])
        for h, side in enumerate(("left", "right")):
            hand = np.array([0.0, way.grip.hands[h][1], 0.0])
            goal = way.grip.handle + hand - way.grip.cradle + along * way.grip.mouth
            p = samples[f"object{index}_p_WO"][k] + R @ goal
            out[k, h] = samples[f"{side}_p_WH"][k] - p
    return out


def _judge_hover(samples: Samples, index: int, way: ToolPlan) -> dict[str, float]:
    """Return the tracking errors of both tips, and the platform's drift (fig. 23, 24)."""
    error = compute_grasp_errors(samples, index, way, -LOW)
    each = np.sqrt(np.mean(np.sum(error**2, axis=2), axis=0))
    drift = samples["p_WB"] - samples["p_WB"][0]
    return {
        "tip.hover_rms_mm": 1e3 * float(np.max(each)),
        "tip.hover_max_mm": 1e3 * float(np.max(np.linalg.norm(error, axis=2))),
        "platform.hover_rms_mm": 1e3
        * float(np.sqrt(np.mean(np.sum((samples["p_WB"] - samples["ref_p_WB"]) ** 2, axis=1)))),
        "platform.drift_max_mm": 1e3 * float(np.max(np.linalg.norm(drift, axis=1))),
    }
