"""Measures of Caballero 2018, section IV: transport of the bar along the plan; the passive
joint."""

import numpy as np

from skywright.core.arrays import Array
from skywright.description.loader import load_description
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import Bars, ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.series import cut, phase_time, read_metric
from skywright.models.planar import build_planar_lrm, fill_equations
from skywright.models.scene import build_scene

METRICS = {
    "tip_max_m": ("tip.tracking_max_m", max),
    "tip_rms_m": ("tip.tracking_rms_m", max),
    "platform_max_m": ("platform.tracking_max_m", max),
    "swing_deg": ("swing.max_deg", max),
    "contacts": ("transport.contacts", max),
    "clearance_m": ("transport.clearance_min_m", min),
}
"""Quantity -> metric of a flight, and its reduction over all flights."""


def measure_follow(records: Records) -> Measured:
    """Tracking of the plan: the worst of all flights, and the first one's coordinates (figure
    8)."""
    flights = records["flight"]
    values = {"flights": float(len(flights)), **_find_worst(flights)}
    if "cascade" in records:
        values |= {f"cascade_{k}": v for k, v in _find_worst(records["cascade"]).items()}
    s = cut(flights[0], "transport", "settle")
    t = s["t"] - s["t"][0]
    panels = [
        Panel(title, "time since the start (s)", unit,
              [Curve("flown", t, y), Curve("planned", t, plan, "dashed")])
        for title, unit, y, plan in (
            ("q1, platform along", "m", s["p_WB"][:, 0], s["ref_p_WB"][:, 0]),
            ("q3, platform up", "m", s["p_WB"][:, 2], s["ref_p_WB"][:, 2]),
        )
    ]  # fmt: skip
    off = 50.0 * np.linalg.norm(
        s["left_p_WH"] + s["right_p_WH"] - s["left_ref_p_WH"] - s["right_ref_p_WH"], axis=1
    )
    panels.append(
        Panel("Bar's middle from the plan", "time since the start (s)", "cm", [Curve("", t, off)],
              [(8.0, "limit of the mission")], low=0.0)
    )  # fmt: skip
    panels.append(
        Panel("q0 and q7", "time since the start (s)", "deg",
              [Curve("passive joint", t, np.degrees(s["q"][:, 0])),
               Curve("left shoulder", t, np.degrees(s["q"][:, 1]))])
    )  # fmt: skip
    return Measured(values, ClaimFigure(panels, "The first flight."))


def _find_worst(flights: list[Record]) -> dict[str, float]:
    """Return the worst of all flights. Raises InputError if one was interrupted."""
    return {key: worst(read_metric(flights, name)) for key, (name, worst) in METRICS.items()}


def measure_similar(records: Records) -> Measured:
    """Distance between two flights of one plan at equal times: platform, bar and arms."""
    apart, bars, angles = [], [], []
    panels: list[Panel] = []
    for one, other in zip(records["simulated"], records["outdoors"], strict=True):
        t, a, b = _together(one, other)
        apart.append(float(np.max(np.linalg.norm(a["p_WB"] - b["p_WB"], axis=1))))
        bars.append(float(np.max(np.linalg.norm(_bar(a) - _bar(b), axis=1))))
        angles.append(float(np.degrees(np.max(np.abs(a["q"][:, 1:5] - b["q"][:, 1:5])))))
        if not panels:
            panels = [
                Panel(title, "time since the start (s)", "m",
                      [Curve("still air", t, a["p_WB"][:, k]),
                       Curve("outdoors", t, b["p_WB"][:, k], "dashed")])
                for k, title in ((0, "q1, platform along"), (2, "q3, platform up"))
            ]  # fmt: skip
    values = {"apart_m": max(apart), "bar_m": max(bars), "angle_deg": max(angles)}
    return Measured(values, ClaimFigure(panels, "The first pair of flights."))


def _bar(s: dict[str, Array]) -> Array:
    return np.asarray(0.5 * (s["left_p_WH"] + s["right_p_WH"]))


def _together(one: Record, other: Record) -> tuple[Array, dict[str, Array], dict[str, Array]]:
    """Return both transports at equal times since their start."""
    parts = []
    for r in (one, other):
        s = cut(r, "transport", "settle")
        parts.append((s["t"] - phase_time(r, "transport")[0], s))
    n = min(len(parts[0][0]), len(parts[1][0]))
    t = parts[0][0][:n]
    names = ("p_WB", "q", "left_p_WH", "right_p_WH")
    cuts = [
        {k: np.column_stack([np.interp(t, own, c) for c in s[k].T]) for k in names}
        for own, s in parts
    ]
    return t, cuts[0], cuts[1]


def measure_free_joint(records: Records) -> Measured:
    """Angular acceleration of the platform from a horizontal force at the arms' shoulders, by (3).

    Computed with a free passive joint and with the link fixed to the platform, at rest, with the
    arms hanging and fixed.
    """
    d = load_description("bar-transport", sets={"mission.task.bar_length_m": 0.0})
    p = build_planar_lrm(build_scene(d.robot, d.world), d.robot)
    M, rhs = np.zeros((8, 8)), np.zeros((8, 24))
    fill_equations(p, np.zeros(8), M, rhs)
    # per unit of q5 or q0 a point l below the joint moves by -l; the joint moves by -d of q5
    push = np.array([1.0, 0.0, -(p.d + p.l_b), -p.l_b])
    turn = []
    for free in (4, 3):
        keep = slice(0, free)
        turn.append(float(abs(np.linalg.solve(M[keep, keep], push[keep])[2])))
    values = {"free_rad_s2": turn[0], "fixed_rad_s2": turn[1], "ratio": turn[0] / turn[1]}
    bars = Bars("Platform turned by 1 N at the shoulders", "rad/s^2", ["link on a free joint",
                "link fixed"], [""], np.array(turn)[:, None])  # fmt: skip
    return Measured(values, ClaimFigure([bars], "By (3), at rest.", across=1))
