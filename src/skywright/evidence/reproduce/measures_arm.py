"""Measures of the arm's elasticity and of the control laws that the paper rejects."""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.description.loader import load_description
from skywright.description.robot.spec import Robot
from skywright.evidence.reproduce import elastic
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import Bars, ClaimFigure, Curve, Map, Panel, Part
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.series import (
    band_rms,
    cut,
    phase_time,
    ring_growth,
    ring_remaining,
    spectrum,
    tangential,
)
from skywright.models.capability import compute_capability
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.run.planning import plan_mission

BAND = (4.0, 20.0)
"""Hz, around the arm's first structural mode (11 Hz in free flight)."""
RING_BAND = (4.0, 45.0)
"""Hz, of the vibration after a tap: with stiff servos the mode is at 28 Hz."""
REMAINS = 0.25
"""Share of the vibration after a tap that remains 5 s later in an unstable loop.

A decay slower than 0.26 1/s counts as none.
"""

DAMPING_RATIOS = (0.5, 1.0, 2.0)
"""Kd in units of sqrt(Kp m), for the sweeps of the reduced model."""


def measure_joint_space(records: Records) -> Measured:
    """Tip error along the surface with joint-space tracking only, compared with the displaced law.

    Three plants: kinematic errors as shipped, mirrored, and none (the arm still sags). The smallest
    of the three errors counts, because errors may cancel by chance.
    """
    names = {"joint": "as shipped", "joint_mirrored": "mirrored", "joint_exact": "none"}
    rms, tilt = {}, []
    for role in (*names, "displaced", "displaced_mirrored", "displaced_exact"):
        s = cut(records[role][0], "scan")
        rms[role] = 1e3 * float(np.sqrt(np.mean(np.sum(tangential(s, "WT") ** 2, axis=1))))
        if role in names:
            tilt.append(math.degrees(float(np.max(s["tilt"]))))
    pairs = [[rms[r], rms[r.replace("joint", "displaced")]] for r in names]
    values = {
        "rms_mm": min(rms[r] for r in names),
        "rms_worst_mm": max(rms[r] for r in names),
        "displaced_mm": max(p[1] for p in pairs),
        "tilt_max_deg": max(tilt),
        "gap_max_mm": max(float(records[r][0].info["metrics"]["contact.gap_max_mm"])
                          for r in names),
    }  # fmt: skip
    bars = Bars(
        "Tip error along the surface", "rms (mm)",
        [f"kinematic errors\n{n}" for n in names.values()],
        ["joint space only", "tip fed back, law (4)"], np.array(pairs), [(4.0, "limit 4 mm")],
    )  # fmt: skip
    curves = []
    for role, label in (("joint_mirrored", "joint space only"), ("displaced_mirrored", "law (4)")):
        s = cut(records[role][0], "scan")
        size = 1e3 * np.linalg.norm(tangential(s, "WT"), axis=1)
        curves.append(Curve(label, s["t"] - s["t"][0], size))
    panel = Panel(
        "Kinematic errors mirrored", "time since the scan's start (s)", "tip error (mm)", curves,
        [(4.0, "limit 4 mm")], low=0.0,
    )  # fmt: skip
    return Measured(
        values, ClaimFigure([bars, panel], "The limit is the mission's, not the paper's.")
    )


