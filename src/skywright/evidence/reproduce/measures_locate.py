"""Measures of localisation: alignment, filters, outage, and the time-consistent frame.

No mission is flown: the flights are the simulated sensor recordings of `analysis/locate`.
"""

from functools import lru_cache

import numpy as np

from skywright.analysis.locate import reach
from skywright.core.arrays import Array
from skywright.evidence.reproduce.figures import Band, Bars, ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.models.localisation.drift_filter import CAMERA

SEEDS = 50
ALIGNMENT_SEEDS = 20
EXAMPLE = 1
"""Seed of the flight in the figures."""


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


@lru_cache(maxsize=1)
def _example() -> reach.Estimates:
    return reach.process(reach.fly_outage(EXAMPLE))


def measure_alignment(records: Records) -> Measured:
    """Error of the camera before and after the calibration, during its span (figure 10)."""
    raw, twelve, seven, scales = [], [], [], []
    for seed in range(1, ALIGNMENT_SEEDS + 1):
        e = reach.process(reach.fly_outage(seed))
        use = (e.events.kind == CAMERA) & (e.t < reach.CALIBRATION)
        camera = e.flight.camera.p[: int(np.count_nonzero(use))]
        raw.append(rms(np.linalg.norm(camera - e.truth[use][: len(camera)], axis=1)))
        twelve.append(rms(e.error(e.events.z_paper)[use]))
        seven.append(rms(e.error(e.events.z)[use]))
        scales.append(e.calibration.paper.scale * e.flight.errors.scale)
    e = _example()
    use = (e.events.kind == CAMERA) & (e.t < reach.CALIBRATION)
    thin = np.flatnonzero(use)[::20]
    camera = e.flight.camera.p[::20]
    camera = camera[: len(thin)]
    panel = Panel(
        "From above, as in the paper's figure 10", "x (m)", "y (m)",
        [
            Curve("truth", e.truth[thin, 0], e.truth[thin, 1], color="#222222"),
            Curve("camera, raw", camera[:, 0], camera[:, 1], color="#E69F00"),
            Curve("camera, aligned", e.events.z_paper[thin, 0], e.events.z_paper[thin, 1],
                  color="#9d4edd"),
        ], equal=True,
    )  # fmt: skip
    bars = Bars(
        "Distance from the truth, rms", "m", ["raw", "12 numbers (3)-(5)", "similarity"],
        ["camera"],
        np.array([[rms(np.array(raw))], [rms(np.array(twelve))], [rms(np.array(seven))]]),
        log_y=True,
    )  # fmt: skip
    values = {
        "ratio": rms(np.array(twelve)) / rms(np.array(raw)),
        "raw_m": rms(np.array(raw)),
        "aligned_m": rms(np.array(twelve)),
        "similarity_m": rms(np.array(seven)),
        "scale_error": rms(np.array(scales) - 1.0),
    }
    caption = f"Left: seed {EXAMPLE}. Right: {ALIGNMENT_SEEDS} flights."
    return Measured(values, ClaimFigure([panel, bars], caption))


