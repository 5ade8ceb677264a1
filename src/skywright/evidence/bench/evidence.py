"""Studies behind the tables of the documentation, as rows: no timings, machine-independent."""

import re

import numpy as np

from skywright.description.loader import load_description
from skywright.evidence import consistency, estimators, force_estimators, loop
from skywright.evidence.bench.rows import Row, Session, build_row


def measure_consistency(session: Session) -> list[Row]:
    """Squared errors of the filter in units of its covariance (NEES), over seeds."""
    seeds = range(1, 1 + session.pick(1, 5, 20))
    traces = consistency.fly_traces("pipe-weld-scan", ["plant.sensor_noise_error=0"], seeds)
    rows = []
    for name, part in consistency.PARTS.items():
        c = consistency.compute_consistency(traces, part)
        rows.append(build_row(
            f"{_slug(name)}_nees_per_state", c.mean,
            note=f"{len(seeds)} scans; 1 is consistent, 95 % of instants between {c.low:.3f} and "
            f"{c.high:.3f} expected, {100 * c.inside:.0f} % found",
        ))  # fmt: skip
    variance, memory = consistency.compute_whiteness(traces)
    worst = variance[np.argmax(np.abs(variance - 1.0))]
    rows.append(build_row("innovation_variance", worst, note="farthest from 1 of the six"))
    rows.append(build_row("innovation_correlation", np.max(np.abs(memory)),
                          note="largest between neighbours"))  # fmt: skip
    return rows


def measure_estimators(session: Session) -> list[Row]:
    """Measure each estimator in good and degraded conditions of motion capture and link."""
    seeds = range(1, 1 + session.pick(1, 3, 10))
    conditions = list(estimators.CONDITIONS)[: session.pick(1, None, None)]
    rows = []
    for condition in conditions:
        for r in estimators.measure_all(condition, seeds):
            note = f"{condition}; requirements met by {r.met} of {r.flights}"
            start = f"{r.estimator}_{_slug(condition.split(',')[0])}"
            if r.lost == r.flights:
                rows.append(build_row(f"{start}_lost", r.lost, note=f"{note}; control lost"))
                continue
            rows.append(build_row(f"{start}_position_mm", r.position_mm, "mm", note=note))
            rows.append(build_row(f"{start}_velocity_mmps", r.velocity_mmps, "mm/s", note=note))
            rows.append(build_row(f"{start}_tip_mm", r.tip_mm, "mm", note=note))
    return rows


def measure_margins(session: Session) -> list[Row]:
    """Compute the margins of the weld scan's loops from their linear model."""
    d = load_description("pipe-weld-scan")
    m, g = loop.build_loop_model(d), loop.read_gains(d)
    rows = [build_row("least_damping", loop.compute_least_damping(m, g),
                      note="damping ratio while friction brakes the tip")]  # fmt: skip
    for x in loop.compute_margins(m, g):
        note = f"crossover {x.crossover:.1f} rad/s, largest sensitivity {x.sensitivity:.2f}"
        rows.append(build_row(f"{_slug(x.name)}_phase_margin_deg", x.phase_deg, "deg", note=note))
    return rows


def measure_force(session: Session) -> list[Row]:
    """Measure both force estimators of a compliant arm in a force loop at 2 N."""
    rows = []
    for r in force_estimators.compare():
        tare = "tare" if r.tare else "no tare"
        name = "_".join((r.estimator, r.pose, r.direction, *(["tare"] if r.tare else [])))
        note = f"{r.pose}, {r.direction}, {tare}: true mean {r.true_mean_n:.2f} N of 2 N"
        rows.append(build_row(f"{_slug(name)}_rms_error_n", r.rms_error_n, "N", note=note))
    return rows


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