def measure_vibration(records: Records) -> Measured:
    """Vibration of the tip in flight and after a tap: inverse kinematics and the displaced law."""
    flown = {}
    curves = []
    for role, label in (("flight", "inverse kinematics"), ("displaced", "displaced, law (4)")):
        s = cut(records[role][0], "scan")
        error = np.asarray(s["p_WT"] - s["ref_p_WT"])
        flown[role] = 1e3 * band_rms(error, *BAND)
        f, power = spectrum(error)
        keep = (f > 0.5) & (f < 30.0)
        curves.append(Curve(label, f[keep], 1e3 * np.sqrt(power[keep])))
    labels = {
        "tap": "as shipped, truth fed back",
        "tap_estimated": "as shipped, estimate (noisy) fed back",
        "tap_undamped": "no structural damping, stiff servos",
    }
    values = {
        "ratio": flown["flight"] / flown["displaced"],
        "flight_mm": flown["flight"],
        "displaced_mm": flown["displaced"],
    }
    rings = []
    for role, label in labels.items():
        record = records[role][0]
        gains = np.array(record.info["gains"])
        growth = np.array([ring_growth(tip, *RING_BAND) for tip in record.arrays["tip"]])
        still = growth[0]  # the first gain is 0: no feedback to the arm
        rings.append(Curve(label, gains[1:], np.clip(growth[1:], -8.0, 8.0), "line+points"))
        unstable = gains[growth > 0.0]
        values[f"{role}_still"] = float(still)
        values[f"{role}_at_3"] = float(np.interp(3.0, gains, growth))
        values[f"{role}_unstable_from"] = float(unstable[0]) if len(unstable) else math.inf
        worse = gains[1:][growth[1:] > still + 0.2 * abs(still)]
        values[f"{role}_worse_from"] = float(worse[0]) if len(worse) else math.inf
    panels: list[Part] = [
        Panel(
            "Tip vibration while scanning, gain 3 1/s", "frequency (Hz)",
            "tip error (mm/√Hz)", curves, log_y=True,
        ),
        Panel(
            "After a tap on the probe: growth of the ringing", "gain of the arm's feedback (1/s)",
            "growth (1/s)", rings, [(0.0, "grows above")], log_x=True,
        ),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "Below zero the ringing dies out."))


def measure_workspace(records: Records) -> Measured:
    """Share of angles at which a scan of 40 deg is feasible, with and without posts; a rigid
    tool."""
    angles = np.arange(-180.0, 180.0, 15.0)
    shares = {}
    for posts in (False, True):
        found = [
            plan_mission(load_description("pipe-weld-scan", sets={
                "plant.map_error_m": 0.0, "plant.map_error_deg": 0.0,
                "plant.map_error_size_m": 0.0, "mission.task.survey": False,
                "mission.task.side": "angle", "mission.task.centre_angle_deg": float(angle),
                "world.pipe.supports": posts,
            })).feasible
            for angle in angles
        ]  # fmt: skip
        shares[posts] = float(np.mean(found))
    # a rigid tool turns with the platform, within the pitch angles at which it can hover
    tilt = math.degrees(
        max(compute_capability(load_description("pipe-weld-scan").robot).hover_tilt)
    )
    values = {
        "share": shares[False], "posts_share": shares[True], "rigid_share": 2.0 * tilt / 360.0,
        "tilt_deg": tilt, "sectors": float(len(angles)),
    }  # fmt: skip
    bars = Bars(
        "Circumference around which a scan can be planned", "share",
        ["with the arm", "with the arm,\npipe on posts", "rigid tool"], [""],
        np.array([values["share"], values["posts_share"], values["rigid_share"]])[:, None],
    )  # fmt: skip
    return Measured(values, ClaimFigure([bars], f"{len(angles)} angles, sectors of 40 deg."))


def build_elastic(robot: Robot, ratio: float = 0.0) -> elastic.Elastic:
    """Build the reduced model of a robot: platform with the arm's base, probe, bending of the arm.

    The two structural springs act in series at the tip, each with its distance to the tip.
    """
    assert robot.arm is not None and robot.probe is not None
    mass, _, _ = compute_body(build_body_model(robot), posture(robot, "working"))
    reach, compliance = robot.probe.length_m, 0.0
    for link in reversed(list(robot.arm.links.values())):
        reach += link.length_m
        if link.flex_stiffness_nm_per_rad is not None:
            compliance += reach**2 / link.flex_stiffness_nm_per_rad
    m2 = robot.probe.mass_kg
    return elastic.build_damped(mass - m2, m2, 1.0 / compliance, ratio)


def _gains(model: elastic.Elastic) -> tuple[Array, list[float]]:
    mass = model.m1 + model.m2
    kp = model.k * np.geomspace(0.01, 3.0, 60)
    return kp, [r * math.sqrt(model.k * mass) for r in DAMPING_RATIOS]