def measure_outage(records: Records) -> Measured:
    """13 s without the station: the printed filter, the drift-aware one, the lower bound (figure
    12)."""
    o = reach.measure_outage(SEEDS)
    values = {
        "paper_cm": 100.0 * rms(o.paper),
        "aligned_cm": 100.0 * rms(o.aligned),
        "share_below": float(np.mean(o.aligned <= 0.205)),
        "fused_cm": 100.0 * rms(o.fused),
        "floor_cm": 100.0 * rms(o.floor),
        "ratio": o.ratio,
        "lasted_s": float(o.lasted.mean()),
        "path_m": float(o.path.mean()),
        "paper_after_cm": 100.0 * float(o.recovery_paper[-1]),
        "fused_after_cm": 100.0 * float(o.recovery[o.since.searchsorted(2.0)]),
        "back_s": o.recovery_time(0.01),
    }
    e = _example()
    start, back = reach.find_outage(e)
    use = np.flatnonzero((e.t > start - 15.0) & (e.events.kind == CAMERA))[::10]
    panel = Panel(
        "Error of that flight", "time (s)", "distance from the truth (cm)",
        [
            Curve("printed filter", e.t[use], 100.0 * e.error(e.paper)[use], color="#CC79A7"),
            Curve("with the camera's drift", e.t[use], 100.0 * e.error(e.fused.p)[use],
                  color="#0072B2"),
        ], limits=[(20.5, "printed: 20.5 cm")], low=0.0, bands=[Band(start, back, "#e8e8e8")],
    )  # fmt: skip
    rank = np.linspace(0.0, 100.0, len(o.paper))
    spread = Panel(
        f"When the station is back, {SEEDS} flights", "flights below (%)",
        "distance from the truth (cm)",
        [
            Curve("printed filter", rank, 100.0 * np.sort(o.paper), color="#CC79A7"),
            Curve("with the camera's drift", rank, 100.0 * np.sort(o.fused), color="#0072B2"),
            Curve("floor of the drift (rms)", rank, np.full(len(rank), 100.0 * rms(o.floor)),
                  "dashed", "#222222"),
        ], limits=[(20.5, "printed")], low=0.0,
    )  # fmt: skip
    caption = (
        f"One flight (seed {EXAMPLE}) and, last, all of them. Grey: the station is away, from "
        f"{start:.1f} s to {back:.1f} s. The paper shows its filter and the station's data."
    )
    return Measured(values, ClaimFigure([*_draw_outage(e, start, back), panel, spread], caption))


def _draw_outage(e: reach.Estimates, start: float, back: float) -> list[Panel]:
    """Draw the fused trajectory and its coordinates around the outage; figure 12 (a) and (b)."""
    use = np.flatnonzero((e.t > start - 15.0) & (e.events.kind == CAMERA))[::10]
    station = e.flight.station
    at = station.t - e.flight.station_delay
    seen = at > start - 15.0
    at, fixes = at[seen], station.p[seen]
    lines = (
        ("printed filter", e.paper, "#CC79A7"),
        ("with the camera's drift", e.fused.p, "#0072B2"),
    )
    above = Panel(
        "From above, as in figure 12 (a)", "x (m)", "y (m)",
        [
            Curve("station", fixes[:, 0], fixes[:, 1], "points", "#222222"),
            *(Curve(name, p[use, 0], p[use, 1], color=color) for name, p, color in lines),
        ], equal=True,
    )  # fmt: skip
    return [above] + [
        Panel(
            f"{axis}, as in figure 12 (b)", "time (s)", "m",
            [
                Curve("station", at, fixes[:, i], "points", "#222222"),
                *(Curve(name, e.t[use], p[use, i], color=color) for name, p, color in lines),
            ], bands=[Band(start, back, "#e8e8e8")],
        )
        for i, axis in enumerate("xyz")
    ]  # fmt: skip


def measure_rejoin(records: Records) -> Measured:
    """Recovery of the estimates after the outage."""
    o = reach.measure_outage(SEEDS)
    k = int(o.since.searchsorted(2.0))
    values = {
        "paper_ratio": float(o.recovery_paper[-1]) / rms(o.paper),
        "paper_before_cm": 100.0 * rms(o.paper),
        "paper_after_cm": 100.0 * float(o.recovery_paper[-1]),
        "fused_after_cm": 100.0 * float(o.recovery[k]),
        "weight": (200.0 / 1e-2) / (200.0 / 1e-2 + 10.0 / 5e-3),
    }
    panel = Panel(
        f"After the outage, rms of {SEEDS} flights", "time since the station is back (s)",
        "distance from the truth (cm)",
        [
            Curve("printed filter", o.since, 100.0 * o.recovery_paper, color="#CC79A7"),
            Curve("with the camera's drift", o.since, 100.0 * o.recovery, color="#0072B2"),
        ], low=0.0,
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], "Both get the same measurements."))


