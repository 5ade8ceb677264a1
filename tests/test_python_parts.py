"""The parts of the Python API: scripts of the docs, what importing costs, results by name."""

from __future__ import annotations

import ast
import inspect
import re
import runpy
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import skywright
from skywright.analysis.campaign.campaign import CampaignResult
from skywright.analysis.identify.fit import Fit
from skywright.analysis.identify.identify import Identification
from skywright.analysis.identify.identify import identify as identify_logs
from skywright.analysis.locate.locate import LocateReport
from skywright.analysis.locate.locate import locate as locate_files
from skywright.core.compiled_code import _list_imports, find_dependents
from skywright.errors import InfeasibleError, InputError
from skywright.inspection.weld import WeldResult
from skywright.inspection.weld_data import WeldReport, process_file
from skywright.inspection.weld_line import WeldLine
from skywright.models import as_mujoco
from skywright.models.capability import Capability
from skywright.models.localisation.trajectory import Trajectory
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.run.planning import MissionPlan
from skywright.run.result import RunResult
from skywright.run.results import read_name
from skywright.vehicle.bus import Body

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = sorted((ROOT / "examples" / "parts").glob("*.py"))
PAGE = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")


# What importing costs


def test_importing_the_package_touches_no_files_and_loads_nothing_heavy():
    code = """
import sys
seen = []
FILES = ("open", "os.scandir", "os.mkdir", "os.remove", "os.rename", "os.utime")
def hook(event, args):
    if event in FILES and not str(args[0]).endswith((".py", ".pyc", ".so")):
        seen.append((event, str(args[0])))
sys.addaudithook(hook)
import skywright
assert not seen, seen
heavy = {"numpy", "numba", "scipy", "mujoco", "pydantic", "importlib.metadata"} & set(sys.modules)
assert not heavy, heavy
ours = sorted(name for name in sys.modules if name.startswith("skywright."))
assert ours == ["skywright.errors"], ours
assert skywright.__version__ and seen  # its metadata are read when asked for
"""
    done = subprocess.run([sys.executable, "-B", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_stale_code_is_dropped_wherever_compiled_code_is_loaded():
    """Every module that compiles with a cache imports the one that drops it, directly or not."""
    root = ROOT / "src" / "skywright"
    texts = {}
    for path in root.rglob("*.py"):
        name = ".".join(path.relative_to(root.parent).with_suffix("").parts)
        texts[name.removesuffix(".__init__")] = path.read_text(encoding="utf-8")
    imports = {}
    for name, text in texts.items():
        at_the_top = "\n".join(line for line in text.splitlines() if not line.startswith(" "))
        imports[name] = set(_list_imports(at_the_top, set(texts)))
    safe = find_dependents(["skywright.core.user_code"], imports)
    assert "skywright" not in safe
    unsafe = {n for n, text in texts.items() if re.search(r'cache=True|"cache": True', text)} - safe
    assert not unsafe


# The scripts


@pytest.mark.docs
def test_scripts_run(tmp_path, monkeypatch, capsys):
    """In a folder that they share, as a reader of the page has it."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    for script in SCRIPTS:
        runpy.run_path(str(script), run_name="__main__")
        assert capsys.readouterr().out, script


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_script_is_what_the_page_shows(script):
    text = script.read_text(encoding="utf-8")
    body = text.partition('"""\n\n')[2]
    assert f"```python\n{body}```" in PAGE
    lines = body.splitlines()
    code = [n for n in ast.walk(ast.parse(body)) if isinstance(n, ast.stmt)]
    code = [n for n in code if not isinstance(n, ast.Import | ast.ImportFrom)]
    assert len(code) <= 10 and len(lines) <= 20


def test_the_page_names_all_that_is_public():
    assert {name for name in skywright.__all__ if f"`{name}" not in PAGE} == set()
    assert set(skywright.__all__) <= set(dir(skywright))


def test_the_page_lists_the_keywords_of_the_commands():
    listed: dict[str, list[str]] = {"weld": [], "locate": [], "identify": []}
    table = PAGE.partition("| function | keyword |")[2].partition("\n\n")[0].splitlines()[2:]
    for row in table:
        function, keywords = row.split("|")[1:3]
        listed[function.strip(" `")] += re.findall(r"`(\w+)`", keywords)
    functions = {"weld": process_file, "locate": locate_files, "identify": identify_logs}
    for name, function in functions.items():
        first, *keywords = inspect.signature(getattr(skywright, name)).parameters
        assert first in ("data", "logs") and sorted(listed[name]) == sorted(keywords)
        inner = inspect.signature(function).parameters
        assert set(keywords) <= {"mass", *inner}
        for key in keywords:  # the same defaults
            mine = inspect.signature(getattr(skywright, name)).parameters[key].default
            assert key not in inner or inner[key].default in (mine, inspect.Parameter.empty)


def test_the_page_lists_attributes_that_results_have():
    heads = {f" `{c.__name__}` |": c for c in (
        RunResult, Capability, CampaignResult, WeldReport, WeldLine, LocateReport, Identification
    )} | {"of a plan |": MissionPlan}  # fmt: skip
    for head, cls in heads.items():
        table = PAGE.partition(head)[2]
        rows = table.partition("\n\n")[0].splitlines()[2:]
        names = [n for row in rows for n in re.findall(r"`([\w.]+)(?:\(\))?`", row.split("|")[1])]
        assert names
        for name in names:
            owner, _, inner = name.partition(".")
            assert hasattr(cls, owner), f"{cls.__name__}.{name}"
            part = {"result": WeldResult, "trajectory": Trajectory, "fit": Fit}.get(owner)
            assert not inner or hasattr(part, inner), f"{cls.__name__}.{name}"


# Results by name


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory):
    sets = {"mission.task.points": [{"x_m": 0.3, "y_m": 0.0, "z_m": 1.2, "hold_s": 0.5}]}
    out = tmp_path_factory.mktemp("results") / "run"
    return skywright.run(skywright.load("waypoints", sets=sets), out=out, report=False)


@pytest.fixture(scope="module")
def directory(result) -> Path:
    return result.directory


def test_the_estimate_of_a_run_is_judged_from_its_start_on(directory):
    bag = directory / "recording.mcap"
    found = skywright.locate(
        f"{bag}:/estimate/pose", reference=f"{bag}:/truth/pose", compare="none"
    )
    assert found.to_json()["errors"]["trajectory"]["absolute_m"]["max"] < 0.01


def test_a_run_is_read_back_by_name(result):
    run, samples = skywright.open_run(result.directory), result.samples
    assert run.outcome == result.outcome and run.phases == result.phases
    assert run.metrics == result.metrics
    for name in run.names:
        assert len(run[name])
    np.testing.assert_array_equal(run["platform.p_W"], samples["p_WB"])
    np.testing.assert_array_equal(run["p_WB"], samples["p_WB"])
    assert run["/sensors/inertial"]["gyro"].shape[1] == 3
    assert [r["passed"] for r in run.requirements] == [r.passed for r in result.requirements]
    assert [e.text for e in run.events]
    for shown in (result, run):  # without the samples
        assert repr(shown).endswith(f"{result.directory}: {result.outcome}>")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("platform.p_w", ["no 'platform.p_w'", "platform.p_W"]),
        ("gapp", ["no 'gapp'", "gap"]),
        ("/sensors/imu", ["no stream '/sensors/imu'", "/sensors/inertial"]),
    ],
)
def test_a_wrong_name_suggests_near_ones(directory, name, words):
    with pytest.raises(InputError) as caught:
        skywright.open_run(directory)[name]
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize(
    ("column", "name"),
    [
        ("p_WT", "tip.p_W"),
        ("w_WB_B", "platform.w_B"),
        ("est_p_WT", "estimate.tip.p_W"),
        ("ref_q_WB", "reference.platform.q_W"),
        ("meas_p_WT", "measured.tip.p_W"),
        ("left_p_WH", "left.hand.p_W"),
        ("object0_q_WO", "object0.q_W"),
        ("f_normal", "f_normal"),
        ("left_est_p_WH", "left_est_p_WH"),
    ],
)
def test_names_say_whose_and_what(column, name):
    assert read_name(column) == name


