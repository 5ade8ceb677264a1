"""The 3-D replay: what is drawn stands where it was flown, in one page that plays offline."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chromium_page import open_page
from exact_map import EXACT
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
from skywright.reports.meshes import Mesh, build_mesh, build_ribbon
from skywright.reports.replay import build_overlay_data, build_replay, write_replay
from skywright.reports.scene3d import (
    FOV,
    Scene3d,
    _list_edges,
    build_views,
    start_server,
    stop_server,
    weld_curve,
)
from skywright.reports.trace3d import (
    FREE,
    GOOD,
    LIFTED,
    TILTED,
    build_legend,
    build_trace,
    list_judged,
)
from skywright.run.run import RunResult, run_mission
from waiting import wait_for

SHORT = (
    *EXACT,
    "mission.task.passes=2", "mission.task.pass_length_m=0.04", "mission.task.arc_deg=10",
    "mission.task.speed_mps=0.02",
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
    server = start_server()
    try:
        scene = Scene3d(server, description.robot, description.world)
        poses = scene.compute_poses(samples).nodes
    finally:
        stop_server(server)
    assert description.robot.probe is not None
    length = description.robot.probe.length_m
    for i in range(2):
        holder, slider = poses["/holder"], poses["/holder/slider"]
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
    assert list_judged(d.robot, d.world) == ()  # though its last phase is called settle
    meanings = [text for _, text in build_legend(d.robot, d.world, False)]
    assert "limits of the area" in meanings
    edges = _list_edges((0.0, 1.0), (0.0, 2.0), (0.0, 3.0))
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert sorted(lengths) == [1.0] * 4 + [2.0] * 4 + [3.0] * 4
    scan = load_description("pipe-weld-scan")
    assert "scan" in list_judged(scan.robot, scan.world)


def test_trace_is_coloured_by_contact_quality() -> None:
    samples = np.zeros(5, SAMPLE)
    samples["gap"] = samples["gap_max"] = [0.05, 0.0, 0.0, 0.002, 0.0]
    samples["gap_max"][4] = 0.0015  # lifted between two samples
    samples["tilt"] = np.radians([50.0, 3.0, 12.0, 12.0, 0.0])
    judged = np.array([False, True, True, True, True])
    _, colours = build_trace(samples, judged, arm=True)
    assert [tuple(c) for c in colours] == [FREE, GOOD, TILTED, LIFTED, LIFTED]
    points, colours = build_trace(samples, judged, arm=False)
    assert np.all(colours == FREE) and np.all(points == samples["p_WB"])


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


def test_replay_is_small_quick_and_complete(scan: RunResult) -> None:
    write_replay(scan)  # imports and first use
    start = time.process_time()
    path = write_replay(scan)
    assert time.process_time() - start < 4.0  # about 0.3 s
    assert path == scan.directory / "replay.html" and path.stat().st_size < 5_000_000
    page = path.read_text(encoding="utf-8")
    assert "<title>pipe-weld-scan: replay</title>" in page
    assert "__DATA__" not in page and "__VISER_EMBED_DATA__" in page


def test_numbers_of_the_overlay_are_those_of_the_recording(scan: RunResult) -> None:
    data = build_overlay_data(scan, scan.samples)
    json.dumps(data, allow_nan=False)
    assert [p["name"] for p in data["phases"]] == [p.name.replace("_", " ") for p in scan.phases]
    numbers = {n["name"]: n for n in data["numbers"]}
    assert numbers["air gap"]["limit"] == 1.0 and numbers["probe tilt"]["limit"] == 10.0
    i = len(scan.samples) // 2
    shown = numbers["height"]["values"][i // round(100 * data["period"])]
    rows = scan.samples[:: round(100 * data["period"])]
    assert shown == pytest.approx(rows["p_WB"][i // round(100 * data["period"]), 2], abs=0.006)
    assert numbers["air gap"]["values"][0] is None  # far away a gap means nothing
    assert ["#d628aa", "detected weld"] in data["legend"]


def test_robot_without_arm_has_its_own_numbers(flight: RunResult) -> None:
    data = build_overlay_data(flight, flight.samples)
    assert {"off the path", "speed", "platform tilt"} <= {n["name"] for n in data["numbers"]}
    assert not any("weld" in text for _, text in data["legend"])


def test_diverged_and_empty_runs_still_give_a_page(flight: RunResult) -> None:
    broken = flight.samples[:400].copy()
    broken["p_WB"][300:] = np.nan
    assert "sky-panel" in build_replay(flight._replace(samples=broken, outcome="diverged"))
    empty = flight._replace(samples=flight.samples[:0], phases=[], outcome="interrupted")
    assert "sky-panel" in build_replay(empty)


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
    for mission in ("tool-install", "pipe-weld-scan", "bridge-contact", "bar-transport"):
        d = load_description(mission)
        mount = find_mount(d.robot, build_drawing(d.robot, d.world))
        axes = np.stack([mount.forward, mount.up])
        np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-12)
        model, q = build_body_model(d.robot), posture(d.robot, "working")
        hands = is_compliant(d.robot)
        work = find_hands(model, q).mean(axis=0) if hands else compute_tip(model, q)[0]
        seen = (work - mount.position) @ mount.forward / np.linalg.norm(work - mount.position)
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
    scan: RunResult, chromium: str, tmp_path: Path
) -> None:
    """The viewer starts, goes to a time, and the overlay names the phase and its numbers."""
    path = write_replay(scan)
    sliding = next(p for p in scan.phases if p.name == "scan")
    t = 0.5 * (sliding.start_s + sliding.end_s)
    url = f"{path.resolve().as_uri()}#t={t:.1f}"
    offline = "--host-resolver-rules=MAP * ~NOTFOUND"
    with open_page(chromium, url, tmp_path / "profile", offline) as evaluate:

        def read(selector: str) -> str:
            return str(evaluate(f"(document.querySelector({selector!r}) || {{}}).innerText"))

        wait_for(lambda: f"{t:.1f} / " in read("#sky-panel .now"))
        assert read("#sky-panel .now").startswith("scan")
        assert re.search(r"push on the pipe\s+\d\.\d\d N", read("#sky-panel table"))
        assert read("#sky-phases .on") == "scan"
        held = """(() => {
            const canvas = document.querySelector("#root canvas");
            const key = canvas && Object.keys(canvas).find((k) => k.startsWith("__reactFiber$"));
            let f = key ? canvas[key] : null;
            while (f && !f.memoizedProps?.value?.mutable?.current?.cameraControl) f = f.return;
            return f?.memoizedProps.value.mutable.current;
        })()"""

        def stands_at(place: np.ndarray) -> bool:
            """Whether the camera is there (in W; three.js has y up); no before it is known."""
            at = evaluate(f"{held}?.camera?.matrixWorld.elements.slice(12, 15)")
            root = evaluate(f"{held}?.nodePoseData?.['']?.wxyz")
            if at is None or root is None:
                return False
            root = np.array(root, float)
            to_world = rot_from_quat(root / np.linalg.norm(root)).T
            return np.allclose(to_world @ np.array(at), place, atol=0.02)

        click = "[...document.querySelectorAll('#sky-panel .views a')].at({}).click()"
        d = scan.description
        first = build_views(d.robot, d.world, scan.samples["p_WB"][::50])[0].position
        wait_for(lambda: stands_at(first))
        evaluate(click.format(-1))  # the first person
        mount = find_mount(d.robot, build_drawing(d.robot, d.world))
        row = scan.samples[np.searchsorted(scan.samples["t"], t + scan.samples["t"][0])]
        aboard = row["p_WB"] + rot_from_quat(row["q_WB"]) @ mount.position
        wait_for(lambda: stands_at(aboard))
        evaluate(click.format(0))
        wait_for(lambda: stands_at(first))
        evaluate("[...document.querySelectorAll('#sky-phases div')].at(-1).click()")  # back and on
        wait_for(lambda: read("#sky-panel .now").startswith("land"))
        loaded = evaluate("performance.getEntriesByType('resource').map((e) => e.name).join(' ')")
        assert not re.search(r"https?:", str(loaded))
