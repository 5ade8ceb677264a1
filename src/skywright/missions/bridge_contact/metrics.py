"""Metrics of the kind "bridge-contact": held force, motion while docked, speed at the touch.

The force is the true force of the tip on the structure along the probe, compared with the
reference.
"""

from typing import Any

import numpy as np

from skywright.core.arrays import Array, Samples
from skywright.description.world.structure import Surface, locate_point
from skywright.missions.bridge_contact.operated_press import PRESS, TOUCH
from skywright.missions.bridge_contact.plan import ContactPlan
from skywright.missions.bridge_contact.survey import read_survey
from skywright.missions.bridge_contact.task import BridgeContact
from skywright.missions.bridge_contact.visits import list_visits
from skywright.missions.skills.datum import (
    DATUM_WHERE,
    get_datum,
    judge_datum,
    read_datum,
    spread_over_structure,
)
from skywright.missions.skills.operated import OPERATED_MEASURES, measure_operated
from skywright.missions.skills.survey import PHASE
from skywright.missions.skills.surveyed import SURVEY_WHERE
from skywright.missions.skills.surveyed_structure import (
    STRUCTURE_MEASURES,
    fit_structure,
    judge_structure,
)
from skywright.models.drawing import rotate_vectors
from skywright.recordings.columns import has_columns
from skywright.recordings.period import compute_period
from skywright.run.flight import Flown, PhaseRecord
from skywright.run.kind import Measures
from skywright.run.metrics import OFF_SURFACE
from skywright.run.where import Where

