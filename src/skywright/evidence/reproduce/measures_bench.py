"""Measures of Suarez 2020, section V-E: two cooperating hands, from the mission bimanual-bench."""

import numpy as np

from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.series import cut, read_metric


def _values(records: list[Record], **names: str) -> dict[str, float]:
    """Return the worst of all flights for metrics `bench.NAME`. Raises InputError if one is
    missing."""
    out = {}
    for key, name in names.items():
        found = read_metric(records, f"bench.{name}")
        out[key] = min(found) if name == "box_lift_m" else max(found)
    return {**out, "flights": float(len(records))}


def measure_squeeze(records: Records) -> Measured:
    """A box without handles, held by friction: (31), (32)."""
    flights = records["bench"]
    values = _values(flights, lift_m="box_lift_m", slip_mm="box_slip_mm", off_n="squeeze_error_n")
    values["press_n"] = float(np.mean(read_metric(flights, "bench.squeeze_n")))
    s = cut(flights[0], "squeeze", "lift", "hold box")
    t = s["t"] - s["t"][0]
    i = flights[0].info["objects"].index("box")
    panels = [
        Panel(
            "Force of the hands on the box, sideways", "time (s)", "N",
            [Curve("left", t, -s["left_f_W"][:, 1]), Curve("right", t, s["right_f_W"][:, 1])],
            low=0.0,
        ),
        Panel(
            "The box", "time (s)", "lifted (m)",
            [Curve("", t, s[f"object{i}_p_WO"][:, 2] - s[f"object{i}_p_WO"][0, 2])],
        ),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "Mission bimanual-bench, first run."))


def measure_unplug(records: Records) -> Measured:
    """Pulling a plug until it is free, as detected by (33)."""
    flights = records["bench"]
    values = _values(flights, delay_s="unplug_delay_s", slip_mm="plug_slip_mm")
    s = cut(flights[0], "pull", "unplugged")
    t = s["t"] - s["t"][0]
    i = flights[0].info["objects"].index("plug")
    plug, hand = s[f"object{i}_p_WO"], s["left_p_WH"]
    panel = Panel(
        "Way since the pull began", "time (s)", "mm",
        [Curve("plug", t, 1e3 * np.linalg.norm(plug - plug[0], axis=1)),
         Curve("left hand", t, 1e3 * np.linalg.norm(hand - hand[0], axis=1))],
        [(_threshold(flights[0]), "threshold of (33)")], low=0.0,
    )  # fmt: skip
    values["threshold_mm"] = _threshold(flights[0])
    return Measured(values, ClaimFigure([panel], "Mission bimanual-bench, first run.", across=1))


def _threshold(record: Record) -> float:
    """Return Delta_th of (33) in mm."""
    return 1e3 * float(record.info["task"]["unplug_threshold_m"])


def measure_bar(records: Records) -> Measured:
    """A bar moved by both hands: (29), (30)."""
    flights = records["bench"]
    values = _values(flights, off_mm="bar_position_mm", off_deg="bar_direction_deg")
    s = cut(flights[0], "lift bar", "turn bar", "bar forward")
    t = s["t"] - s["t"][0]
    i = flights[0].info["objects"].index("bar")
    bar = s[f"object{i}_p_WO"] - s[f"object{i}_p_WO"][0]
    goal = 0.5 * (s["left_ref_p_WH"] + s["right_ref_p_WH"])
    goal = goal - goal[0]
    between = s["left_p_WH"] - s["right_p_WH"]
    heading = np.degrees(np.arctan2(-between[:, 0], between[:, 1]))
    panels = [
        Panel(
            "Centre of the bar", "time (s)", "m",
            [Curve(f"{n}", t, bar[:, k]) for k, n in enumerate("xyz")]
            + [Curve(f"{n} asked for", t, goal[:, k], "dashed") for k, n in enumerate("xyz")],
        ),
        Panel("Line of both hands", "time (s)", "turned (deg)", [Curve("", t, heading)]),
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "Mission bimanual-bench, first run."))


def measure_sensor(records: Records) -> Measured:
    """Estimation of the base's drift from arms that hold a fixed object."""
    flights = records["bench"]
    values = _values(flights, off_mm="drift_error_mm")
    values["drift_mm"] = float(np.mean(read_metric(flights, "bench.drift_rms_mm")))
    values["share"] = values["off_mm"] / values["drift_mm"]
    s = cut(flights[0], "drift")
    t = s["t"] - s["t"][0]
    in_base = 0.5 * (s["left_est_p_WH"] + s["right_est_p_WH"]) - s["est_p_WB"]
    felt, true = 1e3 * (in_base[0] - in_base), 1e3 * (s["p_WB"] - s["p_WB"][0])
    axis = int(np.argmax(np.ptp(true, axis=0)))
    panel = Panel(
        f"Drift of the base along {'xyz'[axis]}", "time (s)", "mm",
        [Curve("true", t, true[:, axis]), Curve("felt by the arms", t, felt[:, axis])],
    )  # fmt: skip
    return Measured(values, ClaimFigure([panel], "Mission bimanual-bench, first run.", across=1))
