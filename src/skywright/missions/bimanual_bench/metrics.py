"""Metrics of the kind "bimanual-bench": box, plug, bar and post in two hands."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask, Samples
from skywright.description.loader import Description
from skywright.description.world.things import find_first, list_movers, locate_thing
from skywright.missions.bimanual_bench.plan import BenchPlan
from skywright.missions.bimanual_bench.task import BimanualBench
from skywright.models.drawing import rotate_vectors
from skywright.models.things.bench import Bench
from skywright.run.flight import Flown, PhaseRecord
from skywright.run.kind import Measures
from skywright.run.metrics import in_phases
from skywright.run.where import Where

MEASURES: Measures = {
    "bench.box_lift_m": ("m", "smallest lift of the box while it is held"),
    "bench.box_lift_share": ("", "bench.box_lift_m divided by the requested lift"),
    "bench.box_slip_mm": (
        "mm",
        "largest displacement of the box relative to the hands while it is held",
    ),
    "bench.squeeze_n": ("N", "mean force of a hand on the box while it is held"),
    "bench.squeeze_error_n": ("N", "rms error of that force"),
    "bench.squeeze_off": ("", "bench.squeeze_error_n divided by the requested squeeze force"),
    "bench.unplug_delay_s": (
        "s",
        "delay between the plug's passing of the threshold and its detection",
    ),
    "bench.plug_slip_mm": ("mm", "largest displacement of the released plug relative to the hands"),
    "bench.bar_position_mm": (
        "mm",
        "largest distance of the bar from its reference, over three poses",
    ),
    "bench.bar_direction_deg": ("deg", "largest angle between the bar and its reference"),
    "bench.drift_error_mm": ("mm", "rms error of the base's drift as estimated by the arms"),
    "bench.drift_rms_mm": ("mm", "rms of the base's drift"),
    "bench.drift_off": ("", "bench.drift_error_mm divided by the amplitude of the drift"),
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""

LAST_S = 1.0  # s at the end of a phase over which a pose is evaluated
BOX, DRIFT = Where(("hold box",)), Where(("drift",))
PULL, UNPLUGGED = Where(("pull",)), Where(("unplugged",))
POSES = Where(("lift bar", "turn bar", "bar forward"), f"the last {LAST_S:g} s of each")
WHERE = {
    "bench.box": BOX,
    "bench.squeeze": BOX,
    "bench.unplug_delay_s": Where((*PULL.phases, *UNPLUGGED.phases)),
    "bench.plug_slip_mm": UNPLUGGED,
    "bench.bar": POSES,
    "bench.drift": DRIFT,
}


def compute_metrics(run: Flown[BimanualBench, BenchPlan]) -> dict[str, float]:
    """Evaluate the trials that were made."""
    samples, phases, description = run.samples, run.phases, run.setup.description
    names, task = list_movers(description.world.things), run.task
    out: dict[str, float] = {}
    for trial in run.task.trials:
        judge = {"squeeze": _judge_box, "unplug": _judge_plug, "bar": _judge_bar}.get(trial)
        if judge is not None:
            thing = {"squeeze": task.box, "unplug": task.plug, "bar": task.bar}[trial]
            out |= judge(samples, phases, names.index(thing), description)
        else:
            out |= _judge_drift(samples, phases, description)
    return out


def _judge_box(
    s: Samples, phases: list[PhaseRecord], i: int, d: Description[BimanualBench]
) -> dict[str, float]:
    """Return the height of the box, its slip between the hands, and the squeeze."""
    hold = BOX.select(s, phases)
    if not np.any(hold):
        return {}
    stood = locate_thing(d.world.things, d.mission.task.box).p
    box = s[f"object{i}_p_WO"][hold]
    press = 0.5 * (s["right_f_W"][hold][:, 1] - s["left_f_W"][hold][:, 1])
    task, lift = d.mission.task, float(np.min(box[:, 2])) - float(stood[2])
    error = float(np.sqrt(np.mean((press - task.squeeze_n) ** 2)))
    return {
        "bench.box_lift_m": lift, "bench.box_lift_share": lift / task.lift_m,
        "bench.box_slip_mm": _compute_slip(s, hold, i),
        "bench.squeeze_n": float(np.mean(press)),
        "bench.squeeze_error_n": error, "bench.squeeze_off": error / task.squeeze_n,
    }  # fmt: skip


def _compute_slip(s: Samples, held: Mask, i: int) -> float:
    """Return the largest motion (mm) of thing i relative to the hands' midpoint since the first
    sample."""
    away = s[f"object{i}_p_WO"][held] - 0.5 * (s["left_p_WH"] + s["right_p_WH"])[held]
    return 1e3 * float(np.max(np.linalg.norm(away - away[0], axis=1)))


def _judge_plug(
    s: Samples, phases: list[PhaseRecord], i: int, d: Description[BimanualBench]
) -> dict[str, float]:
    """Return the delay of the release's detection, and the slip of the plug in the hands."""
    pull = PULL.select(s, phases)
    if not np.any(pull):
        return {}
    was = locate_thing(d.world.things, d.mission.task.plug).p
    way = np.linalg.norm(s[f"object{i}_p_WO"] - was, axis=1)
    free = np.flatnonzero((s["t"] >= s["t"][pull][0]) & (way > d.mission.task.unplug_threshold_m))
    noticed = next((p.start_s for p in phases if p.name == "unplugged"), None)
    out = UNPLUGGED.select(s, phases)
    if noticed is None or not len(free) or s["t"][free[0]] > s["t"][out][-1]:
        return {}  # or a false detection: the hands slipped off
    return {
        "bench.unplug_delay_s": abs(noticed - float(s["t"][free[0]])),
        "bench.plug_slip_mm": _compute_slip(s, out, i),
    }


