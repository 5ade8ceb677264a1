"""Texts of a report: meaning of the numbers, outcome of the run, assumptions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skywright.core.keys import iterate_leaves
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.sourced import list_unsourced
from skywright.description.world.datum import find_seen_datum
from skywright.description.world.things import find_marker
from skywright.models.deviated_sensors import draw_noise_factors
from skywright.models.deviation import build_deviation
from skywright.models.nominal import Nominal
from skywright.reports.summary import (
    describe_inertial,
    describe_link,
    describe_localisation,
    describe_wind,
)
from skywright.run.kind import load_kind
from skywright.run.names import list_measures
from skywright.run.parts import build_named, get_law, uses_truth
from skywright.run.where import find_where
from skywright.vehicle.targets import list_tracked

if TYPE_CHECKING:
    from skywright.core.spec import Spec
    from skywright.description.loader import Description
    from skywright.run.result import RunResult


class Row(NamedTuple):
    """A row of a table: name, value, remark."""

    name: str
    value: str
    note: str = ""
    where: str = ""


def format_value(value: Any) -> str:
    """Format a number with three significant digits; a missing one is a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    if abs(value) >= 1000 or float(value).is_integer():
        return f"{value:.0f}"
    return f"{value:.3g}"


def _ending(reason: str) -> str:
    return reason if reason.startswith("interrupted") else f"interrupted: {reason}"


def describe_outcome(result: RunResult) -> str:
    """Return one sentence: what was flown, and how the run ended."""
    failed = [r for r in result.requirements if not r.passed]
    total = len(result.requirements)
    if result.outcome == "aborted":
        return f"The mission was aborted: {result.reason or 'no reason was recorded'}."
    if result.outcome == "interrupted":
        return f"The run was {_ending(result.reason)}."
    if result.outcome == "diverged":
        return f"The simulation failed: {result.reason}."
    did = load_kind(result.description.mission.kind).figures().describe(result)
    if not total:
        return f"{did}. The mission sets no requirement."
    if failed:
        verb = "requirement" if total == 1 else "requirements"
        names = ", ".join(r.name for r in failed)
        return f"{did}. {len(failed)} of {total} {verb} failed: {names}."
    which = {1: "The requirement was", 2: "Both requirements were"}
    return f"{did}. {which.get(total, f'All {total} requirements were')} met."


def list_metrics(result: RunResult) -> list[Row]:
    """Return all metrics with unit and meaning, including those of requirements."""
    rows, where = [], load_kind(result.description.mission.kind).where
    measures = list_measures(result.description.mission.kind)
    for name, value in sorted(result.metrics.items()):
        unit, meaning = measures.get(name, ("", ""))
        here = find_where(name, where).text
        rows.append(Row(name, f"{format_value(value)} {unit}".strip(), meaning, here))
    return rows


def list_assumptions(result: RunResult) -> list[Row]:
    """Return every assumed number of this run with its plausible range and note."""
    d = result.description
    rows = []
    for root, spec in d.roots.items():
        for key, value in iterate_leaves(spec, root):
            source = d.sources.get(key)
            if source is None or source.kind != "assumed":
                continue
            note = source.note
            if source.range is not None:
                low, high = source.range
                note = f"plausible {low:g} to {high:g}" + (f"; {note}" if note else "")
            rows.append(Row(key, _text(value), note))
    return rows


def count_unsourced(result: RunResult) -> int:
    """Return the number of values of this run without a source."""
    d = result.description
    return len(list_unsourced(d.robot, d.sources)) + sum(
        key not in d.sources
        for root, spec in d.roots.items()
        if root != "robot"
        for key, value in iterate_leaves(spec, root)
        if isinstance(value, int | float) and not isinstance(value, bool)
    )


def list_changes(result: RunResult) -> list[Row]:
    """Return values set on the command line, or by the mission for its robot or world."""
    d = result.description
    home = d.origin.get("mission.name", "")
    rows = []
    for root, spec in d.roots.items():
        for key, value in iterate_leaves(spec, root):
            origin = d.origin.get(key)
            if origin == "--set":
                rows.append(Row(key, _text(value), "set on the command line"))
            elif origin == home and root != "mission" and not d.mission.resolved:
                rows.append(Row(key, _text(value), "set by the mission"))
    return rows


