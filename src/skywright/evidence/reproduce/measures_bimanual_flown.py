"""Measures from flights and bench trials of the compliant dual arm."""

import math

import numpy as np

from skywright.description.robot.loader import load_robot
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import Bars, ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.measures_bimanual import (
    FORCE,
    NAMES,
    SHORT,
    compute_statics,
    judge_statement,
)
from skywright.evidence.reproduce.series import cut, read_metric
from skywright.models.tip_force import Loaded


def measure_press(records: Records) -> Measured:
    """True force with the paper's estimator and with joint torques, in both poses."""
    cases = [records[r][0].info for r in ("l", "l_torque", "stretched", "stretched_torque")]
    true = np.array([r["true_mean_n"] for r in cases])
    bars = Bars(
        "True force while 2 N are asked for, upward", "N", ["L pose", "stretched"],
        ["Cartesian deflection, (25)-(28)", "joint torques"], true.reshape(2, 2), [(2.0, "2 N")],
    )  # fmt: skip
    off = np.array([r["rms_error_n"] for r in cases])
    errors = Bars(
        "Error of the force, rms over 5 s", "N", ["L pose", "stretched"],
        ["Cartesian deflection, (25)-(28)", "joint torques"], off.reshape(2, 2),
    )  # fmt: skip
    near, near_torque, far, far_torque = cases
    values = {
        "l_n": near["true_mean_n"], "l_said_n": near["estimated_mean_n"],
        "l_off_n": near["rms_error_n"],
        "l_torque_n": near_torque["true_mean_n"], "l_torque_off_n": near_torque["rms_error_n"],
        "far_n": far["true_mean_n"], "far_said_n": far["estimated_mean_n"],
        "far_off_n": far["rms_error_n"], "far_torque_n": far_torque["true_mean_n"],
        "far_torque_off_n": far_torque["rms_error_n"],
        "worse": far["rms_error_n"] / near["rms_error_n"],
    }  # fmt: skip
    caption = "Platform clamped; one of these closes the loop. Reference: force sensor in the box."
    return Measured(values, ClaimFigure([bars, errors], caption))


def measure_lean(records: Records) -> Measured:
    """Force from the angle of the link, (VI-C), compared with the applied force; figure 33."""
    said, angle, expected, pulled = [], [], [], []
    robot, _ = load_robot(NAMES[1])
    for record in records["pull"]:
        q, arms = record.arrays["q"], Loaded(robot, record.arrays["goal"])
        for force, row in zip(record.info["forces_n"], q, strict=True):
            _, J, hold = arms.hand(row)
            said.append(-float(hold[0] / J[0, 0]))
            angle.append(math.degrees(float(row[0])))
            found = arms.compute_reaction(np.array([-force, 0.0, 0.0]))
            expected.append(math.degrees(arms.q[0] + found.swing) if found else math.nan)
            pulled.append(force)
    f, s = np.array(pulled), np.array(said)
    a, e = np.array(angle), np.array(expected)
    two = f == FORCE
    panels = [
        Panel(
            "Force from the link's angle", "force on the hand (N)", "estimate (N)",
            [Curve("estimate", f, s, "points"), Curve("exact", np.sort(f), np.sort(f), "dashed")],
        ),
        Panel(
            "Angle of the link", "force on the hand (N)", "deg",
            [Curve("encoder", f, a, "points"), Curve("equilibrium", np.sort(f), np.sort(e))],
        ),
    ]  # fmt: skip
    values = {
        "error_n": float(np.max(np.abs(s - f))), "at_two_n": float(np.mean(s[two])),
        "angle_error_deg": float(np.max(np.abs(a - e))), "angle_deg": float(np.mean(a[two])),
        "rest_deg": math.degrees(arms.q[0]), "most_n": float(f.max()),
    }  # fmt: skip
    caption = "Platform clamped, bearing with friction, deviations of the plant; forearms level."
    return Measured(values, ClaimFigure(panels, caption))


