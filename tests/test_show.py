"""The picture of `skywright show`: what it shows is the geometry that is simulated."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.core.rotations import rot_z
from skywright.description.loader import load_description
from skywright.description.lookup import Subject, find_any
from skywright.description.world.surface import build_cylinder, unroll_points
from skywright.missions.scan.figures import compute_angle_std, place_at_work, scan_path
from skywright.models.rigid_body import build_body_model, compute_tip, posture
from skywright.models.rotors import build_rotors
from skywright.reports.show import (
    draw_mission,
    draw_world,
    write_show_figure,
)
from skywright.reports.show_robot import CCW, CW, draw_robot, pad_joints
from skywright.reports.summary import describe_world

SUBJECTS = ("othex", "f550-bridge", "hexarotor", "pipe", "open", "pipe-weld-scan", "waypoints")


@pytest.mark.parametrize("name", SUBJECTS)
def test_every_built_in_has_a_picture(name: str, tmp_path: Path) -> None:
    write_show_figure(find_any(name), tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    if name in ("hexarotor", "open", "waypoints"):  # one of each kind
        write_show_figure(find_any(name), tmp_path / "a.svg")
        assert "<svg" in (tmp_path / "a.svg").read_text(encoding="utf-8")[:1000]


def _texts(figure) -> str:
    own = [t.get_text() for t in figure.texts] + [figure.get_suptitle()]
    for ax in figure.axes:
        own += [t.get_text() for t in ax.texts]
        own += [ax.get_title(), ax.get_xlabel(), ax.get_ylabel()]
        legend = ax.get_legend()
        own += [t.get_text() for t in legend.get_texts()] if legend else []
    return "\n".join(own)


def test_robot_picture_names_masses_rotors_and_joints() -> None:
    robot = find_any("othex").robot
    assert robot is not None
    text = _texts(draw_robot(robot))
    for words in ("1.6 kg", "2.25 kg", "link1", "-150..120°", "200 N/m", "1.2 m", "thrust",
                  "x in B (m)", "arm folded"):  # fmt: skip
        assert words in text, words


def test_thrust_arrows_point_along_the_rotor_axes() -> None:
    robot = find_any("othex").robot
    assert robot is not None
    side = draw_robot(robot).axes[1]
    rotors = build_rotors(robot.rotors)
    arrows = [t for t in side.texts if t.get_text() == "" and getattr(t, "arrow_patch", None)]
    assert len(arrows) == len(rotors.axis)
    for arrow, axis, spin in zip(arrows, rotors.axis, robot.rotors.spin, strict=True):
        way = np.array(arrow.xy) - np.array(arrow.xyann)
        assert way[0] * axis[2] == pytest.approx(way[1] * axis[0])
        assert way[1] > 0.0  # upwards
        colour = arrow.arrow_patch.get_edgecolor()
        red = int((CCW if spin == "ccw" else CW)[1:3], 16) / 255
        assert colour[0] == pytest.approx(red)


def test_robot_at_work_touches_the_middle_of_the_scan() -> None:
    """Also where the pipe is turned: the tip is on the surface, the probe square on it."""
    sets = ("world.pipe.yaw_deg=40", "mission.task.centre_s_m=0.03")
    d = load_description("pipe-weld-scan", sets=sets)
    assert d.world.pipe is not None
    ghost = place_at_work(d.robot, d.world.pipe, d.mission.task)
    assert ghost is not None
    place, heading = ghost
    q = pad_joints(posture(d.robot, "working"))
    p_BT, R_BT = compute_tip(build_body_model(d.robot), q)
    tip = place + rot_z(heading) @ p_BT
    found = np.ravel(unroll_points(build_cylinder(d.world.pipe), tip[None]))
    assert found == pytest.approx([0.03, 0.0, 0.0])
    axis = rot_z(heading) @ R_BT[:, 2]
    assert axis[:2] @ [math.cos(math.radians(40)), math.sin(math.radians(40))] > 0.99


def test_underside_has_no_working_pose_of_a_level_platform() -> None:
    d = load_description("pipe-weld-scan", sets=("mission.task.side=underside",))
    assert d.world.pipe is not None
    assert place_at_work(d.robot, d.world.pipe, d.mission.task) is None
    assert "from the side" in _texts(draw_mission(d))


def test_the_angle_of_a_weld_has_the_uncertainty_of_the_surveyed_axis() -> None:
    """In front of the pipe a rotation about its horizontal x turns the weld, at its top about z."""
    known = {"survey.turn_up_std_deg": 0.3, "survey.turn_aside_std_deg": 0.1}
    surface = SimpleNamespace(radius=0.2)
    for phi, axis in (
        (0.0, 0.3),
        (0.5 * math.pi, 0.1),
        (0.25 * math.pi, math.hypot(0.3, 0.1) / 2**0.5),
    ):
        line: Any = SimpleNamespace(std_angle=math.radians(0.04), c=0.2 * phi)
        run: Any = SimpleNamespace(
            metrics=known, details=SimpleNamespace(surface=surface),
            description=SimpleNamespace(plant=SimpleNamespace(map_error_deg=3.0)),
        )  # fmt: skip
        assert compute_angle_std(run, line) == pytest.approx(math.hypot(0.04, axis))
        run.metrics = {}  # no survey: the map's error remains
        assert compute_angle_std(run, line) == pytest.approx(math.hypot(0.04, math.sqrt(3.0)))
        run.description.plant.map_error_deg = 0.0
        assert compute_angle_std(run, line) == pytest.approx(0.04)


def test_the_tubes_of_a_world_are_listed() -> None:
    rows = dict(describe_world(load_description("bar-transport").world)[0].rows)
    said = [v for v in rows.values() if v.startswith("tube of ")]
    assert said and all(" m diameter from (" in v and ") to (" in v for v in said)


def test_scan_path_covers_the_sector() -> None:
    d = load_description("pipe-weld-scan")
    assert d.world.pipe is not None
    s, phi = scan_path(d.mission.task, d.world.pipe)
    assert np.ptp(s) == pytest.approx(d.mission.task.pass_length_m)
    assert math.degrees(np.ptp(phi)) == pytest.approx(d.mission.task.arc_deg)


def test_pattern_that_does_not_fit_is_said_so() -> None:
    d = load_description("pipe-weld-scan", sets=("mission.task.pass_length_m=0.9",))
    assert "does not fit" in _texts(draw_mission(d))


def test_wind_obstacles_and_upright_pipe_are_drawn(tmp_path: Path) -> None:
    sets = ("world.wind.kind=steady", "world.wind.mean_mps=3", "world.pipe.inclination_deg=90",
            "world.things.box1={ kind = 'box', x_m = 1.0, y_m = 1.0, z_m = 0.5, size_x_m = 0.4, "
            "size_y_m = 0.4, size_z_m = 1.0 }")  # fmt: skip
    d = load_description("pipe-weld-scan", sets=sets)
    text = _texts(draw_world(d.world))
    assert "wind 3 m/s" in text
    write_show_figure(Subject("world", "x", None, d.world, None, {}), tmp_path / "w.png")
    assert (tmp_path / "w.png").stat().st_size > 10_000
