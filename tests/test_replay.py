"""The 3-D replay: what is drawn stands where it was flown, in one page that plays offline."""

from __future__ import annotations

import base64
import json
import math
import re
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from playwright.sync_api import Page, expect

from exact_map import EXACT
from page_checks import list_cut
from skywright.core.rotations import quat_from_rot, rot_from_quat, rot_z
from skywright.core.types import MAX_JOINTS
from skywright.description.loader import load_description
from skywright.description.world.surface import build_cylinder, unroll_points
from skywright.errors import InputError
from skywright.models.compliant_arms import find_hands, is_compliant
from skywright.models.drawing import (
    Shape,
    build_drawing,
    compute_part_poses,
    multiply_quaternions,
    rotate_vectors,
)
from skywright.models.rigid_body import build_body_model, compute_tip, joint_names, posture
from skywright.reports.first_person import find_mount
from skywright.reports.frames import FrameBuilder, list_columns
from skywright.reports.meshes import Mesh, build_mesh, build_ribbon
from skywright.reports.replay import (
    build_replay,
    build_replay_data,
    embed_page,
    pack_frames,
    write_replay,
)
from skywright.reports.scene3d import Scene3d, _list_edges, weld_curve
from skywright.reports.served import unlink_files
from skywright.reports.trace3d import (
    COLOURS,
    FREE,
    GOOD,
    LIFTED,
    TILTED,
    build_legend,
    judge_trace,
    list_judged,
)
from skywright.reports.views3d import FOV, build_views, find_hidden
from skywright.run.result import RunResult
from skywright.run.run import run_mission
from waiting import wait_for

SHORT = (
    *EXACT,
    "mission.task.passes=2", "mission.task.pass_length_m=0.04", "mission.task.arc_deg=10",
    "mission.task.speed_mps=0.02", "mission.timestep_ms=2",
)  # fmt: skip


SAMPLE = np.dtype(
    [(n, "f8", 3) for n in ("p_WB", "p_WT", "ref_normal_W")]
    + [(n, "f8", 4) for n in ("q_WB", "q_WT")]
    + [(n, "f8") for n in ("t", "spring", "gap", "gap_max", "tilt")]
    + [("q", "f8", MAX_JOINTS)]
)
"""The columns that drawings read."""


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A short scan that crosses the weld twice."""
    out = tmp_path_factory.mktemp("scan") / "run"
    return run_mission(load_description("pipe-weld-scan", sets=SHORT), out=out)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    out = tmp_path_factory.mktemp("flight") / "run"
    return run_mission(load_description("waypoints"), out=out)


def _place_tip(drawing, poses, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Chain the drawn frames down to the slider: (p_W, R_W)."""
    index = [p.name for p in drawing.parts].index("slider")
    p, R = np.zeros(3), np.eye(3)
    while index >= 0:
        position, quaternion = poses[index][0][row], poses[index][1][row]
        local = rot_from_quat(quaternion)
        p, R = position + local @ p, local @ R
        index = drawing.parts[index].parent
    return p, R


