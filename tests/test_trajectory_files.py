"""Trajectory files as others write them, and what must be refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from skywright.analysis.locate.point_file import load_points, pair_points
from skywright.analysis.locate.trajectory_file import load_trajectory, name_column
from skywright.analysis.locate.trajectory_mcap import _decode_message
from skywright.errors import InputError
from skywright.models.localisation.trajectory import (
    Trajectory,
    find_covered,
    interpolate_position,
    remove_spikes,
)
from skywright.recordings.cdr import HEADER
from skywright.recordings.mcap_file import McapWriter, build_message_header
from skywright.recordings.messages import definition, full_name

TUM = """# timestamp(s) tx ty tz qx qy qz qw
1403715273.26214 0.878895 2.183400 0.948427 -0.824237 -0.106942 -0.551702 0.069433
1403715273.31214 0.878973 2.183480 0.948329 -0.824253 -0.106951 -0.551676 0.069437
"""
EUROC = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], "
    "b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], "
    "b_a_RS_S_z [m s^-2]\n"
    "1403636645813555456,-1.78,5.20,0.62,0.548,-0.142,-0.818,-0.091" + ",0" * 9 + "\n"
    "1403636645963555584,-1.89,5.30,0.63,0.551,-0.145,-0.816,-0.091" + ",0" * 9 + "\n"
)


def write(folder: Path, text: str | bytes, name: str = "data.txt") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def load(folder: Path, text: str | bytes) -> Trajectory:
    return load_trajectory(str(write(folder, text)))


def test_tum_is_read_with_its_quaternion_order(tmp_path):
    traj = load(tmp_path, TUM)
    assert traj.t == pytest.approx([1403715273.26214, 1403715273.31214], abs=1e-6)
    assert traj.p[1] == pytest.approx([0.878973, 2.18348, 0.948329])
    assert traj.q is not None
    assert traj.q[0] == pytest.approx([0.069433, -0.824237, -0.106942, -0.551702], abs=1e-5)
    bare = load(tmp_path, TUM.split("\n", 1)[1])  # without the comment: the same
    assert np.array_equal(bare.p, traj.p) and np.array_equal(bare.q, traj.q)


def test_euroc_is_read_with_nanoseconds_and_its_order(tmp_path):
    traj = load(tmp_path, EUROC)
    assert np.diff(traj.t) == pytest.approx([0.15], abs=1e-6)
    assert traj.p[0] == pytest.approx([-1.78, 5.20, 0.62])
    assert traj.q is not None
    assert traj.q[0] * np.sign(traj.q[0, 0]) == pytest.approx(
        np.array([0.548, -0.142, -0.818, -0.091]) / np.linalg.norm([0.548, -0.142, -0.818, -0.091])
    )
    bare = load(tmp_path, EUROC.split("\n", 1)[1])
    assert bare.p == pytest.approx(traj.p) and any("EuRoC" in n for n in bare.notes)


def test_leica_of_euroc_has_no_orientation(tmp_path):
    head = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]\n"
    traj = load(tmp_path, head + "1403636578013555456,4.67,-1.75,0.82\n1403636578063555584,1,2,3\n")
    assert traj.q is None and traj.p[0] == pytest.approx([4.67, -1.75, 0.82])


def test_units_and_mixed_units(tmp_path):
    traj = load(tmp_path, "z_cm;t_ms;x_mm;y_m\n300;0;1500;2\n300;10;1500;2\n")
    assert traj.t == pytest.approx([0.0, 0.01])
    assert traj.p[0] == pytest.approx([1.5, 2.0, 3.0])
    head = "Time [Seconds],x (metres),y [m],z [inches]\n"
    traj = load(tmp_path, head + "0,1,2,10\n0.5,1,2,10\n")
    assert traj.t == pytest.approx([0.0, 0.5]) and traj.p[0] == pytest.approx([1.0, 2.0, 0.254])
    assert not traj.notes


def test_rostopic_export_takes_the_message_s_own_time(tmp_path):
    names = "%time,field.header.seq,field.header.stamp,field.header.frame_id," + ",".join(
        f"field.pose.pose.{a}" for a in ("position.x", "position.y", "position.z",
        "orientation.x", "orientation.y", "orientation.z", "orientation.w"))  # fmt: skip
    rows = "".join(f"9{k}00000000000000000,1,14036365780{k}0000000,map,1,2,{k},0,0,0,1\n"
                   for k in range(1, 4))  # fmt: skip
    traj = load(tmp_path, names + "\n" + rows)
    assert np.diff(traj.t) == pytest.approx([0.01, 0.01], rel=1e-4)
    assert traj.q is not None and traj.q[0] == pytest.approx([1, 0, 0, 0])


def test_a_word_in_brackets_that_is_no_unit_is_read_past(tmp_path):
    for head in ("time (UTC),x,y,z", "t [epoch],x (East),y (North),z (Up)"):
        traj = load(tmp_path, f"{head}\n0,1,2,3\n1,1,2,3\n")
        assert traj.t.tolist() == [0, 1] and traj.p.tolist() == [[1, 2, 3]] * 2


def test_flaws_are_repaired_and_noted(tmp_path):
    rows = ["t_s,x_m,y_m,z_m", "3,1,1,1", "1,1,1,1", "2,nan,1,1", "2,1,1,1", "2,9,9,9", "4,1,1"]
    traj = load(tmp_path, "\n".join(rows))
    assert traj.t.tolist() == [1, 2, 3]
    assert traj.p.tolist() == [[1, 1, 1]] * 3
    text = " ".join(traj.notes)
    assert "line 4" in text and "sorted" in text and "duplicate" in text and "line 7" in text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("  \n\n", "is empty"),
        ("# only\n# comments\n", "only comments"),
        (bytes(range(256)) * 8, "neither text nor MCAP"),
        ("t_s,x_m,y_m,z_m\n", "no rows of numbers"),
        ("t_s,x_m,y_m,z_m\n0,1,2,3\n", "at least 2"),
        ("t_s,x_m,y_m,z_m\n0,1,2,3\n0,1,2,3\n", "the same time"),
        ("t_s,x_m,y_m\n0,1,2\n1,1,2\n", "no column z"),
        ("x_m,y_m,z_m\n0,1,2\n1,1,2\n", "no time"),
        ("t_s,x_m,x_mm,y_m,z_m\n0,1,2,3,4\n", "two columns give x"),
        ("t_s,x [furlong],y,z\n0,1,2,3\n1,1,2,3\n", "unknown unit 'furlong'"),
        ("time [min],x,y,z\n0,1,2,3\n1,1,2,3\n", "line 1: unknown unit 'min' of t; valid: s, "),
        ("time [m],x,y,z\n0,1,2,3\n1,1,2,3\n", "unknown unit 'm' of t"),
        ("t_s,x (usft),y,z\n0,1,2,3\n1,1,2,3\n", "unknown unit 'usft' of x; valid: m, mm"),
        ("# time [h] x y z\n0 1 2 3\n1 1 2 3\n", "line 1: unknown unit 'h' of t"),
        ("time,lat,lon,alt\n0,1,2,3\n1,1,2,3\n", "no column x"),
        ("t_s,x_m,y_m,z_m\n0,1,2\n1,2,3\n2,3,4\n", "line 2: 3 cells where 4"),
        ("t_s,x_m,y_m,z_m\na,b,c,d\ne,f,g,h\n1,1,1,1\n", "line 2"),
        (" ".join(["1.0"] * 12) + "\n", "KITTI"),
        ("1 2 3\n4 5 6\n", "3 columns without names"),
        ("t_s,x_m,y_m,z_m\n0,1e99,2,3\n1,1e99,2,3\n", "at least"),
        ("# Title\nsome prose, with commas,\nand more of it\n", "no time"),
    ],
)
def test_refused_in_one_line_that_names_the_file(tmp_path, text, said):
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        load(tmp_path, text)
    assert "data.txt" in str(caught.value) and "\n" not in str(caught.value)


def test_refused_paths(tmp_path):
    for name, said in ((str(tmp_path), "is a directory"), (str(tmp_path / "no"), "No such file")):
        with pytest.raises(InputError, match=said):
            load_trajectory(name)
    path = write(tmp_path, TUM)
    with pytest.raises(InputError, match="not an MCAP file"):
        load_trajectory(f"{path}:/pose")


numbers = st.floats(-1e4, 1e4, allow_nan=False).map(lambda x: round(x, 6))


@given(
    st.lists(st.tuples(numbers, numbers, numbers), min_size=2, max_size=20),
    st.sampled_from([",", ";", "\t", " "]),
    st.permutations(["t_s", "x_m", "y_m", "z_m", "note"]),
    st.randoms(use_true_random=False),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_order_delimiter_and_sorting_gives_the_same(tmp_path, rows, delimiter, order, random):
    lines = []
    for k, p in enumerate(rows):
        cells = dict(zip(["t_s", "x_m", "y_m", "z_m", "note"], [0.1 * k, *p, 7], strict=True))
        lines.append(delimiter.join(repr(cells[name]) for name in order))
    random.shuffle(lines)
    traj = load(tmp_path, "\n".join([delimiter.join(order), *lines]))
    assert traj.t == pytest.approx(0.1 * np.arange(len(rows)))
    assert traj.p == pytest.approx(np.array(rows))


@given(st.binary(max_size=300) | st.text(max_size=300).map(str.encode))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
def test_anything_else_is_an_input_error_or_a_trajectory(tmp_path, data):
    try:
        traj = load(tmp_path, data)
    except InputError as error:
        assert "\n" not in str(error).strip() or "data.txt" in str(error)
    else:
        assert np.all(np.diff(traj.t) > 0) and np.all(np.isfinite(traj.p))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("x", ("x", None)), ("x_mm", ("x", 1e-3)), ("Pos_X [m]", ("x", 1.0)), ("ty", ("y", None)),
        ("pz", ("z", None)), ("qw", ("qw", 1.0)), ("q_RS_x []", ("qx", 1.0)),
        ("timestamp [ns]", ("t", 1e-9)), ("time(ms)", ("t", 1e-3)), ("vx", None), ("v_x", None),
        ("twist.linear.x", None), ("bias_x", None), ("pose.position.z", ("z", None)),
        ("pose.orientation.w", ("qw", 1.0)), ("x_std_m", None), ("w", None), ("", None),
    ],
)  # fmt: skip
def test_names_of_columns(name, expected):
    assert name_column(name) == expected


# --- MCAP ---------------------------------------------------------------------------------------

KINDS = {
    "geometry_msgs/PointStamped": False, "geometry_msgs/PoseStamped": True,
    "nav_msgs/Odometry": True, "geometry_msgs/TransformStamped": True,
}  # fmt: skip


def serialise(
    kind: str, t: float, p: list[float], frame: str, q_xyzw: tuple[float, ...] = (0, 0, 0.6, 0.8)
) -> bytes:
    """One message by an independent implementation of CDR."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    make = lambda name, *values: types[name](*values)  # noqa: E731
    sec = int(t)
    stamp = make("builtin_interfaces/msg/Time", sec, round(1e9 * (t - sec)))
    header = make("std_msgs/msg/Header", stamp, frame)
    point, turn = make("geometry_msgs/msg/Point", *p), make(
        "geometry_msgs/msg/Quaternion", *q_xyzw)  # fmt: skip
    vector = make("geometry_msgs/msg/Vector3", *p)
    pose = make("geometry_msgs/msg/Pose", point, turn)
    name = full_name(kind)
    if kind.endswith("PointStamped"):
        message = make(name, header, point)
    elif kind.endswith("PoseStamped"):
        message = make(name, header, pose)
    elif kind.endswith("TransformStamped"):
        message = make(name, header, "child", make("geometry_msgs/msg/Transform", vector, turn))
    else:
        zero = make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        cov = np.zeros(36)
        twist = make("geometry_msgs/msg/TwistWithCovariance",
                     make("geometry_msgs/msg/Twist", zero, zero), cov)  # fmt: skip
        message = make(name, header, "a_child",
                       make("geometry_msgs/msg/PoseWithCovariance", pose, cov), twist)  # fmt: skip
    return bytes(store.serialize_cdr(message, name))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("frame", ["", "map", "a_long_frame"])
