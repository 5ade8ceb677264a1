"""Metrics of the kind "thickness-survey": the gauge's readings against the true wall."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np

from skywright.core.arrays import Array
from skywright.inspection.thickness import GaugeCheck, Reading
from skywright.missions.bridge_contact.metrics import compute_metrics as judge_contact
from skywright.missions.bridge_contact.visits import is_left_out, list_visits
from skywright.missions.skills.datum import DATUM_WHERE, read_datum
from skywright.missions.skills.surveyed import SURVEY_WHERE
from skywright.missions.skills.surveyed_structure import STRUCTURE_MEASURES
from skywright.missions.thickness_survey.gauge import build_gauge, check, find_probe
from skywright.missions.thickness_survey.plan import ThicknessWay
from skywright.missions.thickness_survey.task import ThicknessSurvey
from skywright.models.things.wall import build_wall_field, compute_wall
from skywright.models.ultrasonic import build_face, find_tilt_null
from skywright.recordings.columns import has_columns
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.where import WHOLE, Where
from skywright.vehicle.sensors.ultrasonic import find_wall, rebuild_ascans

SKIP = 0.25e-3
"""m, error from which a reading counts as a skipped cycle or a doubling."""

MEASURES: Measures = {
    "thickness.spots": ("", "number of requested spots"),
    "thickness.accepted_fraction": ("", "fraction of the spots with an accepted reading"),
    "thickness.error_p95_mm": (
        "mm",
        "error of the accepted readings against the true wall that 95 % do not exceed",
    ),
    "thickness.bias_mm": ("mm", "size of the mean error of the accepted readings"),
    "thickness.mean_error_mm": (
        "mm",
        "mean error of the accepted readings with its sign; its mean over a campaign is the bias "
        "of the method",
    ),
    "thickness.u95_covers_fraction": (
        "",
        "fraction of the accepted readings whose stated 95 % interval contains the true wall",
    ),
    "thickness.u95_max_mm": ("mm", "largest stated half width of an accepted reading"),
    "thickness.false_accepts": (
        "",
        "number of accepted readings with air under the probe or a tilt beyond its null",
    ),
    "thickness.skips": (
        "",
        "number of accepted readings that are wrong by more than 0.25 mm: a skipped cycle, or the "
        "second echo",
    ),
    "thickness.touches": ("", "number of touches with the probe, repeated ones included"),
    "thickness.block_error_mm": (
        "mm",
        "largest error of the gauge on its block's steps after the flight",
    ),
    "press.place_error_mm": (
        "mm",
        "largest distance of the tip from its spot along the surface, less the bound of the map's "
        "error unless a datum was seen",
    ),
    **STRUCTURE_MEASURES,
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""
HELD = Where(("hold *", "free hold *"))
WHERE = {
    **SURVEY_WHERE,
    **DATUM_WHERE,
    "thickness.": HELD,
    "thickness.spots": WHOLE,
    "thickness.block_error_mm": Where(note="on the reference block, after the flight"),
    "press.": HELD,
}


class SpotReading(NamedTuple):
    """Reading of one touch of a spot."""

    spot: str
    u: float  # m, place on the true surface
    v: float
    reading: Reading  # the last one of the touch
    true: float  # m, wall under the probe
    false: bool  # air under the probe, or tilted beyond its null
    ascan: Array  # (n,) FSH


def find_readings(run: Flown[ThicknessSurvey, ThicknessWay]) -> list[SpotReading]:
    """Process the recorded A-scans of each touch as the flight did.

    A touch that a pilot or an order interrupted has no reading.
    """
    if not has_columns(run.samples, "ut_scan"):
        return []
    d, task = run.setup.description, run.task
    probe = find_probe(run.setup)
    world = d.true_world
    gauge = build_gauge(task.procedure, run.way.gauge)
    t, scans, states = rebuild_ascans(run.samples, probe.true, world, d.mission.seed)
    field = build_wall_field(find_wall(world, probe.name)[0])
    transducer = probe.true.build_transducer()
    face = build_face(transducer.radius)
    names = list_spot_names(task)
    held = HELD.find(run.phases)
    out, at, tries = list[SpotReading](), 0, 0
    for visit in list_visits(run.phases, task.dock):
        accepted = False
        for i in sorted(set(visit).intersection(held)):
            phase = run.phases[i]
            if phase.is_interrupted:
                continue
            mine = np.flatnonzero((t > phase.start_s) & (t < phase.end_s))
            gauge.restart()
            read = gauge.add(t[mine], scans[mine]) if mine.size else []
            accepted = any(r.accepted for r in read)
            if read:
                k = next((j for j, r in enumerate(read) if r.accepted), len(read) - 1)
                _, _, share, tilt, u, v = states[mine[k]].tolist()
                true = float(np.mean(compute_wall(field, u + face[:, 0], v + face[:, 1])[0]))
                false = share == 0.0 or tilt >= find_tilt_null(transducer)
                out.append(SpotReading(
                    names[min(at, len(names) - 1)], u, v, read[k], true, false, scans[mine[k]]
                ))  # fmt: skip
        tries += 1
        if accepted or tries == task.tries or is_left_out([run.phases[i] for i in visit]):
            at, tries = at + 1, 0
            gauge.leave_site()
    return out


def find_check(run: Flown[ThicknessSurvey, ThicknessWay]) -> GaugeCheck:
    """Check the gauge on the block after the flight."""
    return check(run.setup, find_probe(run.setup), run.task.procedure, run.way.gauge)


def list_spot_names(task: ThicknessSurvey) -> list[str]:
    """Return the names of the spots; those without one are numbered."""
    return [s.name or f"spot {i + 1}" for i, s in enumerate(task.spots)]


def compute_metrics(run: Flown[ThicknessSurvey, ThicknessWay]) -> dict[str, float]:
    """Evaluate the readings; phases that were not reached yield no metric."""
    pressed: Any = Flown(
        cast(Any, run.setup), run.plan._replace(way=cast(Any, run.way.contact)), run.samples,
        run.phases,
    )  # fmt: skip
    contact: dict[str, float] = judge_contact(pressed)
    own = ("press.", "thickness.")
    out = {k: v for k, v in contact.items() if k in MEASURES and not k.startswith(own)}
    out["thickness.spots"] = float(len(run.task.spots))
    if not HELD.find(run.phases):
        return out
    found = run.once(find_readings)
    out["thickness.touches"] = float(len(HELD.find(run.phases)))
    if found:
        out["press.place_error_mm"] = 1e3 * _find_place_error(run, found)
    out["thickness.block_error_mm"] = 1e3 * float(np.max(np.abs(find_check(run).errors)))
    return out | judge_readings(found, len(run.task.spots))


def judge_readings(found: list[SpotReading], spots: int) -> dict[str, float]:
    """Compare the accepted readings with the true wall; without readings there are no errors."""
    good = [r for r in found if r.reading.accepted]
    out = {
        "thickness.accepted_fraction": len({r.spot for r in good}) / spots,
        "thickness.false_accepts": float(sum(r.false for r in good)),
    }
    if good:
        error = np.array([r.reading.thickness - r.true for r in good])
        u95 = np.array([r.reading.u95 for r in good])
        out["thickness.error_p95_mm"] = 1e3 * float(np.quantile(np.abs(error), 0.95))
        out["thickness.mean_error_mm"] = 1e3 * float(np.mean(error))
        out["thickness.bias_mm"] = abs(out["thickness.mean_error_mm"])
        out["thickness.u95_covers_fraction"] = float(np.mean(np.abs(error) <= u95))
        out["thickness.u95_max_mm"] = 1e3 * float(np.max(u95))
        out["thickness.skips"] = float(np.sum(np.abs(error) > SKIP))
    return out


def _find_place_error(run: Flown[ThicknessSurvey, ThicknessWay], found: list[SpotReading]) -> float:
    """Return the largest distance (m) of the probe from its spot, less the error of the map."""
    spots = dict(zip(list_spot_names(run.task), run.task.spots, strict=True))
    off = [math.hypot(r.u - spots[r.spot].x_m, r.v - spots[r.spot].y_m) for r in found]
    seen = read_datum(run.setup, run.samples, run.phases) is not None  # then the map is not used
    return max(max(off) - (0.0 if seen else run.setup.description.plant.map_error_m), 0.0)


def describe_readings(run: Flown[ThicknessSurvey, ThicknessWay]) -> dict[str, Any]:
    """Return readings, procedure and checks as plain numbers."""
    if not HELD.find(run.phases):
        return {}
    last = run.once(find_check)

    def tell(x: float) -> float | None:
        return round(1e3 * x, 4) if math.isfinite(x) else None

    return {
        "procedure": run.task.procedure.model_dump(),
        "block_after": {"errors_mm": [tell(e) for e in last.errors], "reasons": list(last.reasons)},
        "readings": [
            {
                "spot": r.spot, "t_s": round(r.reading.t, 3), "u_m": round(r.u, 4),
                "v_m": round(r.v, 4), "thickness_mm": tell(r.reading.thickness),
                "u95_mm": tell(r.reading.u95), "height_fsh": round(r.reading.height, 3),
                "snr_db": round(r.reading.snr_db, 1), "accepted": r.reading.accepted,
                "reason": r.reading.reason,
            }
            for r in run.once(find_readings)
        ],
    }  # fmt: skip