def measure_reduced_tip_only(records: Records) -> Measured:
    """Stable gains of tip-only feedback in the undamped reduced model, by eigenvalues and Routh."""
    model = build_elastic(load_description("pipe-weld-scan").robot)
    kp, kds = _gains(model)
    growth = np.array([[elastic.compute_growth(model, p, d, False) for p in kp] for d in kds])
    routh = [
        elastic.is_stable_by_routh(elastic.characteristic(model, p, d, False))
        for d in kds for p in kp
    ]  # fmt: skip
    values = {
        "stable_gains": float(np.sum(growth < 0.0)),
        "stable_by_routh": float(np.sum(routh)),
        "gains": float(growth.size),
        "least_growth": float(np.min(growth)),
        "stiffness": model.k,
        "frequency_hz": model.frequency / (2.0 * math.pi),
    }
    curves = [
        Curve(f"Kd = {r:g} sqrt(k m)", kp / model.k, g)
        for r, g in zip(DAMPING_RATIOS, growth, strict=True)
    ]
    panel = Panel(
        "Tip position and tip velocity, no damping in the structure",
        "Kp over the elastic stiffness", "growth of the fastest motion (1/s)", curves,
        [(0.0, "stable below")], log_x=True,
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], "The largest real part of the loop's poles."))


def measure_reduced_displaced(records: Records) -> Measured:
    """Largest stable Kp of the displaced law relative to the elastic stiffness, for several Kd."""
    model = build_elastic(load_description("pipe-weld-scan").robot)
    kp, kds = _gains(model)
    limits = [elastic.find_stability_limit(model, d, True, 10.0 * model.k) / model.k for d in kds]
    disagree = sum(
        (elastic.compute_growth(model, p, d, True) < 0.0)
        != elastic.is_stable_by_routh(elastic.characteristic(model, p, d, True))
        for d in kds for p in kp
    )  # fmt: skip
    damped = build_elastic(load_description("pipe-weld-scan").robot, 0.03)
    relaxed = [elastic.find_stability_limit(damped, d, True, 10.0 * damped.k) for d in kds]
    values = {
        "limit": float(np.mean(limits)),
        "limit_spread": float(np.ptp(limits)),
        "disagree": float(disagree),
        "damped_limit": float(np.min(relaxed)) / damped.k,
        "stiffness": model.k,
    }
    curves = [
        Curve(
            f"Kd = {r:g} sqrt(k m)", kp / model.k,
            np.array([elastic.compute_growth(model, p, d, True) for p in kp]),
        )
        for r, d in zip(DAMPING_RATIOS, kds, strict=True)
    ]  # fmt: skip
    panel = Panel(
        "Tip position and vehicle velocity, no damping in the structure",
        "Kp over the elastic stiffness", "growth of the fastest motion (1/s)", curves,
        [(0.0, "stable below")], log_x=True,
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], "All lines cross zero at Kp = k."))