def test_messages_of_an_independent_writer(kind, frame):
    raw = serialise(kind, 12.25, [1.5, -2.5, 3.5], frame)
    strings = 1 if kind in ("nav_msgs/Odometry", "geometry_msgs/TransformStamped") else 0
    values = _decode_message(raw, strings, KINDS[kind])
    assert values[:4] == pytest.approx([12.25, 1.5, -2.5, 3.5])
    if KINDS[kind]:
        assert values[4:] == pytest.approx([0, 0, 0.6, 0.8])


def write_mcap(path: Path, topics: dict[str, tuple[str, list[bytes]]]) -> None:
    with path.open("wb") as stream:
        writer = McapWriter(stream, "test")
        for topic, (kind, messages) in topics.items():
            schema = definition(kind) if kind.startswith("geometry") else "std_msgs/Header header"
            channel = writer.add_channel(topic, full_name(kind), schema)
            data, offsets = b"", []
            for k, raw in enumerate(messages):
                offsets.append(len(data))
                data += build_message_header(channel, len(raw), k) + raw
            if messages:
                writer.add_chunk(data, np.arange(len(messages)), {channel: np.array(offsets)})
        writer.finish()


def test_topics_of_a_recording(tmp_path):
    path = tmp_path / "flight.mcap"
    point, odometry = "geometry_msgs/PointStamped", "nav_msgs/Odometry"
    write_mcap(path, {
        "/leica": (point, [serialise(point, 0.1 * k, [k, 2, 3], "map") for k in range(5)]),
        "/vio": (odometry, [serialise(odometry, 0.05 * k, [k, 1, 1], "o") for k in range(9)]),
        "/other": ("geometry_msgs/Vector3Stamped", [HEADER + bytes(40)]),
    })  # fmt: skip
    station = load_trajectory(f"{path}:/leica")
    assert station.q is None and station.p[:, 0].tolist() == [0, 1, 2, 3, 4]
    camera = load_trajectory(f"{path}:/vio")
    assert camera.q is not None and camera.q[0] == pytest.approx([0.8, 0, 0, 0.6])
    assert camera.t == pytest.approx(0.05 * np.arange(9))
    with pytest.raises(InputError, match=r"name one as flight\.mcap:TOPIC, valid: /leica, /vio"):
        load_trajectory(str(path))
    with pytest.raises(InputError, match="no trajectory '/loica'; valid: /leica"):
        load_trajectory(f"{path}:/loica")


