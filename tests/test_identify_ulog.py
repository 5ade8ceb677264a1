"""Identification from ULog files with known truth, and its command line."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import skywright
from exact_map import KNOWN
from identify_log import (
    COM,
    GAIN,
    GRAVITY,
    INERTIA,
    MASS,
    ROBOT,
    make_log,
    rotor_parameters,
    truth,
    ulog_topics,
)
from skywright.analysis.identify.flight_log import FlightLog
from skywright.analysis.identify.identify import identify
from skywright.analysis.identify.load import load_log
from skywright.analysis.identify.rotor_signals import build_mixer
from skywright.cli import main
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.rotors import build_rotors
from skywright.run.run import run_mission
from ulog_file import write_ulog


@pytest.fixture(scope="module")
def made() -> FlightLog:
    return make_log(30.0, rate=100.0)


def test_ulog_gives_what_its_signals_hold(made: FlightLog, tmp_path: Path) -> None:
    """The same truth through a ULog in NED and FRD, with the rotors in PX4's own order."""
    order = [4, 1, 0, 3, 5, 2]
    topics = ulog_topics(made)
    speeds = {n: topics["esc_status"][n] for n in topics["esc_status"]}
    for i, k in enumerate(order):
        topics["esc_status"][f"esc[{i}].esc_rpm"] = speeds[f"esc[{k}].esc_rpm"].copy()
    topics["esc_status"] = {
        "timestamp": speeds["timestamp"],
        **{f"esc[{i}].esc_rpm": make_rpm(made, k) for i, k in enumerate(order)},
    }
    path = write_ulog(tmp_path / "flight.ulg", topics, rotor_parameters(order))
    log = load_log(path, ROBOT)
    inside = (log.t > 1) & (log.t < 28)
    at = np.searchsorted(made.t, log.t[inside] - 1e-6)
    np.testing.assert_allclose(log.R_WB[inside], made.R_WB[at], atol=3e-3)
    np.testing.assert_allclose(log.v_WB[inside], made.v_WB[at], atol=1e-2)
    found = {e.parameter.name: e for e in identify([path], ROBOT, MASS).fit.estimates}
    for name, value in truth().items():
        e = found[name]
        assert e.identified, name
        assert abs(e.value - value) < 0.02 * e.parameter.scale, name


def make_rpm(log: FlightLog, rotor: int) -> np.ndarray:
    assert log.rotor_speed is not None
    return log.rotor_speed[:, rotor] * 60 / (2 * math.pi)


def test_ulog_with_commands_only(made: FlightLog, tmp_path: Path) -> None:
    """Without rotor speeds the commands and the lag that fits them best take their place."""
    topics = ulog_topics(made)
    del topics["esc_status"]
    topics["actuator_motors"] = {
        "timestamp": made.t + 12.5,
        **{f"control[{i}]": u for i, u in enumerate(make_commands(made).T)},
    }
    path = write_ulog(tmp_path / "flight.ulg", topics, {"THR_MDL_FAC": 0.0})
    result = identify([path], ROBOT, MASS)
    assert any("30 ms" in note for note in result.notes)
    found = {e.parameter.name: e for e in result.fit.estimates}
    for axis, value in zip(("xx", "yy", "zz"), INERTIA[:3], strict=True):
        assert found[f"pose_1.inertia_{axis}_kgm2"].value == pytest.approx(value, rel=0.05)


def age(topics: dict[str, dict[str, np.ndarray]], made: FlightLog) -> None:
    """Turn today's topics into those of PX4 1.6: raw sensors and pulse widths."""
    rates = topics.pop("vehicle_angular_velocity")
    s_B = np.einsum("kji,kj->ki", made.R_WB, np.gradient(made.v_WB, made.t, axis=0) + G_W)
    topics["sensor_combined"] = {
        "timestamp": rates["timestamp"],
        **{f"gyro_rad[{i}]": rates[f"xyz[{i}]"] for i in range(3)},
        **{f"accelerometer_m_s2[{i}]": s_B[:, i] * (1.0, -1.0, -1.0)[i] for i in range(3)},
    }
    topics["actuator_outputs"] = {
        "timestamp": made.t + 12.5,
        **{f"output[{i}]": 1075 + 875 * u for i, u in enumerate(make_commands(made).T)},
    }
    del topics["esc_status"]


