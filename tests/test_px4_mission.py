"""The back end px4: missions whose platform an autopilot flies, arms and contact in the plant.

The peer speaks PX4's protocol and flies by Skywright's own law: what is tested are the composition
and its rules. Flights of PX4 itself are in test_px4_real.py.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skywright
from px4_flying_peer import FlyingPeer
from px4_peer import Misbehaviour
from short_mission import write_short
from skywright.core.rotations import rot_z
from skywright.errors import InputError
from skywright.links.mavlink import modes
from skywright.links.px4 import mission
from skywright.links.px4.check import find_losses, find_refusal
from skywright.links.px4.docked import DockedAttitude
from skywright.links.px4.gains import compute_force_units
from skywright.links.px4.mission import Options, parse_options
from skywright.links.px4.parameters import build_airframe
from skywright.models.nominal import Nominal
from skywright.run.parts import build_law
from skywright.run.result import RunResult
from skywright.run.run import run_mission
from skywright.run.setup import Setup


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@contextmanager
def peer(description: Any, **kwargs: Any) -> Iterator[tuple[FlyingPeer, str]]:
    """Run a peer; the back end's name comes with it."""
    port, onboard = free_port(), free_port(socket.SOCK_DGRAM)
    found = FlyingPeer(port, onboard, description, **kwargs)
    found.start()
    try:
        yield found, f"px4:{port}?speed=max&onboard={onboard}&wait=60"
    finally:
        found.stop()
        found.join(5.0)


def fly(description: Any, backend: str, tmp_path: Path) -> RunResult:
    return run_mission(description, backend=backend, out=tmp_path / "run")


def test_a_mission_is_flown_by_set_points_and_judged_by_the_truth(tmp_path: Path) -> None:
    """Two seconds without the onboard link do not end it."""
    description = write_short(tmp_path)
    with peer(description) as (px4, backend):
        px4.silent = lambda t: 14.0 < t < 16.0
        result = fly(description, backend, tmp_path)
    assert result.outcome == "succeeded", result.reason
    assert result.backend == backend and not px4.armed and px4.mode == modes.LAND
    wanted = [(176, 1.0), (400, 1.0), (176, 1.0)]  # Offboard, arm, Land
    assert [c for c in px4.commanded if c[0] in (176, 400)] == wanted
    s = result.samples
    assert s["t"][0] > 0.5  # PX4 boots before the mission
    # what the laws saw is what the autopilot told; the truth is beside it
    flown = s[(s["autopilot_armed"] > 0.5) & (s["p_WB"][:, 2] > 0.8)]
    heard = (flown["t"] < 12.5) | (flown["t"] > 16.0)
    flown = flown[heard]  # its clock runs a second ahead
    off = np.linalg.norm(flown["autopilot_p_WB"] - flown["p_WB"], axis=1)
    assert len(flown) > 300 and 0.0 < off.max() < 0.05
    assert np.abs(flown["autopilot_p_WB_des"][:, 2]).max() == pytest.approx(1.2, abs=0.05)
    # the rotors are the autopilot's
    assert 0.2 < flown["autopilot_command"].mean() < 0.9
    assert not np.any(s["autopilot_command"][s["autopilot_armed"] < 0.5])


def test_the_reference_stands_still_while_px4_starts_its_motors(tmp_path: Path) -> None:
    description = write_short(tmp_path)
    with peer(description) as (px4, backend):
        vehicle = skywright.fly(mission=tmp_path / "short.toml", backend=backend)
        try:
            plant: Any = vehicle.backend
            row = np.array(plant.reference)
            table = np.repeat(row[None], 2)
            table["t"] = [0.0, 2.0]
            table["p_WB"][1, 2] += 1.0
            plant.track(table)
            before = plant.t
            plant.stand_still(1.0)
            assert plant.t == pytest.approx(before + 1.0, abs=0.005)
            assert plant.tracking[1] == pytest.approx(0.0, abs=0.005)
            assert plant.reference["p_WB"][2] == pytest.approx(row["p_WB"][2], abs=0.005)
        finally:
            vehicle.close()
    assert not px4.armed


def test_an_autopilot_that_vanishes_in_flight_ends_the_mission(tmp_path: Path) -> None:
    description = write_short(tmp_path)
    with peer(description, wrong=Misbehaviour(vanish=3500)) as (_, backend):
        result = fly(description, backend, tmp_path)
    assert result.outcome == "aborted" and "PX4 has gone: the rotors stop" in result.reason


def test_a_refusal_to_arm_is_told_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mission, "READY_S", 5.0)
    description = write_short(tmp_path)
    with peer(description) as (px4, backend):
        px4.refuses = "Preflight Fail: heading estimate not stable"
        result = fly(description, backend, tmp_path)
    assert result.outcome == "aborted"
    assert len([c for c in px4.commanded if c[0] == 400]) > 5  # PX4 may still be booting
    assert "no take-off" in result.reason and "heading estimate not stable" in result.reason


