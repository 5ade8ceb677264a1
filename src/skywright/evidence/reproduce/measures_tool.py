"""Measures of flights that install a tool with two hands (Suarez 2020, section VI-A)."""

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.measured import Measured, Records

SIDES = ("left", "right")


def measure_tool(records: Records) -> Measured:
    """Installing the tool on the pipe and returning it, by phase; figure 21."""
    flights = records["flight"]
    done = [r for r in flights if r.info["outcome"] == "succeeded"]
    values = {
        "flights": float(len(flights)), "done": float(len(done)),
        "share": len(done) / len(flights),
        "seat_mm": max(_list(flights, "tool.seat_error_mm")),
        "seat_deg": max(_list(flights, "tool.seat_angle_deg")),
        "returned": min(_list(flights, "tool.returned")),
        "retries": sum(_list(flights, "tool.retries")),
    }  # fmt: skip
    s = flights[0].arrays
    t = s["t"]
    panels = [
        Panel(
            f"Platform and tool: {axis}, as in figure 21", "time (s)", "m",
            [Curve("platform", t, s["p_WB"][:, a]), Curve("tool", t, s["tool_p_WO"][:, a])],
        )
        for a, axis in enumerate("xyz")
    ]  # fmt: skip
    return Measured(values, ClaimFigure(panels, "Mission tool-install, first flight.", across=1))


def measure_grasp(records: Records) -> Measured:
    """Motion of both tips to the handle, in the tool's frame; figure 22."""
    reached, bent = [], []
    shown = _first_grasp(records["flight"][0])
    for record in records["flight"]:
        s = _first_grasp(record)
        for h in range(2):
            error = s["grasp_error_O"][:, h]
            way = error[-1] - error[0]
            along = way / np.linalg.norm(way)
            aside = error - error[0] - np.outer((error - error[0]) @ along, along)
            reached.append(float(np.linalg.norm(error[-1])))
            bent.append(float(np.max(np.linalg.norm(aside, axis=1))))
    values = {
        "reached_mm": 1e3 * max(reached), "aside_mm": 1e3 * max(bent),
        "began_mm": 1e3 * float(np.max(np.linalg.norm(shown["grasp_error_O"][0], axis=1))),
        "flights": float(len(records["flight"])),
    }  # fmt: skip
    t = shown["t"] - shown["t"][0]
    panels = [
        Panel(
            f"{side.capitalize()} tip from the grasping point, as in figure 22",
            "time (s)",
            "mm",
            [Curve(axis, t, 1e3 * shown["grasp_error_O"][:, h, a]) for a, axis in enumerate("xyz")],
        )
        for h, side in enumerate(SIDES)
    ]
    return Measured(values, ClaimFigure(panels, "Phase grasp of the first flight, at the bench."))


def measure_tool_hover(records: Records) -> Measured:
    """Distance of the tips from their points below the handle for 50 s; figures 23 and 24."""
    flights = records["flight"]
    values = {
        "tip_rms_mm": max(_list(flights, "tip.hover_rms_mm")),
        "tip_max_mm": max(_list(flights, "tip.hover_max_mm")),
        "drift_mm": max(_list(flights, "platform.drift_max_mm")),
        "flights": float(len(flights)),
    }
    s = flights[0].arrays
    index = [i for i, p in enumerate(flights[0].info["phases"]) if p["name"] == "hover check"]
    keep = np.isin(s["phase"], index)
    t, error = s["t"][keep], 1e3 * np.linalg.norm(s["wait_error_O"][keep], axis=2)
    moved = 1e3 * (s["p_WB"][keep] - s["p_WB"][keep][0])
    panels = [
        Panel(
            "Tracking error of the tips, as in figure 24a",
            "time (s)",
            "mm",
            [Curve(side, t - t[0], error[:, h]) for h, side in enumerate(SIDES)],
        ),
        Panel(
            "Displacement of the platform, as in figure 24b",
            "time (s)",
            "mm",
            [Curve(axis, t - t[0], moved[:, a]) for a, axis in enumerate("xyz")],
        ),
    ]
    return Measured(values, ClaimFigure(panels, "Phase hover check of the first flight."))


def _first_grasp(record: Record) -> dict[str, Array]:
    """Return the samples of the first phase "grasp", at the bench. Raises InputError without it."""
    found = [i for i, p in enumerate(record.info["phases"]) if p["name"] == "grasp"]
    keep = record.arrays["phase"] == found[0] if found else np.zeros(0, bool)
    if not np.any(keep):
        raise InputError(f"the flight has no phase grasp: {record.info['reason']}")
    return {k: record.arrays[k][keep] for k in ("t", "grasp_error_O")}


def _list(records: list[Record], name: str) -> list[float]:
    """Return a metric of every flight; missing values count as failed."""
    lacking = 0.0 if name in ("tool.returned", "tool.retries") else np.inf
    return [float(r.info["metrics"].get(name, lacking)) for r in records]
