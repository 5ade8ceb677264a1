"""Measures of the tilted F550: capability, and prediction of a flight by its model."""

import math

import numpy as np

from skywright.analysis.identify.fit import fit_parameters
from skywright.analysis.identify.load import IDENTIFY_FIELDS, build_log, parse_description
from skywright.analysis.identify.signals import build_columns
from skywright.analysis.identify.truth import compute_truth
from skywright.core.arrays import Array
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.evidence.reproduce.figures import Bars, ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.printed_mixer import (
    build_correct,
    build_printed,
    can_hover,
    find_wrong_entries,
)
from skywright.models.capability import compute_capability
from skywright.models.rigid_body import joint_names
from skywright.models.rotors import build_rotors
from skywright.models.sweep import TiltSweep, compute_tilt_sweep, strip_robot

GF = 9.81e-3  # N
TILT = math.radians(20.0)


def _bare() -> Robot:
    """Return the platform of Table 2: 2.0 kg, without arm and gear."""
    return strip_robot(load_robot("f550-bridge")[0])


def _sweep() -> TiltSweep:
    return compute_tilt_sweep(_bare())


def measure_lateral_force(records: Records) -> Measured:
    """Table 2 with the robot's thrust bounds, and with other interpretations of them; figure 4."""
    robot = _bare()
    k = compute_capability(robot, directions_deg=[0.0, 90.0, 180.0, 270.0])
    force = k.lateral_force / GF
    rotors = robot.rotors.model_copy(update={"thrust_min_n": 0.0})
    open_ = compute_capability(
        robot.model_copy(update={"rotors": rotors}), directions_deg=[0.0, 90.0]
    )
    fitted = robot.rotors.model_copy(update={"thrust_min_n": 0.0, "thrust_max_n": 739 * GF})
    other = compute_capability(
        robot.model_copy(update={"rotors": fitted}), directions_deg=[180.0, 270.0]
    )
    s = _sweep()
    tilt = np.degrees(s.tilts)
    panel = Panel(
        "Lateral force at level attitude, as in figure 4", "tilt of the rotors (deg)", "force (gf)",
        [
            Curve("+x", tilt, s.lateral_force[:, 0] / GF, color="#b3261e"),
            Curve("+y", tilt, s.lateral_force[:, 1] / GF, color="#1f5fa8"),
            Curve("-x", tilt, s.lateral_force[:, 2] / GF, "dashed", "#b3261e"),
            Curve("-y", tilt, s.lateral_force[:, 3] / GF, "dashed", "#1f5fa8"),
        ], [(415.0, "Table 2: 415 gf"), (555.0, "555 gf")], low=0.0,
    )  # fmt: skip
    bars = Bars(
        "At 20 deg, by direction and thrust bounds", "gf", ["+x", "-x", "+y", "-y"],
        ["90 to 765 gf a rotor"], force[[0, 2, 1, 3], None], [(415.0, "415"), (555.0, "555")],
    )  # fmt: skip
    values = {
        "x_gf": float(force[0]), "y_gf": float(force[1]), "minus_x_gf": float(force[2]),
        "minus_y_gf": float(force[3]), "open_x_gf": float(open_.lateral_force[0] / GF),
        "open_y_gf": float(open_.lateral_force[1] / GF),
        "other_x_gf": float(other.lateral_force[0] / GF),
        "other_y_gf": float(other.lateral_force[1] / GF),
    }  # fmt: skip
    caption = "Closed form of problem (1): six rotors have one thrust vector for each wrench."
    return Measured(values, ClaimFigure([panel, bars], caption))


def measure_hover_tilt(records: Records) -> Measured:
    """Maximum tilt in hover, without and with arm and gear; figure 5."""
    bare, whole = _bare(), load_robot("f550-bridge")[0]
    k, flying = compute_capability(bare), compute_capability(whole, posture="folded")
    s = _sweep()
    tilt = np.degrees(s.tilts)
    panel = Panel(
        "Tilt of the body in hover, as in figure 5", "tilt of the rotors (deg)",
        "largest tilt (deg)",
        [
            Curve("roll", tilt, np.degrees(s.hover_tilt[:, 0])),
            Curve("pitch", tilt, np.degrees(s.hover_tilt[:, 1])),
        ], [(10.0, "flown: 10 deg")], low=0.0,
    )  # fmt: skip
    values = {
        "tilt_deg": math.degrees(min(k.hover_tilt)),
        "flying_deg": math.degrees(min(flying.hover_tilt)),
        "flying_kg": flying.body.mass,
    }
    caption = "Problem (2): the whole rotor force vertical, no torque, every thrust in its bounds."
    return Measured(values, ClaimFigure([panel], caption))


