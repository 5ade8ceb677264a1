"""replay.html: a 3-D replay of a finished run, in one self-contained file.

It is the ground station's page (reports/station) with embedded scene and frames of the run.
`replay.html#t=42&view=overview` opens at 42 s in the view "overview".
"""

import json
import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Ints
from skywright.description.loader import Description
from skywright.inspection.weld import WeldResult
from skywright.models.deviation import build_socket_error
from skywright.reports.first_person import find_mount
from skywright.reports.frames import FrameBuilder, list_columns
from skywright.reports.page import write_page
from skywright.reports.phases import explain_phase
from skywright.reports.scene3d import ESTIMATE, Scene3d, encode
from skywright.reports.served import read_asset
from skywright.reports.trace3d import COLOURS, build_legend, list_judged
from skywright.reports.views3d import View, build_views
from skywright.run.backends import has_forces
from skywright.run.kind import load_kind
from skywright.run.result import RunResult

FRAME_RATE = 15.0  # Hz
MAX_FRAMES = 4500
VERSION = 1
"""Version of the page's data; the page refuses other versions."""


def write_replay(result: RunResult) -> Path:
    """Write replay.html into the run's directory and return its path.

    The page links to report.html, which is written next. Raises InputError if it cannot be written.
    """
    path = result.directory / "replay.html"
    write_page(path, build_replay(result))
    return path


def build_replay(result: RunResult) -> str:
    """Return the replay of a run as one HTML document."""
    return embed_page(build_replay_data(result), _link_files(result.directory))


def embed_page(data: dict[str, Any], links: str) -> str:
    """Return the page as one document with embedded data, script and style; `links` is HTML."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    text = text.replace("<", "\\u003c")  # a name must not end the script
    html, script, style = (read_asset(f"station.{end}") for end in ("html", "js", "css"))
    title = f"<title>{_escape(data['mission'])}: replay</title>"
    html = html.replace("<title>Skywright</title>", title, 1)
    html = html.replace('<link rel="stylesheet" href="station.css">', f"<style>{style}</style>", 1)
    html = html.replace('<p id="clock"></p>', f'<p id="clock"></p>\n  {links}', 1)
    script = script.replace("</script", "<\\/script")
    inside = (
        f'<script type="application/json" id="data">{text}</script>\n'
        f'<script type="module">{script}</script>'
    )
    return html.replace('<script type="module" src="station.js"></script>', inside, 1)


def build_replay_data(result: RunResult) -> dict[str, Any]:
    """Return the data of a replay as plain JSON."""
    samples = result.samples
    finite = np.isfinite(samples["p_WB"]).all(axis=1) & np.isfinite(samples["q_WB"]).all(axis=1)
    samples = samples[finite]  # a diverged run ends with non-finite values
    shown = samples[_choose_frames(samples)]
    d = result.description
    flown = samples["p_WB"][::50] if len(samples) else np.zeros((1, 3))
    start = float(samples["t"][0]) if len(samples) else 0.0
    scene = Scene3d(d.robot, d.true_world, build_socket_error(d.plant))
    weld = result.details if isinstance(result.details, WeldResult) else None
    if weld is not None:
        _draw_weld(scene, weld, start)
    marks = load_kind(d.mission.kind).figures().marks(result) if len(samples) else []
    for mark in marks:
        scene.draw_mark(mark, start)
    judged_names = list_judged(d.robot, d.world, d.mission.kind)
    builder = FrameBuilder(
        scene, list_columns(result.samples), judged_names, d.mission.task.get_gap_limit(),
        forces=has_forces(result.backend),
    )  # fmt: skip
    judged = np.isin(
        shown["phase"], [i for i, p in enumerate(result.phases) if p.name in judged_names]
    )
    found = weld is not None and weld.line is not None
    views = build_views(d.robot, d.true_world, flown, scene.drawing.world)
    data = describe(d, scene, builder, views, result.plan.way, found)
    named = {mark.name: mark.colour for mark in marks if mark.name}
    data["legend"] += [["#{:02x}{:02x}{:02x}".format(*rgb), name] for name, rgb in named.items()]
    frames = builder.build(shown, judged, _read_signal(weld, shown["t"]))
    data |= {
        "mode": "replay",
        "backend": result.backend,
        "outcome": result.outcome,
        "reason": result.reason,
        "duration": float(samples["t"][-1]) - start if len(samples) else 0.0,
        "phases": [
            {"name": p.name.replace("_", " "), "start": p.start_s - start, "end": p.end_s - start,
             "outcome": p.outcome, "what": explain_phase(d.mission.kind, p.name)}
            for p in result.phases
        ],
        "alarms": [{"t": a.t_s - start, "text": a.says, "rule": a.rule} for a in result.acted],
        "frames": pack_frames(shown["t"] - start, frames),
    }  # fmt: skip
    return data


def describe(
    d: Description, scene: Scene3d, builder: FrameBuilder, views: list[View], way: Any,
    found: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Return the data that the page needs before frames; `way` is that of the plan."""
    scene.draw_sketch(load_kind(d.mission.kind).figures().sketch(d, way))
    scene.draw_wind(views[0].look_at + [0.0, 0.0, 0.75])
    return {
        "version": VERSION,
        "mission": d.mission.name,
        "robot": d.robot.name,
        "world": d.world.name,
        "seed": d.mission.seed,
        **scene.data,
        "layout": builder.layout,
        "views": [
            [v.name, *([round(float(x), 3) for x in p] for p in (v.position, v.look_at))]
            for v in views
        ],
        "camera": _describe_camera(d, scene),
        "legend": build_legend(
            d.robot, d.world, found, builder.gap_limit, judged=bool(builder.judged)
        ),
        "qualities": [list(c) for c in COLOURS],
    }


