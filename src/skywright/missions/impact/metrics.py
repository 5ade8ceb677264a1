"""Metrics of the kind "impact": loads on platform and pad, and recoil."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.missions.impact.plan import RECOIL_S, ImpactPlan
from skywright.missions.impact.task import Impact
from skywright.models.drawing import rotate_vectors
from skywright.models.rigid_body import compute_body
from skywright.models.statics import UP, build_layout, compute_ray, wrench_at
from skywright.recordings.columns import has_columns
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.setup import Setup
from skywright.run.where import Where

MEASURES: Measures = {
    "impact.speed_mps": ("m/s", "speed of the impacting part just before contact"),
    "impact.speed_error_mps": (
        "m/s",
        "difference between impact.speed_mps and the commanded speed",
    ),
    "impact.speed_off": ("", "impact.speed_error_mps divided by the commanded speed"),
    "impact.peak_force_n": (
        "N",
        "largest force of arms or passive link on the platform, minus its value in free "
        "flight (at 1 kHz)",
    ),
    "impact.peak_torque_nm": (
        "N m",
        "largest torque about the platform's centre, minus its value in free flight",
    ),
    "impact.torque_share": (
        "",
        "impact.peak_torque_nm divided by the pitch torque of the rotors at hover",
    ),
    "impact.recoil_share": ("", "impact.recoil_deg over control.tilt_max_deg"),
    "impact.contact_s": ("s", "contact time until the contact opens or the platform is at rest"),
    "impact.contact_force_n": ("N", "largest force on the pad during the contact (at 1 kHz)"),
    "impact.impulse_ns": (
        "N s",
        "impulse on the pad during the contact, including the rotors' thrust",
    ),
    "impact.recoil_deg": (
        "deg",
        "largest tilt of the platform from its attitude before contact, within 1 s",
    ),
    "impact.yaw_deg": ("deg", "largest change of heading within 1 s"),
    "impact.swing_deg": ("deg", "largest rotation of the passive link within 1 s"),
    "impact.deflection_deg": (
        "deg",
        "largest deflection of a spring of the left arm, minus its value in free flight",
    ),
    "impact.overrun_m": ("m", "distance that the platform travels on after contact"),
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""

NEAR = Where(("impact", "retreat"), "from contact on")
BEFORE_S = 0.05  # s over which the speed before the contact is measured
WHERE = {
    "impact.": NEAR,
    "impact.speed": NEAR._replace(note=f"the last {BEFORE_S:g} s before contact"),
    **dict.fromkeys(
        ("impact.contact", "impact.impulse_ns"), NEAR._replace(note="during the contact")
    ),
    **dict.fromkeys(
        ("impact.recoil", "impact.yaw", "impact.swing", "impact.deflection", "impact.overrun"),
        NEAR._replace(note=f"within {RECOIL_S:g} s after contact"),
    ),
}

FELT = 0.5  # N on the pad that counts as contact
OPEN_S = 0.05  # s without a force after which a contact counts as over


def compute_metrics(run: Flown[Impact, ImpactPlan]) -> dict[str, float]:
    """Evaluate the collision; returns {} without one."""
    samples, phases, task, way = run.samples, run.phases, run.task, run.way
    near = NEAR.select(samples, phases)
    first = find_contact(samples, near)
    if first is None:
        return {}
    t0 = float(samples["t"][first])
    speed = compute_speed(samples, first, way, task.part)
    s = samples[near & (samples["t"] >= t0)]
    soon = s[s["t"] <= t0 + RECOIL_S]
    before = samples[max(first - 1, 0)]
    end = find_end(s, way.ahead)
    out = {
        "impact.speed_mps": speed,
        "impact.speed_error_mps": abs(speed - task.speed_mps),
        "impact.peak_force_n": float(np.max(s["load_f_peak"])),
        "impact.peak_torque_nm": float(np.max(s["load_t_peak"])),
        "impact.contact_force_n": float(np.max(s["pad_f_peak"][: end + 1])),
        "impact.contact_s": float(s["pad_touch_s"][end]),
        "impact.impulse_ns": float(np.linalg.norm(s["pad_impulse_W"][end])),
        "impact.recoil_deg": math.degrees(float(np.max(compute_tilt(soon, before)))),
        "impact.yaw_deg": math.degrees(float(np.max(np.abs(compute_turn(soon, before))))),
        "impact.overrun_m": float(np.max((soon["p_WB"] - before["p_WB"]) @ way.ahead)),
    }
    control = run.setup.robot.control
    out["impact.speed_off"] = out["impact.speed_error_mps"] / task.speed_mps
    out["impact.recoil_share"] = out["impact.recoil_deg"] / control.tilt_max_deg
    most = compute_pitch_torque(run.setup, way.q)
    out["impact.torque_share"] = out["impact.peak_torque_nm"] / most
    if run.setup.robot.pendulum is not None:
        turned = soon["q"][:, 0] - before["q"][0]
        out["impact.swing_deg"] = math.degrees(float(np.max(np.abs(turned))))
    if has_columns(samples, "deflection") and np.any(samples["deflection"]):
        wound = np.max(np.abs(soon["deflection"] - before["deflection"]))
        out["impact.deflection_deg"] = math.degrees(float(wound))
    return out


def compute_pitch_torque(setup: Setup[Impact], q: Array) -> float:
    """Return the torque (N m) that the rotors can produce in pitch while they carry the robot."""
    layout = build_layout(setup.rotors, setup.robot.rotors.thrust_fraction)
    mass, p_BC, _ = compute_body(setup.model, q)
    weight = wrench_at(mass * setup.world.gravity_mps2 * UP, p_BC)
    return compute_ray(layout, weight, np.eye(6)[4]).hi


def compute_tilt(samples: NDArray[Any], before: Any) -> Array:
    """Return the angle (n,) rad of the platform's vertical axis from its direction in `before`."""
    up = np.tile([0.0, 0.0, 1.0], (len(samples), 1))
    cosine = rotate_vectors(samples["q_WB"], up) @ rotate_vectors(before["q_WB"][None], up[:1])[0]
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def compute_turn(samples: NDArray[Any], before: Any) -> Array:
    """Return the change (n,) rad of the platform's heading since `before`."""

    def heading(q: Array) -> Array:
        ahead = rotate_vectors(q, np.tile([1.0, 0.0, 0.0], (len(q), 1)))
        return np.arctan2(ahead[:, 1], ahead[:, 0])

    turned = heading(samples["q_WB"]) - heading(before["q_WB"][None])
    return np.asarray((turned + math.pi) % (2.0 * math.pi) - math.pi)