@given(st.integers(0, 2**32 - 1))
def test_drawn_tip_is_where_the_kinematics_put_it(seed: int) -> None:
    description = load_description("pipe-weld-scan")
    robot, rng = description.robot, np.random.default_rng(seed)
    drawing = build_drawing(robot, description.world)
    n = len(joint_names(robot))
    q, p_WB = rng.uniform(-2, 2, (1, n)), rng.uniform(-3, 3, (1, 3))
    q_WB = rng.standard_normal((1, 4))
    q_WB /= np.linalg.norm(q_WB)
    poses = compute_part_poses(drawing, p_WB, q_WB, q, np.zeros(1))
    p, R = _place_tip(drawing, poses, 0)
    padded = np.zeros(MAX_JOINTS)
    padded[:n] = q[0]
    p_BT, R_BT = compute_tip(build_body_model(robot), padded)
    R_WB = rot_from_quat(q_WB[0])
    assert robot.probe is not None
    drawn = p + R @ [robot.probe.length_m, 0.0, 0.0]
    np.testing.assert_allclose(drawn, p_WB[0] + R_WB @ p_BT, atol=1e-12)
    np.testing.assert_allclose(R[:, 0], (R_WB @ R_BT)[:, 2], atol=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_quaternion_helpers_agree_with_matrices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, v = rng.standard_normal((3, 4)), rng.standard_normal((3, 4)), rng.standard_normal((3, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    product, turned = multiply_quaternions(a, b), rotate_vectors(a, v)
    for i in range(3):
        A, B = rot_from_quat(a[i]), rot_from_quat(b[i])
        np.testing.assert_allclose(rot_from_quat(product[i]), A @ B, atol=1e-12)
        np.testing.assert_allclose(turned[i], A @ v[i], atol=1e-12)


def test_probe_is_drawn_from_the_true_tip() -> None:
    """Also where the arm bends: the tip ends at p_WT, the spring shortens the holder only."""
    description = load_description("pipe-weld-scan")
    samples = np.zeros(2, SAMPLE)
    samples["q_WB"][:, 0] = samples["q_WT"][:, 0] = 1.0
    samples["p_WT"] = [[1.0, 2.0, 3.0], [1.0, 2.0, 3.1]]
    samples["q_WT"][1] = quat_from_rot(rot_z(0.7) @ rot_from_quat([0.8, 0.0, 0.6, 0.0]))
    samples["spring"] = [0.0, 0.004]
    scene = Scene3d(description.robot, description.world)
    names = [part.name for part in scene.drawing.parts]
    poses = dict(zip(names, scene.compute_poses(samples), strict=True))
    assert scene.parents[names.index("holder")] == -1
    assert scene.parents[names.index("slider")] == names.index("holder")
    assert description.robot.probe is not None
    length = description.robot.probe.length_m
    for i in range(2):
        holder, slider = poses["holder"], poses["slider"]
        R = rot_from_quat(holder[1][i])
        tip = holder[0][i] + R @ (slider[0][i] + [length, 0.0, 0.0])
        np.testing.assert_allclose(tip, samples["p_WT"][i], atol=1e-12)
        np.testing.assert_allclose(
            R[:, 0], rot_from_quat(samples["q_WT"][i])[:, 2], atol=1e-12
        )  # fmt: skip
        assert slider[0][i][0] == pytest.approx(-samples["spring"][i])


def _volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.sum(np.cross(a, b) * c)) / 6.0


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        ("sphere", [0.3, 0.0, 0.0], 4 / 3 * np.pi * 0.3**3),
        ("capsule", [0.1, 0.4, 0.0], np.pi * 0.1**2 * 0.8 + 4 / 3 * np.pi * 0.1**3),
        ("cylinder", [0.2, 0.5, 0.0], np.pi * 0.2**2),
        ("box", [0.1, 0.2, 0.3], 8 * 0.006),
    ],
)
def test_meshes_are_closed_and_face_outwards(kind: str, size: list[float], volume: float) -> None:
    turned = quat_from_rot(rot_z(0.4))
    shape = Shape("x", kind, np.array(size), np.array([1.0, -2.0, 0.5]), turned, np.ones(4))
    mesh = build_mesh(shape, 96)
    assert _volume(mesh) == pytest.approx(volume, rel=0.03)  # positive: faces point outwards
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), [1.0, -2.0, 0.5], atol=1e-9)


def test_ribbon_has_its_width_and_faces_the_normal() -> None:
    x = np.linspace(0.0, 1.0, 11)
    points = np.column_stack([x, 0.0 * x, 0.0 * x])
    mesh = build_ribbon(points, np.tile([0.0, 0.0, 1.0], (11, 1)), 0.2)
    assert np.ptp(mesh.vertices[:, 1]) == pytest.approx(0.2)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0.0)


@pytest.mark.parametrize(("angle", "offset"), [(10.0, 0.02), (-30.0, 0.0), (90.0, 0.1)])
def test_weld_is_drawn_on_its_line(angle: float, offset: float) -> None:
    sets = (f"world.weld.angle_deg={angle}", f"world.weld.offset_m={offset}",
            "world.pipe.yaw_deg=25", "world.pipe.inclination_deg=15")  # fmt: skip
    world = load_description("pipe-weld-scan", sets=sets).world
    assert world.pipe is not None and world.weld is not None
    cylinder = build_cylinder(world.pipe)
    pieces, _ = weld_curve(world.pipe, world.weld)
    assert sum(len(p) for p in pieces) > 50
    slope = np.radians(angle)
    for s, c, gap in zip(*unroll_points(cylinder, np.concatenate(pieces)), strict=True):
        assert abs(gap) < 1e-9 and abs(s) <= cylinder.half_length + 1e-9
        if angle == 90.0:
            assert c == pytest.approx(offset)
        else:
            height = cylinder.radius * np.sin(c / cylinder.radius)  # of a plane's cut
            assert s - offset == pytest.approx(np.tan(slope) * height, abs=1e-9)