def pack_frames(t: Array, frames: NDArray[np.float32]) -> dict[str, Any]:
    """Return frames (n, size) at times `t` (n,) s as text: each column separately, deflated.

    Bytes of equal significance are grouped, which halves the compressed size.
    """
    n = len(frames)
    planes = np.ascontiguousarray(frames.T).view(np.uint8).reshape(-1, 4).T
    packed = zlib.compress(np.ascontiguousarray(planes).tobytes(), 6)
    return {"n": n, "t": encode(t, "<f4"), "body": encode(np.frombuffer(packed, np.uint8), "u1")}


def _choose_frames(samples: NDArray[Any]) -> Ints:
    """Return the indices of the shown samples."""
    if len(samples) == 0:
        return np.zeros(0, np.int64)
    t = samples["t"]
    span = float(t[-1] - t[0])
    count = int(min(max(span * FRAME_RATE, 1.0), MAX_FRAMES)) + 1
    return np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], count)).clip(0, len(t) - 1))


def _read_signal(weld: WeldResult | None, t: Array) -> Array | None:
    """Return the weld component of the probe's signal at times `t`, NaN away from the surface."""
    if weld is None or len(weld.t) == 0:
        return None
    at = np.searchsorted(weld.t, t).clip(0, len(weld.t) - 1)
    value = np.where(weld.contact[at] & (np.abs(weld.t[at] - t) < 0.1), weld.weld[at], np.nan)
    return np.asarray(value)


def _draw_weld(scene: Scene3d, weld: WeldResult, start: float) -> None:
    """Draw each crossing from its detection time, and the estimated lines from the last one."""
    last = 0.0
    for crossing in weld.crossings:
        last = max(last, crossing.t - start)
        scene.draw_ball(np.array(crossing.p_W), 0.008, ESTIMATE, since=crossing.t - start)
    for k, line in enumerate(weld.lines):
        mine = weld.list_crossings(k)
        s, c = np.array([[x.s, x.c] for x in mine] + [[line.s, line.c]]).T
        half = 0.5 * math.hypot(np.ptp(s), np.ptp(c)) + 0.03
        s, c = line.follow(np.linspace(-half, half, 60))
        inside = np.abs(s) <= weld.surface.half_length
        if np.count_nonzero(inside) > 1:
            scene.draw_surface_line(s[inside], c[inside], 0.004, ESTIMATE, 0.0016, since=last)


def _describe_camera(d: Description, scene: Scene3d) -> dict[str, Any]:
    """Return the camera of the first-person view: its part, and its mount in the part's frame."""
    mount = find_mount(d.robot, scene.drawing)
    vectors = {"position": mount.position, "forward": mount.forward, "up": mount.up}
    return {
        "name": "first person", "fov": mount.fov_deg, "part": mount.part,
        **{name: [round(float(x), 4) for x in v] for name, v in vectors.items()},
    }  # fmt: skip


def _link_files(folder: Path) -> str:
    """Return links to the report, which is written after the replay, and to the recording.

    reports/served.py finds them by their id and their first words.
    """
    files = {"report.html": "report"}
    if (folder / "recording.mcap").is_file():
        files["recording.mcap"] = "recording"
    links = ", ".join(f'<a href="{file}">{what}</a>' for file, what in files.items())
    return f'<p id="files">Files of this run: {links}.</p>'


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