def test_names_of_columns_are_unique(directory):
    run = skywright.open_run(directory)
    assert len({read_name(c.name) for c in run.columns}) == len(run.columns)


def test_a_data_frame_has_a_column_a_number(directory):
    run = skywright.open_run(directory)
    if find_spec("pandas") is None:
        with pytest.raises(InputError, match=r"skywright\[pandas\]"):
            run.to_dataframe()
        return
    frame = run.to_dataframe()
    assert frame.index.name == "t" and len(frame) == len(run["t"])
    np.testing.assert_array_equal(frame["p_WB_z"], run["p_WB"][:, 2])
    np.testing.assert_array_equal(frame["q_WB_w"], run["q_WB"][:, 0])
    np.testing.assert_array_equal(frame["rotor_thrust_1"], run["rotor_thrust"][:, 1])


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"is not a run directory, mission\.toml is missing"):
        skywright.open_run(tmp_path)


# Robot, model, plan


@pytest.mark.parametrize("nominal", [False, True])
def test_the_model_as_text_is_the_model_that_flies(nominal):
    text = skywright.build_mjcf("othex", "pipe", nominal=nominal)
    read, built = mujoco.MjModel.from_xml_string(text), skywright.build_model(
        "othex", "pipe", nominal=nominal
    )  # fmt: skip
    names = ("nq", "nv", "nu", "ngeom", "npair", "nsensor")
    assert [getattr(read, n) for n in names] == [getattr(built, n) for n in names]
    robot = skywright.load_robot("othex")
    mass = compute_body(build_body_model(robot, 9.81), posture(robot, "folded"))[0]
    assert sum(read.body_mass) == pytest.approx(mass, rel=1e-9)
    np.testing.assert_allclose(
        read.body_inertia, built.body_inertia, rtol=1e-5, atol=1e-12
    )  # six digits
    assert (built.geom_contype.any() or built.npair > 0) is not nominal


