"""Measures on the bridge's missions: sensor, bench, flight modes, inspection, localisation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError
from skywright.models.drawing import rotate_vectors
from skywright.models.force_sensor import build_force_sensor, compute_count, compute_force
from skywright.reports.figures.claims import Bars, ClaimFigure, Curve, Panel
from skywright.robots.loader import load_robot
from skywright.studies.reproduce.cache import Record
from skywright.studies.reproduce.measured import Measured, Records
from skywright.studies.reproduce.series import cut

Array = NDArray[np.float64]

THIN = 10  # of the samples, in figures


def _worst(records: list[Record], name: str) -> float:
    """Largest value of a metric over flights; InputError where one did not get that far."""
    found = [r.info["metrics"].get(name) for r in records]
    if any(value is None for value in found):
        reason = next(r.info["reason"] for r in records if name not in r.info["metrics"])
        raise InputError(f"a flight has no {name}: {reason or 'not reached'}")
    return float(max(found))


def _press(a: dict[str, NDArray[Any]]) -> Array:
    """True force (n,) N of the tip along the probe."""
    axis = rotate_vectors(a["q_WT"], np.tile([0.0, 0.0, 1.0], (len(a["t"]), 1)))
    return np.asarray(-np.sum(a["f_contact"] * axis, axis=1))


def _tilt_deg(q_WB: Array) -> Array:
    """Tilt (n,) deg from level of attitudes (n, 4) wxyz."""
    up = rotate_vectors(q_WB, np.tile([0.0, 0.0, 1.0], (len(q_WB), 1)))[:, 2]
    return np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))


def _track(a: dict[str, NDArray[Any]], name: str, values: Array, wanted: Array) -> Panel:
    """A panel of what was flown and what was asked for."""
    t = a["t"][::THIN]
    curves = [Curve("flown", t, values[::THIN]), Curve("reference", t, wanted[::THIN], "dashed")]
    return Panel(name, "time (s)", name.rpartition(",")[2].strip() or name, curves)


def measure_sensor_calibration(records: Records) -> Measured:
    """The two slopes of Table 3: where they meet, and what a count resolves; figure 7."""
    spec = load_robot("f550-bridge")[0].force_sensor
    assert spec is not None
    sensor = build_force_sensor(spec)[0]
    counts = np.arange(0.0, 4096.0)
    force = np.array([compute_force(sensor, c) for c in counts])
    limit = spec.limit_count
    step = abs(force[limit] - force[limit - 1])
    back = np.array([compute_count(sensor, f) for f in force[force > 0.0]])
    panel = Panel(
        "Force by the sensor's count, as in figure 7", "count", "force (N)",
        [Curve("Table 3", counts[::8], force[::8])], low=0.0,
    )  # fmt: skip
    values = {
        "jump_n": float(step), "soft_mn": 1e3 * abs(spec.soft_slope_n_per_count),
        "hard_mn": 1e3 * abs(spec.hard_slope_n_per_count), "largest_n": float(force.max()),
        "back_counts": float(np.max(np.abs(back - counts[force > 0.0]))),
    }  # fmt: skip
    return Measured(values, ClaimFigure([panel], "Two straight pieces over a 12-bit converter."))


def measure_bench(records: Records) -> Measured:
    """Force staircase on the test bench; figure 18."""
    flown = records["bench"]
    a = cut(flown[0], *{p["name"] for p in flown[0].info["phases"]})
    t = a["t"][::THIN]
    angles = np.degrees(a["q"])[::THIN]
    joints = Panel(
        "Joints, as in figure 18", "time (s)", "angle (deg)",
        [Curve("shoulder", t, angles[:, 0]), Curve("elbow", t, angles[:, 1])],
    )  # fmt: skip
    asked = np.where(a["pressing"] > 0.5, a["ref_force"], 0.0)
    force = Panel(
        "Force on the vertical surface", "time (s)", "force (N)",
        [
            Curve("measured", t, a["force_meas"][::THIN]), Curve("true", t, _press(a)[::THIN]),
            Curve("asked for", t, asked[::THIN], "dashed"),
        ],
    )  # fmt: skip
    values = {
        "rms_n": _worst(flown, "force.rms_error_n"),
        "mean_n": _worst(flown, "force.mean_error_n"),
        "sensor_n": _worst(flown, "force.sensor_error_n"),
    }
    return Measured(values, ClaimFigure([joints, force], "The arm clamped before a plate."))


def measure_modes(records: Records) -> Measured:
    """Tilting in place and moving level; figure 20."""
    flown = records["flight"]
    a = cut(flown[0], *{p["name"] for p in flown[0].info["phases"]})
    off = 1e3 * np.linalg.norm(a["p_WB"] - a["ref_p_WB"], axis=1)
    asked = _tilt_deg(a["ref_q_WB"])
    panels = [
        _track(a, "Position x (m)", a["p_WB"][:, 0], a["ref_p_WB"][:, 0]),
        _track(a, "Position y (m)", a["p_WB"][:, 1], a["ref_p_WB"][:, 1]),
        _track(a, "Tilt, deg", _tilt_deg(a["q_WB"]), asked),
        Panel("Distance from the reference", "time (s)", "mm",
              [Curve("flown", a["t"][::THIN], off[::THIN])]),
    ]  # fmt: skip
    least = min(r.info["metrics"].get("modes.tilt_deg", math.nan) for r in flown)
    exact = records["exact"][0].info["metrics"]
    values = {
        "tilt_deg": float(least),
        "asked_deg": float(np.max(asked)),
        "exact_deg": exact.get("modes.tilt_deg", math.nan),
        "exact_mm": exact.get("modes.position_error_mm", math.nan),
        "off_mm": _worst(flown, "modes.position_error_mm"),
        "level_deg": _worst(flown, "modes.translate_tilt_deg"),
        "drift_m": _worst(flown, "modes.standard_drift_m"),
    }
    caption = "Standard stabilisation, command position and command angle, one after the other."
    return Measured(values, ClaimFigure(panels, caption))


def measure_inspection(records: Records) -> Measured:
    """How X, Y, Z and the force follow what is commanded; figure 23."""
    flown = [*records["level"], *records["sloped"]]
    a = cut(flown[0], *{p["name"] for p in flown[0].info["phases"]})
    panels = [
        _track(a, f"Position {n} (m)", a["p_WB"][:, i], a["ref_p_WB"][:, i])
        for i, n in enumerate("xyz")
    ]
    t = a["t"][::THIN]
    asked = np.where(a["pressing"] > 0.5, a["ref_force"], 0.0)
    panels.append(
        Panel("Force (N)", "time (s)", "N",
              [Curve("true", t, _press(a)[::THIN]), Curve("asked for", t, asked[::THIN], "dashed")])
    )  # fmt: skip
    docked = [_worst(flown, f"force.{n}_error_n") for n in ("rms", "mean")]
    free = [_worst(records["level"], f"free.{n}_error_n") for n in ("rms", "mean")]
    values = {
        "wander_mm": _worst(flown, "dock.wander_mm"), "rms_n": docked[0], "mean_n": docked[1],
        "touch_mps": _worst(flown, "dock.touch_speed_mps"),
        "free_rms_n": free[0], "free_wander_mm": _worst(records["level"], "free.wander_mm"),
        "flights": float(len(flown)),
        "failed": float(sum(r.info["outcome"] != "succeeded" for r in flown)),
    }  # fmt: skip
    caption = "Level and calm; then without the help of the gear."
    return Measured(values, ClaimFigure(panels, caption))


def measure_gear(records: Records) -> Measured:
    """The same forces docked and in flight."""
    flown = records["level"]
    force = np.array([
        [_worst(flown, f"{how}.rms_error_n") for how in ("force", "free")],
    ])  # fmt: skip
    moved = np.array([[_worst(flown, "dock.wander_mm"), _worst(flown, "free.wander_mm")]])
    how = ["docked", "in flight"]
    bars = [
        Bars("Error of the force, rms", "N", [""], how, force),
        Bars("How far the platform moved", "mm", [""], how, moved),
    ]
    values = {
        "dock_mm": float(moved[0, 0]), "free_mm": float(moved[0, 1]),
        "dock_n": float(force[0, 0]), "free_n": float(force[0, 1]),
        "ratio": float(moved[0, 0] / moved[0, 1]),
    }  # fmt: skip
    return Measured(values, ClaimFigure(bars, "Worst of the flights."))


def measure_flight_localisation(records: Records) -> Measured:
    """Error of the estimate that the flights were controlled with."""
    flown = [*records["level"], *records["hidden"]]
    panels = []
    for name, role in (("station in sight but behind a pillar", "level"),
                       ("station hidden while docked", "hidden")):  # fmt: skip
        a = cut(records[role][0], *{p["name"] for p in records[role][0].info["phases"]})
        up = a["t"] > 3.0
        off = 1e3 * np.linalg.norm(a["est_p_WB"] - a["p_WB"], axis=1)[up][::THIN]
        t, std = a["t"][up][::THIN], 1e3 * a["pose_std"][up][::THIN]
        panels.append(
            Panel(f"Error of the position, {name}", "time (s)", "mm",
                  [Curve("error", t, off), Curve("stated, 1 sigma an axis", t, std, "dashed")])
        )  # fmt: skip
    values = {
        "rms_mm": _worst(records["level"], "estimate.position_rms_mm"),
        "outage_mm": _worst(records["level"], "estimate.outage_max_mm"),
        "hidden_mm": _worst(records["hidden"], "estimate.position_max_mm"),
        "hidden_s": _worst(records["hidden"], "estimate.outage_s"),
        "sigmas": _worst(flown, "estimate.sigmas"),
        "failed": float(sum(r.info["outcome"] != "succeeded" for r in flown)),
    }
    caption = "Total station, tracking camera, range finder and inertial unit feed the controller."
    return Measured(values, ClaimFigure(panels, caption))