def test_a_transport_is_not_judged_by_contact_and_shows_its_area() -> None:
    d = load_description("bar-transport")
    assert (
        list_judged(d.robot, d.world, d.mission.kind) == ()
    )  # though its last phase is called settle
    meanings = [text for _, text in build_legend(d.robot, d.world, False, judged=False)]
    assert "limits of the area" in meanings
    edges = _list_edges((0.0, 1.0), (0.0, 2.0), (0.0, 3.0))
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert sorted(lengths) == [1.0] * 4 + [2.0] * 4 + [3.0] * 4
    scan = load_description("pipe-weld-scan")
    assert "scan" in list_judged(scan.robot, scan.world, scan.mission.kind)
    # a way-point flight touches nothing, even with a probe beside a pipe
    assert list_judged(scan.robot, scan.world, "waypoints") == ()
    scene = Scene3d(scan.robot, scan.world)
    untouched = FrameBuilder(scene, frozenset({"ec"}), ())
    assert untouched.layout["map"] is None
    assert not {"push on the pipe", "air gap"} & {c.name for c in untouched.channels}


def test_trace_is_coloured_by_contact_quality() -> None:
    samples = np.zeros(5, SAMPLE)
    samples["gap"] = samples["gap_max"] = [0.05, 0.0, 0.0, 0.002, 0.0]
    samples["gap_max"][4] = 0.0015  # lifted between two samples
    samples["tilt"] = np.radians([50.0, 3.0, 12.0, 12.0, 0.0])
    judged = np.array([False, True, True, True, True])
    _, quality = judge_trace(samples, judged, arm=True)
    assert quality.tolist() == [FREE, GOOD, TILTED, LIFTED, LIFTED]
    points, quality = judge_trace(samples, judged, arm=False)
    assert np.all(quality == FREE) and np.all(points == samples["p_WB"])


def test_colours_of_the_trace_differ_for_colour_blind_eyes() -> None:
    """As deuteranopes and protanopes see them (Vienot, Brettel and Mollon 1999)."""
    rgb = np.array(COLOURS) / 255.0
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_lms = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714],
                       [0.0299566, 0.184309, 1.46709]])  # fmt: skip
    deutan = np.array([[1, 0, 0], [0.494207, 0, 1.24827], [0, 0, 1]])
    protan = np.array([[0, 2.02344, -2.52581], [0, 1, 0], [0, 0, 1]])
    for seen in (np.eye(3), deutan, protan):
        look = linear @ (np.linalg.inv(to_lms) @ seen @ to_lms).T
        look = np.clip(look, 0.0, 1.0) ** (1 / 2.2)
        apart = np.linalg.norm(look[:, None] - look[None], axis=2)
        assert apart[~np.eye(len(look), dtype=bool)].min() > 0.2


def test_first_view_sees_everything_that_was_flown(scan: RunResult) -> None:
    d, flown = scan.description, scan.samples["p_WB"][::100]
    for view in build_views(d.robot, d.world, flown)[:1]:
        ahead = view.look_at - view.position
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        way = flown - view.position
        depth, half = way @ ahead, np.tan(FOV / 2)
        assert np.all(depth > 0.2)
        assert np.all(np.abs(way @ np.cross(right, ahead)) < half * depth)
        assert np.all(np.abs(way @ right) < 1.3 * half * depth)


def test_first_view_is_not_behind_a_wall(scan: RunResult) -> None:
    d, flown = load_description("waypoints"), scan.samples["p_WB"][::100]
    free = build_views(d.robot, d.world, flown)[0]
    place = 0.5 * (free.position + free.look_at)
    turn = math.atan2(*(free.position - free.look_at)[1::-1])
    quat = np.array([math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2)])
    size = np.array([0.05, 4.0, 4.0])
    wall = Shape("wall", "box", size, place, quat, np.ones(4))
    assert find_hidden(free.position, flown, [wall]).all()
    assert not find_hidden(free.look_at, flown, [wall._replace(position=place + 100.0)]).any()
    assert not find_hidden(free.position, flown, [wall._replace(kind="plane")]).any()
    view = build_views(d.robot, d.world, flown, [wall])[0]
    assert view.name == free.name and not find_hidden(view.position, flown, [wall]).any()


