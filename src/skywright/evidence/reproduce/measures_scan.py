"""Measures of the scan: contact, attitude, weld, degraded conditions, planning."""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import Bars, ClaimFigure, Curve, Panel, Part
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.series import (
    along_surface,
    attitude_error,
    cut,
    phase_time,
    read_metric,
    smooth,
    tangential,
)
from skywright.missions.scan.metrics import LIFT_OFF_THRESHOLD
from skywright.models.eddy_current import Instrument
from skywright.reports.figures.style import BLUE, ORANGE, RUN_CLOCK


def _worst(records: list[Record], name: str) -> float:
    return float(np.max(read_metric(records, name)))


def _mean(records: list[Record], name: str) -> float:
    return float(np.mean(read_metric(records, name)))


def lift_off(ec: Array) -> Array:
    """Return the lift-off component (n,) of the instrument's signal, in its units."""
    phase = Instrument().phase
    return np.asarray(ec @ np.array([math.cos(phase), math.sin(phase)]))


def measure_contact(records: Records) -> Measured:
    """True force of the probe and largest lift-off signal during the scan, over all seeds."""
    parts = [cut(r, "scan") for r in records["scan"]]
    values = {
        "lift_off_max": max(float(np.max(lift_off(s["ec"]))) for s in parts),
        "least_n": min(float(np.min(s["f_normal"])) for s in parts),
        "unloaded_s": max(float(np.sum(np.diff(s["t"])[s["f_normal"][:-1] <= 0.0])) for s in parts),
        "seeds": float(len(parts)),
    }
    s = cut(records["scan"][0], "trim", "touch", "settle", "scan", "leave")
    panels: list[Part] = [
        Panel(
            "Lift-off signal from stand-off to departure", RUN_CLOCK, "w_l (instrument units)",
            [Curve("", s["t"], lift_off(s["ec"]))], [(LIFT_OFF_THRESHOLD, "contact below 15")],
        ),
        Panel(
            "Contact force", RUN_CLOCK, "normal force (N)", [Curve("", s["t"], s["f_normal"])],
            low=0.0,
        ),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "The probe is in air, touches, slides, leaves."))


def measure_air_gap(records: Records) -> Measured:
    """Largest true gap between probe and surface during the scan."""
    s = cut(records["scan"][0], "scan")
    values = {"gap_max_mm": _worst(records["scan"], "contact.gap_max_mm")}
    panel = Panel(
        "Gap between probe and surface", RUN_CLOCK, "gap (mm), below 0 in contact",
        [Curve("", s["t"], 1e3 * s["gap_max"])], [(1.0, "limit 1 mm")],
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], "The true gap, which only a simulation knows."))


def measure_probe_tilt(records: Records) -> Measured:
    """Largest angle between probe and surface normal during the scan."""
    s = cut(records["scan"][0], "scan")
    values = {"tilt_max_deg": _worst(records["scan"], "contact.tilt_max_deg")}
    panel = Panel(
        "Probe to surface normal", RUN_CLOCK, "angle (deg)",
        [Curve("", s["t"], np.degrees(s["tilt"]))], [(10.0, "limit 10 deg")], low=0.0,
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], "Zero is perpendicular."))


def measure_platform_offset(records: Records) -> Measured:
    """Offsets along the surface, with and without errors: platform from nominal, tip from desired.

    Offsets along the normal are excluded, because both are intended there.
    """
    names = {
        "exact_stiff": "kinematics exact,\narm ten times stiffer",
        "exact": "kinematics exact",
        "as_shipped": "as shipped",
        "doubled": "calibration\nerrors doubled",
    }
    rows: dict[str, tuple[float, float]] = {}
    for role in names:
        flown = [cut(r, "scan") for r in records[role]]
        platform, tip = (
            1e3 * float(np.mean([np.mean(np.linalg.norm(tangential(s, what), axis=1))
                                 for s in flown]))
            for what in ("WB", "WT")
        )  # fmt: skip
        rows[role] = platform, tip
    values = {
        "ratio": rows["as_shipped"][0] / rows["as_shipped"][1],
        "platform_mm": rows["as_shipped"][0],
        "tip_mm": rows["as_shipped"][1],
        "exact_platform_mm": rows["exact"][0],
        "exact_share": rows["exact"][0] / rows["as_shipped"][0],
        "stiff_platform_mm": rows["exact_stiff"][0],
        "doubled_platform_mm": rows["doubled"][0],
        "doubled_tip_mm": rows["doubled"][1],
        "platform_growth": rows["doubled"][0] / rows["exact_stiff"][0],
    }
    bars = Bars(
        "Mean offset along the surface during the scan", "offset (mm)", list(names.values()),
        ["platform from its nominal pose", "tip from its desired position"],
        np.array([rows[r] for r in names]),
    )  # fmt: skip
    return Measured(
        values,
        ClaimFigure([bars], "The platform gives way so that the tip stays where it should be."),
    )