def test_the_text_has_the_stiffness_of_docking_feet():
    """The feet's stiffness follows from the compiled model: every array must be in the text."""
    built = skywright.build_model("f550-bridge")
    read = mujoco.MjModel.from_xml_string(skywright.build_mjcf("f550-bridge"))
    assert built.geom_solref.min() < -1000.0
    for name in (n for n in dir(built) if not n.startswith("_")):
        values = getattr(built, name)
        if isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
            np.testing.assert_allclose(
                getattr(read, name), values, rtol=1e-4, atol=1e-8, err_msg=name
            )


def test_sizes_that_mujoco_refuses_are_wrong_input(monkeypatch):
    def build_wrong(*_):
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(name="dot", size=[0.0, 0.0, 0.0])
        return spec

    monkeypatch.setattr(as_mujoco, "build_spec", build_wrong)
    with pytest.raises(InputError, match=r"robot 'othex' in world 'open': .*size"):
        skywright.build_mjcf("othex")


BOX = skywright.Box(centre=(2.0, 0.0, 1.0), size=(0.2, 2.0, 2.0))


def distance_to_box(p):
    return np.linalg.norm(np.maximum(np.abs(p - [2.0, 0.0, 1.0]) - [0.1, 1.0, 1.0], 0.0))


def test_a_motion_goes_around_ones_own_shapes():
    ends = ((0.0, 0.0, 1.0, 0.0), (4.0, 0.0, 1.0, 1.0))
    free = skywright.plan_motion("hexarotor", *ends)
    assert len(free.p_WB) == 2 and free.yaw[-1] == pytest.approx(1.0)
    way = skywright.plan_motion("hexarotor", *ends, [BOX], margin=0.2)
    assert len(way.p_WB) > 2 and way.clearance >= 0.2
    points = np.concatenate([np.linspace(a, b, 50) for a, b in zip(way.p_WB, way.p_WB[1:])])  # noqa: B905
    assert min(map(distance_to_box, points)) >= 0.2
    again = skywright.plan_motion("hexarotor", *ends, [BOX], margin=0.2)
    np.testing.assert_array_equal(way.p_WB, again.p_WB)


def test_a_motion_into_a_shape_is_refused_with_its_name():
    with pytest.raises(InfeasibleError, match="shape 0") as caught:
        skywright.plan_motion("hexarotor", (0.0, 0.0, 1.0, 0.0), (2.0, 0.0, 1.0, 0.0), [BOX])
    assert caught.value.blocked_by.startswith("goal")
    assert caught.value.blocked_by.endswith("they overlap")


