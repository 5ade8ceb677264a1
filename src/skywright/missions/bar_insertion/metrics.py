"""Metrics of the kind "bar-insertion": depth of the peg, attempts, and forces."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Samples
from skywright.description.loader import Description
from skywright.description.world.things import list_movers, locate_thing
from skywright.missions.bar_insertion.plan import InsertionPlan
from skywright.missions.bar_insertion.task import BarInsertion
from skywright.missions.skills.operated import OPERATED_MEASURES, measure_operated
from skywright.models.deviation import build_socket_error
from skywright.models.drawing import rotate_vectors
from skywright.models.things._build import find_offsets
from skywright.models.things.peg import Peg
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.where import Where

MEASURES: Measures = {
    **OPERATED_MEASURES,
    "insert.done": ("", "1 if the peg is in the hole after the hands have withdrawn, otherwise 0"),
    "insert.depth_mm": ("mm", "depth of the peg's end below the socket's face at the end"),
    "insert.force_max_n": (
        "N",
        "largest force of the peg on the socket, excluding inertial forces",
    ),
    "insert.tries": ("", "number of insertion attempts"),
    "insert.time_s": ("s", "time from arrival above the socket to the end of the last attempt"),
    "insert.aim_error_mm": (
        "mm",
        "distance of the peg's end from the hole's axis at the start of the last attempt",
    ),
    "insert.aim_angle_deg": (
        "deg",
        "angle between bar and hole about the hole's axis at that moment",
    ),
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""

END, TRIES = Where(("return",), "at its end"), Where(("lower", "insert"))
INSERTING = Where((*TRIES.phases, "draw out", "set free"))
OPERATED = Where(("align", *TRIES.phases))
WHERE = {
    "insert.done": END,
    "insert.depth_mm": END,
    "insert.force_max_n": INSERTING,
    "insert.tries": TRIES,
    "insert.time_s": OPERATED,
    "operator.": OPERATED,
    "insert.aim": Where(("lower",), "at the start of the last one"),
}

SEATED = 0.95  # of the peg's length in the hole, from which it is inserted


class PegWay(NamedTuple):
    """Motion of the peg relative to the true hole, one row per sample."""

    tip_S: Array  # (n, 3) m, middle of the peg's end in S
    tilt: Array  # (n,) rad, between peg and hole
    turn: Array  # (n,) rad, of the bar about the hole's axis
    f_W: Array  # (n, 3) N, contact force of the peg on its surroundings, without inertia


def compute_peg_way(samples: Samples, d: Description[BarInsertion]) -> PegWay:
    """Return the motion of the peg relative to the true hole, and its contact force."""
    task, things = d.mission.task, d.world.things
    peg = d.world.find_thing(task.bar, Peg)
    offsets = find_offsets(things, build_socket_error(d.plant))
    p_WS, R_WS = locate_thing(things, task.socket, offsets=offsets)
    i = list_movers(things).index(task.bar)
    q = samples[f"object{i}_q_WO"]
    axes = [rotate_vectors(q, np.tile(np.eye(3)[a], (len(samples), 1))) for a in range(3)]
    tip = samples[f"object{i}_p_WO"] - peg.length_m * axes[2]
    along = np.clip(axes[2] @ R_WS[:, 2], -1.0, 1.0)
    turn = np.arctan2(-axes[1] @ R_WS[:, 0], axes[1] @ R_WS[:, 1])
    weight = np.array([0.0, 0.0, peg.mass_kg * d.world.gravity_mps2])
    carried = samples["left_f_W"] + samples["right_f_W"]
    return PegWay((tip - p_WS) @ R_WS, np.arccos(along), turn, carried - weight)


def compute_metrics(run: Flown[BarInsertion, InsertionPlan]) -> dict[str, float]:
    """Evaluate the phases that were flown; phases that were not reached yield no metric."""
    samples, phases, description = run.samples, run.phases, run.setup.description
    peg = description.world.find_thing(run.task.bar, Peg)
    out = {"insert.tries": float(sum(p.name == "lower" for p in phases))}
    out["insert.done"] = 0.0
    way = compute_peg_way(samples, description)
    last = np.flatnonzero(END.select(samples, phases))
    if len(last):
        depth = -float(way.tip_S[last[-1], 2])
        aside = float(np.max(np.abs(way.tip_S[last[-1], :2])))
        out["insert.depth_mm"] = 1e3 * depth
        out["insert.done"] = float(depth > SEATED * peg.length_m and aside < 0.5 * peg.flange_m)
    inserting = INSERTING.select(samples, phases)
    if np.any(inserting):
        pressed = np.linalg.norm(way.f_W[inserting], axis=1)
        out["insert.force_max_n"] = float(np.max(pressed))
    operated = OPERATED.select(samples, phases)
    if np.any(operated):
        pressed = np.linalg.norm(way.f_W[operated], axis=1)
        out |= measure_operated(samples[operated], pressed)
    tries = [phases[i] for i in TRIES.find(phases)]
    if tries:
        begins = [p.start_s for p in tries if p.name == "lower"][-1]
        at = min(int(np.searchsorted(samples["t"], begins)), len(samples) - 1)
        out["insert.aim_error_mm"] = 1e3 * float(np.linalg.norm(way.tip_S[at, :2]))
        out["insert.aim_angle_deg"] = math.degrees(abs(float(way.turn[at])))
        first = next(p.start_s for p in phases if p.name == "align")
        out["insert.time_s"] = tries[-1].end_s - first
    return out