def make_commands(made: FlightLog) -> np.ndarray:
    """Return what a first-order lag of 30 ms turns into the rotors' speeds, as 0 to 1 of thrust."""
    assert made.rotor_speed is not None
    command = made.rotor_speed + 0.03 * np.gradient(made.rotor_speed, made.t, axis=0)
    k_f = build_rotors(ROBOT.rotors).k_f
    return np.asarray(np.clip(k_f * command**2 / ROBOT.rotors.thrust_max_n, 0, 1))


def test_topics_of_older_px4(made: FlightLog, tmp_path: Path) -> None:
    """A log of PX4 1.6 that mostly stands on the ground: idling rotors are neither flight nor a
    reason to call them unlogged, and the page says which part was used."""
    topics = ulog_topics(made)
    age(topics, made)
    idle = np.arange(0.0, 60.0, 0.01)
    for fields in topics.values():
        for name, x in fields.items():
            still = 1120.0 if name.startswith("output") else x[0] if "q[" in name else 0.0
            still = -GRAVITY if name == "accelerometer_m_s2[2]" else still
            ground = idle + 12.5 if name == "timestamp" else np.full(len(idle), still)
            fields[name] = np.concatenate([ground, x + (60.0 if name == "timestamp" else 0.0)])
    path = write_ulog(tmp_path / "flight.ulg", topics, {"PWM_MIN": 1075, "PWM_MAX": 1950})
    log = load_log(path, ROBOT)
    assert 0.95 * 30 < 0.01 * log.free.sum() < 1.02 * 30
    result = identify([path], ROBOT, MASS)
    assert result.parts[0].start_s == pytest.approx(60, abs=0.5)
    assert any("used: " in note and "60" in note for note in result.notes)
    assert any("actuator_outputs" in note for note in result.notes)
    found = {e.parameter.name: e for e in result.fit.estimates}
    for axis, value in zip(("xx", "yy", "zz"), INERTIA[:3], strict=True):
        assert found[f"pose_1.inertia_{axis}_kgm2"].value == pytest.approx(value, rel=0.05)


def test_mixer_is_px4_s() -> None:
    """Tables that PX4 1.12 prints for its geometry files quad_x and hex_x (roll, pitch, yaw)."""
    s, c = 0.5, 0.866025
    quad = [[-0.707107, 0.707107, 1], [0.707107, -0.707107, 1], [0.707107, 0.707107, -1],
            [-0.707107, -0.707107, -1]]  # fmt: skip
    hexa = [[-1, 0, -1], [1, 0, 1], [s, c, -1], [-s, -c, 1], [-s, c, 1], [s, -c, -1]]
    for table, azimuth in ((quad, (-45, 135, 45, -135)), (hexa, (-90, 90, 30, -150, -30, 150))):
        angle = np.radians(azimuth)
        place = 0.3 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        rotors = build_rotors(ROBOT.rotors)._replace(
            position=place, spin=np.array([row[2] for row in table], dtype=float)
        )
        np.testing.assert_allclose(build_mixer(rotors)[:, :3], table, atol=1e-5)
        np.testing.assert_allclose(build_mixer(rotors)[:, 3], 1.0)


def test_mixer_inputs_become_thrusts(made: FlightLog, tmp_path: Path) -> None:
    topics = ulog_topics(made)
    del topics["esc_status"]
    t = made.t + 12.5
    controls = [0.1 * np.sin(t), 0.05 * np.cos(t), 0 * t, 0.5 + 0.1 * np.sin(2 * t)]
    topics["actuator_controls_0"] = {
        "timestamp": t, **{f"control[{i}]": x for i, x in enumerate(controls)},
    }  # fmt: skip
    log = load_log(write_ulog(tmp_path / "flight.ulg", topics), ROBOT)
    assert log.rotor_command is not None
    # rotor 2 of the file sits on the left (hex_x motor 2): all of the roll, no pitch
    expected = np.interp(log.t, made.t, controls[0] + controls[3]) * ROBOT.rotors.thrust_max_n
    np.testing.assert_allclose(log.rotor_command[:, 1], expected, atol=1e-3)