def test_messages_before_the_first_estimate_are_dropped(tmp_path):
    """The estimate is at the origin until the estimator is ready; other topics may start there."""
    path, kind, none = tmp_path / "run.mcap", "geometry_msgs/PoseStamped", (0.0, 0.0, 0.0, 1.0)
    unset = [serialise(kind, 0.1 * k, [0, 0, 0], "map", none) for k in range(3)]
    known = [serialise(kind, 0.3 + 0.1 * k, [0, k, 0], "map", none) for k in range(1, 6)]
    write_mcap(
        path, {"/estimate/pose": (kind, unset + known), "/truth/pose": (kind, unset + known)}
    )
    found = load_trajectory(f"{path}:/estimate/pose")
    assert found.p[:, 1].tolist() == [1, 2, 3, 4, 5]
    assert found.notes == ("3 messages before the first estimate dropped",)
    assert len(load_trajectory(f"{path}:/truth/pose").t) == 8
    write_mcap(path, {"/estimate/pose": (kind, unset)})
    with pytest.raises(InputError, match="/estimate/pose contains no estimate; valid: a recording"):
        load_trajectory(f"{path}:/estimate/pose")


def test_recordings_without_a_trajectory_are_refused(tmp_path):
    path = tmp_path / "x.mcap"
    write_mcap(path, {"/other": ("geometry_msgs/Vector3Stamped", [HEADER + bytes(40)])})
    with pytest.raises(InputError, match="contains no trajectory; its topics: /other"):
        load_trajectory(str(path))
    write_mcap(path, {"/p": ("geometry_msgs/PointStamped", [b"\0\1\0\0" + bytes(3)] * 4)})
    with pytest.raises(InputError, match="0 of 4 rows"):
        load_trajectory(str(path))
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match=r"x\.mcap"):
        load_trajectory(str(path))


