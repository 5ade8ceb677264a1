"""The built-in robots, worlds and missions: complete, sourced, and as the papers print them."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from skywright.core.keys import iterate_leaves
from skywright.core.toml_files import iterate_numbers
from skywright.description.loader import list_missions, load_description
from skywright.description.robot.loader import list_robots, load_robot
from skywright.description.robot.sourced import list_needing_source
from skywright.description.world.loader import list_worlds, load_world
from skywright.models.capability import check_can_fly, compute_capability
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip, posture
from skywright.models.rotors import build_rotors
from skywright.models.sweep import strip_robot

ROBOTS = [entry.name for entry in list_robots()]


@pytest.mark.parametrize("name", ROBOTS)
def test_every_number_of_a_robot_has_a_source(name: str) -> None:
    """Also those that would otherwise be silent defaults; a guess states its range and why."""
    robot, sources = load_robot(name)
    values = dict(iterate_leaves(robot, "robot"))
    for key in list_needing_source(robot):
        value = values[key]
        assert key in sources, f"{name}: {key} = {value} has no source"
        source = sources[key]
        assert source.note, f"{name}: {key} does not say where its number comes from"
        if source.kind == "assumed":
            assert source.range is not None
            low, high = source.range
            assert low < high
            assert all(low <= number <= high for number in iterate_numbers(value))


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_can_fly(name: str) -> None:
    robot, _ = load_robot(name)
    check_can_fly(robot)
    assert robot.name == name
    assert robot.description


@pytest.mark.parametrize("name", ROBOTS)
def test_spin_and_layout_balance(name: str) -> None:
    """Equal thrusts cancel yaw torque: of the tilts, and of the propellers' drag alone."""
    robot, _ = load_robot(name)
    rotors = build_rotors(robot.rotors)
    wrench = rotors.B.sum(axis=1)
    assert wrench[5] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(rotors.spin @ rotors.axis[:, 2], 0.0, atol=1e-6)
    edge = max(robot.rotors.radii) + robot.rotors.propeller_radius_m
    assert 2 * edge == pytest.approx(robot.platform.diameter_m, rel=0.01)


def test_othex_is_the_papers() -> None:
    """Tognon 2018, Table I, and the consistency check of the propulsion."""
    robot, _ = load_robot("othex")
    assert robot.arm is not None and robot.probe is not None
    assert robot.platform.mass_kg == 1.6
    assert sum(link.mass_kg for link in robot.arm.links.values()) == pytest.approx(0.45)
    assert robot.probe.mass_kg == 0.2
    assert (robot.arm.links["link1"].length_m, robot.arm.links["link2"].length_m) == (0.29, 0.25)
    mass, _, _ = compute_body(build_body_model(robot), _pad(posture(robot, "folded")))
    assert mass == pytest.approx(2.25)
    rotors = build_rotors(robot.rotors)
    # published payload of 28 N on 1.6 kg (IEEE RAM, December 2018)
    centred = robot.platform.model_copy(update={"com_x_m": 0.0})
    bare = robot.model_copy(update={"arm": None, "probe": None, "platform": centred})
    upward = compute_capability(bare, thrust_fraction=1.0).vertical_force
    assert upward == pytest.approx(1.6 * 9.81 + 28, rel=0.01)
    # drag adds to the tilt's yaw torque: both have the same sign for every rotor
    tilt = np.cross(rotors.position, rotors.axis)[:, 2]
    assert np.all(tilt * -rotors.spin > 0)


def test_othex_aperture_and_folding() -> None:
    """The arm passes between the front propellers, and folded it stays above the ground."""
    robot, _ = load_robot("othex")
    r = robot.rotors
    azimuth = sorted(((a + 180) % 360) - 180 for a in r.azimuth_deg)
    inner = [a for a in azimuth if abs(a) < 90]
    assert inner[-1] - inner[0] == pytest.approx(85.0)
    half = r.radius_m * math.sin(math.radians(42.5)) - r.propeller_radius_m
    assert robot.arm is not None and half > 2 * robot.arm.links["link1"].radius_m
    model = build_body_model(robot)
    for which in ("folded", "working"):
        tip, _ = compute_tip(model, _pad(posture(robot, which)))
        assert tip[2] > -robot.platform.gear_height_m + 0.03
    front = r.radius_m * math.cos(math.radians(42.5)) + r.propeller_radius_m
    assert tip[0] > front + 0.08  # at work the tip is well in front of the propellers