def test_ticks_of_a_constant_differ(
    show_page: Callable[..., Page], flight: RunResult, tmp_path: Path
) -> None:
    """A plot of one value, or of none, has no two ticks with equal text, and none is cut."""
    data = build_replay_data(flight)
    t, channels = np.linspace(0.0, 20.0, 40), data["layout"]["channels"]
    frames = np.ones((40, data["layout"]["size"]), "<f4")
    plotted = np.flatnonzero([c["plotted"] for c in channels])
    assert len(plotted) >= 3
    for k, value in enumerate((0.0, 10.0, math.nan)):
        frames[:, frames.shape[1] - len(channels) + plotted[k::3]] = value
    data["frames"] = pack_frames(t, frames)
    (tmp_path / "replay.html").write_text(embed_page(data, ""), encoding="utf-8")
    page = show_page(tmp_path / "replay.html")
    canvases = page.evaluate("readTexts()")
    assert len(canvases) >= len(plotted) and list_cut(page) == []
    for _, _, texts in canvases:
        written = [text for text, *_ in texts]
        assert len(set(written)) == len(written) > 2, written


def test_replay_is_small_quick_and_complete(scan: RunResult) -> None:
    write_replay(scan)  # imports and first use
    start = time.process_time()
    path = write_replay(scan)
    assert time.process_time() - start < 4.0  # about 0.3 s
    assert path == scan.directory / "replay.html" and path.stat().st_size < 5_000_000
    page = path.read_text(encoding="utf-8")
    assert "<title>pipe-weld-scan: replay</title>" in page
    assert 'src="station.js"' not in page and 'href="station.css"' not in page


def test_a_replay_leads_to_the_report_and_the_recording(scan: RunResult, tmp_path: Path) -> None:
    """Those beside it; the report is written after it. A server offers neither."""
    page = build_replay(scan)
    head = page[page.index("<header") : page.index("</header>")]
    assert re.findall(r'href="([^"]*)"', head) == ["report.html", "recording.mcap"]
    moved = build_replay(scan._replace(directory=tmp_path, samples=scan.samples[:50]))
    assert 'href="report.html"' in moved and 'href="recording.mcap"' not in moved
    served = unlink_files(page, tmp_path)
    head = served[served.index("<header") : served.index("</header>")]
    assert "href" not in head
    assert f"report, recording. They are in the folder <code>{tmp_path}</code>" in head