def measure_stability_map(records: Records) -> Measured:
    """Vibration of the tip 6 s after a tap in the full simulation: Kp, damping, two laws."""
    rows = ("damping_00", "damping_01", "damping_03")
    groups = {
        "tip_shipped": "tip only, as shipped",
        "displaced_shipped": "displaced, as shipped",
        "tip_ideal": "tip only, ideal actuators",
        "displaced_ideal": "displaced, ideal actuators",
    }
    model = build_elastic(load_description("pipe-weld-scan").robot)
    stiffness = model.k
    values: dict[str, float] = {
        "stiffness": stiffness,
        "reduced_hz": model.frequency / (2.0 * math.pi),
    }
    for kind in ("shipped", "ideal"):
        f, power = spectrum(records[f"displaced_{kind}_damping_00"][0].arrays["tip"][0])
        inside = (f > RING_BAND[0]) & (f < RING_BAND[1])
        values[f"{kind}_hz"] = float(f[inside][np.argmax(power[inside])])
    panels: list[Part] = []
    for group, title in groups.items():
        gains = np.array(records[f"{group}_{rows[0]}"][0].info["gains"])
        left = np.array([
            [ring_remaining(tip, *RING_BAND) for tip in records[f"{group}_{row}"][0].arrays["tip"]]
            for row in rows
        ])  # fmt: skip
        values[f"{group}_unstable"] = float(np.mean(left > REMAINS))
        values[f"{group}_undamped_unstable"] = float(np.mean(left[0] > REMAINS))
        values[f"{group}_worst"] = float(np.max(left))
        unstable = gains[np.any(left > REMAINS, axis=0)]
        values[f"{group}_from"] = float(unstable[0]) if len(unstable) else math.inf
        below = left[:, gains < stiffness]
        values[f"{group}_stable_below"] = float(np.mean(below < REMAINS))
        at = float(np.interp(stiffness, gains, np.arange(len(gains))))
        panels.append(
            Map(
                title, "Kp (N/m)", "structural damping ratio", [f"{g:g}" for g in gains],
                ["0", "0.01", "0.03"], left, REMAINS, "vibration that remains 5 s later",
                at if gains[0] < stiffness < gains[-1] else None, "elastic stiffness",
            )
        )  # fmt: skip
    caption = (
        "The full simulation at the stand-off, after a tap on the probe. Blue decays, red does not "
        "(more than a quarter remains). Ideal actuators: rotors ten times as fast, stiff servos."
    )
    return Measured(values, ClaimFigure(panels, caption))


def measure_spared_arm(records: Records) -> Measured:
    """Ratio of peak changes of the arm's structural torque at touch-down: sprung to rigid
    holder."""
    peaks: dict[str, Array] = {}
    for role in ("sprung_bump", "rigid_bump"):
        record = records[role][0]
        torque = record.arrays["torque"]
        change = torque - torque[:, :25].mean(axis=1, keepdims=True)
        peaks[role] = np.max(np.abs(change), axis=(1, 2))
    speeds = np.array(records["sprung_bump"][0].info["speeds"])
    flown = {role: _touch_torque(records[role][0]) for role in ("sprung", "rigid")}
    ratio = peaks["sprung_bump"] / peaks["rigid_bump"]
    model = build_elastic(load_description("pipe-weld-scan").robot)
    robot = load_description("pipe-weld-scan").robot
    assert robot.probe is not None
    vehicle = (model.m1 + model.m2) * robot.control.position_bandwidth_rad_s**2
    compliance = np.array([1.0 / vehicle, 1.0 / model.k, 1.0 / robot.probe.spring_n_per_m])
    share = compliance / compliance.sum()
    values = {
        "ratio": flown["sprung"] / flown["rigid"],
        "sprung_nm": flown["sprung"],
        "rigid_nm": flown["rigid"],
        "fast_ratio": float(ratio[-1]),
        "fast_mps": float(speeds[-1]),
        "fast_force_ratio": float(
            records["sprung_bump"][0].arrays["force"][-1]
            / records["rigid_bump"][0].arrays["force"][-1]
        ),
        "vehicle_share": float(share[0]),
        "arm_share": float(share[1]),
        "spring_share": float(share[2]),
    }
    panels: list[Part] = [
        Panel(
            "Change of the arm's torque at touch-down", "mean speed of the touch (m/s)",
            "peak change (N m)",
            [
                Curve("rigid holder", speeds, peaks["rigid_bump"], "line+points"),
                Curve("sprung holder", speeds, peaks["sprung_bump"], "line+points"),
            ],
            low=0.0, log_x=True,
        ),
        Bars(
            "Who gives way to a push", "share of the deflection",
            ["vehicle's\nposition loop", "arm's\nstructure", "holder's\nspring"], [""],
            share[:, None],
        ),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "Three springs in series carry the same force."))


def _touch_torque(record: Record) -> float:
    """Return the peak change (N m) of any structural torque from the touch to the settling."""
    watched = record.arrays["watched"]
    start, _ = phase_time(record, "touch")
    end = phase_time(record, "settle")[1]
    t, torque = watched[:, 0], watched[:, 1:-3]
    before = torque[(t > start - 1.0) & (t < start)].mean(axis=0)
    return float(np.max(np.abs(torque[(t >= start) & (t <= end)] - before)))
