"""Time series of a run: the probe in contact, and the whole flight."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skywright.core.arrays import Array, Mask, Samples
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    LIMIT,
    ORANGE,
    PURPLE,
    SERIES,
    WIDTH,
    clip_phases,
    draw_limit,
    draw_line,
    draw_requirement,
    fit_y,
    new_figure,
    shade_phases,
    stack_panels,
)
from skywright.run.metrics import quat_angle
from skywright.run.result import RunResult

TOUCHING = ("touch", "settle", "scan", "back_off", "leave")
"""Phases near the surface."""

LIMITS_DRAWN = (
    "Dashed red lines are limits; a dashed orange line is the largest thrust that plans use."
)
"""Part of the captions of figures with rotors."""

GAP_SHOWN = 3.0  # mm; larger gaps are not shown


def find_contact_window(result: RunResult) -> tuple[float, float] | None:
    """Return the times (s) between which the probe was near the surface; None if it was not."""
    near = [p for p in result.phases if p.name in TOUCHING]
    if not near or len(result.samples) == 0:
        return None
    end = float(result.samples["t"][-1])
    return max(near[0].start_s - 2.0, 0.0), min(near[-1].end_s + 1.0, end)


def compute_tip_errors(s: Samples) -> tuple[Array, Array]:
    """Return distances (n,) m of the tip from its desired point: along the surface, and outward.

    NaN in free flight, where there is no surface.
    """
    normal = s["ref_normal_W"]
    error = s["p_WT"] - s["ref_p_WT"]
    out = np.sum(error * normal, axis=1)
    along = np.linalg.norm(error - out[:, None] * normal, axis=1)
    free = np.linalg.norm(normal, axis=1) < 0.5
    return np.where(free, np.nan, along), np.where(free, np.nan, out)


def compute_tilt(q_WB: Array) -> Array:
    """Return the angle (n,) rad between z_B and the vertical."""
    return np.asarray(np.arccos(np.clip(1.0 - 2.0 * (q_WB[:, 1] ** 2 + q_WB[:, 2] ** 2), -1, 1)))


def draw_contact_series(result: RunResult, push: float, depth: float) -> Figure | None:
    """Draw tip error, gap, tilt, force, attitude and rotor loads while the probe is at the surface.

    `push` (N) and `depth` (m, of the desired tip inside the surface) are the planned values.
    """
    window = find_contact_window(result)
    if window is None or result.description.world.structure is not None:  # has its own figures
        return None
    samples = result.samples
    s = samples[(samples["t"] >= window[0]) & (samples["t"] <= window[1])]
    along, out = compute_tip_errors(s)
    if np.count_nonzero(np.isfinite(along)) < 2:
        return None  # a hand at work, not a probe: its kind draws the figure
    t = s["t"]
    figure = new_figure(WIDTH, 11.6)
    strip, axes = stack_panels(figure, 7)
    shade_phases(strip, axes, clip_phases(result.phases, float(t[0]), float(t[-1])))
    _draw_tangential(axes[0], t, along, result)
    _draw_normal(axes[1], t, out, 1e3 * depth)
    _draw_gap(axes[2], t, s, result)
    touching = s["gap"] < 5e-3
    tilt = np.where(touching, np.degrees(s["tilt"]), np.nan)
    _draw_single(axes[3], t, tilt, "Probe tilt from the surface's normal", "tilt (deg)", BLUE)
    limit = draw_requirement(axes[3], result, "contact.tilt_max_deg", "limit {:g} deg")
    _fit_limit(axes[3], tilt, limit)
    _draw_single(axes[4], t, s["f_normal"], "Force of the probe on the surface", "force (N)", BLUE)
    axes[4].axhline(push, color=GREEN, lw=1.1, ls=":", label=f"planned push {push:.2g} N")
    axes[4].legend(loc="lower right")
    fit_y(axes[4], float(np.max(s["f_normal"])), push, low=0.0)
    _draw_attitude(axes[5], t, s)
    _draw_rotors(axes[6], t, s, result)
    return figure


def draw_flight_series(result: RunResult) -> Figure | None:
    """Draw position, attitude, estimate, rotor loads and power over the whole run, if it flew."""
    s = result.samples
    if len(s) < 2 or not np.any(s["rotor_thrust"]):
        return None
    t = s["t"]
    figure = new_figure(WIDTH, 9.4)
    strip, axes = stack_panels(figure, 6)
    shade_phases(strip, axes, clip_phases(result.phases, float(t[0]), float(t[-1])))
    distance = np.linalg.norm(s["p_WB"] - s["ref_p_WB"], axis=1)
    flying = s["rotor_thrust"].sum(axis=1) > 0.5
    distance[~flying] = np.nan
    _draw_single(
        axes[0], t, distance, "Platform: distance from its reference", "distance (m)", BLUE
    )
    limit = draw_requirement(axes[0], result, "position.rms_m", "limit {:g} m on the rms")
    if limit is not None or flying.any():
        _fit_limit(axes[0], distance, limit)
    _draw_attitude(axes[1], t, s, flying)
    tilt = np.where(flying, np.degrees(compute_tilt(s["q_WB"])), np.nan)
    _draw_single(axes[2], t, tilt, "Platform tilt from level", "tilt (deg)", BLUE)
    tilt_max = result.description.robot.control.tilt_max_deg
    draw_limit(axes[2], tilt_max, f"largest tilt of the controller {tilt_max:g} deg")
    _fit_limit(axes[2], tilt, tilt_max)
    error = 1e3 * np.linalg.norm(s["est_p_WB"] - s["p_WB"], axis=1)
    error[~flying] = np.nan
    _draw_single(
        axes[3], t, error, "Estimator: distance of the estimated from the true position",
        "distance (mm)", PURPLE,
    )  # fmt: skip
    if flying.any():
        fit_y(axes[3], float(np.nanmax(error)), 1.0, low=0.0)
    _draw_rotors(axes[4], t, s, result)
    _draw_single(axes[5], t, s["power"], "Electrical power", "power (W)", BLACK)
    fit_y(axes[5], float(np.max(s["power"])), low=0.0)
    return figure


def _draw_single(ax: Axes, t: Array, y: Array, title: str, label: str, color: str) -> None:
    draw_line(ax, t, y, color=color)
    ax.set(title=title, ylabel=label)


def _fit_limit(ax: Axes, y: Array, limit: float | None) -> None:
    """Set the range from 0 to include all values and the limit."""
    known = y[np.isfinite(y)]
    fit_y(ax, float(known.max()) if known.size else 0.0, limit or 0.0, low=0.0)


def _draw_tangential(ax: Axes, t: Array, along: Array, result: RunResult) -> None:
    _draw_single(
        ax, t, 1e3 * along, "Tip error along the surface (to the desired tip)", "error (mm)", BLUE
    )
    rms = result.metrics.get("tip.tangential_rms_mm", math.nan)
    if math.isfinite(rms):
        ax.axhline(rms, color=GREEN, lw=1.1, ls=":", label=f"rms while scanning {rms:.2f} mm")
        ax.legend(loc="upper left")
    top = 1e3 * float(np.nanmax(along)) if np.isfinite(along).any() else 0.0
    limit = draw_requirement(ax, result, "tip.tangential_rms_mm", "limit on the rms {:g} mm")
    fit_y(ax, top, limit or 0.0, low=0.0)


def _draw_normal(ax: Axes, t: Array, out: Array, depth: float) -> None:
    """`depth` (mm) is the planned depth."""
    _draw_single(
        ax, t, 1e3 * out,
        "Tip error along the normal: the desired tip lies inside the surface; this offset "
            "causes the contact force",
        "error (mm)", BLUE,
    )  # fmt: skip
    ax.axhline(depth, color=GREEN, lw=1.1, ls=":", label=f"planned depth {depth:.0f} mm")
    ax.legend(loc="lower right")
    known = out[np.isfinite(out)]
    fit_y(ax, depth, *([1e3 * float(known.max()), 1e3 * float(known.min())] if known.size else []))


def _draw_gap(ax: Axes, t: Array, s: Samples, result: RunResult) -> None:
    gap = 1e3 * s["gap_max"]
    ax.axhspan(-10.0, 0.0, color="#e8f3ee", lw=0, zorder=0.5)
    _draw_single(
        ax, t, np.clip(gap, -2.0, 2 * GAP_SHOWN), "Air gap under the probe (green: touching)",
        "gap (mm)", BLUE,
    )  # fmt: skip
    draw_requirement(ax, result, "contact.gap_max_mm", "limit {:g} mm")
    limit = result.description.mission.task.get_gap_limit()
    if limit is not None:
        ax.axhline(
            1e3 * limit, color=LIMIT, lw=1.0, ls="--", label=f"counts up to {1e3 * limit:g} mm"
        )
        ax.legend(loc="upper right")
    ax.set_ylim(-0.5, GAP_SHOWN)
    lost = s["f_normal"] <= 0.0
    scanning = np.isin(s["phase"], [i for i, p in enumerate(result.phases) if p.name == "scan"])
    if np.any(lost & scanning):
        at = t[lost & scanning]
        ax.plot(at, np.full(len(at), -0.3), "|", color=LIMIT, ms=5, label="no force")
        ax.legend(loc="upper right")


def _draw_attitude(ax: Axes, t: Array, s: Samples, flying: Mask | None = None) -> None:
    error = np.degrees(quat_angle(s["q_WB"], s["ref_q_WB"]))
    if flying is not None:
        error[~flying] = np.nan
    _draw_single(
        ax, t, error, "Platform: attitude error (angle to its reference)", "error (deg)", BLUE
    )
    if np.isfinite(error).any():
        fit_y(ax, float(np.nanmax(error)), low=0.0)


def _draw_rotors(ax: Axes, t: Array, s: Samples, result: RunResult) -> None:
    rotors = result.description.robot.rotors
    n = len(rotors.azimuth_deg)
    for i in range(n):
        draw_line(ax, t, s["rotor_thrust"][:, i], color=SERIES[i], lw=0.9, label=f"{i + 1}")
    ax.set(title="Thrust of each rotor", ylabel="thrust (N)")
    full, usable = rotors.thrust_max_n, rotors.thrust_max_n * rotors.thrust_fraction
    draw_limit(ax, full, f"rotor's limit {full:.3g} N")
    if usable < 0.995 * full:
        ax.axhline(
            usable, color=ORANGE, lw=1.0, ls=(0, (2, 2)), label=f"_planned up to {usable:.3g} N"
        )
        ax.annotate(
            f"planned up to {usable:.3g} N", (0.0, usable), (3, -2),
            xycoords=ax.get_yaxis_transform(), textcoords="offset points", va="top", fontsize=7.5,
            color="#8a5a00",
        )  # fmt: skip
    if rotors.thrust_min_n > 0:
        draw_limit(ax, rotors.thrust_min_n, f"least {rotors.thrust_min_n:.2g} N")
    ax.set_ylim(0.0, 1.22 * full)
    saturated = s["saturated"] > 0.0
    if saturated.any():
        at = t[saturated]
        ax.plot(
            at[:: max(1, len(at) // 400)], np.full(len(at[:: max(1, len(at) // 400)]), 0.3), "|",
            color=BLACK, ms=5, label="command not realised by the allocation",
        )  # fmt: skip
    ax.legend(
        loc="upper left", ncols=n + 1, fontsize=7, title_fontsize=7, handlelength=1.2,
        columnspacing=0.9, borderaxespad=0.1, alignment="left",
    )  # fmt: skip


__all__ = [
    "LIMITS_DRAWN",
    "compute_tilt",
    "compute_tip_errors",
    "draw_contact_series",
    "draw_flight_series",
    "find_contact_window",
]