def measure_payload(records: Records) -> Measured:
    """Payload at 90 % of the thrust, and the remaining lateral force."""
    robot = _bare()
    k = compute_capability(robot)
    masses = np.arange(0.0, 1.01, 0.05)
    least = []
    for mass in masses:
        heavier = robot.platform.model_copy(update={"mass_kg": robot.platform.mass_kg + mass})
        found = compute_capability(
            robot.model_copy(update={"platform": heavier}),
            directions_deg=np.arange(0.0, 360.0, 15.0),
        )
        least.append(float(np.min(found.lateral_force)) / GF)
    panel = Panel(
        "Lateral force left with a payload", "payload (kg)", "weakest direction (gf)",
        [Curve("", 1.0 * masses, np.array(least))], low=0.0,
    )  # fmt: skip
    values = {
        "payload_kg": float(k.payload),
        "left_gf": float(np.interp(0.6, masses, least)),
        "empty_gf": least[0],
    }
    return Measured(values, ClaimFigure([panel], "At 90 % of the thrust, level."))


def measure_mixer(records: Records) -> Measured:
    """The printed mixer compared with the geometry: wrong entries, conditioning, hover."""
    r = build_rotors(load_robot("f550-bridge")[0].rotors)
    printed, correct = build_printed(TILT, TILT), build_correct(r)
    wrong = find_wrong_entries(printed, correct)
    maps = [m.build(0.275, r.torque_per_thrust) for m in (printed, correct)]
    weight, low, high = 2.0 * 9.81, float(r.thrust_min[0]), 0.9 * float(r.thrust_max[0])
    thrust = np.array([np.linalg.solve(m, [0, 0, weight, 0, 0, 0]) for m in maps])
    values = {
        "wrong": float(len(wrong)),
        "hovers": float(can_hover(maps[0], weight, low, high)),
        "condition": float(np.linalg.cond(maps[0])),
        "correct_condition": float(np.linalg.cond(maps[1])),
        "least_n": float(thrust[0].min()),
        "equal_n": float(thrust[1].max()),
    }
    bars = Bars(
        "Thrusts that the mixers ask for in level hover", "N", [str(i + 1) for i in range(6)],
        ["printed (20)-(22)", "geometry"], thrust.T, [(low, "least thrust"), (high, "90 %")],
    )  # fmt: skip
    entries = ", ".join(f"{w.block}({w.row},{w.column})" for w in wrong)
    return Measured(values, ClaimFigure([bars], f"Entries that disagree: {entries}."))


def measure_model(records: Records) -> Measured:
    """Predicted and measured angular acceleration on held-out parts; figure 16."""
    worst, errors, inside, count = [], [], 0, 0
    shown: tuple[Array, Array, Array] | None = None
    for record in records["flight"]:
        description = parse_description(record.info["mission"].encode())
        kept = {n: record.arrays[n] for n in IDENTIFY_FIELDS if n in record.arrays}
        samples = np.zeros(
            len(kept["t"]), np.dtype([(n, a.dtype, a.shape[1:]) for n, a in kept.items()])
        )
        for name, column in kept.items():
            samples[name] = column
        names = np.array([p["name"] for p in record.info["phases"]])
        log = build_log(
            "flight", description.robot, description.world, samples, names[samples["phase"]],
            tuple(joint_names(description.robot)),
        )  # fmt: skip
        columns = build_columns(log)
        truth, mass = compute_truth(description, columns.poses)
        found = fit_parameters(columns, log.robot, mass, log.gravity)
        p = found.prediction
        worst.append(p.r_squared(p.predicted)[3:])
        for e in found.estimates:
            true = truth.get(e.parameter.name)
            if true is None or not e.identified:
                continue
            inside += abs(e.value - true) <= e.half_width
            count += 1
            if e.parameter.name.endswith(("xx_kgm2", "yy_kgm2", "zz_kgm2")):
                errors.append(abs(e.value / true - 1.0))
        if shown is None:
            use = p.held_out
            at = np.flatnonzero(use)[:50]
            shown = (p.t[at], p.measured[at, 3:], p.predicted[at, 3:])
    r2 = np.array(worst)
    assert shown is not None
    t, measured, predicted = shown
    panels = [
        Panel(
            f"Angular acceleration about {axis}", "time (s)", "rad/s²",
            [Curve("measured", t, measured[:, i]), Curve("predicted", t, predicted[:, i])],
        )
        for i, axis in enumerate(("x (roll), as in figure 16", "y (pitch)"))
    ]  # fmt: skip
    values = {
        "r_squared": float(r2[:, :2].min()),
        "r_squared_yaw": float(r2[:, 2].min()),
        "inertia_error": float(np.max(errors)),
        "covered": inside / max(count, 1),
        "estimates": float(count),
        "flights": float(len(r2)),
    }
    caption = "A part of the flight that the fit did not see."
    return Measured(values, ClaimFigure(panels, caption))