def _unpack(packed: dict, size: int) -> np.ndarray:
    """Read frames as the page does: four planes of bytes, column after column."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["body"])), np.uint8)
    numbers = np.ascontiguousarray(planes.reshape(4, -1).T).view("<f4").ravel()
    return numbers.reshape(size, packed["n"]).T


@given(st.integers(0, 40), st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_packed_frames_come_back_bit_for_bit(n: int, size: int, seed: int) -> None:
    frames = np.random.default_rng(seed).standard_normal((n, size)).astype("<f4")
    frames[np.random.default_rng(seed + 1).random((n, size)) < 0.2] = np.nan
    packed = pack_frames(np.arange(n, dtype=float), frames)
    assert packed["n"] == n
    if n:
        np.testing.assert_array_equal(_unpack(packed, size), frames)


def test_numbers_of_the_page_are_those_of_the_recording(scan: RunResult) -> None:
    data = build_replay_data(scan)
    json.dumps(data, allow_nan=False)
    assert [p["name"] for p in data["phases"]] == [p.name.replace("_", " ") for p in scan.phases]
    layout = data["layout"]
    channels = {c["name"]: c for c in layout["channels"]}
    assert channels["air gap"]["limit"] == 1.0 and channels["probe tilt"]["limit"] == 10.0
    frames = _unpack(data["frames"], layout["size"])
    first = layout["size"] - len(channels)
    column = {name: frames[:, first + i] for i, name in enumerate(channels)}
    t = np.frombuffer(base64.b64decode(data["frames"]["t"]), "<f4") + scan.samples["t"][0]
    rows = scan.samples[np.searchsorted(scan.samples["t"], t - 1e-4)]
    np.testing.assert_allclose(column["height"], rows["p_WB"][:, 2], atol=1e-6)
    assert np.isnan(column["air gap"][0])  # far away a gap means nothing
    sliding = rows["gap"] < 0.001
    assert np.count_nonzero(sliding) > 20
    np.testing.assert_allclose(
        column["push on the pipe"][sliding], rows["f_normal"][sliding], rtol=1e-6
    )
    assert ["#d628aa", "detected weld"] in data["legend"]
    since = [m["since"] for m in data["meshes"] if "since" in m]
    assert len(since) == len(scan.details.crossings) + len(scan.details.lines)
    shown = frames[:, first - 3 : first]  # of the map: s, c, value
    on = np.isfinite(shown[:, 2])
    assert 20 < np.count_nonzero(on) < len(on) / 2  # on the surface only
    assert np.ptp(shown[on, 0]) > 0.02


def test_robot_without_arm_has_its_own_numbers(flight: RunResult) -> None:
    data = build_replay_data(flight)
    names = {c["name"] for c in data["layout"]["channels"]}
    assert {"off the path", "speed", "platform tilt"} <= names
    assert not any("weld" in text for _, text in data["legend"])
    assert data["layout"]["map"] is None


def test_force_arrows_are_the_forces_of_the_recording(scan: RunResult) -> None:
    d, rows = scan.description, scan.samples[::97]
    scene = Scene3d(d.robot, d.true_world)
    builder = FrameBuilder(scene, list_columns(rows), ())
    frames = builder.build(rows, np.zeros(len(rows), bool))
    k = 7 * len(scene.drawing.parts) + 6 * [a.name for a in builder.arrows].index("tip")
    strong = np.linalg.norm(rows["f_contact"], axis=1) > 0.1
    assert np.any(strong) and not np.all(strong)
    np.testing.assert_allclose(frames[strong, k : k + 3], rows["p_WT"][strong], atol=1e-6)
    np.testing.assert_allclose(frames[strong, k + 3 : k + 6], rows["f_contact"][strong], rtol=1e-5)
    weak = np.linalg.norm(rows["f_contact"], axis=1) < 1e-3
    assert np.isnan(frames[weak, k + 3]).all()  # no arrow


def test_diverged_and_empty_runs_still_give_a_page(flight: RunResult) -> None:
    broken = flight.samples[:400].copy()
    broken["p_WB"][300:] = np.nan
    data = build_replay_data(flight._replace(samples=broken, outcome="diverged"))
    size = data["layout"]["size"] - len(data["layout"]["channels"])
    assert np.isfinite(_unpack(data["frames"], data["layout"]["size"])[:, : size - 14]).all()
    assert data["duration"] == pytest.approx(2.99)
    empty = flight._replace(samples=flight.samples[:0], phases=[], outcome="interrupted")
    assert build_replay_data(empty)["frames"]["n"] == 0
    assert "<canvas" in build_replay(empty)


def test_hostile_names_stay_text(flight: RunResult) -> None:
    name = "</script><script>alert(1)</script>"
    d = flight.description
    hostile = d._replace(mission=d.mission.model_copy(update={"name": name}))
    page = build_replay(flight._replace(description=hostile, samples=flight.samples[:300]))
    assert "<script>alert(1)" not in page


def test_unwritable_directory_is_one_line(flight: RunResult, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot write .*replay\.html"):
        write_replay(flight._replace(directory=tmp_path / "gone", samples=flight.samples[:50]))


def test_first_person_sees_the_tools_of_every_robot() -> None:
    missions = (
        "tool-install", "pipe-weld-scan", "bridge-contact", "bar-transport", "sensor-install",
    )  # fmt: skip
    for mission in missions:
        d = load_description(mission)
        mount = find_mount(d.robot, build_drawing(d.robot, d.world))
        axes = np.stack([mount.forward, mount.up])
        np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-12)
        model, q = build_body_model(d.robot), posture(d.robot, "working")
        hands = is_compliant(d.robot)
        work = find_hands(model, q).mean(axis=0) if hands else compute_tip(model, q)[0]
        link = {"bar-transport": [0.0, 0.0, -0.11], "sensor-install": [0.0, 0.0, -0.11]}
        assert (mount.part > 0) == (mission in link)  # between the shoulders below a long link
        away = work - mount.position - link.get(mission, np.zeros(3))
        seen = away @ mount.forward / np.linalg.norm(away)
        assert seen == pytest.approx(1.0)  # in the middle of the picture
    d = load_description("waypoints")
    assert find_mount(d.robot, build_drawing(d.robot, d.world)).forward[2] < 0.0


def test_first_person_is_the_camera_that_a_robot_has() -> None:
    d = load_description("sensor-install", sets=("robot.camera.x_m=0.1", "robot.camera.yaw_deg=90",
                                                 "robot.camera.field_of_view_deg=60"))  # fmt: skip
    mount = find_mount(d.robot, build_drawing(d.robot, d.world))
    np.testing.assert_allclose(mount.position, [0.1, 0.0, 0.0])
    np.testing.assert_allclose(mount.forward, [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(mount.up, [0.0, 0.0, 1.0], atol=1e-12)
    assert mount.fov_deg == 60.0


@pytest.mark.browser
def test_browser_plays_the_page_without_network(
    scan: RunResult, open_page: Callable[..., Page]
) -> None:
    """The viewer starts, goes to a time, and the overlay names the phase and its numbers."""
    path = write_replay(scan)
    sliding = next(p for p in scan.phases if p.name == "scan")
    t = 0.5 * (sliding.start_s + sliding.end_s)
    page = open_page(offline=True)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{path.resolve().as_uri()}#t={t:.1f}")
    clock, phase = page.locator("#clock"), page.locator("#phase")
    expect(clock).to_contain_text(f"{t:.1f} / ")
    expect(phase).to_have_text("scan")
    expect(page.locator("table.numbers").first).to_contain_text(
        re.compile(r"push on the pipe\s*\d\.\d\d N")
    )
    expect(page.locator("#phases .on")).to_have_text("scan")

    def stands_at(place: np.ndarray) -> bool:
        at = page.evaluate("window.skywright.view.camera.position.toArray()")
        return np.allclose(np.array(at), place, atol=0.02)

    def look(name: str) -> None:
        page.get_by_role("group", name="Camera").get_by_role("button", name=name).click()

    d = scan.description
    first = build_views(d.robot, d.world, scan.samples["p_WB"][::50])[0].position
    wait_for(lambda: stands_at(first))
    look("first person")
    mount = find_mount(d.robot, build_drawing(d.robot, d.world))
    row = scan.samples[np.searchsorted(scan.samples["t"], t + scan.samples["t"][0])]
    aboard = row["p_WB"] + rot_from_quat(row["q_WB"]) @ mount.position
    wait_for(lambda: stands_at(aboard))
    look("from below")
    wait_for(lambda: stands_at(row["p_WB"] + [-0.9, -1.1, -0.9]))
    look("overview")
    wait_for(lambda: stands_at(first))
    shown = "window.skywright.player.layout.trace, window.skywright.player.frames.find({})"
    assert page.evaluate(shown.format(0.0)) == 0

    def read_clock() -> float:
        return float(clock.inner_text().split(" ")[0])

    page.get_by_role("group", name="Phases").get_by_role("button").last.click()
    expect(phase).to_have_text("land")
    before = read_clock()
    page.get_by_role("button", name="▶ play").click()
    wait_for(lambda: read_clock() > before)
    # by keyboard: space pauses, an arrow steps
    page.locator("#canvas").focus()
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="▶ play")).to_be_visible()
    page.locator("#canvas").blur()
    at = read_clock()
    page.keyboard.press("ArrowLeft")
    assert read_clock() == pytest.approx(at - 1.0, abs=0.06)
    assert not [url for url in asked if not url.startswith(("file:", "data:", "blob:"))]
    expect(page.locator("#banner")).to_be_hidden()


@pytest.mark.browser
def test_plots_of_a_robot_that_stands_still_have_ticks(
    flight: RunResult, open_page: Callable[..., Page]
) -> None:
    """Values that differ by the resolution of a float: uPlot alone computes ticks without end."""
    page = open_page()
    page.goto(write_replay(flight).resolve().as_uri())
    expect(page.locator("#phase")).not_to_be_empty()
    ranges = page.evaluate(
        """() => {
            const p = window.skywright.player.plots;
            p.fill([1, 2, 3], p.channels.map(() => [2, Math.fround(2.0000002), 2]));
            const free = p.plots.filter((u, i) => u && p.channels[i].limit === null);
            return new Promise((done) => setTimeout(
                () => done(free.map((u) => u.scales.y.max - u.scales.y.min)), 100));
        }"""
    )
    assert ranges
    assert all(1e-4 < r < 0.6 for r in ranges)  # a few steps of the last digit shown
