"""Criteria of the oracle for presses with a probe, on the true structure.

Each force at each spot is held for the requested time, with 0.28 N rms of the tip's true force
along its probe. The tip is within 3 cm of the spot plus the map's error, which a touch cannot
reveal. Docked, the platform stays within 5 mm and met the deck below 0.3 m/s. In flight the tip
keeps pressing: it is never without force for 0.05 s while it slides, nor for 0.5 s while it holds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from oracle_truth import Array, find_longest, list_spans, pick, rms, tell_touches, turn

from skywright.description.loader import Description
from skywright.description.world.structure import locate_point
from skywright.run.setup import Setup

FORCE_N, SPOT_M, WANDER_M, MEET_MPS = 0.28, 0.03, 0.005, 0.3
SLIDE_S, HOLD_S = 0.05, 0.5
FEET_N = 0.05


def find_press(s: Any) -> Array:
    """Return the tip's true force (n,) N along the probe."""
    return np.asarray(-np.sum(s["f_contact"] * turn(s["q_WT"], [0.0, 0.0, 1.0]), axis=1))


def tell_forces(
    s: Any, spans: list[tuple[float, float]], asked: list[float], hold: float
) -> list[str]:
    """Return the requested forces, in their order, that were not held."""
    missing, press = list[str](), find_press(s)
    if len(spans) != len(asked):
        missing.append(f"{len(spans)} of {len(asked)} forces held")
    for (a, b), force in zip(spans, asked, strict=False):
        error = rms(press[pick(s, [(a, b)])] - force)
        if b - a < hold - 0.05 or error > FORCE_N:
            missing.append(f"{force:g} N held for {b - a:.1f} s with {error:.2f} N rms")
    return missing


def judge_bench(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the forces that the clamped arm did not press."""
    task = d.mission.task
    touched = ["touched something"] if np.any(s["f_collision"] > 0.0) else []
    spans = list_spans(told, starts="hold ")
    return touched + tell_forces(s, spans, list(task.forces_n), task.hold_s)


def judge_contact(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return the unmet criteria of a press on a structure, docked or in flight."""
    task, missing = d.mission.task, tell_touches(told, s)
    dt, press = float(np.median(np.diff(s["t"]))), find_press(s)
    docked, free = list_spans(told, starts="hold "), list_spans(told, starts="free hold ")
    surface = Setup(d).true.surface
    assert surface is not None
    spans = docked if task.dock else free
    n = len(task.forces_n)
    if task.dock:
        missing += tell_forces(s, docked, list(task.forces_n) * len(task.spots), task.hold_s)
    elif len(free) != n * len(task.spots):
        missing.append(f"{len(free)} of {n * len(task.spots)} forces held")
    for i, spot in enumerate(task.spots):
        mine = spans[n * i : n * (i + 1)]
        if not mine:
            continue
        there = pick(s, mine)
        place = locate_point(surface, np.array([spot.x_m, spot.y_m]))[0]
        normal = locate_point(surface, np.array([spot.x_m, spot.y_m]))[1][:, 2]
        off = s["p_WT"][there] - place
        off = off - np.outer(off @ normal, normal)
        far = float(np.max(np.linalg.norm(off, axis=1)))
        if far > SPOT_M + d.plant.map_error_m:
            missing.append(f"spot {i + 1}: tip {1e3 * far:.0f} mm beside it")
        p = s["p_WB"][there]
        wander = 1e3 * float(np.max(np.linalg.norm(p - p[0], axis=1)))
        if task.dock and wander > 1e3 * WANDER_M:
            missing.append(f"spot {i + 1}: wandered {wander:.1f} mm")
    if not task.dock and find_longest((press <= 0.0) & pick(s, free), dt) > HOLD_S:
        missing.append("lost contact while holding")
    sliding = pick(s, list_spans(told, starts="slide"))
    if task.slide_m != 0.0:
        gone = float(np.max(s["off_s"][sliding], initial=0.0))
        way = s["p_WT"][sliding]
        length = float(np.max(np.linalg.norm(way - way[0], axis=1))) if len(way) else 0.0
        if gone > SLIDE_S or length < 0.95 * abs(task.slide_m):
            missing.append(f"slid {length:.2f} m, {gone:.2f} s without force")
    if task.dock:
        normal = locate_point(surface, np.zeros(2))[1][:, 2]
        on = np.linalg.norm(s["f_docking_W"], axis=1) > FEET_N
        for k in np.flatnonzero(on[1:] & ~on[:-1]) + 1:
            meeting = (s["t"] >= s["t"][k] - 0.05) & (s["t"] <= s["t"][k])
            speed = float(np.max(s["v_WB"][meeting] @ -normal))
            if speed > MEET_MPS:
                missing.append(f"met the deck at {speed:.2f} m/s")
    return missing