MEASURES: Measures = {
    "dock.touch_speed_mps": ("m/s", "largest approach speed of a docking foot at contact"),
    "dock.wander_mm": (
        "mm",
        "largest displacement of the docked platform from its initial position while "
        "forces are held",
    ),
    "dock.turn_deg": (
        "deg",
        "largest angle between the docked platform and the deck during a press",
    ),
    "press.limit_n": (
        "N",
        "largest press force in these conditions while docked, from the capability analysis",
    ),
    "press.fraction": ("", "largest force of the profile divided by press.limit_n"),
    "press.place_error_mm": (
        "mm",
        "largest distance of the tip from its spot along the surface, less the bound of the map's "
        "error unless a datum was seen",
    ),
    "free.rms_error_n": ("N", "force.rms_error_n in flight, undocked"),
    "free.mean_error_n": ("N", "force.mean_error_n in flight, undocked"),
    "free.sensor_error_n": ("N", "force.sensor_error_n in flight, undocked"),
    "free.wander_mm": ("mm", "dock.wander_mm in flight, undocked"),
    "slide.rms_error_n": ("N", "rms force error while the tip slides along the structure"),
    "slide.lost_s": ("s", "time off the surface (gap above 0.1 mm) while sliding"),
    "slide.no_force_max_s": ("s", "longest time without contact force while sliding (true force)"),
    "slide.length_m": (
        "m",
        "largest distance of the tip from where its slide began; the smaller of both ways",
    ),
    "slide.length_fraction": ("", "this distance as a fraction of the requested length"),
    **STRUCTURE_MEASURES,
    **OPERATED_MEASURES,
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""

HOLD, FREE = Where(("hold *",), whole=True), Where(("free hold *",), whole=True)
SLIDE = Where(("slide*",), whole=True)
FELT = Where((TOUCH, PRESS))  # by an operator, if there is one
DOCKING = Where(("dock", "seat", PHASE), "just before the feet touch")
WHERE = {
    **SURVEY_WHERE,
    **DATUM_WHERE,
    "force.": HOLD,
    "dock.": HOLD,
    "dock.touch_speed_mps": DOCKING,
    "press.": Where(note="the request, against the capability analysis"),
    "press.place_error_mm": Where((*HOLD.phases, *FREE.phases), whole=True),
    "free.": FREE,
    "slide.": SLIDE,
    "operator.": FELT,
}

TOUCHING = 0.05  # N on the docking feet that counts as contact
BEFORE_S = 0.05


def compute_press(samples: Samples) -> Array:
    """Return the true force (n,) N of the tip on the structure along the probe."""
    axis = rotate_vectors(samples["q_WT"], np.tile([0.0, 0.0, 1.0], (len(samples), 1)))
    return np.asarray(-np.sum(samples["f_contact"] * axis, axis=1))


def compute_metrics(run: Flown[BridgeContact, ContactPlan]) -> dict[str, float]:
    """Evaluate the phases that were flown; phases that were not reached yield no metric."""
    samples, phases, way = run.samples, run.phases, run.way
    out: dict[str, float] = {}
    deck = run.setup.true.surface
    assert deck is not None
    normal = locate_point(deck, way.stations[0].place)[1][:, 2]
    held = HOLD.select(samples, phases)
    if np.any(held):
        out.update(_judge_holds(samples, phases, HOLD, "force"))
        out["dock.wander_mm"] = 1e3 * _find_wander(samples, phases, HOLD)
        out["dock.turn_deg"] = _find_turn(samples, phases, normal)
        out["press.fraction"] = way.largest / way.limit_n
        out["press.limit_n"] = way.limit_n
    if way.stations and (np.any(held) or np.any(FREE.select(samples, phases))):
        out["press.place_error_mm"] = 1e3 * _find_place_error(run, deck)
    speeds = _find_touches(samples, phases, normal)
    if len(speeds):
        out["dock.touch_speed_mps"] = float(np.max(speeds))
    flying = FREE.select(samples, phases)
    if np.any(flying):
        out.update(_judge_holds(samples, phases, FREE, "free"))
        out["free.wander_mm"] = 1e3 * _find_wander(samples, phases, FREE)
    s = samples[SLIDE.select(samples, phases)]
    if len(s):
        out["slide.rms_error_n"] = _judge_force(s, "force")["force.rms_error_n"]
        out["slide.lost_s"] = compute_period(s["t"]) * float(
            np.count_nonzero(s["gap_max"] > OFF_SURFACE)
        )
        if has_columns(s, "off_s"):
            out["slide.no_force_max_s"] = float(np.max(s["off_s"]))
        gone = min(
            (
                float(np.max(np.linalg.norm(tip - tip[0], axis=1)))
                for i in SLIDE.find(phases)
                if phases[i].outcome != "retry"  # it is repeated
                and len(tip := samples["p_WT"][samples["phase"] == i])
            ),
            default=0.0,
        )
        out["slide.length_m"] = gone
        if run.task.slide_m:
            out["slide.length_fraction"] = gone / abs(run.task.slide_m)
    return out | _measure_hand(samples, phases) | _judge_survey(run)


def _measure_hand(samples: Samples, phases: list[PhaseRecord]) -> dict[str, float]:
    """Return the time for which an operator pressed, and the largest force; {} without one."""
    felt = FELT.select(samples, phases)
    return measure_operated(samples[felt], compute_press(samples[felt])) if np.any(felt) else {}


def _find_place_error(run: Flown[BridgeContact, ContactPlan], deck: Surface) -> float:
    """Return the largest distance (m) of the tip from its spot, along the surface."""
    samples, phases, task = run.samples, run.phases, run.task
    holds = set((HOLD if task.dock else FREE).find(phases))
    worst = 0.0
    for spot, visit in zip(task.spots, list_visits(phases, task.dock), strict=False):
        place, R = locate_point(deck, np.array([spot.x_m, spot.y_m]))
        for i in holds.intersection(visit):
            off = (samples["p_WT"][samples["phase"] == i] - place) @ R[:, :2]
            worst = max(worst, float(np.max(np.linalg.norm(off, axis=1), initial=0.0)))
    seen = read_datum(run.setup, samples, phases) is not None  # then the map is not used
    return max(worst - (0.0 if seen else run.setup.description.plant.map_error_m), 0.0)


def _judge_survey(run: Flown[BridgeContact, ContactPlan]) -> dict[str, float]:
    """Compare the structure fitted to the recorded touches with the true one, or return {}."""
    survey = run.way.survey
    if survey is None:
        return {}
    touches, ball = read_survey(survey, run.samples, run.phases)
    if all(t.reason for t in touches):
        return {}
    mark = read_datum(run.setup, run.samples, run.phases)
    found = fit_structure(run.setup, touches, ball, mark)
    work = HOLD.select(run.samples, run.phases) | FREE.select(run.samples, run.phases)
    judged = judge_structure(run.setup, found, run.way.stations[0].place, ball)
    return (
        judged
        if mark is None
        else judged | judge_datum(run.setup, mark, run.samples, work, find_place_std(run) or 0.0)
    )


def find_place_std(run: Flown[Any, Any]) -> float | None:
    """Return the largest deviation (m), each way, of a spot's place from the datum; None without
    one."""
    mark, datum = read_datum(run.setup, run.samples, run.phases), get_datum(run.setup)
    if mark is None or datum is None:
        return None
    spots = np.array([[spot.x_m, spot.y_m] for spot in run.task.spots])
    return spread_over_structure(run.setup, datum, mark, spots)


def compute_bench_metrics(run: Flown[Any, Any]) -> dict[str, float]:
    """Return the metrics of the clamped arm's force while each step of the staircase is held."""
    return _judge_holds(run.samples, run.phases, HOLD, "force")


def _judge_holds(
    samples: Samples, phases: list[PhaseRecord], where: Where, name: str
) -> dict[str, float]:
    """Return the worst metrics of the force over all holds that nobody interrupted."""
    held = [samples["phase"] == i for i in where.find(phases)]
    each = [_judge_force(samples[h], name) for h in held if np.any(h)]
    return {key: max(one[key] for one in each) for key in each[0]} if each else {}


def _judge_force(s: Samples, name: str) -> dict[str, float]:
    force = compute_press(s)
    error = force - s["ref_force"]
    return {
        f"{name}.rms_error_n": float(np.sqrt(np.mean(error**2))),
        f"{name}.mean_error_n": abs(float(np.mean(error))),
        f"{name}.sensor_error_n": float(np.sqrt(np.mean((s["force_meas"] - force) ** 2))),
    }


def _find_wander(samples: Samples, phases: list[PhaseRecord], where: Where) -> float:
    """Return the platform's largest distance (m) from its position at a contact's first hold."""
    worst, first, held = 0.0, None, where.find(phases)
    for i, phase in enumerate(phases):
        if i in held:
            p = samples["p_WB"][samples["phase"] == i]
            if len(p):
                first = p[0] if first is None else first
                worst = max(worst, float(np.max(np.linalg.norm(p - first, axis=1))))
        if phase.name.endswith("release") or phase.is_interrupted:
            first = None
    return worst


def _find_turn(samples: Samples, phases: list[PhaseRecord], normal: Array) -> float:
    """Return the largest angle (deg) of the platform from a deck with this normal in a press."""
    s = samples[HOLD.select(samples, phases)]
    up = rotate_vectors(s["q_WB"], np.tile([0.0, 0.0, 1.0], (len(s), 1)))
    return float(np.degrees(np.max(np.arccos(np.clip(-up @ normal, -1.0, 1.0)))))


def _find_touches(samples: Samples, phases: list[PhaseRecord], normal: Array) -> Array:
    """Return the speeds (m/s) towards the deck just before each touch of the feet, if any."""
    if not has_columns(samples, "f_docking_W"):  # a robot without docking gear
        return np.zeros(0)
    docking = DOCKING.select(samples, phases)
    on = docking & (np.linalg.norm(samples["f_docking_W"], axis=1) > TOUCHING)
    starts = np.flatnonzero(on[1:] & ~on[:-1]) + 1
    out = []
    for k in starts:
        before = (samples["t"] >= samples["t"][k] - BEFORE_S) & (samples["t"] <= samples["t"][k])
        out.append(float(np.max(samples["v_WB"][before] @ -normal)))
    return np.array(out)
