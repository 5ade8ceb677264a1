"""Metrics of the kind "flight-modes": tracking errors and drift of each mode."""

import math

import numpy as np

from skywright.core.arrays import Array, Samples
from skywright.missions.flight_modes.plan import ModesPlan
from skywright.missions.flight_modes.task import ModesTask
from skywright.models.drawing import rotate_vectors
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.where import Where

MEASURES: Measures = {
    "modes.tilt_deg": ("deg", "smallest tilt held in a hold that also holds the position"),
    "modes.tilt_held": ("", "`modes.tilt_deg` divided by the required tilt"),
    "modes.tilt_fraction": ("", "required tilt divided by the computed hover limit"),
    "modes.position_error_mm": ("mm", "largest position error while tilting"),
    "modes.translate_tilt_deg": ("deg", "largest tilt during the translation"),
    "modes.track_error_mm": ("mm", "largest distance from the path during the translation"),
    "modes.standard_coupling": (
        "",
        "horizontal acceleration divided by g times tilt, in standard stabilisation",
    ),
    "modes.angle_coupling": (
        "",
        "horizontal acceleration divided by g times tilt, in command angle",
    ),
    "modes.standard_drift_m": ("m", "drift in standard stabilisation"),
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""

HOLD, ANGLE = Where(("hold angle",)), Where(("command angle", "hold angle"))
MOVE, STANDARD = Where(("command position",)), Where(("standard stabilisation",))
WHERE = {
    "modes.tilt": HOLD,
    "modes.tilt_fraction": Where(note="the request, against the capability analysis"),
    "modes.position_error_mm": ANGLE,
    "modes.angle_coupling": ANGLE,
    "modes.translate_tilt_deg": MOVE,
    "modes.track_error_mm": MOVE,
    "modes.standard": STANDARD,
}


def compute_tilt(samples: Samples) -> Array:
    """Return the angle (n,) rad between the platform's axis and the vertical."""
    up = rotate_vectors(samples["q_WB"], np.tile([0.0, 0.0, 1.0], (len(samples), 1)))[:, 2]
    return np.asarray(np.arccos(np.clip(up, -1.0, 1.0)))


def compute_coupling(samples: Samples, gravity: float) -> float:
    """Return the horizontal acceleration over g times the tilt: 1 for a coplanar robot, 0 for none.

    Least squares over the samples; NaN without tilt.
    """
    up = rotate_vectors(samples["q_WB"], np.tile([0.0, 0.0, 1.0], (len(samples), 1)))[:, :2]
    t = samples["t"]
    a = np.gradient(np.gradient(samples["p_WB"][:, :2], t, axis=0), t, axis=0)
    tilts = gravity * up
    return float(np.sum(a * tilts) / np.sum(tilts * tilts))


def compute_metrics(run: Flown[ModesTask, ModesPlan]) -> dict[str, float]:
    """Evaluate each mode that was flown."""
    samples, phases, way = run.samples, run.phases, run.way
    gravity = run.setup.description.world.gravity_mps2
    out = {"modes.tilt_fraction": way.due / way.limit}
    tilt = compute_tilt(samples)
    off = np.linalg.norm(samples["p_WB"] - samples["ref_p_WB"], axis=1)
    held = HOLD.find(phases)
    if held:
        mean = [float(np.mean(tilt[samples["phase"] == i])) for i in held]
        out["modes.tilt_deg"] = math.degrees(min(mean))
        out["modes.tilt_held"] = min(mean) / way.due
        angle = ANGLE.select(samples, phases)
        out["modes.position_error_mm"] = 1e3 * float(np.max(off[angle]))
        out["modes.angle_coupling"] = compute_coupling(samples[angle], gravity)
    move = MOVE.select(samples, phases)
    if np.any(move):
        out["modes.translate_tilt_deg"] = math.degrees(float(np.max(tilt[move])))
        out["modes.track_error_mm"] = 1e3 * float(np.max(off[move]))
    free = STANDARD.select(samples, phases)
    if np.any(free):
        level = samples["p_WB"][free, :2]
        out["modes.standard_coupling"] = compute_coupling(samples[free], gravity)
        out["modes.standard_drift_m"] = float(np.max(np.linalg.norm(level - level[0], axis=1)))
    return out
