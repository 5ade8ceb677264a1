"""Identification against known truth: signals that obey the model exactly, a flight."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from playwright.sync_api import Page
from scipy.spatial.transform import Rotation

from identify_log import (
    INERTIA,
    MASS,
    ROBOT,
    fit,
    make_log,
    truth,
)
from page_checks import check_page
from skywright.analysis.identify.fit import INERTIA_AXES, Fit, choose_held_out
from skywright.analysis.identify.flight_log import FlightLog
from skywright.analysis.identify.identify import Identification, identify
from skywright.analysis.identify.lag import fit_lag
from skywright.analysis.identify.load import build_log
from skywright.analysis.identify.overrides import (
    build_overrides,
    check_replaceable,
    choose_base,
)
from skywright.analysis.identify.plausible import check_fit
from skywright.analysis.identify.report import write_identify_page
from skywright.cli import main
from skywright.description.loader import Description, load_description
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.planning.excitation import Excitation, build_sines, plan_excitation, share_lines
from skywright.run.setup import Setup


@pytest.fixture(scope="module")
def exact() -> Fit:
    return fit(make_log())


def test_exact_signals_give_exact_parameters(exact: Fit) -> None:
    found = {e.parameter.name: e for e in exact.estimates}
    for name, value in truth().items():
        e = found[name]
        assert e.identified, name
        assert abs(e.value - value) < 0.004 * e.parameter.scale, name
    assert np.all(exact.prediction.r_squared(exact.prediction.predicted) > 0.9999)
    # the robot file, which is wrong here, predicts worse
    assert np.all(exact.prediction.r_squared(exact.prediction.nominal)[3:] < 0.97)


def test_intervals_cover_the_truth() -> None:
    """Gyroscope noise of 0.02 rad/s: 95 % intervals hold the truth about as often as they say."""
    inside, count, errors = 0, 0, []
    for seed in range(4):
        found = {
            e.parameter.name: e
            for e in fit(make_log(40.0, rate=100.0, noise=0.02, seed=seed)).estimates
        }
        for name, value in truth().items():
            e = found[name]
            if e.identified and name != "rotor_delay_s":
                inside += abs(e.value - value) <= e.half_width
                count += 1
        errors += [
            found[f"pose_1.inertia_{a}_kgm2"].value / value - 1
            for a, value in zip(("xx", "yy", "zz"), INERTIA[:3], strict=True)
        ]
    assert count > 60 and inside / count > 0.88
    assert np.max(np.abs(errors)) < 0.05 and abs(np.mean(errors)) < 0.01  # noise does not bias it


def test_only_ratios_to_the_mass(exact: Fit) -> None:
    """With a wrong mass everything else is off by the same factor, and nothing else changes."""
    half = {e.parameter.name: e.value for e in fit(make_log(), mass=MASS / 1.3).estimates}
    for e in exact.estimates:
        name = e.parameter.name
        if name.startswith("rotor_gain") or "inertia" in name:
            assert half[name] * 1.3 == pytest.approx(e.value, rel=1e-3, abs=1e-5)
        if "com_" in name:
            assert half[name] == pytest.approx(e.value, abs=1e-5)


def test_what_was_not_excited_is_said() -> None:
    """A flight that never rolls nor pitches says nothing of those inertias, and does not invent."""
    log = make_log(40.0, rate=100.0, noise=0.01, tilt=1e-4, push=0.2)
    found = {e.parameter.name: e for e in fit(log).estimates}
    model = build_body_model(ROBOT)
    _, _, I_B = compute_body(model, posture(ROBOT, "folded"))
    for axis, k in (("xx", 0), ("yy", 1), ("zz", 2)):
        e = found[f"pose_1.inertia_{axis}_kgm2"]
        assert not e.identified and math.isnan(e.half_width)
        assert e.value == pytest.approx(I_B[k, k])  # kept at the robot file's
        assert e.would_be > e.parameter.widest


def test_a_flight_that_turns_too_little_is_refused_with_its_own_r2(exact: Fit) -> None:
    """The message states the fit of all parameters, not that with the file's values in their place.

    A robot file with other inertias and gains predicts a quiet flight much worse than nothing.
    """
    assert np.all(np.isnan(exact.given_up_r2)) and not exact.unused.any()
    p = exact.prediction
    off = 5.0 * p.measured.std(axis=0) * [0.0, 0.0, 0.0, 1.0, 1.0, 0.0]
    quiet = exact._replace(
        unused=np.array([True, True, False]), given_up_r2=np.array([0.49, 0.32, np.nan]),
        prediction=p._replace(predicted=p.predicted + off),
    )  # fmt: skip
    with pytest.raises(InputError, match="does not identify the rotation") as error:
        check_fit(quiet, ROBOT, "quiet.csv")
    told = str(error.value)
    assert "held-out parts is 0.49 about x, 0.32 about y, -" in told and "0.98" not in told
    assert "about all axes without the parameters of these axes, " in told


def change(fit: Fit, **values: dict[str, Any]) -> Fit:
    """Return the fit with fields of its estimates replaced."""
    return fit._replace(
        estimates=[
            e._replace(**values.get(e.parameter.name.rpartition(".")[2], {})) for e in fit.estimates
        ]
    )


def write_file(fit: Fit, folder: Path) -> tuple[Robot, str]:
    """Return the identified robot, loaded from its file, and the file's text."""
    file = folder / "identified.toml"
    file.write_text(build_overrides(find(fit), ROBOT.name))
    return load_robot(str(file))[0], file.read_text()