def test_of_several_shapes_the_one_that_the_robot_is_in_overlaps():
    """The start is 5 cm from shape 0 and inside shape 1."""
    ends = ((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 9.0, 0.0))
    below = skywright.Box((0.0, 0.0, 0.1), (9.0, 9.0, 0.2))
    with pytest.raises(InfeasibleError) as caught:
        skywright.plan_motion("hexarotor", *ends, [below], margin=1.0)
    gap = float(re.search(r"shape 0 \(box\) .*, (\S+) m$", caught.value.blocked_by)[1])
    near = below._replace(centre=(0.0, 0.0, 0.1 + gap - 0.05))
    with pytest.raises(InfeasibleError, match=r"start: .* shape 0 \(box\) .*, 0\.050 m$"):
        skywright.plan_motion("hexarotor", *ends, [near])
    around = skywright.Sphere((0.0, 0.0, 1.0), 0.02)
    with pytest.raises(InfeasibleError, match=r"start: .* shape 1 \(sphere\) .*: they overlap$"):
        skywright.plan_motion("hexarotor", *ends, [near, around])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"shapes": [skywright.Sphere((0.0, 0.0, 1.0), -1.0)]}, "shape 0: Sphere"),
        ({"shapes": [skywright.Box((0.0, 0.0), (1.0, 1.0, 1.0))]}, "shape 0: Box"),
        ({"shapes": [skywright.Box((9.0, 0.0, 1.0), (1.0, 1.0, 1.0), -np.eye(3))]}, "a rotation"),
        ({"shapes": [skywright.Box((9.0, 0.0, 1.0), (1.0, 1.0, 1.0), None)]}, "Box.R_W = None; "),
        ({"shapes": [skywright.Box((9.0, 0.0, 1.0), (1.0, -2.0, 1.0))]}, r"Box.size = \(1.0, -2.0"),
        ({"shapes": [skywright.Box((9.0, 0.0, 1.0), (1.0, 0.0, 1.0))]}, r"Box.size = \(1.0, 0.0"),
        ({"shapes": [skywright.Cylinder((9.0, 0, 1), (9, 0, 1), 0.1)]}, "Cylinder.end = .*start"),
        ({"shapes": [skywright.Cylinder((9.0, 0, 1), (9, 0, 2), 0.0)]}, "Cylinder.radius = 0.0"),
        ({"shapes": BOX}, "shapes: one Box; valid: a list"),
        ({"shapes": [skywright.Sphere((9.0, 0.0, 1.0), 0.1)] * 200}, "200 shapes"),
        ({"goal": (1.0, 2.0, 3.0)}, "goal: .* four numbers"),
        ({"goal": (np.nan, 0.0, 1.0, 0.0)}, "goal: .* finite"),
        ({"goal": skywright.Configuration(np.ones(3), 0.0, np.zeros(5))}, "q has 5 angles"),
        ({"margin": 0.0}, "margin 0"),
        ({"margin": "1"}, "margin '1'"),
        ({"seed": -1}, "seed -1"),
        ({"seed": 1.5}, "seed 1.5"),
        ({"shapes": None}, "shapes: None"),
        ({"start": "home"}, "start: 'home'; .* four numbers"),
        ({"start": ["0", "0", "1", "0"]}, "start: .* four numbers"),
        ({"goal": [[1.0], [1.0, 2.0]]}, "goal: .* four numbers"),
        ({"goal": skywright.Configuration(np.ones(3), 0.0, "abc")}, "q = 'abc'; valid: 0 angles"),
        ({"goal": skywright.Configuration("abc", 0.0, [])}, "goal: .* three numbers"),
        ({"goal": skywright.Configuration(np.ones(3), "east", [])}, "goal: .* yaw a number"),
        ({"goal": (1e12, 0.0, 1.0, 0.0)}, "goal: .* within 1000 m"),
        ({"robot": "othexx"}, "othex"),
    ],
)
def test_a_scene_that_is_none_is_refused(change, words):
    case = {"robot": "hexarotor", "start": (0.0, 0.0, 1.0, 0.0), "goal": (1.0, 0.0, 1.0, 0.0)}
    with pytest.raises(InputError, match=words):
        skywright.plan_motion(**{**case, **change})


@pytest.mark.parametrize(
    ("load", "given", "first"),
    [
        ("load_robot", ["othex"], {}),
        ("load", ["waypoints"], {}),
        ("fly", [], {"robot": "othex"}),
        ("campaign", ["waypoints", 2, {}], {}),
    ],
)
def test_a_wrong_key_names_the_argument_that_holds_it(load, given, first):
    give = getattr(skywright, load)
    with pytest.raises(InputError, match=r"^sets: unknown key robot\.battery\.mass_kg; valid: "):
        give(*given, **first, sets={"robot.battery.mass_kg": 1})
    with pytest.raises(InputError, match=r"^--set: unknown key robot\.battery\.mass_kg"):
        give(*given, **first, sets=["robot.battery.mass_kg=1"])  # as on the command line


def test_the_wind_limit_of_a_coplanar_robot_is_that_of_the_best_tilt():
    can = skywright.compute_capability("hexarotor")
    np.testing.assert_allclose(can.lateral_force, 0.0, atol=1e-9)
    np.testing.assert_array_equal(can.wind_limit, can.wind_limit_tilted)
    assert can.wind_limit.min() > 5.0
    tilted = skywright.compute_capability("othex")
    assert np.all(tilted.wind_limit_tilted > tilted.wind_limit)


def test_a_capability_takes_a_name_or_a_robot():
    heavy = skywright.load_robot("hexarotor", sets=["robot.platform.mass_kg=8"])
    light = skywright.compute_capability("hexarotor")
    assert skywright.compute_capability(heavy).payload < light.payload


@pytest.mark.parametrize("posture", [["a", "b"], [[0.0], [0.0, 1.0]], None])
def test_a_posture_that_is_none_is_refused(posture):
    with pytest.raises(InputError, match=r"posture .*; valid: .* 2 angles"):
        skywright.compute_capability("othex", posture=posture)


# A law and an estimator alone