def test_slow_speeds_give_way_to_commands(made: FlightLog, tmp_path: Path) -> None:
    topics = ulog_topics(made)
    topics["esc_status"] = {n: x[::25] for n, x in topics["esc_status"].items()}  # 4 Hz
    topics["actuator_motors"] = {
        "timestamp": made.t + 12.5,
        **{f"control[{i}]": u for i, u in enumerate(make_commands(made).T)},
    }
    log = load_log(write_ulog(tmp_path / "flight.ulg", topics), ROBOT)
    assert log.rotor_speed is None and log.command_is_thrust
    assert any("4 Hz only: actuator_motors is taken" in note for note in log.notes)


def test_what_does_not_predict_is_refused(made: FlightLog, tmp_path: Path) -> None:
    """Rotors that do not belong to the flight, and a flight that another robot made."""
    topics = ulog_topics(made)
    rng = np.random.default_rng(0)
    names = [n for n in topics["esc_status"] if n != "timestamp"]
    for name in names:
        topics["esc_status"][name] = 5000 + 300 * rng.standard_normal(len(made.t))
    path = write_ulog(tmp_path / "noise.ulg", topics)
    page = tmp_path / "page.html"
    done = call(str(path), "--robot", "f550-bridge", "--mass", str(MASS), "--out", str(page))
    assert re.search(r"R² .* on held-out parts .* at least 0.5 is needed", done.stderr)
    assert done.exit_code == 2 and not page.exists() and not page.with_suffix(".toml").exists()
    topics = ulog_topics(made)
    for name in names:  # thrust is 0.4 of the file's at these speeds
        topics["esc_status"][name] = topics["esc_status"][name] * math.sqrt(2.5)
    with pytest.raises(InputError, match=r"rotor_gain_1 .* valid: 0.5 to 2"):
        identify([write_ulog(tmp_path / "weak.ulg", topics)], ROBOT, MASS)


G_W = np.array([0.0, 0.0, GRAVITY])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda topics: topics.pop("vehicle_angular_velocity"), "lacks vehicle_angular_velocity"),
        (
            lambda topics: topics["esc_status"].update(
                {n: 0 * x for n, x in topics["esc_status"].items() if n != "timestamp"}
            ),
            "in esc_status no rotor turns",
        ),
        (lambda topics: topics.pop("vehicle_attitude"), "lacks vehicle_attitude"),
        (lambda topics: topics.pop("vehicle_local_position"), "neither vehicle_acceleration nor"),
        (lambda topics: topics.pop("esc_status"), "one of esc_status, actuator_motors"),
    ],
)
def test_ulog_that_lacks_something(change: Any, said: str, made: FlightLog, tmp_path: Path) -> None:
    topics = ulog_topics(made)
    change(topics)
    path = write_ulog(tmp_path / "flight.ulg", topics)
    with pytest.raises(InputError, match=said):
        load_log(path, ROBOT)


def test_ulog_with_one_wrong_time_is_refused(made: FlightLog, tmp_path: Path) -> None:
    """30 s at 100 Hz: the axis may span 20 times as much."""
    topics = ulog_topics(made)
    rates = topics["vehicle_angular_velocity"]
    rates["timestamp"] = np.append(rates["timestamp"][:-1], 12.5 + 86400.0)
    path = write_ulog(tmp_path / "flight.ulg", topics)
    said = r"flight\.ulg: vehicle_angular_velocity: its 3000 samples span 86400 s at 100 Hz"
    with pytest.raises(InputError, match=said + r"; valid: up to 600 s"):
        load_log(path, ROBOT)


def test_ulog_of_another_robot(made: FlightLog, tmp_path: Path) -> None:
    path = write_ulog(
        tmp_path / "flight.ulg", ulog_topics(made), rotor_parameters([0, 1, 2, 3, 4, 4])
    )
    with pytest.raises(InputError, match="give the correct robot"):
        load_log(path, ROBOT)
    with pytest.raises(InputError, match="give --robot"):
        load_log(path)


# --- the command line ---


def call(*args: str) -> Any:
    return CliRunner().invoke(main, ["identify", *args])