class BarErrors(NamedTuple):
    """Per sample: position error (n,) m of the bar's centre and angle error (n,) rad."""

    position: Array
    direction: Array


def compute_bar_errors(
    s: Samples, phases: list[PhaseRecord], d: Description[BimanualBench]
) -> BarErrors | None:
    """Compare the bar with the commanded pose, (29) and (30); None if the hands did not grasp it.

    Poses are relative to the bar's pose at the grasp.
    """
    held = in_phases(s, phases, "hold bar")
    if not np.any(held):
        return None
    things, name = d.world.things, d.mission.task.bar
    lay, i = locate_thing(things, name).p, list_movers(things).index(name)
    middle = 0.5 * (s["left_ref_p_WH"] + s["right_ref_p_WH"])
    goal = middle - (middle[held][-1] - lay)
    n = s["left_ref_p_WH"] - s["right_ref_p_WH"]
    n = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
    axis = rotate_vectors(s[f"object{i}_q_WO"], np.tile([0.0, 1.0, 0.0], (len(s), 1)))
    cosine = np.abs(np.sum(n * axis, axis=1))
    return BarErrors(
        np.linalg.norm(s[f"object{i}_p_WO"] - goal, axis=1), np.arccos(np.clip(cosine, 0.0, 1.0))
    )


def _judge_bar(
    s: Samples, phases: list[PhaseRecord], i: int, d: Description[BimanualBench]
) -> dict[str, float]:
    """Return the largest errors of the bar's true centre and direction at the end of each pose."""
    found = compute_bar_errors(s, phases, d)
    late, poses = np.zeros(len(s), dtype=bool), POSES.find(phases)
    for k, phase in enumerate(phases):
        if k in poses:
            late |= (s["phase"] == k) & (s["t"] > phase.end_s - LAST_S)
    if found is None or not np.any(late):
        return {}
    return {
        "bench.bar_position_mm": 1e3 * float(np.max(found.position[late])),
        "bench.bar_direction_deg": math.degrees(float(np.max(found.direction[late]))),
    }


class Drift(NamedTuple):
    """Displacement (n, 3) m of the base during its drift: measured by the arms, and true."""

    felt: Array
    true: Array


def compute_drift(
    s: Samples, phases: list[PhaseRecord], d: Description[BimanualBench]
) -> Drift | None:
    """Return the base's drift, measured by the arms' angles, and the true one.

    The object that the hands touch is fixed, so the base has moved by minus the hands' estimated
    motion in its own frame. The estimate in W contains the estimated base, which is subtracted.
    """
    moving = DRIFT.select(s, phases)
    if not np.any(moving) or find_first(d.world.things, Bench) is None:
        return None
    in_base = 0.5 * (s["left_est_p_WH"] + s["right_est_p_WH"])[moving] - s["est_p_WB"][moving]
    true = s["p_WB"][moving]
    return Drift(in_base[0] - in_base, true - true[0])


def _judge_drift(
    s: Samples, phases: list[PhaseRecord], d: Description[BimanualBench]
) -> dict[str, float]:
    found = compute_drift(s, phases, d)
    if found is None:
        return {}
    off = float(np.sqrt(np.mean(np.sum((found.felt - found.true) ** 2, axis=1))))
    asked = d.mission.task.drift_m
    return ({"bench.drift_off": off / asked} if asked > 0.0 else {}) | {
        "bench.drift_error_mm": 1e3 * off,
        "bench.drift_rms_mm": 1e3 * float(np.sqrt(np.mean(np.sum(found.true**2, axis=1)))),
    }