def test_a_law_alone_carries_the_robot_and_steers_back():
    law = skywright.build_law("waypoints")
    weight = law.vehicle.assembly.get(Body)["mass"] * 9.81
    np.testing.assert_allclose(law.step().f_B, [0.0, 0.0, weight], atol=1e-6)
    law.estimate.p_WB = law.reference.p_WB + [0.0, 0.0, 0.2]  # too high
    first = law.step().f_B[2]
    assert first < weight and law.step().f_B[2] != first  # the integral goes on
    assert law.dt == pytest.approx(0.002) and {"ref", "est"} <= set(law.ports)


def test_the_records_of_a_law_show_their_values_and_name_wrong_ones():
    law = skywright.build_law("waypoints")
    law.reference.v_WB = [0.5, 0.0, 0.25]
    lines = repr(law.reference).splitlines()
    assert "v_WB = [0.5 0. 0.25]" in lines and "track_tip = 0.0" in lines
    assert [line.partition(" = ")[0] for line in lines] == list(law.reference.dtype.names)
    with pytest.raises(ValueError, match=r"^p_WB: .*\(2,\)"):
        law.estimate.p_WB = [1, 2]
    with pytest.raises(ValueError, match=r"^p_WB: "):
        law.estimate.p_WB = "abc"
    with pytest.raises(AttributeError, match=r"no field 'p_W'; valid: .*p_WB"):
        law.estimate.p_W = [1, 2, 3]


def test_a_law_that_tracks_the_tip_reads_the_tip_as_it_is_set():
    law = skywright.build_law(skywright.load("waypoints", robot="othex"))
    rest = law.step().f_B
    law.estimate.p_WT = law.reference.p_WT + [0.1, 0.0, 0.0]  # the tip alone is too far ahead
    np.testing.assert_allclose(law.step().f_B, rest, atol=1e-9)
    law.reference.track_tip = 1.0
    assert law.step().f_B[0] < -1.0


@pytest.mark.parametrize("state", [b"x", None, {}])
def test_what_is_no_state_is_not_restored(state):
    vehicle = skywright.build_vehicle("waypoints")
    vehicle.tick()
    with pytest.raises(InputError, match=r"restore: .*; valid: a state that save\(\) returned"):
        vehicle.restore(state)


def simulate_imu(h, seconds=6.0, rest=0.0):
    """A body that rests, then swings along x and turns about z: exact samples and poses."""
    t = h * np.arange(1, round(seconds / h) + 1)
    s, m = np.maximum(t - rest, 0.0), t - 0.5 * h - rest  # a sample is a mean over its period
    on, o = m > 0.0, 0.0 * t
    yaw, p = 0.4 * np.sin(s), np.stack([0.5 * (1 - np.cos(2 * s)), o, o + 1], axis=1)
    a_W = np.stack([on * 2.0 * np.cos(2 * m), o, o + 9.81], axis=1)
    R = Rotation.from_euler("z", (on * 0.4 * np.sin(m))[:, None]).as_matrix()
    gyro = np.stack([o, o, on * 0.4 * np.cos(m)], axis=1)
    return t, gyro, np.einsum("nji,nj->ni", R, a_W), p, yaw


@pytest.mark.parametrize("h", [0.001, 0.004])
def test_an_estimator_follows_ones_own_arrays(h):
    t, gyro, accel, p, yaw = simulate_imu(h)
    at = slice(9, None, round(0.02 / h))
    R = Rotation.from_euler("z", yaw[at][:, None]).as_matrix()
    found = skywright.run_estimator(
        "waypoints", t=t + 1e6, gyro=gyro, accel=accel, t_fix=t[at] + 1e6, p_fix=p[at], R_fix=R
    )
    late = found["t"] > 1e6 + 3.0
    assert found["ready"][late].all() and not found["ready"][0]
    for name in ("p_WB", "v_WB", "R_WB", "w_WB_B", "p_std"):
        known = np.isfinite(found[name]).reshape(len(found), -1)
        assert np.array_equal(known.all(axis=1), found["ready"]), name
        assert np.array_equal(known.any(axis=1), found["ready"]), name
    true = np.stack([np.interp(found["t"] - 1e6, t, x) for x in p.T], axis=1)
    assert np.abs(found["p_WB"] - true)[late].max() < 0.005
    assert np.abs(found["v_WB"][:, 0] - np.sin(2 * (found["t"] - 1e6)))[late].max() < 0.05
    assert np.abs(found["w_WB_B"][:, 2] - 0.4 * np.cos(found["t"] - 1e6))[late].max() < 0.02


