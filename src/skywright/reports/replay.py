"""replay.html: a finished run in 3-D, in one file that needs no network.

viser records the scene and bundles its own viewer with time slider and speed; an overlay of ours
(replay_overlay.html) adds phases, key numbers, a legend and views, one of them from the robot.
`replay.html#t=42&view=overview` opens at 42 s, seen from there.
"""

import json
import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from skywright.core.arrays import Array, Ints, Mask
from skywright.description.loader import Description
from skywright.description.robot.limbs import SIDES
from skywright.inspection.contact_quality import GAP_LIMIT, TILT_LIMIT
from skywright.inspection.crossings import Crossing
from skywright.inspection.weld import WeldResult
from skywright.models.compliant_arms import is_compliant
from skywright.models.deviation import build_socket_error
from skywright.models.drawing import build_drawing
from skywright.reports.first_person import find_mount
from skywright.reports.page import write_page
from skywright.reports.phases import explain_phase
from skywright.reports.scene3d import (
    ESTIMATE,
    Scene3d,
    View,
    build_views,
    set_camera,
    start_server,
    stop_server,
)
from skywright.reports.trace3d import build_legend, build_trace, draw_trace, list_judged
from skywright.run.kind import load_kind
from skywright.run.run import RunResult

FRAME_RATE = 15.0  # Hz
MAX_FRAMES = 4500
MAX_CHUNKS = 200
NUMBER_RATE = 5.0  # Hz, of the numbers in the overlay
MOVE, TURN = 2e-4, 5e-4
"""m, quaternion units (0.06 deg): smaller motions are not sent."""
NEAR = 0.02  # m; further away than this, gap and tilt mean nothing


def write_replay(result: RunResult) -> Path:
    """Write replay.html into the run's directory and return its path.

    Raises InputError when the directory cannot be written.
    """
    path = result.directory / "replay.html"
    write_page(path, build_replay(result))
    return path


def build_replay(result: RunResult) -> str:
    """Return the replay of a run as one HTML document."""
    samples = result.samples
    finite = np.isfinite(samples["p_WB"]).all(axis=1) & np.isfinite(samples["q_WB"]).all(axis=1)
    samples = samples[finite]  # a diverged run ends with numbers that are none
    rows = _choose_frames(samples)
    d = result.description
    flown = samples["p_WB"][::50] if len(samples) else np.zeros((1, 3))
    views = build_views(d.robot, d.true_world, flown)
    server = start_server()
    try:
        with server.atomic():  # nobody is connected: do not wake viser's thread at every message
            html = _record(result, samples[rows], views, server)
    finally:
        stop_server(server)
    return _add_overlay(html, result, samples, views)


def _choose_frames(samples: NDArray[Any]) -> Ints:
    """Indices of the samples that are shown."""
    if len(samples) == 0:
        return np.zeros(0, np.int64)
    t = samples["t"]
    span = float(t[-1] - t[0])
    count = int(min(max(span * FRAME_RATE, 1.0), MAX_FRAMES)) + 1
    return np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], count)).clip(0, len(t) - 1))


def _record(
    result: RunResult, shown: NDArray[Any], views: list[View], server: viser.ViserServer
) -> str:
    """Draw the scene, play the samples that are `shown` into viser's recorder."""
    d = result.description
    scene = Scene3d(server, d.robot, d.true_world, build_socket_error(d.plant))
    scene.draw_sketch(load_kind(d.mission.kind).figures().sketch(d, result.plan.way))
    set_camera(server, views[0])
    scene.draw_wind(views[0].look_at + [0.0, 0.0, 0.75])
    poses = scene.compute_poses(shown)
    if len(shown):
        scene.show(poses, 0)
    serializer = server.get_scene_serializer()
    if len(shown) < 2:
        return str(serializer.as_html())
    moved = {
        name: (_find_moves(positions, MOVE), _find_moves(quaternions, TURN))
        for name, (positions, quaternions) in poses.nodes.items()
    }
    names = list_judged(d.robot, d.world)
    judged = np.isin(shown["phase"], [i for i, p in enumerate(result.phases) if p.name in names])
    trace, colours = build_trace(shown, judged, d.robot.arm is not None)
    every = max(1, math.ceil(len(shown) / MAX_CHUNKS), round(FRAME_RATE))
    weld = result.details if isinstance(result.details, WeldResult) else None
    crossings = list(enumerate(weld.crossings)) if weld is not None else []
    start = 0
    for i in range(1, len(shown)):
        serializer.insert_sleep(float(shown["t"][i] - shown["t"][i - 1]))
        scene.show(poses, i, moved)
        if i - start >= every or i == len(shown) - 1:
            draw_trace(server, f"/trace/{start}", trace[start : i + 1], colours[start : i + 1])
            start = i
        while crossings and (shown["t"][i] >= crossings[0][1].t or i == len(shown) - 1):
            _draw_crossing(scene, *crossings.pop(0))
            if not crossings and weld is not None:  # the last one completes the line
                _draw_estimate(scene, weld)
    return str(serializer.as_html())


def _find_moves(values: Array, step: float) -> Mask:
    """Mask (n,) of the frames at which a row differs by more than `step` from the last one kept."""
    out = np.zeros(len(values), bool)
    last = 0
    for i in range(1, len(values)):
        if np.abs(values[i] - values[last]).max() > step:
            out[i], last = True, i
    return out


def _draw_crossing(scene: Scene3d, i: int, crossing: Crossing) -> None:
    scene.server.scene.add_icosphere(
        f"/crossings/{i}", radius=0.008, position=crossing.p_W, color=ESTIMATE, subdivisions=2
    )