@pytest.mark.parametrize(
    ("mission", "sets", "says"),
    [
        ("excitation", [], "judges how the robot's own law moves the platform"),
        ("bar-transport", [], "begins in the air, held by a clamp"),
        ("waypoints", ["mission.estimator=truth"], "the platform's estimate is PX4's"),
    ],
)
def test_what_px4_cannot_fly_is_refused_before_anything_listens(
    mission: str, sets: list[str], says: str
) -> None:
    d = skywright.load(mission, sets=sets)
    assert says in find_refusal(Setup(d), tells_truth=bool(sets))


@pytest.mark.parametrize(
    ("mission", "force", "says"),
    [
        ("waypoints", False, ""), ("sensor-install", False, "does not damp the swing of the link"),
        ("bridge-contact", False, "px4?force sends forces"), ("bridge-contact", True, ""),
    ],
)  # fmt: skip
def test_what_a_mission_loses_with_px4_is_told_before_anything_listens(
    mission: str, force: bool, says: str
) -> None:
    d = skywright.load(mission)
    setup = Setup(d)
    told = find_losses(setup, build_law(d, setup), force)
    assert len(told) == bool(says) and says in "".join(told)


@pytest.mark.parametrize("mission", ["bridge-contact", "sensor-install", "waypoints"])
def test_missions_with_contact_are_accepted(mission: str) -> None:
    assert find_refusal(Setup(skywright.load(mission)), tells_truth=False) == ""


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("", Options()),
        ("4570", Options(port=4570)),
        ("4570?force&speed=2", Options(port=4570, force=True, speed=2.0)),
        ("?speed=max&onboard=14541&wait=5", Options(speed=math.inf, onboard=14541, wait_s=5.0)),
    ],
)
def test_options(text: str, options: Options) -> None:
    assert parse_options(text) == options


@pytest.mark.parametrize(
    "text", ["x", "70000", "?speed=0", "?speed=nan", "?forc", "?onboard=", "?wait=-1"]
)
def test_wrong_options_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="backend px4"):
        parse_options(text)


def test_units_of_body_thrust_are_those_of_px4s_allocation() -> None:
    """A share of 1 along z is all rotors at their most; along x it is less.

    Checked by PX4's way: share times the scaled column gives each rotor's share of its thrust.
    """
    robot, world = skywright.load_robot("f550-bridge"), skywright.load_world("open")
    rotors = Nominal(robot, world).rotors
    units = compute_force_units(rotors.B, rotors.thrust_max)
    assert units[2] == pytest.approx(rotors.axis[:, 2] @ rotors.thrust_max, rel=1e-3)
    inverse = np.linalg.inv(rotors.B)
    for axis, unit in enumerate(units):
        shares = inverse[:, axis] * unit / rotors.thrust_max
        assert np.abs(shares).mean() == pytest.approx(1.0, rel=1e-6)
    assert units[0] < 0.5 * units[2]


def test_a_docked_robot_gets_the_torque_of_its_law_and_winds_nothing_up() -> None:
    """PX4's loops at rest, K e + w K times the integral of e, with a set-point that is 24 ms late.

    Half a degree between plan and feet would wind them up without end.
    """
    airframe = build_airframe(skywright.load_robot("f550-bridge"), skywright.load_world("open"))
    docked = DockedAttitude(airframe)
    gains = airframe.gains
    K, w = airframe.torque_units * gains.rate_p * gains.attitude_p, gains.rate_i / gains.rate_p
    trim, law, feet = np.array([0.05, -0.1, 0.02]), np.array([0.3, -0.2, 0.1]), np.zeros(3)
    R, planned = np.eye(3), rot_z(0.01)
    for _ in range(250):
        assert docked.choose(False, planned, R, feet, trim) is planned
    integral, late, made = trim.copy(), [np.zeros(3)] * 6, trim
    for sample in range(2500):  # 4 ms each
        if sample % 5 == 0:
            told = docked.choose(True, planned, R, law, made)
            late[-1] = np.array([told[2, 1], told[0, 2], told[1, 0]])
        angle = late.pop(0)
        late.append(late[-1])
        integral = integral + 0.004 * w * K * angle
        made = K * angle + integral
        if sample > 500:  # 2 s: four times the slowest of the poles at 2 w
            assert np.abs(made - law - trim).max() < 0.02
    assert np.abs(angle).max() < 1e-3
    assert np.abs(w * K * math.radians(0.5) * 10.0).max() > 1.0  # N m, without it in 10 s