# --- points -------------------------------------------------------------------------------------


def test_points(tmp_path):
    path = write(tmp_path, "y_mm, name, x_m, z_m\n2000, A, 1, 3\n0, B, 0, 0\n", "p.csv")
    points = load_points(path)
    assert points["A"] == pytest.approx([1, 2, 3])
    few = write(tmp_path, "name,x_m,y_m,z_m\nA,1,2,3\n", "few.csv")
    with pytest.raises(InputError, match="1 points in common"):
        pair_points(path, few)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name,x_m,y_m,z_m\n", "no points"),
        ("a,b,c,d\nA,1,2,3\n", "found the header"),
        ("name,x_m,y_m,z_m\nA,1,2\n", "line 2"),
        ("name,x_m,y_m,z_m\nA,1,2,3\nA,1,2,3\n", "occurs twice"),
        ("name,x_m,y_m,z_m\nA,1,2,nan\n", "no finite position"),
        ("name,x [usft],y,z\nA,1,2,3\n", "line 1: unknown unit 'usft' of x; valid: m, mm"),
        ("name,x_m,y_m,z [s]\nA,1,2,3\n", "unknown unit 's' of z"),
        ("", "is empty"),
    ],
)
def test_refused_points(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        load_points(write(tmp_path, text, "p.csv"))


# --- interpolation ------------------------------------------------------------------------------


def test_gaps_are_not_bridged():
    t = np.array([0.0, 1.0, 2.0, 10.0, 11.0])
    traj = Trajectory("x", t, np.stack([t, 2 * t, 3 * t], axis=1))
    at = np.array([-0.1, 0.0, 0.5, 2.0, 5.0, 10.0, 10.5, 11.1])
    assert find_covered(t, at, 1.5).tolist() == [False, True, True, True, False, True, True, False]
    p = interpolate_position(traj, at, 1.5)
    good = np.isfinite(p[:, 0])
    assert p[good] == pytest.approx(np.outer(at[good], [1, 2, 3]))


def test_spikes_are_removed_and_motion_is_kept():
    t = np.sort(np.random.default_rng(1).uniform(0, 20, 200))
    p = np.stack([np.sin(t), np.cos(t), 0.1 * t], axis=1)
    bad = [20, 21, 90, 150]
    q = p.copy()
    q[bad] += [[0.5, 0, 0], [0, 0.8, 0], [0, 0, -2], [1, 1, 1]]
    kept = remove_spikes(Trajectory("x", t, q))
    assert not np.isin(t[bad], kept.t).any()
    assert len(kept.t) >= len(t) - len(bad) - 3