def find_contact(samples: NDArray[Any], near: Mask) -> int | None:
    """Return the index of the first sample with contact, or None."""
    felt = np.flatnonzero(near & (samples["pad_f_peak"] > FELT))
    return int(felt[0]) if len(felt) else None


def find_end(s: NDArray[Any], ahead: Array) -> int:
    """Return the index of the sample at which the collision ends.

    It ends when the platform has come to rest along `ahead`, or the pad has had no force for
    OPEN_S. Later samples do not belong to it: the flight law treats the pad as a disturbance and
    presses on it for a second, which gives many times the robot's momentum.
    """
    away = s["pad_f_peak"] <= FELT
    count = max(round(OPEN_S / float(s["t"][1] - s["t"][0])), 1) if len(s) > 1 else 1
    for i in range(len(s) - count + 1):
        if float(s["v_WB"][i] @ ahead) <= 0.0 or np.all(away[i : i + count]):
            return i
    return len(s) - 1


def compute_speed(samples: NDArray[Any], first: int, way: ImpactPlan, part: str) -> float:
    """Return the speed (m/s) along the flight of the colliding part, just before sample `first`."""
    t0 = samples["t"][first]
    used = samples[(samples["t"] < t0) & (samples["t"] >= t0 - BEFORE_S - 1e-9)]
    if len(used) < 2:
        return math.nan
    p = used["p_WB"]
    if part == "link":
        q = used["q"][:, 0]
        down = -way.lever * np.column_stack([np.sin(q), 0.0 * q, np.cos(q)])
        p = p + rotate_vectors(used["q_WB"], down)
    elif has_columns(used, "left_p_WH") and np.any(used["left_p_WH"]):
        p = used["left_p_WH"]
    along = p @ way.ahead
    return float((along[-1] - along[0]) / (used["t"][-1] - used["t"][0]))