def test_an_estimator_takes_fixes_of_the_antenna_with_a_heading():
    d = skywright.load("waypoints", sets={"world.localisation": "gnss"})
    t, gyro, accel, p, yaw = simulate_imu(0.002, 12.0, 3.0)
    s = d.robot.sensors
    lever = Rotation.from_euler("z", yaw[:, None]).apply(
        [s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]
    )
    found = skywright.run_estimator(
        d, t=t, gyro=gyro, accel=accel, t_fix=t[::50], p_fix=(p + lever)[::50], heading=yaw[::50]
    )
    assert found["ready"][-1] and np.abs(found["p_WB"][-2500:] - p[-2500:]).max() < 0.1


def test_fixes_may_come_faster_than_control_ticks():
    """The newest fix of a tick counts; those before it do not pile up."""
    d = skywright.load("waypoints", sets={"world.localisation": "gnss"})
    tick = skywright.build_vehicle(d).dt
    t, gyro, accel, p, yaw = simulate_imu(tick / 4.0, 12.0, 3.0)
    s = d.robot.sensors
    antenna = Rotation.from_euler("z", yaw[:, None]).apply(
        [s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]
    )
    found = skywright.run_estimator(
        d, t=t, gyro=gyro, accel=accel, t_fix=t, p_fix=p + antenna, heading=yaw
    )
    assert len(found) == len(t) // 4
    last = p[3::4][: len(found)]
    assert found["ready"][-1] and np.abs(found["p_WB"] - last)[len(found) // 2 :].max() < 0.1


def rest(noise, rate=20, seconds=10.0, **change):
    """Arrays of a level robot at rest at (0, 0, 1) m, with position noise (m) of the fixes."""
    rng, h = np.random.default_rng(1), 0.001
    t = h * np.arange(1, round(seconds / h) + 1)
    at = t[9 :: round(1.0 / rate / h)]
    turns = rng.normal(0.0, 0.002, (len(at), 3))
    case = {
        "description": "waypoints", "t": t, "gyro": rng.normal(0.0, 0.01, (len(t), 3)),
        "accel": rng.normal(0.0, 0.1, (len(t), 3)) + [0.0, 0.0, 9.81], "t_fix": at,
        "p_fix": rng.normal(0.0, noise, (len(at), 3)) + [0.0, 0.0, 1.0],
        "R_fix": Rotation.from_rotvec(turns).as_matrix(),
    }  # fmt: skip
    return {**case, **change}


def test_fixes_that_are_noisier_than_stated_are_learned_and_told():
    """2 mm instead of 0.3 mm: the error becomes that of the right key, and is stated."""
    with pytest.warns(UserWarning, match=r"position_noise_m = 0.0003 \(found: 0.002") as told:
        found = skywright.run_estimator(**rest(0.002))
    assert len(told) == 1
    assert re.search(r"attitude_noise_rad = 0.002 \(found: 0.00(1[89]|2)", str(told[0].message))
    sets = {"world.mocap.position_noise_m": 0.002}
    right = skywright.run_estimator(
        **rest(0.002, description=skywright.load("waypoints", sets=sets))
    )
    late = found["t"] > 2.0
    rms = [
        np.sqrt(np.mean(np.sum((x["p_WB"][late] - [0.0, 0.0, 1.0]) ** 2, axis=1)))
        for x in (found, right)
    ]
    assert rms[1] < 0.002 and rms[0] < 1.25 * rms[1]
    stated = np.sqrt(np.mean(np.sum(found["p_std"][late] ** 2, axis=1)))
    assert stated == pytest.approx(rms[0], rel=0.3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("noise", "rate"), [(0.0002, 20), (0.0006, 100)])
def test_fixes_as_stated_are_accepted_without_a_warning(noise, rate):
    found = skywright.run_estimator(**rest(noise, rate, 4.0))
    error = found["p_WB"][found["ready"]] - [0.0, 0.0, 1.0]
    assert np.sqrt(np.mean(error**2)) < noise


REST = rest(0.0003, seconds=2.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t": 1e3 * REST["t"], "t_fix": 1e3 * REST["t_fix"]}, "^t: 1 samples per second; .*in s"),
        ({"t": 1e-3 * REST["t"], "t_fix": 1e-3 * REST["t_fix"]}, "^t: 1e.06 samples per second"),
        ({"t_fix": 1e3 * REST["t_fix"] - 9.0}, "^t_fix: 50 s from fix to fix"),
        ({"gyro": REST["gyro"] + 40.0}, "^gyro: 69.* rad/s rms; valid: at most 35"),
        ({"accel": REST["accel"] / 9.81}, r"^accel: magnitude 0.999. m/s\^2; valid: 2.94 to"),
        ({"accel": 1e3 * REST["accel"]}, "^accel: magnitude 98"),
        ({"accel": -REST["accel"]}, r"^accel, R_fix: .* in W is \(.*-9.81\)"),
        ({"R_fix": REST["R_fix"] @ np.diag([1.0, -1.0, -1.0])}, "^accel, R_fix: .*up"),
        ({"p_fix": 1e5 * REST["t_fix"][:, None] * [1.0, 0.0, 0.0]}, "^p_fix: .* m from its median"),
        ({"p_fix": 150.0 * REST["t_fix"][:, None] * [1.0, 0.0, 0.0]}, "^p_fix: moves at 150 m/s"),
        ({"p_fix": 1e3 * (REST["p_fix"] - [0.0, 0.0, 1.0])}, "^p_fix: 40 fixes did not start"),
    ],
)  # fmt: skip
def test_implausible_arrays_are_refused_with_their_unit(change, words):
    with pytest.raises(InputError, match=words):
        skywright.run_estimator(**{**REST, **change})


