"""Transforms of a flight against forward kinematics by other people's programs.

rosbags decodes the recording, Pinocchio places the links of /robot_description; no code of ours
takes part once the recording is written.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader

from cut_flights import Until
from skywright.description.loader import load_description
from skywright.run.run import run_mission

Array = NDArray[np.float64]
ROBOTS = {
    "othex": ("pipe-weld-scan", {
        "mission.task.passes": 1, "mission.task.pass_length_m": 0.05, "mission.task.survey": False,
        "mission.timestep_ms": 2,
    }),
    "bimanual-longreach": ("impact", {}),
}  # fmt: skip
"""An arm with a sprung probe, and two arms on a pendulum; missions that move their joints."""
SPRUNG = ("slider", "tip")
"""Links of the probe behind its spring. The URDF has it released; /contact/state tells by how much
it is compressed, along x of the holder."""


@pytest.fixture(scope="module", params=ROBOTS)
def messages(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, list[tuple[int, Any]]]:
    """Messages of a short flight by topic, with their stamps (ns)."""
    mission, sets = ROBOTS[request.param]
    out = tmp_path_factory.mktemp("flight") / "run"
    d = load_description(mission, request.param, sets=sets)
    result = run_mission(d, out=out, observers=[Until("return")])
    return read_messages(result.directory / "recording.mcap")


def read_messages(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Decode the messages of 200 instants at which /tf is written, and 200 of each other topic."""
    raw: dict[str, list[tuple[int, str, bytes]]] = {}
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([path]) as reader:
        for connection, stamp, data in reader.messages():
            raw.setdefault(connection.topic, []).append((stamp, connection.msgtype, data))
        instants = {stamp for stamp, _, _ in raw["/tf"][:: max(len(raw["/tf"]) // 200, 1)]}
        for topic, several in raw.items():
            step = max(len(several) // 200, 1)
            found[topic] = [
                (stamp, reader.deserialize(data, kind))
                for i, (stamp, kind, data) in enumerate(several)
                if stamp in instants or (topic != "/tf" and i % step == 0)
            ]
    return found


def as_matrix(transform: Any) -> Array:
    """Return a geometry_msgs/Transform as (4, 4)."""
    p, q = transform.translation, transform.rotation
    out = np.eye(4)
    out[:3, :3] = pin.Quaternion(q.w, q.x, q.y, q.z).toRotationMatrix()
    out[:3, 3] = p.x, p.y, p.z
    return out


def chain(transforms: dict[str, tuple[str, Array]], frame: str) -> Array:
    """Return the pose (4, 4) of a frame in `map`, by its parents' transforms."""
    out = np.eye(4)
    while frame != "map":
        frame, step = transforms[frame]
        out = step @ out
    return out


def test_transforms_are_the_forward_kinematics_of_the_urdf(
    messages: dict[str, list[tuple[int, Any]]],
) -> None:
    """Every link, at 200 instants of the flight: within 1 micrometre and 1 microradian."""
    [(_, text)] = messages["/robot_description"]
    [(_, static)] = messages["/tf_static"]
    model = pin.buildModelFromXML(text.data, pin.JointModelFreeFlyer())
    data = model.createData()
    links = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
    joints, spring = dict(messages["/joints"]), dict(messages.get("/contact/state", []))
    moved = []
    for stamp, tf in messages["/tf"]:
        transforms = {
            t.child_frame_id: (t.header.frame_id, as_matrix(t.transform))
            for t in (*static.transforms, *tf.transforms)
        }
        assert transforms["platform"][0] == "map"
        state = joints[stamp]
        angles = dict(zip(state.name, state.position, strict=True))
        assert set(angles) == {name for name in model.names[2:]}
        platform = pin.SE3(transforms["platform"][1])
        q = pin.neutral(model)
        q[:7] = pin.SE3ToXYZQUAT(platform)
        for name, angle in angles.items():
            q[model.joints[model.getJointId(name)].idx_q] = angle
        pin.framesForwardKinematics(model, data, q)
        for link in links:
            pose = data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
            if link in SPRUNG and "holder" in links:
                holder = data.oMf[model.getFrameId("holder", pin.FrameType.BODY)]
                pressed = pin.SE3(np.eye(3), np.array([-spring[stamp].spring, 0.0, 0.0]))
                pose = holder * pressed * holder.inverse() * pose
            error = pin.log6(pose.inverse() * pin.SE3(chain(transforms, link))).vector
            assert np.max(np.abs(error)) < 1e-6, (link, stamp, error)
        moved.append(q)
    assert len(moved) >= 150 and len(links) >= 10
    swept = np.ptp(np.array(moved), axis=0)
    assert np.sort(swept[7:])[-2] > 0.05, "the joints of the flight hardly moved"


def test_every_frame_that_a_topic_names_is_in_the_tree(
    messages: dict[str, list[tuple[int, Any]]],
) -> None:
    [(_, static)] = messages["/tf_static"]
    parents = {
        t.child_frame_id: t.header.frame_id
        for _, message in messages["/tf"]
        for t in (*message.transforms, *static.transforms)
    }
    named = {
        frame: topic
        for topic, several in messages.items()
        for _, message in several
        if hasattr(message, "header")
        for frame in message.header.frame_id.split(", ")
        if frame
    }
    assert len(named) >= 2
    for frame, topic in named.items():
        way = [frame.partition(" (")[0]]  # a twist says of which part: "map (linear)"
        while way[-1] != "map":
            assert way[-1] in parents, f"{topic}: frame {frame!r} is not in the tree"
            way.append(parents[way[-1]])
            assert len(way) <= len(parents) + 1, f"{frame} hangs in a circle"