def test_bad_input(tmp_path: Path, made: FlightLog) -> None:
    (tmp_path / "empty.ulg").write_bytes(b"")
    (tmp_path / "noise.ulg").write_bytes(bytes(range(256)) * 10)
    (tmp_path / "header.ulg").write_bytes(
        b"ULog\x01\x12\x35\x01" + bytes(8) + bytes(range(256)) * 9
    )
    (tmp_path / "noise.mcap").write_bytes(bytes(range(256)) * 10)
    (tmp_path / "text.txt").write_text("t")
    good = write_ulog(tmp_path / "good.ulg", ulog_topics(made))
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(good.read_bytes()[:4000])
    f550 = ("--robot", "f550-bridge")
    cases = [
        ((str(tmp_path / "none.ulg"), *f550), "no such file"),
        ((str(tmp_path), *f550), "contains no recording.mcap"),
        ((str(tmp_path / "empty.ulg"), *f550), "not a readable ULog"),
        ((str(tmp_path / "noise.ulg"), *f550), "not a readable ULog"),
        ((str(tmp_path / "header.ulg"), *f550), "header.ulg"),
        ((str(tmp_path / "noise.mcap"), *f550), "noise.mcap"),
        ((str(tmp_path / "text.txt"), *f550), "unknown kind of log"),
        ((str(cut), *f550), "cut.ulg"),
        ((str(good),), "give --robot"),
        ((str(good), "--robot", "none"), "unknown robot"),
        ((str(good), *f550, "--mass", "-1"), "--mass"),
        ((str(good), *f550, "--mass", "nan"), "--mass"),
        ((str(good), *f550, "--mass", "2500"), "has 2.5 kg in its file"),
        ((str(good), *f550, "--out", str(tmp_path / "x.pdf")), "unknown format"),
        ((), "LOG"),
    ]
    for args, said in cases:
        result = call(*args)
        assert result.exit_code == 2, (args, result.output)
        assert said in result.output + result.stderr, (args, result.output, result.stderr)
        assert "Traceback" not in result.output + result.stderr
    assert not (tmp_path / "x.pdf").exists()


def test_identify_without_a_log_is_refused() -> None:
    with pytest.raises(InputError, match="at least one run directory, recording, ULog or table"):
        skywright.identify()