def test_a_turned_gyroscope_is_told():
    t, gyro, accel, p, yaw = simulate_imu(0.002)
    R = Rotation.from_euler("z", yaw[::5][:, None]).as_matrix()
    with pytest.warns(UserWarning, match="compare axes, clocks and units"):
        skywright.run_estimator(
            "waypoints", t=t, gyro=-gyro, accel=accel, t_fix=t[::5], p_fix=p[::5], R_fix=R
        )


def test_the_observer_uses_the_period_of_the_fixes():
    """Its gains depend on it: with the control period (2 ms) the error is five times as large."""
    description = skywright.load("waypoints", sets={"mission.estimator": "observer"})
    t, t_fix, w = 0.001 * np.arange(6000), 0.01 * np.arange(600), 2.0 * np.pi * 0.5  # 0.5 Hz
    accel = np.zeros((len(t), 3)) + [0.0, 0.0, 9.81]
    accel[:, 0] = -0.5 * w**2 * np.sin(w * t)
    p = np.stack([0.5 * np.sin(w * t_fix), 0.0 * t_fix, 0.0 * t_fix + 1.0], axis=1)
    found = skywright.run_estimator(
        description, t=t, gyro=np.zeros((len(t), 3)), accel=accel, t_fix=t_fix, p_fix=p,
        R_fix=np.tile(np.eye(3), (len(t_fix), 1, 1)),
    )  # fmt: skip
    late = found[found["t"] > 2.0]
    error = late["p_WB"][:, 0] - 0.5 * np.sin(w * late["t"])
    assert np.sqrt(np.mean(error**2)) < 0.015


GNSS = skywright.load("waypoints", sets={"world.localisation": "gnss"})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gyro": np.zeros((99, 3))}, r"gyro: has the shape \(99, 3\); valid: \(100, 3\)"),
        ({"accel": np.full((100, 3), np.nan)}, "accel: row 0 is not finite"),
        ({"t": np.linspace(0, 1, 100) ** 3}, "t: .*evenly spaced"),
        ({"t_fix": [0.2, 0.1]}, "t_fix: .*rise"),
        ({"t": np.zeros(100)}, "t: .*rise"),
        ({"t": -0.001 * np.arange(100)}, "t: .*rise"),
        ({"t": 1e9 + 0.001 * np.arange(100)}, "t_fix: 0.01 to 0.02 s; .*same clock"),
        ({"t": [0.0, 0.001], "gyro": np.zeros((2, 3)), "accel": np.zeros((2, 3))},
         "t_fix: .*within the times t"),
        ({"t_fix": [], "p_fix": np.zeros((0, 3)), "R_fix": np.zeros((0, 3, 3))},
         "t_fix: no fixes"),
        ({"R_fix": np.zeros((2, 3, 3))}, "R_fix: row 0 is not a rotation"),
        ({"R_fix": np.stack([np.eye(3), 2.0 * np.eye(3)])}, "R_fix: row 1 is not a rotation"),
        ({"R_fix": np.stack([np.eye(3), -np.eye(3)])}, "R_fix: row 1 is not a rotation"),
        ({"R_fix": None}, "R_fix: missing"),
        ({"heading": [0.0, 0.0]}, "heading: not read; .*give R_fix only"),
        ({"description": GNSS, "R_fix": None}, "heading: missing"),
        ({"description": GNSS, "heading": [0.0, 0.0]}, "R_fix: not read; .*give heading only"),
        ({"description": skywright.load("waypoints", sets={"mission.estimator": "truth"})},
         "reads no inertial samples"),
        ({"description": skywright.load("bridge-contact", sets={
            "world.localisation": "total-station"})}, "no input for odometry of a tracking camera"),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_refused(change, words):
    case = {
        "description": "waypoints", "t": 0.001 * np.arange(100), "gyro": np.zeros((100, 3)),
        "accel": np.zeros((100, 3)), "t_fix": [0.01, 0.02], "p_fix": np.zeros((2, 3)),
        "R_fix": np.tile(np.eye(3), (2, 1, 1)),
    }  # fmt: skip
    with pytest.raises(InputError, match=words):
        skywright.run_estimator(**{**case, **change})