def test_othex_tilt_alternation_is_the_better_one() -> None:
    """With the arm extended the mirrored alternation of the tilt holds less sideways."""
    robot, _ = load_robot("othex")
    rotors = robot.rotors
    flipped = rotors.model_copy(
        update={
            "alpha_deg": [-a for a in rotors.alpha_deg],
            "spin": ["cw" if s == "ccw" else "ccw" for s in rotors.spin],
        }
    )
    ours = np.nanmin(compute_capability(robot).lateral_force)
    other = np.nanmin(
        compute_capability(robot.model_copy(update={"rotors": flipped})).lateral_force
    )
    assert ours > other > 0


def test_f550_limits_are_the_papers() -> None:
    """Sanchez-Cuevas 2020, Table 2: 415 and 555 gf, met in +x and +y with 90 gf minimum thrust."""
    robot, _ = load_robot("f550-bridge")
    k = compute_capability(strip_robot(robot), directions_deg=[0.0, 90.0])
    np.testing.assert_allclose(k.lateral_force / 9.81e-3, [415, 555], rtol=0.005)


def test_hexarotor_is_coplanar() -> None:
    robot, _ = load_robot("hexarotor")
    np.testing.assert_allclose(build_rotors(robot.rotors).axis, [[0, 0, 1]] * 6, atol=1e-12)


def test_worlds_and_missions_load() -> None:
    for entry in list_worlds():
        world, _ = load_world(entry.name)
        assert (world.name, world.description) == (entry.name, entry.description)
    for entry in list_missions():
        d = load_description(entry.name)
        assert (d.mission.name, d.mission.description) == (entry.name, entry.description)
        assert d.mission.requirements


def test_scan_asks_what_the_paper_asks() -> None:
    d = load_description("pipe-weld-scan")
    assert d.world.pipe is not None
    assert (d.mission.task.arc_deg, d.mission.task.passes) == (40.0, 4)
    assert (d.world.pipe.diameter_m, d.world.pipe.length_m) == (0.4, 0.5)
    limits = {name: (r.sense, r.limit) for name, r in d.mission.requirements.items()}
    assert limits == {
        "contact.gap_max_mm": ("<", 1.0),
        "contact.lost_s": ("<=", 0.0),
        "contact.no_force_max_s": ("<=", 0.05),
        "contact.tilt_max_deg": ("<", 10.0),
        "contact.collisions": ("<=", 0.0),
        "tip.tangential_rms_mm": ("<=", 4.0),
        "weld.missed": ("<=", 0.0),
        "weld.lines_missed": ("<=", 0.0),
        "weld.unresolved": ("<=", 0.0),
        "weld.false_alarms": ("<=", 0.0),
        "weld.crossing_error_mm": ("<=", 5.0),
        "weld.line_error_mm": ("<=", 5.0),
        "coverage.fraction": (">=", 0.98),
        "flight.saturated_max_s": ("<=", 0.5),
        "arm.saturated_max_s": ("<=", 0.5),
    }


@pytest.mark.parametrize("name", [entry.name for entry in list_missions()])
def test_every_limit_of_a_mission_names_a_paper_or_the_reason_of_the_choice(name: str) -> None:
    paper = r"(Caballero 2018|Sanchez-Cuevas 2020|Suarez 2020|Tognon 2018), section "
    for metric, requirement in load_description(name).mission.requirements.items():
        assert re.match(paper + r"|chosen: \S+ \S+", requirement.source), (
            f"{name}: {metric}: {requirement.source!r} is neither a section of a paper nor a reason"
        )


def test_no_limit_of_the_package_or_an_example_has_the_source_ours() -> None:
    root = Path(__file__).parent.parent
    files = [*(root / "src").rglob("*.toml"), *(root / "examples").rglob("*.toml")]
    found = [f for f in files if re.search(r'limit = .*source = "ours', f.read_text("utf-8"))]
    assert files and not found


def _pad(q: np.ndarray) -> np.ndarray:
    out = np.zeros(8)
    out[: len(q)] = q
    return out