def find(fit: Fit, robot: Robot = ROBOT) -> Identification:
    made = make_log(2.0)
    return Identification(
        robot, ["a.csv"], [], fit, made.q[:1], made.joints, None, None, [], True, []
    )


def test_the_identified_file_extends_the_robot_that_flew(
    exact: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A built-in robot, a file elsewhere, or, for changed robots, a file with all values."""
    file = tmp_path / "out" / "identified.toml"
    file.parent.mkdir()
    monkeypatch.chdir(tmp_path)
    mine = Path('a "b"/mine.toml')
    mine.parent.mkdir()
    mine.write_text(f'[robot]\nname = "mine"\nextends = "{ROBOT.name}"\n')
    assert choose_base(find(exact), None, file) == (ROBOT.name, "")
    assert choose_base(find(exact), ROBOT.name, file) == (ROBOT.name, "")
    base, whole = choose_base(find(exact), str(mine), file)
    assert (base, whole) == ('../a "b"/mine.toml', "")
    file.write_text(build_overrides(find(exact, load_robot(mine)[0]), base))
    assert load_robot(file)[0].name == "mine-identified"
    for change in ({"time_constant_s": 0.07}, {"radius_m": 0.31}):
        rotors = ROBOT.rotors.model_copy(update=change)
        changed = ROBOT.model_copy(update={"rotors": rotors})
        base, whole = choose_base(find(exact, changed), None, file)
        file.with_name(base).write_text(whole)
        check_replaceable(file.with_name(base), [])  # by the next identification
        assert load_robot(file.with_name(base))[0] == changed
        file.write_text(build_overrides(find(exact, changed), base))
        monkeypatch.chdir("/")
        assert load_robot(file)[0].rotors.radius_m == rotors.radius_m
    away = changed.model_copy(update={"extends": "elsewhere.toml"})  # not beside the new file
    assert choose_base(find(exact, away), None, file) == (base, whole)


def test_rotors_without_inertia_have_none_within_the_interval(exact: Fit, tmp_path: Path) -> None:
    """Simulators leave it out; the estimate is then zero to within its error, on either side."""
    below = change(exact, rotor_inertia_kgm2={"value": -3e-7, "half_width": 2e-6})
    check_fit(below, ROBOT, "sim.csv")
    assert write_file(below, tmp_path)[0].rotors.rotor_inertia_kgm2 == 0.0
    far = change(exact, rotor_inertia_kgm2={"value": -5e-6, "half_width": 2e-6})
    with pytest.raises(InputError, match=r"rotor_inertia_kgm2 .* would be -5e-06 kg m"):
        check_fit(far, ROBOT, "sim.csv")


def test_an_inertia_is_written_without_those_that_were_not_identified(
    exact: Fit, tmp_path: Path
) -> None:
    whole, _ = write_file(exact, tmp_path)
    nominal = {e.parameter.name: e.parameter.nominal for e in exact.estimates}
    z = {"value": nominal["pose_1.inertia_zz_kgm2"], "half_width": np.nan, "identified": False}
    part, text = write_file(change(exact, inertia_zz_kgm2=z), tmp_path)
    assert part.platform.inertia_xx_kgm2 == pytest.approx(whole.platform.inertia_xx_kgm2)
    assert part.platform.inertia_yy_kgm2 == pytest.approx(whole.platform.inertia_yy_kgm2)
    assert part.platform.inertia_zz_kgm2 == ROBOT.platform.inertia_zz_kgm2
    assert "no rigid body" not in text
    x = {"value": 0.2, "half_width": 0.001}  # more than the other two together
    part, text = write_file(change(exact, inertia_zz_kgm2=z, inertia_xx_kgm2=x), tmp_path)
    assert part.platform.inertia_xx_kgm2 == ROBOT.platform.inertia_xx_kgm2
    assert "# inertia_xx_kgm2 = 0.1" in text and "no rigid body has it" in text


def test_a_flight_that_tells_nothing_identifies_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """As damaged files do: every interval is too wide, and no parameter is left to fit."""
    from skywright.analysis.identify import fit as module

    known = module.list_parameters

    def narrow(*args: Any) -> Any:
        return [p._replace(widest=1e-15) for p in known(*args)]

    monkeypatch.setattr(module, "list_parameters", narrow)
    found = fit(make_log(12.0, noise=0.01)).estimates
    assert not any(e.identified for e in found)
    assert [e.value for e in found] == [e.parameter.nominal for e in found]


def test_delay_of_the_rotor_signals() -> None:
    """Speeds that are logged 4 ms too early come out as a delay, and spoil nothing else."""
    log = make_log(rate=250.0)
    early = np.roll(log.rotor_speed, -1, axis=0)  # type: ignore[arg-type]
    early[-1] = early[-2]
    found = {e.parameter.name: e for e in fit(log._replace(rotor_speed=early)).estimates}
    assert found["rotor_delay_s"].value == pytest.approx(0.004, abs=2e-4)
    assert found["pose_1.inertia_xx_kgm2"].value == pytest.approx(INERTIA[0], rel=0.01)


def sample(log: FlightLog, keep: np.ndarray) -> FlightLog:
    """Return the log of a run whose recording has the samples `keep` of an exact log."""
    assert log.rotor_speed is not None and log.v_WB is not None
    quaternions = np.roll(Rotation.from_matrix(log.R_WB).as_quat(), 1, axis=1)
    columns = {
        "t": log.t, "est_q_WB": quaternions * np.where(np.sin(log.t) < 0.0, -1.0, 1.0)[:, None],
        "est_v_WB": log.v_WB, "est_w_WB_B": log.w_WB_B, "rotor_speed": log.rotor_speed,
        "q": log.q, "qd": 0.0 * log.q, "cmd_qd": log.servo_command, "f_collision": 0.0 * log.t,
        "cmd_f_B": 0.0 * log.w_WB_B, "cmd_t_B": 0.0 * log.w_WB_B,
        "f_contact": np.zeros((len(log.t), 1)), "spring": 0.0 * log.t,
    }  # fmt: skip
    s = np.zeros(len(log.t), [(n, x.dtype, x.shape[1:]) for n, x in columns.items()])
    for name, x in columns.items():
        s[name] = x
    s, phases = s[keep], np.where(log.t < 2.0, "take_off", "shake")[keep]
    return build_log("uneven", ROBOT, load_description("excitation").world, s, phases, log.joints)


@pytest.mark.parametrize("steps", [(5, 5), (4, 6), (4, 4, 4, 8)])
def test_the_interval_of_the_samples_may_alternate(steps: tuple[int, ...]) -> None:
    """As at 250 and 125 Hz, where a recording has samples each 8 and 12 or 8 and 16 ms."""
    exact = make_log(40.0, rate=500.0)
    at = np.cumsum(np.resize(steps, 4000)) - steps[0]
    log = sample(exact, at[at < len(exact.t)])
    assert not log.notes and np.ptp(np.diff(log.t)) < 1e-9
    assert log.period == pytest.approx(0.01, rel=1e-3)
    np.testing.assert_array_equal(log.free, log.t > 1.995)  # the nearest sample's phase
    found = {e.parameter.name: e for e in fit(log).estimates}
    for name, value in truth().items():
        assert abs(found[name].value - value) < 0.02 * found[name].parameter.scale, name


def test_a_gap_of_a_recording_is_not_flown() -> None:
    exact = make_log(20.0, rate=100.0)
    log = sample(exact, np.flatnonzero((exact.t < 10.0) | (exact.t > 12.0)))
    assert log.notes == ("2.0 s of flight lie in gaps of the log: not used",)
    assert not log.free[(log.t > 10.0) & (log.t < 12.0)].any()
    assert log.free[((log.t > 2.0) & (log.t < 9.9)) | (log.t > 12.01)].all()


def test_a_recording_with_one_wrong_time_is_refused() -> None:
    exact = make_log(20.0, rate=100.0)
    late = exact._replace(t=np.append(exact.t[:-1], 86400.0))
    with pytest.raises(InputError, match="uneven: its 2000 samples span 86400 s at 100 Hz"):
        sample(late, np.arange(2000))


def test_lag_of_a_first_order_response() -> None:
    t = np.arange(0.0, 40.0, 0.01)
    u = build_sines(t, np.arange(0.1, 1.5, 0.1), 0)
    y = np.zeros_like(u)
    tau, gain = 0.07, 0.9
    for i in range(1, len(t)):
        y[i] = gain * u[i - 1] + (y[i - 1] - gain * u[i - 1]) * math.exp(-0.01 / tau)
    lag = fit_lag("servo", "rad/s", t, u, y + 0.02, np.ones(len(t), dtype=bool))
    assert lag.identified and lag.gain == pytest.approx(gain, abs=0.01)
    assert lag.lag == pytest.approx(tau + 0.005, abs=0.003)  # the hold of a step adds half of it
    assert lag.offset == pytest.approx(0.02, abs=0.002) and lag.r_squared > 0.999
    u[1000:1030] = math.nan  # a servo without a command
    part = fit_lag("servo", "rad/s", t, u, y, np.ones(len(t), dtype=bool))
    assert part.identified and part.lag == pytest.approx(lag.lag, abs=0.003)
    u[1000:1030] = 0.0
    still = fit_lag("servo", "rad/s", t, 0 * u, 0 * y, np.ones(len(t), dtype=bool))
    assert not still.identified and "never commanded" in still.reason


@pytest.mark.parametrize("duration", [12.0, 15.5, 16.0, 18.0, 20.0, 36.0, 60.0])
def test_about_a_quarter_is_held_out(duration: float) -> None:
    share = float(np.mean(choose_held_out(np.arange(0.0, duration, 0.05))))
    assert 0.13 <= share <= 0.35


# --- the excitation itself ---

EXCITATION = Excitation(40.0, math.radians(4), math.radians(12), 0.8, 0.15, 1.2)


def plan(robot: Robot) -> Any:
    setup = Setup(load_description("excitation")._replace(robot=robot))
    return plan_excitation(
        robot, setup.loads, EXCITATION, np.array([0, 0, 2.0, 0.3]), posture(robot, "folded"), 9.81
    )  # fmt: skip


@pytest.mark.parametrize("name", ["f550-bridge", "hexarotor", "othex"])
def test_excitation_is_one_motion(name: str) -> None:
    """Rest to rest, derivatives consistent, every rotor within its limits."""
    robot = load_robot(name)[0]
    motion = plan(robot)
    rows = motion.rows
    assert rows is not None and motion.rotor_margin >= 0.0
    for end in (0, -1):
        np.testing.assert_allclose(rows["p_WB"][end], [0, 0, 2.0], atol=1e-9)
        for field in ("v_WB", "a_WB", "w_WB_B"):
            np.testing.assert_allclose(rows[field][end], 0.0, atol=1e-6)
    np.testing.assert_allclose(
        np.gradient(rows["p_WB"], 0.02, axis=0)[2:-2], rows["v_WB"][2:-2], atol=4e-3
    )
    np.testing.assert_allclose(
        np.gradient(rows["v_WB"], 0.02, axis=0)[2:-2], rows["a_WB"][2:-2], atol=2e-2
    )
    step = np.einsum("kji,kjl->kil", rows["R_WB"][:-1], rows["R_WB"][1:])
    turn = np.stack([step[:, 2, 1], step[:, 0, 2], step[:, 1, 0]], axis=1) / 0.02
    middle = 0.5 * (rows["w_WB_B"][:-1] + rows["w_WB_B"][1:])
    np.testing.assert_allclose(turn, middle, atol=2e-2)
    tilt = np.degrees(np.arccos(rows["R_WB"][:, 2, 2]))
    if name == "hexarotor":
        assert tilt.max() < 1e-6  # its tilt follows from the acceleration
    else:
        assert 1.0 < tilt.max() < 7.0


def test_channels_are_orthogonal() -> None:
    t = np.arange(0.0, 36.0, 0.01)
    base = EXCITATION._replace(duration=40.0)
    signals = np.array([build_sines(t, lines, 0) for lines in share_lines(base, 6)])
    assert np.all(np.abs(signals).max(axis=1) > 0.9) and np.all(np.abs(signals).max(axis=1) < 1.01)
    correlation = np.corrcoef(signals)
    assert np.max(np.abs(correlation - np.eye(6))) < 0.02


def test_excitation_that_does_not_fit() -> None:
    """Too heavy to lean at all: told with the rotor that cannot."""
    data = ROBOT.model_dump()
    data["platform"]["mass_kg"] = 3.6
    motion = plan(Robot(**data))
    assert motion.rows is None and "rotor" in motion.blocked_by and "valid" in motion.blocked_by


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (("mission.task.high_hz=0.2",), "too few frequencies"),
        (("mission.task.duration_s=8",), "too few frequencies"),
        (("mission.task.poses=[]",), "poses"),
        (('mission.task.poses=["up"]',), "folded"),
        (('mission.task.poses=["folded", "working", "folded"]',), "a pose appears twice"),
        (("mission.task.tilt_deg=-1",), "tilt_deg"),
        (("mission.task.tilts_deg=1",), "tilt_deg"),
    ],
)
def test_bad_task(sets: tuple[str, ...], said: str) -> None:
    args = [a for s in sets for a in ("--set", s)]
    result = CliRunner().invoke(main, ["plan", "excitation", *args])
    assert result.exit_code == 2 and said in result.stderr, result.stderr


@pytest.fixture(scope="module")
def shaken(tmp_path_factory: pytest.TempPathFactory) -> tuple[Description, Identification]:
    """An excitation flight of a perturbed plant, and what its recording identifies."""
    import skywright

    folder = tmp_path_factory.mktemp("shaken") / "shaken"
    sets = [
        'mission.task.poses=["folded"]',
        "mission.task.joint_deg=0",
        "mission.task.duration_s=24",
    ]
    d = skywright.load("excitation", sets=sets, seed=3)
    result = skywright.run(d, out=folder, report=False)
    assert result.outcome == "succeeded"
    mass = 2.5 * (1 + d.plant.mass_error)  # what a scale would say
    return d, identify([folder], None, mass)


def test_a_flight_gives_back_the_plant_s_deviations(
    shaken: tuple[Description, Identification],
) -> None:
    """run and identify: the perturbed plant's gains, mass distribution and lag."""
    from skywright.models.deviation import build_deviation

    d, found = shaken
    values = {e.parameter.name: e for e in found.fit.estimates}
    gain = build_deviation(d.plant, d.robot, 3).rotor_gain
    for i, g in enumerate(gain):
        assert values[f"rotor_gain_{i + 1}"].value == pytest.approx(g, abs=0.01)
    assert values["pose_1.com_x_m"].value == pytest.approx(0.0033, abs=1e-3)
    # inertia: the platform's is 5 % off, of which arm and gear dilute a part
    for axis, true in (("xx", 0.0528), ("yy", 0.0606), ("zz", 0.0702)):
        e = values[f"pose_1.inertia_{axis}_kgm2"]
        assert e.identified and abs(e.value - true) < max(1.5 * e.half_width, 0.03 * true)
    assert found.rotor_lag is not None and found.rotor_lag.lag == pytest.approx(0.03, abs=0.001)
    r2 = found.fit.prediction.r_squared(found.fit.prediction.predicted)
    assert np.all(r2[3:] > 0.87)  # the rates' noise is up to 1.6 times the file's
    assert "extends" in build_overrides(found, "f550-bridge")


def test_the_page_zooms_over_time_and_nothing_is_cut_off(
    shaken: tuple[Description, Identification], tmp_path: Path,
    show_page: Callable[..., Page],
) -> None:  # fmt: skip
    _, found = shaken
    write_identify_page(found, build_overrides(found, "f550-bridge"), tmp_path / "identify.html")
    page = check_page(show_page, tmp_path / "identify.html", has_plots=True)
    assert page.locator(".panels h4").count() == 6  # three accelerations, three specific forces
    assert page.locator(".panels p").first.inner_text() == "time in the log (s)"


def test_truth_is_the_plant_s() -> None:
    """What claims compare with equals MuJoCo's own mass matrix of the perturbed plant."""
    import mujoco

    from skywright.analysis.identify.truth import compute_truth
    from skywright.description.loader import load_description
    from skywright.models.deviation import build_deviation
    from skywright.models.scene import build_scene

    d = load_description("excitation", seed=4)
    pose = posture(d.robot, "working")
    truth_of, mass = compute_truth(d, pose[None])
    scene = build_scene(d.robot, d.world, build_deviation(d.plant, d.robot, 4))
    data = mujoco.MjData(scene.model)
    data.qpos[3], data.qpos[scene.places.joint_qpos] = 1.0, pose
    mujoco.mj_forward(scene.model, data)
    M = np.zeros((scene.model.nv, scene.model.nv))
    mujoco.mj_fullM(scene.model, data, M)
    body = scene.places.platform_body
    assert mass == pytest.approx(float(scene.model.body_subtreemass[body]), rel=1e-9)
    com = data.subtree_com[body] - data.qpos[:3]
    found = [truth_of[f"pose_1.com_{a}_m"] for a in "xyz"]
    np.testing.assert_allclose(found, com, atol=2e-4)  # a link is 4 mm longer in the plant
    for i, j in INERTIA_AXES:
        name = f"pose_1.inertia_{'xyz'[i]}{'xyz'[j]}_kgm2"
        assert truth_of[name] == pytest.approx(M[3 + i, 3 + j], abs=6e-4)