@pytest.mark.parametrize("title, kind", [("a `Capability`", Capability), ("a plan", MissionPlan)])
def test_the_page_lists_attributes_that_exist(title: str, kind: type) -> None:
    table = PAGE.partition(f"| attribute of {title} |")[2].partition("\n\n")[0].splitlines()[2:]
    named = {name for row in table for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert len(named) >= 8
    assert all(hasattr(kind, name) for name in named)


# Data of instruments and flights

SCAN = ROOT / "examples" / "weld_data" / "pipe_scan.csv"


def test_a_calibration_span_is_a_text_or_two_numbers():
    texts = skywright.weld(SCAN, calibrate="0:7")
    assert skywright.weld(SCAN, calibrate=(0, np.float32(7.0))).to_json() == texts.to_json()
    for wrong in ((0,), 7, ("a", 1), (0, 1, 2)):
        with pytest.raises(InputError, match=r"calibrate: .*; valid: 2 numbers, or a text T0:T1"):
            skywright.weld(SCAN, calibrate=wrong)


def test_a_threshold_above_the_signal_in_air_has_a_note():
    usual = skywright.weld(SCAN, calibrate="0:7")
    assert 0.9 < usual.result.contact_fraction < 1.0
    assert not any("air counts as contact" in note for note in usual.notes)
    above = 1.1 * usual.result.calibration.excursion
    found = skywright.weld(SCAN, calibrate="0:7", lift_off_threshold=above)
    assert found.result.contact_fraction == 1.0
    assert any("air counts as contact" in note for note in found.notes)


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """A trajectory, and the same one by a clock that is 0.35 s ahead."""
    t = 0.02 * np.arange(1000)
    p = np.stack([np.sin(t), np.cos(0.7 * t), 0.1 * t], axis=1)
    files = tmp_path / "track.txt", tmp_path / "reference.txt"
    for file, clock in zip(files, (t, t + 0.35), strict=True):
        np.savetxt(file, np.column_stack([clock, p, 0.0 * p, np.ones(len(t))]), fmt="%.6f")
    return files


def test_a_reference_offset_is_the_clock_of_the_reference_minus_that_of_the_trajectory(pair):
    track, reference = pair
    for offset in (0.35, np.float32(0.35), None):  # None: it is estimated
        found = skywright.locate(
            track, reference=reference, compare="none", reference_offset=offset
        ).errors["trajectory"]
        assert found.absolute.max < 1e-3 and found.time_offset == pytest.approx(0.35, abs=1e-3)
        assert isinstance(found.time_offset, float)
    for wrong in (-0.35, 0.0):
        found = skywright.locate(
            track, reference=reference, compare="none", reference_offset=wrong
        ).errors["trajectory"]
        assert found.absolute.rms > 0.2


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"time_offset": 0.35}, "--time-offset needs a station.*; valid here: --reference-offset"),
        ({"span": (0, 10)}, "--calibrate needs a station"),
        ({"prism": (0.0, 0.0, 1.0)}, "--prism needs a station"),
        ({"span": 3}, "span: 3; valid: 2 numbers, or a text T0:T1"),
        ({"prism": (0, 0)}, r"prism: \(0, 0\); valid: 3 numbers, or a text X,Y,Z"),
        ({"reference_offset": "0"}, "--reference-offset '0'; valid: a number of seconds"),
        ({"frame": ("a.csv",)}, r"frame: \('a.csv',\); valid: two files"),
        ({"frame": "points.csv"}, "frame: 'points.csv'; valid: two files"),
        ({"frame": ("a.csv", "b.csv", "c.csv")}, r"frame: \('a.csv', .*\); valid: two files"),
        ({"frame": ("a.csv", 3)}, r"frame: \('a.csv', 3\); valid: two files"),
        ({"reference_offset": [0, 1]}, r"--reference-offset \[0, 1\]; valid: a number"),
    ],
)
def test_arguments_of_locate_that_do_not_fit_are_refused(pair, given, words):
    with pytest.raises(InputError, match=words):
        skywright.locate(pair[0], reference=pair[1], **given)


@pytest.mark.parametrize("mass", ["5.85", [1.0], -1.0, float("nan")])
def test_a_mass_that_is_none_is_refused(directory, mass):
    with pytest.raises(InputError, match=r"--mass .*: give the mass of the robot in kg, above 0"):
        skywright.identify(directory, mass=mass)