def list_plant(result: RunResult) -> list[Row]:
    """Return the deviations of the plant from the nominal model."""
    d = result.description
    mapped = d.world.pipe is not None or d.world.structure is not None
    rows = [
        Row(key, _text(value))
        for key, value in iterate_leaves(d.plant, "plant")
        if mapped or not key.startswith("plant.map_")
    ]
    drawn = build_deviation(d.plant, d.robot, d.mission.seed)
    factors = {"rotor gains drawn": drawn.rotor_gain}
    if any(limb.link.flex_stiffness_nm_per_rad for limb in list_joints(d.robot)):
        factors["stiffness of the joints' springs drawn"] = drawn.spring_factor
    if d.robot.probe is not None:
        factors["stiffness of the probe's spring drawn"] = np.array([drawn.probe_spring_factor])
    for sensor, table in _list_sensors(d).items():
        drawn_noise = draw_noise_factors(table, sensor, d.plant.sensor_noise_error, d.mission.seed)
        if drawn_noise:
            factors[f"noise of {sensor} drawn"] = np.array(list(drawn_noise.values()))
    for name, values in factors.items():
        rows.append(
            Row(name, ", ".join(f"{x:.3f}" for x in values), "of this seed, over the file's")
        )
    return rows


def _list_sensors(d: Description[Any]) -> dict[str, Spec]:
    """Return the tables of the run's sensors by the names of their components."""
    r, w = d.robot, d.world
    tables: dict[str, Spec | None] = {"inertial": r.sensors, "probe force": r.force_sensor}
    if w.localisation == "mocap":
        tables["mocap"] = w.mocap
        tables |= {f"tracked {name}": w.mocap for name in list_tracked(r, w)}
    elif w.localisation == "gnss":
        tables["gnss"] = w.gnss.fill()
    else:
        tables["total station"] = w.total_station
        tables |= {"tracking camera": r.tracking_camera, "range finder": r.range_finder}
    if find_marker(w.things):
        tables["camera"] = r.camera
    if r.probe is not None and find_seen_datum(r, w):
        tables["datum camera"] = r.probe.camera
    tables |= {c.name: c.table for c in build_named(d) if c.group == "sensor"}
    return {name: table for name, table in tables.items() if table is not None}


def list_conditions(result: RunResult) -> list[Row]:
    """Return the conditions of the run: law, estimator, bandwidths, sensors, link, wind, seed."""
    d = result.description
    c, m, w = d.robot.control, d.mission, d.world
    rows = [
        Row("control law", get_law(d, Nominal(d.robot, d.world)).kind),
        Row(
            "springs",
            "calibrated with known loads" if m.calibrate_springs else "the robot file's",
        ),
        Row("estimator", "the simulator's truth" if uses_truth(d) else m.estimator.kind),
        Row(
            "position bandwidth",
            f"{c.position_bandwidth_rad_s:g} rad/s",
            f"damping {c.position_damping:g}, integral {c.position_integral_rad_s:g} rad/s",
        ),
        Row(
            "attitude bandwidth",
            f"{c.attitude_bandwidth_rad_s:g} rad/s",
            f"damping {c.attitude_damping:g}, integral {c.attitude_integral_rad_s:g} rad/s",
        ),
        Row("arm bandwidth", f"{c.arm_bandwidth_rad_s:g} rad/s"),
        Row("observer bandwidth", f"{c.observer_bandwidth_rad_s:g} rad/s"),
        Row("control rate", f"{c.rate_hz:g} Hz"),
        *(Row(*line) for line in describe_inertial(d.robot.sensors)),
        Row(*describe_localisation(w)),
        Row("link", *describe_link(w.link)),
        Row("wind", *describe_wind(w.wind)),
        Row("way of running", m.mode),
        Row("seed", str(m.seed)),
    ]
    arm = d.robot.arm is not None and c.arm_bandwidth_rad_s > 0.0  # servos have none
    return [r for r in rows if arm or r.name != "arm bandwidth"]


def list_timing(result: RunResult) -> list[Row]:
    """Return planning and timing values, as far as they are known."""
    t, plan = result.timing, result.plan
    rows = [
        Row("planning time", f"{plan.plan_s:.2f} s"),
        Row("planned duration", f"{plan.duration_s:.1f} s", "without take-off, waits and landing"),
        Row("estimated duration", f"{plan.flight_s:.1f} s", "of the whole flight"),
    ]
    if math.isfinite(plan.min_clearance_m):
        rows.append(Row("smallest planned clearance", f"{format_value(plan.min_clearance_m)} m"))
    if math.isfinite(plan.min_rotor_margin):
        rows.append(Row("smallest planned rotor margin", f"{100 * plan.min_rotor_margin:.0f} %",
                        "of the usable thrust range"))  # fmt: skip
    m = plan.metrics
    if {"plan.cost", "plan.lower_bound", "plan.first_solution_s"} <= set(m):
        least, first = format_value(m["plan.lower_bound"]), 1e3 * m["plan.first_solution_s"]
        note = f"lower bound of the cost: {least}; first path after {first:.1f} ms"
        rows.append(Row("cost of the path", format_value(m["plan.cost"]), note))
    for key, name, unit in (
        ("simulated_s", "simulated time", "s"),
        ("wall_s", "computing time without this report", "s"),
        ("real_time_factor", "real-time factor", "x"),
    ):
        if key in t:
            rows.append(Row(name, f"{format_value(t[key])} {unit}"))
    return rows


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_text(v) for v in value)
    return format_value(value)