def measure_touch_down(records: Records) -> Measured:
    """Decay of the attitude error after touch-down, with and without integral action.

    The error is relative to the last second before the contact, which excludes constant errors of
    the model. It is observed until the sliding starts.
    """
    fades, left, peaks, curves, tilt = [], [], [], [], []
    for role, label in (("with_integral", "with the integral"), ("without", "integral off")):
        for i, record in enumerate(records[role]):
            t, turn, s = _turned_by_contact(record)
            after = t >= 0.0
            peak = int(np.argmax(turn[after]))
            time, size = t[after][peak:], turn[after][peak:]
            if role == "without":
                left.append(float(size[-1] / size[0]))
            else:
                low = np.flatnonzero(size < 0.2 * size[0])
                fades.append(float(time[low[0]] - time[0]) if len(low) else math.inf)
                peaks.append(float(size[0]))
            if i == 0:
                keep = t > -2.0
                curves.append(Curve(label, t[keep], turn[keep]))
                tilt.append(Curve(label, t[keep], np.degrees(s["tilt"][keep])))
    values = {"fade_s": max(fades), "left_without": min(left), "peak_deg": max(peaks)}
    since = "time since the contact (s)"
    panels: list[Part] = [
        Panel("Platform attitude, change by the contact", since, "angle (deg)", curves, low=0.0),
        Panel("Probe to surface normal", since, "angle (deg)", tilt, low=0.0),
    ]
    return Measured(
        values, ClaimFigure(panels, "The push turns the platform; the integral turns it back.")
    )


def _turned_by_contact(record: Record) -> tuple[Array, Array, dict[str, Array]]:
    """Return time since contact (s), attitude change (deg) and samples until the sliding starts."""
    s = cut(record, "trim", "touch", "settle")
    start = phase_time(record, "touch")[0]
    touching = (s["f_normal"] > 0.2) & (s["t"] > start)
    if not np.any(touching):
        raise InputError("the probe never touched the surface")
    t = s["t"] - float(s["t"][np.argmax(touching)])
    error = smooth(attitude_error(s), 0.3)
    before = (t > -1.5) & (t < -0.5)
    return t, np.degrees(np.linalg.norm(error - error[before].mean(axis=0), axis=1)), s


def measure_weld(records: Records) -> Measured:
    """Detected crossings of the weld, and the error of its line."""
    runs = records["scan"]
    values = {
        "crossings": float(np.min(read_metric(runs, "weld.crossings"))),
        "offset_mm": _mean(runs, "weld.offset_error_mm"),
        "offset_worst_mm": _worst(runs, "weld.offset_error_mm"),
        "angle_deg": _mean(runs, "weld.angle_error_deg"),
        "angle_worst_deg": _worst(runs, "weld.angle_error_deg"),
        "seeds": float(len(runs)),
    }
    s = cut(runs[0], "scan")
    phase = Instrument().phase
    across = s["ec"] @ np.array([-math.sin(phase), math.cos(phase)])
    offsets = read_metric(runs, "weld.offset_error_mm")
    angles = read_metric(runs, "weld.angle_error_deg")
    panels: list[Part] = [
        Panel(
            "Signal across the lift-off direction", RUN_CLOCK, "instrument units",
            [Curve("", s["t"], across)],
        ),
        Bars(
            "Error of the weld's line, one seed each", "offset (mm), angle (deg)",
            [f"seed {i + 1}" for i in range(len(runs))], ["offset", "angle"],
            np.array([offsets, angles]).T,
        ),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "Each excursion on the left is a crossing."))