def _draw_estimate(scene: Scene3d, weld: WeldResult) -> None:
    """Draw the estimated lines along their crossings."""
    for k, line in enumerate(weld.lines):
        mine = weld.list_crossings(k)
        s, c = np.array([[x.s, x.c] for x in mine] + [[line.s, line.c]]).T
        half = 0.5 * math.hypot(np.ptp(s), np.ptp(c)) + 0.03
        s, c = line.follow(np.linspace(-half, half, 60))
        inside = np.abs(s) <= weld.surface.half_length
        if np.count_nonzero(inside) > 1:
            scene.draw_surface_line(f"/estimate{k}", s[inside], c[inside], 0.004, ESTIMATE, 0.0016)


# --- the overlay -----------------------------------------------------------------------------


def _add_overlay(html: str, result: RunResult, samples: NDArray[Any], views: list[View]) -> str:
    """Put phases, key numbers and legend into viser's page."""
    content = build_overlay_data(result, samples)
    content["views"] = [
        [v.name, *([round(float(x), 3) for x in p] for p in (v.position, v.look_at))] for v in views
    ]
    content["camera"] = _describe_camera(result.description)
    data = json.dumps(content, allow_nan=False)
    data = data.replace("<", "\\u003c")  # a name may not end the script
    overlay = (files("skywright.reports") / "replay_overlay.html").read_text(encoding="utf-8")
    overlay = overlay.replace("__DATA__", data)
    title = f"<title>{_escape(result.description.mission.name)}: replay</title>"
    html = html.replace("<title>Viser</title>", title, 1)
    end = html.rindex("</body>")
    return html[:end] + overlay + html[end:]


def _describe_camera(d: Description) -> dict[str, Any]:
    """The first-person view: the drawn platform that carries it, and its mount in B."""
    drawing = build_drawing(d.robot, d.true_world)
    mount = find_mount(d.robot, drawing)
    vectors = {
        "position": mount.position, "forward": mount.forward, "up": mount.up
    }  # fmt: skip
    return {
        "name": "first person", "node": f"/{drawing.parts[0].name}", "fov": mount.fov_deg,
        **{name: [round(float(x), 4) for x in v] for name, v in vectors.items()},
    }  # fmt: skip


def build_overlay_data(result: RunResult, samples: NDArray[Any]) -> dict[str, Any]:
    """What the overlay shows: names, phases, numbers over time and legend."""
    d = result.description
    start = float(samples["t"][0]) if len(samples) else 0.0
    end = float(samples["t"][-1]) if len(samples) else 0.0
    phases = [
        {"name": p.name.replace("_", " "), "start": p.start_s - start, "end": p.end_s - start,
         "outcome": p.outcome, "what": explain_phase(d.mission.kind, p.name)}
        for p in result.phases
    ]  # fmt: skip
    found = isinstance(result.details, WeldResult) and result.details.line is not None
    step = max(1, round(100.0 / NUMBER_RATE))
    rows = samples[::step]
    return {
        "mission": d.mission.name,
        "robot": d.robot.name,
        "world": d.world.name,
        "seed": d.mission.seed,
        "outcome": result.outcome,
        "reason": result.reason,
        "duration": end - start,
        "phases": phases,
        "period": step / 100.0,
        "numbers": _build_numbers(result, rows),
        "legend": build_legend(d.robot, d.world, found),
    }


def _build_numbers(result: RunResult, rows: NDArray[Any]) -> list[dict[str, Any]]:
    """Rows of the table: name, unit, limit (or None) and values (None where meaningless)."""
    out: list[dict[str, Any]] = []

    def add(
        name: str, unit: str, values: Array, limit: float | None = None, digits: int = 1
    ) -> None:
        shown = [round(float(v), digits) if math.isfinite(v) else None for v in values]
        out.append({"name": name, "unit": unit, "limit": limit, "digits": digits, "values": shown})

    error = np.linalg.norm(rows["p_WB"] - rows["ref_p_WB"], axis=1)
    probe = result.description.robot.probe is not None and result.description.world.pipe is not None
    if probe:
        near = rows["gap"] < NEAR
        add("push on the pipe", "N", np.where(near, rows["f_normal"], np.nan), digits=2)
        gap = np.maximum(1e3 * rows["gap"], 0.0)
        add("air gap", "mm", np.where(near, gap, np.nan), 1e3 * GAP_LIMIT, digits=2)
        tilt = np.degrees(rows["tilt"])
        add("probe tilt", "°", np.where(near, tilt, np.nan), math.degrees(TILT_LIMIT))
        pushing = np.linalg.norm(rows["ref_normal_W"], axis=1) > 0.5
        wrong = rows["p_WT"] - rows["ref_p_WT"]
        along = np.sum(wrong * rows["ref_normal_W"], axis=1)[:, None] * rows["ref_normal_W"]
        side = 1e3 * np.linalg.norm(wrong - along, axis=1)
        add("tip off its path", "mm", np.where(pushing, side, np.nan))
    else:
        add("off the path", "m", error, digits=2)
        arm = result.description.robot.arm
        if arm is not None and is_compliant(result.description.robot):
            for side in SIDES[: arm.sides]:
                add(f"{side} hand force", "N", np.linalg.norm(rows[f"{side}_f_W"], axis=1))
        lean = 2.0 * np.arccos(np.clip(np.hypot(rows["q_WB"][:, 0], rows["q_WB"][:, 3]), 0.0, 1.0))
        add("platform tilt", "°", np.degrees(lean))
        add("speed", "m/s", np.linalg.norm(rows["v_WB"], axis=1), digits=2)
    load = rows["rotor_thrust"].max(axis=1) / result.description.robot.rotors.thrust_max_n
    add("busiest rotor", "%", 100.0 * load, 100.0, digits=0)
    add("height", "m", rows["p_WB"][:, 2], digits=2)
    return out


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