def measure_impact(records: Records) -> Measured:
    """Maximum loads on the platform in a collision of a hand at 0.5 m/s."""
    roles = ("stiff", "soft", "far")
    torque = np.array([_mean(records[r], "impact.peak_torque_nm") for r in roles])
    force = np.array([_mean(records[r], "impact.peak_force_n") for r in roles])
    names = ["standard, stiff joints", "standard, compliant", "long reach, compliant"]
    parts = [
        Bars("Torque on the platform", "N m", names, [""], torque[:, None]),
        Bars("Force on the platform", "N", names, [""], force[:, None]),
    ]
    values = {
        "ratio": float(torque[0] / torque[1]), "far_ratio": float(torque[1] / torque[2]),
        "stiff_nm": float(torque[0]), "soft_nm": float(torque[1]), "far_nm": float(torque[2]),
        "stiff_n": float(force[0]), "soft_n": float(force[1]), "far_n": float(force[2]),
        "force_ratio": float(force[1] / force[2]),
    }  # fmt: skip
    return Measured(values, ClaimFigure(parts, "Mission impact, 0.5 m/s, gauges at 1 kHz."))


def measure_safer(records: Records) -> Measured:
    """Verdict of `skywright compare` on "safer", with the collision flown."""
    torque = [_mean(records[r], "impact.peak_torque_nm") for r in ("near", "far")]
    statics = compute_statics()
    values = {
        "holds": judge_statement("safer", {"impact.peak_torque_nm": (torque[0], torque[1])}),
        "near_nm": torque[0], "far_nm": torque[1],
        "near_roll_m": statics["near_roll_m"], "far_roll_m": statics["far_roll_m"],
        "roll_ratio": statics["far_roll_m"] / statics["near_roll_m"],
    }  # fmt: skip
    bars = Bars(
        "Torque on the platform, collision at 0.5 m/s", "N m", list(SHORT), [""],
        np.array(torque)[:, None],
    )  # fmt: skip
    return Measured(values, ClaimFigure([bars], "Rows of skywright compare."))


def _mean(records: list[Record], name: str) -> float:
    return float(np.mean(read_metric(records, name)))


def measure_accuracy(records: Records) -> Measured:
    """Rms distances of tip and platform from their references in gusty wind."""
    values, panels = {}, []
    wind = np.array(records["near"][0].info["winds_mps"])
    for what in ("tip", "platform"):
        curves = []
        for role, name in (("near", "standard"), ("far", "long reach")):
            table = 1e3 * np.array([r.arrays[what] for r in records[role]])
            curves.append(Curve(name, wind, table.mean(axis=0), "line+points"))
            values[f"{role}_{what}_mm"] = float(table[:, 0].mean())
            values[f"{role}_{what}_wind_mm"] = float(table[:, -1].mean())
        panels.append(
            Panel(f"{what.capitalize()} from its place, rms", "mean wind (m/s)", "mm", curves)
        )
    values["ratio"] = values["far_tip_mm"] / values["near_tip_mm"]
    values["ratio_wind"] = values["far_tip_wind_mm"] / values["near_tip_wind_mm"]
    values["wind_mps"] = float(wind[-1])
    v = values
    values["holds"] = judge_statement("more accurate", {
        "accuracy.tip_calm_mm": (v["near_tip_mm"], v["far_tip_mm"]),
        "accuracy.tip_wind_mm": (v["near_tip_wind_mm"], v["far_tip_wind_mm"]),
    })  # fmt: skip
    return Measured(values, ClaimFigure(panels, "Tip kept in place for 15 s, arms at work."))


def measure_downwash(records: Records) -> Measured:
    """Effect of the rotors' downwash on the springs of the arms: with and without it."""
    values, rows = {}, []
    for role in ("near", "far"):
        blown = np.mean([r.arrays["deflection"][0] for r in records[role]], axis=0)
        still = np.mean([r.arrays["deflection"][0] for r in records[f"{role}_still"]], axis=0)
        rows.append(math.degrees(float(np.max(np.abs(blown - still)))))
        values[f"{role}_deg"] = rows[-1]
        tip = [1e3 * _tip(records[k]) for k in (role, f"{role}_still")]
        values[f"{role}_tip_mm"], values[f"{role}_still_mm"] = tip
    values["far_ratio"] = values["far_deg"] / values["near_deg"]
    bars = Bars(
        "Change of the most deflected joint by the downwash", "deg", ["standard", "long reach"],
        [""], np.array(rows)[:, None],
    )  # fmt: skip
    return Measured(values, ClaimFigure([bars], "Hover in calm air, links with drag and without."))