def measure_degraded(records: Records) -> Measured:
    """Increase of the tip's error along the surface relative to good conditions, with equal seeds.
    Of several degraded cases the worst counts, together with the requirements of all flights.
    """
    good = records["good"]
    told = records.get("across", [])  # beyond the effect of a fan: reported, not judged
    cases = {role: runs for role, runs in records.items() if role not in ("good", "across")}
    names = ("tip.tangential_rms_mm", "contact.tilt_max_deg", "weld.offset_error_mm")
    rms = {role: _mean(runs, names[0]) for role, runs in cases.items()}
    worst = max(rms, key=lambda role: rms[role])
    bad, flown = cases[worst], [r for runs in cases.values() for r in runs]
    still = _mean(good, names[0])
    values = {
        "rise_mm": rms[worst] - still,
        "ratio": rms[worst] / still,
        "good_mm": still,
        "degraded_mm": rms[worst],
        "steady_ratio": rms.get("steady", math.nan) / still,
        "across_failed": float(sum(r.info["outcome"] != "succeeded" for r in told)),
        "across_flights": float(len(told)),
        "weld_rise_mm": max(_mean(runs, names[2]) for runs in cases.values())
        - _mean(good, names[2]),
        "lift_off_max": max(float(np.max(lift_off(cut(r, "scan")["ec"]))) for r in flown),
        "gap_max_mm": _worst(flown, "contact.gap_max_mm"),
        "tilt_max_deg": _worst(flown, "contact.tilt_max_deg"),
        "crossings": float(np.min(read_metric(flown, "weld.crossings"))),
        "failed": float(sum(len(r.info["failed"]) for r in flown)),
        "bad_flights": float(sum(bool(r.info["failed"]) for r in flown)),
        "flights": float(len(flown)),
        "wind_n": float(
            np.mean(
                [np.mean(np.linalg.norm(cut(r, "scan")["f_wind_W"], axis=1)) for r in bad]
            )
        ),
        "seeds": float(len(bad)),
    }  # fmt: skip
    curves = []
    for runs, label, color in ((bad, "degraded", ORANGE), (good, "good conditions", BLUE)):
        s = cut(runs[0], "scan")
        size = 1e3 * np.linalg.norm(tangential(s, "WT"), axis=1)
        curves.append(Curve(label, s["t"] - s["t"][0], size, color=color))
    groups = ["tip error rms\n(mm)", "probe tilt max\n(deg)", "weld offset error\n(mm)"]
    columns = [good, *cases.values()]
    table = np.array([[_mean(runs, n) for runs in columns] for n in names])
    panels: list[Part] = [
        Panel(
            f"Tip error along the surface, seed 1, {worst}", "time since the scan's start (s)",
            "error (mm)", curves, low=0.0,
        ),
        Bars(f"Means of {len(bad)} seeds", "value", groups, ["good conditions", *cases], table),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "The same seeds, flown in every condition."))


def measure_planning(records: Records) -> Measured:
    """Wall time of planning, and duration of the contact phase."""
    runs = records["scan"]
    for r in runs:
        cut(r, "scan")  # raises InputError for a flight without sliding
    times = [float(r.info["plan_s"]) for r in runs]
    duration = float(np.mean([np.subtract(*phase_time(r, "scan")[::-1]) for r in runs]))
    values = {
        "plan_s": float(np.median(times)),
        "duration_s": duration,
        "times_faster": 9.0 / float(np.median(times)),
    }
    bars = Bars(
        "Time to plan the contact trajectory", "s",
        ["paper: about 110 s,\nIntel i5 of 2018", f"here: {duration:.0f} s,\nthis machine"], [""],
        np.array([[9.0], [float(np.median(times))]]), log_y=True,
    )  # fmt: skip
    return Measured(values, ClaimFigure([bars], "Different machines: an order of magnitude only."))


def measure_normal_error(records: Records) -> Measured:
    """The tip's error along the normal during the scan, and the integral action."""
    record = records["scan"][0]
    s = cut(record, "touch", "settle", "scan")
    start, end = phase_time(record, "scan")
    normal = np.asarray(s["ref_normal_W"])
    error = 1e3 * np.sum((s["p_WT"] - s["ref_p_WT"]) * normal, axis=1)
    sliding = s["t"] >= start
    watched = record.arrays["watched"]
    inside = (watched[:, 0] >= start) & (watched[:, 0] <= end)
    t, sigma = watched[inside, 0], watched[inside, -3:]
    out = np.stack([np.interp(t, s["t"], normal[:, i]) for i in range(3)], axis=1)
    along = np.sum(sigma * out, axis=1)
    across = np.linalg.norm(along_surface(sigma, out), axis=1)
    # no integral action along the normal: the stored vector is constant, only the normal turns
    held = sigma[0] @ out.T
    grown = along - held
    values = {
        "error_mm": float(np.min(error[sliding])),
        "error_mean_mm": float(np.mean(error[sliding])),
        "depth_mm": 1e3 * float(record.info["depth_m"]),
        "wind_up_n": float(np.max(np.abs(grown))),
        "would_be_n": float(np.mean(error[sliding]) * 1e-3 * (end - start)),
        "force_drift_n": float(
            np.mean(s["f_normal"][s["t"] > end - 10.0])
            - np.mean(s["f_normal"][sliding & (s["t"] < start + 10.0)])
        ),
    }
    panels: list[Part] = [
        Panel(
            "Tip from its desired position, along the outward normal", RUN_CLOCK, "error (mm)",
            [Curve("", s["t"], error)], low=0.0,
        ),
        Panel(
            "Position integral during the scan", RUN_CLOCK, "force (N)",
            [
                Curve("along the normal", t, along),
                Curve("of which grown since the start", t, grown),
                Curve("along the surface", t, across),
            ],
        ),
    ]  # fmt: skip
    return Measured(
        values, ClaimFigure(panels, "The desired tip lies inside the pipe, so the error stays.")
    )
