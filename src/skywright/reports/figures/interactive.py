"""Time series as data, with which a page can zoom in the panels of a figure.

Matplotlib draws a figure once; its lines, limits and phases are then read from it. Therefore the
figures of a mission kind are interactive without further code.
"""

import base64
import json
import re
import zlib
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure

from skywright.core.arrays import Array
from skywright.reports.figures.style import SPANS, WHOLE_LINES

LEVELS, MOST = 65_534, 40_000
"""Quantization steps between the smallest and the largest value of a line (one more encodes NaN);
and maximum number of samples of a line: longer ones are decimated."""
PLAIN = "time (s)"
_DASHES = {"--": [6, 4], ":": [2, 3], "-.": [6, 3, 2, 3]}


def build_plot(figure: Figure, group: str = "", clock: str = PLAIN) -> str:
    """Return the panels of a figure over time as JSON for templates/plots.js; "" without any.

    Panels of one `group` and time axis zoom together. `clock` is the time that the label "time (s)"
    stands for on this page.
    Also returns "" if a panel has another x axis, because the plot replaces the picture.
    """
    if not all(find_clock(ax) for ax in figure.axes if ax.axison):
        return ""
    data = bytearray()
    panels = [
        {"clock": clock if label == PLAIN else label, **_read_panel(ax, data)}
        for ax in figure.axes
        if ax.axison and (label := find_clock(ax))
    ]
    if not any(p["lines"] for p in panels):
        return ""
    found = {
        "group": group,
        "panels": panels,
        "phases": [[s.name, s.start, s.end, s.number] for s in SPANS.get(figure, ())],
        "data": base64.b64encode(zlib.compress(bytes(data), 9)).decode("ascii"),
    }
    return json.dumps(found, allow_nan=False).replace("<", "\\u003c")  # a name may not end it


def find_clock(ax: Axes) -> str:
    """Return the label of the time axis (s) that stacked panels share; "" for other axes."""
    if ax.get_xscale() != "linear":
        return ""
    siblings = ax.get_shared_x_axes().get_siblings(ax)
    return next((x for a in siblings if re.match(r"time .*\(s\)$", x := a.get_xlabel())), "")


def _pack(values: Array, data: bytearray) -> dict[str, float]:
    """Append quantized values (n,) as differences, low bytes before high bytes; NaN has its own
    code."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    step = (high - low) / LEVELS or 1.0
    steps = np.where(np.isfinite(values), (values - low) / step, LEVELS + 1)
    change = np.diff(np.round(steps).astype(np.int64), prepend=0).astype(np.uint16)
    at = len(data)
    data += (change & 255).astype(np.uint8).tobytes() + (change >> 8).astype(np.uint8).tobytes()
    return {"at": at, "n": len(values), "low": low, "step": step}


def _read_panel(ax: Axes, data: bytearray) -> dict[str, Any]:
    """Return title, ranges, lines, horizontal and vertical lines, and shaded areas of a panel."""
    unit = re.search(r"\(([^)]*)\)\s*$", ax.get_ylabel())
    panel: dict[str, Any] = {
        "title": ax.get_title(loc="left") or ax.get_title(), "label": ax.get_ylabel(),
        "unit": unit[1] if unit else ax.get_ylabel(), "x": list(map(float, ax.get_xlim())),
        "y": list(map(float, ax.get_ylim())), "log": ax.get_yscale() == "log",
        "lines": [], "levels": [], "marks": [], "areas": [],
    }  # fmt: skip
    for line in ax.lines:
        style = {
            "color": to_hex(line.get_color()), "width": float(line.get_linewidth()),
            "dash": _DASHES.get(str(line.get_linestyle()), []),
        }  # fmt: skip
        label = str(line.get_label())
        named = "" if label.startswith("_child") else label.removeprefix("_")
        in_x, in_y = line.get_transform().contains_branch_seperately(ax.transData)
        x, y = (np.asarray(v, float) for v in WHOLE_LINES.get(line, line.get_data()))
        if in_y and len(y) and (not in_x or (named and label.startswith("_"))):
            ends = x[np.isfinite(y)].tolist() if in_x else []
            spans = list(zip(ends[::2], ends[1::2], strict=True))
            panel["levels"].append({**style, "label": named, "y": float(y[0]), "spans": spans})
        elif in_x and not in_y and len(x):
            color = to_hex(to_rgba(line.get_color(), line.get_alpha()), keep_alpha=True)
            panel["marks"].append({**style, "color": color, "x": float(x[0])})
        elif in_x and in_y and len(x) > 0:
            every = -(-len(x) // MOST)
            panel["lines"].append({
                **style, "label": named, "points": str(line.get_linestyle()) == "None",
                "t": _pack(x[::every], data), "y": _pack(y[::every], data),
            })  # fmt: skip
    for patch in ax.patches:
        in_x, in_y = patch.get_data_transform().contains_branch_seperately(ax.transData)
        box = patch.get_path().get_extents(patch.get_patch_transform())
        panel["areas"].append({
            "x": [float(box.x0), float(box.x1)] if in_x else None,
            "y": [float(box.y0), float(box.y1)] if in_y else None,
            "color": to_hex(patch.get_facecolor(), keep_alpha=True),
        })  # fmt: skip
    return panel