def test_a_robot_file_of_the_user_is_not_replaced(
    made: FlightLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the file of an earlier identification is, unless --robot names or extends it."""
    log = str(write_ulog(tmp_path / "flight.ulg", ulog_topics(made)))
    monkeypatch.chdir(tmp_path)
    mine, heir = Path("mine.toml"), Path("heir.toml")
    mine.write_text('[robot]\nname = "mine"\nextends = "f550-bridge"\n')
    text = mine.read_bytes()

    def refuse(robot: str, out: str) -> str:
        with monkeypatch.context() as patch:  # refused before computing
            patch.setattr("skywright.analysis.identify.identify.identify", pytest.fail)
            result = call(log, "--robot", robot, "--out", out)
        assert result.exit_code == 2 and not Path(out).exists(), result.output
        return " ".join(result.stderr.split())

    assert "mine.toml: is a file of the robot" in refuse("mine.toml", "mine.html")
    assert "not from an earlier identification" in refuse("f550-bridge", "mine.html")
    assert mine.read_bytes() == text
    for robot in ("mine.toml", "f550-bridge"):
        result = call(log, "--robot", robot, "--mass", str(MASS), "--out", "found.html")
        assert result.exit_code == 0, result.output + result.stderr
    Path("found.html").unlink()
    heir.write_text('[robot]\nname = "heir"\nextends = "found.toml"\n')
    assert "found.toml: is a file of the robot" in refuse("heir.toml", "found.html")


def test_a_recording_of_another_robot_is_told(tmp_path: Path) -> None:
    """Other joints are refused; another name, as of an identified robot, is said."""
    sets = KNOWN | {"mission.task.forces_n": [2.0], "mission.task.slide_m": 0.0}
    run_mission(load_description("wall-contact", sets=sets), out=tmp_path / "run")
    result = call(str(tmp_path / "run"), "--robot", "hexarotor", "--out", str(tmp_path / "x.html"))
    assert result.exit_code == 2 and not (tmp_path / "x.html").exists()
    assert "was flown by 'f550-bridge' with joints shoulder, elbow" in result.stderr
    assert not load_log(tmp_path / "run", ROBOT).notes
    other = ROBOT.model_copy(update={"name": "f550-two"})
    assert "was flown by 'f550-bridge'" in load_log(tmp_path / "run", other).notes[0]


def test_page_json_and_robot_file(made: FlightLog, tmp_path: Path) -> None:
    """The robot file that comes out flies the identified values, and the page is whole."""
    path = write_ulog(tmp_path / "flight.ulg", ulog_topics(made))
    page = tmp_path / "found.html"
    result = call(
        str(path), "--robot", "f550-bridge", "--mass", str(MASS), "--json", "--out", str(page)
    )
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["mass_source"] == "given" and found["r_squared"]["angular_acceleration_x"] > 0.999
    assert any("servo" in line or "rotors' lag" in line for line in found["not_identified"])
    text = page.read_text().replace("<wbr>", "")
    assert "rotor_gain_1" in text and "http://" not in text.replace("http://www.w3.org", "")
    robot, sources = load_robot(tmp_path / "found.toml")
    assert robot.name == "f550-bridge-identified"
    assert sources["robot.rotors.thrust_coefficient_n_per_rad2s2"].kind == "derived"
    model = build_body_model(robot)
    mass, com, I_B = compute_body(model, posture(robot, "folded"))
    assert mass == pytest.approx(MASS, abs=1e-6)
    np.testing.assert_allclose(com, COM, atol=3e-4)
    np.testing.assert_allclose(np.diag(I_B), INERTIA[:3], rtol=0.02)
    mean = (
        robot.rotors.thrust_coefficient_n_per_rad2s2 / ROBOT.rotors.thrust_coefficient_n_per_rad2s2
    )
    assert mean == pytest.approx(GAIN.mean(), rel=0.003)


def test_flights_add_up(made: FlightLog, tmp_path: Path) -> None:
    """Two halves of a flight tell what the whole does."""
    parts = []
    for name, use in (("a", made.t < 15), ("b", made.t >= 15)):
        topics = {
            topic: {k: v[use] for k, v in fields.items()}
            for topic, fields in ulog_topics(made).items()
        }
        parts.append(write_ulog(tmp_path / f"{name}.ulg", topics))
    found = {e.parameter.name: e for e in identify(parts, ROBOT, MASS).fit.estimates}
    assert len({n.split(".")[0] for n in found if n.startswith("pose_")}) == 1
    assert found["pose_1.inertia_zz_kgm2"].value == pytest.approx(INERTIA[2], rel=0.02)


@pytest.mark.parametrize("nan", [False, True])
@pytest.mark.parametrize("name", ["vehicle_attitude", "esc_status", "vehicle_local_position"])
def test_gaps_of_a_topic_are_not_flown(
    name: str, nan: bool, made: FlightLog, tmp_path: Path
) -> None:
    """A gap has no samples, or samples whose last field is NaN."""
    topics = ulog_topics(made)
    t = topics[name]["timestamp"] - topics[name]["timestamp"][0]
    keep = (t < 10.0) | (t > 12.0)
    if nan:
        field = list(topics[name])[-1]
        topics[name][field] = np.where(keep, topics[name][field], np.nan)
    else:
        topics[name] = {key: x[keep] for key, x in topics[name].items()}
    path = write_ulog(tmp_path / "gap.ulg", topics, rotor_parameters(list(range(6))))
    log = load_log(path, ROBOT)
    assert any("s of flight lie in gaps" in note for note in log.notes)
    assert not log.free[(log.t > 10.1) & (log.t < 11.9)].any()
    assert log.free[(log.t > 5.0) & (log.t < 9.9)].all() and log.free[log.t > 12.1].any()


def test_gaps_of_a_topic_that_is_not_taken_are_flown(made: FlightLog, tmp_path: Path) -> None:
    topics = ulog_topics(made)
    keep = (made.t < 10.0) | (made.t > 12.0)
    topics["actuator_motors"] = {
        "timestamp": made.t + 12.5,
        **{f"control[{i}]": np.where(keep, u, np.nan) for i, u in enumerate(make_commands(made).T)},
    }
    topics["vehicle_land_detected"] = {"timestamp": np.array([12.5, 42.5]), "landed": np.zeros(2)}
    log = load_log(write_ulog(tmp_path / "flight.ulg", topics), ROBOT)
    assert log.rotor_speed is not None and not any("gaps" in note for note in log.notes)