def _tip(records: list[Record]) -> float:
    return float(np.mean([r.arrays["tip"][0] for r in records]))


def measure_install(records: Records) -> Measured:
    """Pressing the sensor on in flight: force, platform, link; figures 27 to 29."""
    flights = records["flight"]
    shown = flights[0]
    keys = {
        "mean_n": "force.mean_n", "off_n": "force.rms_error_n", "lost_s": "contact.lost_s",
        "installed": "sensor.installed", "bond_n": "sensor.bond_n",
        "excursion_m": "platform.excursion_m", "decay_s": "swing.decay_s",
        "start_deg": "swing.start_deg", "tip_mm": "tip.hover_rms_mm",
    }  # fmt: skip
    values = {name: _mean(flights, key) for name, key in keys.items()}
    values["decay_s"] = max(_list(flights, "swing.decay_s"))
    values["excursion_m"] = max(_list(flights, "platform.excursion_m"))
    values["installed"] = min(_list(flights, "sensor.installed"))
    values["flights"] = float(len(flights))
    s = cut(shown, "touch", "press", "force")
    t = s["t"] - s["t"][0]
    moved = 1e3 * (s["p_WB"] - s["p_WB"][0])
    panels = [
        Panel(
            "Force on the pipe, as in figure 28", "time (s)", "N",
            [Curve("true", t, s["left_f_W"][:, 2]), Curve("estimate", t, s["left_est_f_W"][:, 2])],
            [(2.0, "2 N")],
        ),
        Panel(
            "Displacement of the platform, as in figure 27b", "time (s)", "mm",
            [Curve(n, t, moved[:, i]) for i, n in enumerate("xyz")],
        ),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "Mission sensor-install, first flight."))


def measure_swing(records: Records) -> Measured:
    """Decay of the link's swing after its release at 10 deg."""
    values = {"decay_s": max(_list(records["flight"], "swing.decay_s"))}
    s = cut(records["flight"][0], "swing check")
    t, q = s["t"] - s["t"][0], np.degrees(s["q"][:, 0])
    rest = float(np.mean(q[t > t[-1] - 1.0]))
    curves = [Curve("with damping of the swing", t, q - rest)]
    plain = records["plain"][0]
    values["plain_s"] = max(_list(records["plain"], "swing.decay_s"))
    s = cut(plain, "swing check")
    q = np.degrees(s["q"][:, 0])
    curves.append(Curve("without", s["t"] - s["t"][0], q - float(np.mean(q))))
    values["start_deg"] = _mean(records["flight"], "swing.start_deg")
    panel = Panel(
        "Link from its rest, let go in hover", "time (s)", "deg", curves,
        [(1.0, "1 deg"), (-1.0, "")],
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], "Mission sensor-install, phase swing check."))


def measure_stretched(records: Records) -> Measured:
    """The second trial: the force with the arm almost straight; figure 31."""
    values: dict[str, float] = {}
    curves = []
    for role, name in (
        ("printed", "printed law"), ("torque", "joint torques"), ("leaving", "platform moves"),
    ):  # fmt: skip
        flights = records[role]
        s = cut(flights[0], "touch", "press", "leave singularity", "force")
        curves.append(Curve(name, s["t"] - s["t"][0], s["left_f_W"][:, 2]))
        off = [r.info["metrics"].get("force.rms_error_n", FORCE) for r in flights]
        # for the law that the paper says fails, the smallest error counts
        values[f"{role}_off_n"] = float(min(off) if role == "printed" else max(off))
        values[f"{role}_mean_n"] = float(
            np.mean([r.info["metrics"].get("force.mean_n", 0.0) for r in flights])
        )
    values["flights"] = float(len(records["printed"]))
    panel = Panel("Force on the pipe, as in figure 31a", "time (s)", "N", curves, [(2.0, "2 N")])
    caption = "Mission sensor-install, pose stretched; a trial ends where contact is lost."
    return Measured(values, ClaimFigure([panel], caption, across=1))


def _list(records: list[Record], name: str) -> list[float]:
    return [r.info["metrics"].get(name, math.inf) for r in records]
