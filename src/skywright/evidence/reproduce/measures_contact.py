"""Measures of the bridge missions: sensor, bench, flight modes, inspection, localisation."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.description.robot.loader import load_robot
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import (
    Band,
    Bars,
    Block,
    Blocks,
    ClaimFigure,
    Curve,
    Panel,
)
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.series import cut, read_metric
from skywright.missions.flight_modes.figures import MODES
from skywright.models.drawing import rotate_vectors
from skywright.models.force_sensor import build_force_sensor, compute_count, compute_force

THIN = 10  # decimation of samples in figures
SATURATED = "flight.saturated_max_s"


def _count_failed(records: list[Record]) -> float:
    """Return the number of flights that failed a requirement or were not completed."""
    return float(sum(r.info["outcome"] != "succeeded" for r in records))


def _worst(records: list[Record], name: str) -> float:
    """Return the largest value of a metric over flights. Raises InputError if a flight lacks it."""
    return max(read_metric(records, name))


def _press(a: dict[str, NDArray[Any]]) -> Array:
    """Return the true force (n,) N of the tip along the probe."""
    axis = rotate_vectors(a["q_WT"], np.tile([0.0, 0.0, 1.0], (len(a["t"]), 1)))
    return np.asarray(-np.sum(a["f_contact"] * axis, axis=1))


def _tilt_deg(q_WB: Array) -> Array:
    """Return the tilt (n,) deg from level of attitudes (n, 4) wxyz."""
    up = rotate_vectors(q_WB, np.tile([0.0, 0.0, 1.0], (len(q_WB), 1)))[:, 2]
    return np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))


def _track(
    a: dict[str, NDArray[Any]], title: str, unit: str, values: Array, wanted: Array,
    bands: list[Band],
) -> Panel:  # fmt: skip
    """Build a panel of flown and reference values."""
    t = a["t"][::THIN]
    curves = [Curve("flown", t, values[::THIN]), Curve("reference", t, wanted[::THIN], "dashed")]
    return Panel(title, "time (s)", unit, curves, bands=bands)


def _colour(record: Record, colors: dict[str, str]) -> list[Band]:
    """Return coloured bands of the phases whose names begin with a key of `colors`."""
    return [
        Band(p["start_s"], p["end_s"], color)
        for p in record.info["phases"]
        for name, color in colors.items()
        if p["name"].startswith(name)
    ]


def measure_sensor_calibration(records: Records) -> Measured:
    """The two slopes of Table 3: jump between them, and resolution of a count; figure 7."""
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
        [
            Curve("shoulder, gamma 1", t, angles[:, 0] + 90.0),
            Curve("elbow, gamma 2", t, -angles[:, 1]),
        ],
    )  # fmt: skip
    asked = np.where(a["pressing"] > 0.5, a["ref_force"], 0.0)
    force = Panel(
        "Force on the vertical surface", "time (s)", "force (N)",
        [
            Curve("measured", t, a["force_meas"][::THIN]), Curve("true", t, _press(a)[::THIN]),
            Curve("asked for", t, asked[::THIN], "dashed"),
        ],
    )  # fmt: skip
    held = [cut(r, next(p["name"] for p in r.info["phases"][::-1] if p["name"].startswith("hold")))
            for r in flown]  # fmt: skip
    touched = cut(flown[0], "touch")["p_WT"][-1]
    values = {
        "last_n": min(float(np.mean(s["force_meas"])) for s in held),
        "slid_mm": 1e3 * float(np.linalg.norm(held[0]["p_WT"][-1] - touched)),
        "rms_n": _worst(flown, "force.rms_error_n"),
        "mean_n": _worst(flown, "force.mean_error_n"),
        "sensor_n": _worst(flown, "force.sensor_error_n"),
        "slippery_n": _worst(records["slippery"], "force.rms_error_n"),
        "rough_n": _worst(records["rough"], "force.rms_error_n"),
    }
    return Measured(
        values, ClaimFigure([joints, force], "Clamped before a plate; the paper's angles.")
    )


def measure_modes(records: Records) -> Measured:
    """Tilting in place and level translation; figure 20."""
    flown = records["flight"]
    a = cut(flown[0], *{p["name"] for p in flown[0].info["phases"]})
    off = 1e3 * np.linalg.norm(a["p_WB"] - a["ref_p_WB"], axis=1)
    asked = _tilt_deg(a["ref_q_WB"])
    bands = _colour(flown[0], MODES)
    panels = [
        _track(a, "Position x, as in figure 20", "m", a["p_WB"][:, 0], a["ref_p_WB"][:, 0], bands),
        _track(a, "Position y", "m", a["p_WB"][:, 1], a["ref_p_WB"][:, 1], bands),
        _track(a, "Tilt", "deg", _tilt_deg(a["q_WB"]), asked, bands),
        Panel("Distance from the reference", "time (s)", "mm",
              [Curve("flown", a["t"][::THIN], off[::THIN])], bands=bands),
    ]  # fmt: skip
    exact = records["exact"][0].info["metrics"]
    values = {
        "tilt_deg": min(read_metric(flown, "modes.tilt_deg")),
        "asked_deg": float(np.max(asked)),
        "exact_deg": exact.get("modes.tilt_deg", math.nan),
        "exact_mm": exact.get("modes.position_error_mm", math.nan),
        "off_mm": _worst(flown, "modes.position_error_mm"),
        "level_deg": _worst(flown, "modes.translate_tilt_deg"),
        "drift_m": _worst(flown, "modes.standard_drift_m"),
        "coupling": min(read_metric(flown, "modes.standard_coupling")),
        "angle_coupling": max(map(abs, read_metric(flown, "modes.angle_coupling"))),
    }
    caption = (
        "The paper's colours. Green, standard stabilisation: it tilts by 2 deg and drifts, for "
        "nothing holds the position. Yellow, command position: a metre along x and along y, level. "
        "Red, command angle: it tilts each way, in place. White: take-off, flying back, landing."
    )
    return Measured(values, ClaimFigure(panels, caption))


def measure_inspection(records: Records) -> Measured:
    """Tracking of X, Y, Z and the force; figure 23."""
    flown = [*records["level"], *records["sloped"]]
    columns = [
        _draw_inspection(flown[0], "level and calm"),
        _draw_inspection(records["sloped"][0], "deck of 6 deg, 2 m/s"),
    ]
    panels = [panel for row in zip(*columns, strict=True) for panel in row]
    docked = [_worst(flown, f"force.{n}_error_n") for n in ("rms", "mean")]
    free = [_worst(records["level"], f"free.{n}_error_n") for n in ("rms", "mean")]
    values = {
        "wander_mm": _worst(flown, "dock.wander_mm"), "rms_n": docked[0], "mean_n": docked[1],
        "touch_mps": _worst(flown, "dock.touch_speed_mps"),
        "free_rms_n": free[0], "free_wander_mm": _worst(records["level"], "free.wander_mm"),
        "flights": float(len(flown)),
        "failed": _count_failed(flown), "saturated_s": _worst(flown, SATURATED),
    }  # fmt: skip
    caption = (
        "Yellow: docked and pressing, the paper's inspection phase. Orange, on the level deck: the "
        "same in flight, without the help of the gear. The axis of Y is magnified: it is off by "
        "centimetres in flight, and docked it stays where the feet took hold."
    )
    return Measured(values, ClaimFigure(panels, caption))


def _draw_inspection(record: Record, name: str) -> list[Panel]:
    """Draw X, Y, Z and the force of one flight; figure 23."""
    a = cut(record, *{p["name"] for p in record.info["phases"]})
    docked = dict.fromkeys(("touch", "press", "hold", "release"), "#fbf6dc")
    bands = _colour(record, {**docked, "free touch": "#fbe3cd", "free press": "#fbe3cd",
                             "free hold": "#fbe3cd", "free release": "#fbe3cd"})  # fmt: skip
    panels = [
        _track(a, f"{n}, {name}", "m", a["p_WB"][:, i], a["ref_p_WB"][:, i], bands)
        for i, n in enumerate("XYZ")
    ]
    t = a["t"][::THIN]
    asked = np.where(a["pressing"] > 0.5, a["ref_force"], 0.0)
    curves = [Curve("true", t, _press(a)[::THIN]), Curve("asked for", t, asked[::THIN], "dashed")]
    return [*panels, Panel(f"Force, {name}", "time (s)", "N", curves, bands=bands)]


def measure_gear(records: Records) -> Measured:
    """The same forces, docked and in flight."""
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
    """Error of the estimate that controlled the flights."""
    flown = [*records["level"], *records["hidden"]]
    panels = []
    for name, role in (("hidden by a pillar twice", "level"),
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
        "failed": _count_failed(flown),
        "saturated_s": _worst(flown, SATURATED),
    }
    caption = (
        "Left, from figure 11: how the positioning works here. Right and below: the error of the "
        "estimate that the controller flew with."
    )
    return Measured(values, ClaimFigure([build_positioning(), *panels], caption))


def build_positioning() -> Blocks:
    """Return the block diagram of the positioning, as in figure 11."""
    blocks = [
        Block(0.0, 3.0, "total station\n0-20 Hz"),
        Block(0.0, 2.0, "camera\n200 Hz"),
        Block(0.0, 1.0, "range finder\n20 Hz"),
        Block(0.0, 0.0, "inertial unit\n1 kHz"),
        Block(3.2, 2.0, "alignment:\nclock, frame,\nscale"),
        Block(3.2, 0.5, "filter:\ndrift, scale,\nclock"),
        Block(6.4, 0.5, "control of\nposition"),
    ]
    arrows = [
        (0, 4, "prism in W, late"), (1, 4, "pose in C"), (2, 5, "height"),
        (3, 5, "force, rate"), (4, 5, "in W"), (5, 6, "place, speed"),
    ]  # fmt: skip
    return Blocks("Positioning, as in figure 11", blocks, arrows)