def measure_nominal(records: Records) -> Measured:
    """Errors with both sensors, after the calibration."""
    found = reach.measure_nominal(ALIGNMENT_SEEDS)
    late = reach.measure_nominal(ALIGNMENT_SEEDS, arrival_stamps=True)
    values = {
        "fused_mm": 1e3 * found.fused,
        "paper_mm": 1e3 * found.paper,
        "aligned_mm": 1e3 * found.aligned,
        "predicted_mm": 1e3 * found.predicted,
        "late_mm": 1e3 * late.fused,
    }
    bars = Bars(
        "Distance from the truth, rms", "mm",
        ["camera, aligned", "printed filter", "with the\ncamera's drift"],
        ["stamped when measured", "stamped on arrival"],
        1e3 * np.array([[found.aligned, late.aligned], [found.paper, late.paper],
                        [found.fused, late.fused]]), log_y=True,
    )  # fmt: skip
    caption = f"{ALIGNMENT_SEEDS} flights of 90 s at 0.5 m/s, the first 40 s calibrate."
    return Measured(values, ClaimFigure([bars], caption))


def measure_climb(records: Records) -> Measured:
    """Errors after a climb of 3 m from a calibration in a plane."""
    c = reach.measure_climb(SEEDS)
    values = {
        "affine_cm": 100.0 * rms(c.affine),
        "paper_cm": 100.0 * rms(c.paper),
        "similarity_cm": 100.0 * rms(c.similarity),
        "fused_cm": 100.0 * rms(c.fused),
        "flatness": float(c.flatness.mean()),
    }
    rank = np.linspace(0.0, 100.0, len(c.fused))
    panel = Panel(
        f"At the top, {SEEDS} flights", "flights below (%)", "distance from the truth (cm)",
        [
            Curve(name, rank, 100.0 * np.sort(v))
            for name, v in (("12 numbers (3)-(5)", c.affine), ("similarity", c.similarity),
                            ("similarity, filtered", c.fused))
        ], log_y=True,
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], "The station is out of sight during the climb."))


def measure_revisit(records: Records) -> Measured:
    """One point inspected in ten flights, with the station elsewhere each time."""
    r = reach.measure_revisit()
    size = np.linalg.norm(r.errors, axis=1)
    values = {
        "rms_mm": 1e3 * r.rms,
        "worst_mm": 1e3 * float(size.max()),
        "untested_mm": 1e3 * rms(np.linalg.norm(r.untested, axis=1)),
        "predicted_mm": 1e3 * rms(r.predicted),
        "moved": float(r.moved),
        "found": float(r.found),
        "false_alarms": float(r.false_alarms),
        "away_m": float(np.mean(np.linalg.norm(r.stations[:, :2], axis=1))),
        "flights": float(len(r.errors)),
    }
    bars = Bars(
        "The point's place in each flight", "distance from its true place (mm)",
        [f"{i + 1}" for i in range(len(size))], ["points tested", "every point believed"],
        1e3 * np.column_stack([size, np.linalg.norm(r.untested, axis=1)]),
    )  # fmt: skip
    place = Panel(
        "Where the station stood", "x (m)", "y (m)",
        [
            Curve("station", r.stations[:, 0], r.stations[:, 1], "points", "#0072B2"),
            Curve("terrain points", reach.TERRAIN[:, 0], reach.TERRAIN[:, 1], "points", "#222222"),
            Curve("inspected", reach.INSPECTED[:1], reach.INSPECTED[1:2], "points", "#D55E00"),
        ], equal=True,
    )  # fmt: skip
    caption = f"Before every third flight a terrain point has moved by {100 * reach.MOVED:.0f} cm."
    return Measured(values, ClaimFigure([bars, place], caption))
