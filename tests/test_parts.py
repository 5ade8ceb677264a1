"""Components that a description names: tables, kinds from files, and what is refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from skywright.description.dump import dump_description, list_sources
from skywright.description.loader import list_layer_problems, load_description
from skywright.errors import InputError, SimulationError
from skywright.run.backends import build_vehicle
from skywright.run.directory import load_run
from skywright.run.parts import build_estimator, build_law, build_named
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup

EXAMPLES = Path(__file__).parent.parent / "examples"
LQR = f"{EXAMPLES / 'laws' / 'lqr.py'}:Lqr"
COMPLEMENTARY = f"{EXAMPLES / 'estimators' / 'complementary.py'}:Complementary"

EMPTY_LAW = """
from skywright.vehicle.bus import Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Law, Out
{imports}

class Mine(Law):
    {body}
"""


def write_law(folder: Path, body: str, imports: str = "", name: str = "mine.py") -> str:
    path = folder / name
    path.write_text(EMPTY_LAW.format(body=body.replace("\n", "\n    "), imports=imports))
    return f"{path}:Mine"


def load(**sets: object):
    return load_description(
        "waypoints", "othex", sets={k.replace("__", "."): v for k, v in sets.items()}
    )


# --- tables ------------------------------------------------------------------------------------


def test_a_text_and_a_table_mean_the_same_law():
    text, table = load(mission__law="joint_space"), load(mission__law__kind="joint_space")
    assert text.mission.law == table.mission.law and text.law.kind == "joint_space"


def test_a_laws_own_keys_are_set_and_checked():
    d = load(mission__law=LQR, mission__law__q=900.0)
    assert build_law(d, Setup(d)).table.q == 900.0
    d = load(mission__law=LQR)
    assert build_law(d, Setup(d)).table.q == 10000.0
    d = load(mission__law="push_and_slide", mission__law__position_bandwidth_rad_s=2.0)
    assert build_law(d, Setup(d)).table.position_bandwidth_rad_s == 2.0
    with pytest.raises(InputError, match=r"mission\.law.*q_dott.*q_dot"):
        load(mission__law=LQR, mission__law__q_dott=1.0)
    with pytest.raises(InputError, match=r"mission\.law\.q is -1"):
        load(mission__law=LQR, mission__law__q=-1.0)


def test_a_layer_that_names_another_kind_replaces_the_table(tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(
        "[mission]\nname = 'm'\nkind = 'waypoints'\nrobot = 'othex'\nworld = 'open'\n"
        f"[mission.law]\nkind = '{LQR}'\nq = 7.0\n"
        "[[mission.task.points]]\nx_m = 0.5\ny_m = 0.0\nz_m = 1.2\n"
    )
    assert load_description(path).mission.law.q == 7.0
    other = load_description(path, sets={"mission.law": "joint_space"})
    assert other.mission.law.model_dump() == {"kind": "joint_space"}
    again = load_description(path, sets={"mission.law.kind": LQR, "mission.law.q": 8.0})
    assert again.mission.law.q == 8.0


def test_descriptions_with_parts_survive_pickling_and_their_own_file(tmp_path):
    d = load(mission__law=LQR, mission__law__q=900.0)
    again = pickle.loads(pickle.dumps(d))
    assert again.mission.law == d.mission.law and again.mission == d.mission
    assert [p.name for p in list_sources(d)] == ["lqr.py"]
    (tmp_path / "lqr.py").write_text(Path(LQR.rpartition(":")[0]).read_text())
    text = dump_description(d, {Path(LQR.rpartition(":")[0]): "lqr.py"})
    (tmp_path / "mission.toml").write_text(text)
    repeated = load_description(tmp_path / "mission.toml")
    assert (
        repeated.mission.law.kind == f"{tmp_path / 'lqr.py'}:Lqr" and repeated.mission.law.q == 900
    )


# --- flown ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("sets", [{"mission.law": LQR}, {"mission.estimator": COMPLEMENTARY}])
def test_parts_from_files_fly(sets):
    result = fly_and_evaluate(load_description("waypoints", "othex", sets=sets))
    assert result.outcome == "succeeded", result.reason


def test_a_law_in_plain_python_flies_like_the_compiled_one(tmp_path):
    source = Path(LQR.rpartition(":")[0]).read_text()
    path = tmp_path / "slow.py"
    path.write_text(
        source.replace(
            "needs_full_actuation = True", "needs_full_actuation = True\n    compiled = False"
        )
    )
    flown = []
    for kind in (LQR, f"{path}:Lqr"):
        vehicle = build_vehicle(load(mission__law=kind))
        table = vehicle._table.copy()
        table["active"], table["p_WB"] = 1.0, table["p_WB"] + [0.0, 0.0, 0.3]
        for _ in range(10):
            vehicle.tick()
        vehicle.track(table)
        for _ in range(10):
            vehicle.tick()
        flown.append((vehicle.interactive, vehicle.estimate))
    assert [f[0] for f in flown] == [False, True]
    for name in ("p_WB", "v_WB", "R_WB"):
        np.testing.assert_allclose(flown[0][1][name], flown[1][1][name], atol=1e-9)


# --- refused ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "imports", "says"),
    [
        ("pass", "", "has no static method 'step'"),
        (
            "@staticmethod\ndef step(v: Airspeed, cmd: Out[WrenchCommand]) -> None: ...",
            "from skywright.vehicle.component import Output\nclass Airspeed(Output):\n    v: float",
            "reads Airspeed, which no component of this vehicle fills",
        ),
        (
            "@staticmethod\ndef step(truth: Truth, cmd: Out[WrenchCommand]) -> None: ...",
            "from skywright.vehicle.bus import Truth",
            "cannot read Truth",
        ),
        (
            "@staticmethod\ndef step(est: Estimate, cmd: Out[WrenchCommand]) -> None:\n"
            "    cmd.f_B[0] = est.nonsense",
            "",
            "mine.py:",
        ),
    ],
)
def test_laws_that_do_not_fit_are_refused(tmp_path, body, imports, says):
    kind = write_law(tmp_path, body, imports)
    with pytest.raises(InputError) as caught:
        build_vehicle(load(mission__law=kind))
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = 1 +\n", "line 1"),
        ("import nowhere_at_all\n", "nowhere_at_all"),
        ("def Mine(par, mem, ref, est, body, cmd): ...\n", "is a function"),
        ("class Mine: ...\n", "control law"),
        ("class Other: ...\n", "no class 'Mine'"),
    ],
)
def test_files_that_hold_no_law_are_refused(tmp_path, text, says):
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load(mission__law=f"{path}:Mine")
    assert "mission.law" in str(caught.value) and says in str(caught.value)


def test_unknown_kinds_name_their_neighbours():
    with pytest.raises(InputError, match="joint_space"):
        load(mission__law="joint_spac")
    with pytest.raises(InputError, match="filter"):
        load(mission__estimator="ukf")


def test_a_named_part_may_not_take_a_built_in_name(tmp_path):
    sensor = tmp_path / "s.py"
    sensor.write_text(
        "from skywright.vehicle.component import Sensor, Output, Out\n"
        "class Heat(Sensor):\n"
        "    class Reading(Output):\n        t: float\n"
        "    @staticmethod\n    def step(out: Out[Reading]) -> None:\n        out.t = 1.0\n"
    )
    sets = {"robot.sensors.heat.kind": f"{sensor}:Heat"}
    d = load_description("waypoints", "othex", sets=sets)
    assert [c.name for c in build_named(d)] == ["heat"]
    sets = {"robot.sensors.truth.kind": f"{sensor}:Heat"}
    with pytest.raises(InputError, match="two components are named 'truth'"):
        build_vehicle(load_description("waypoints", "othex", sets=sets))


def test_check_lists_the_problems_of_a_part(tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(
        "[mission]\nname = 'm'\nkind = 'waypoints'\nrobot = 'othex'\nworld = 'open'\n"
        f"[mission.law]\nkind = '{LQR}'\nqq = 7.0\n"
        "[[mission.task.points]]\nx_m = 0.5\ny_m = 0.0\nz_m = 1.2\n"
    )
    problems = list_layer_problems(path)
    assert len(problems) == 1 and "qq" in problems[0] and "mission.law" in problems[0]


def test_an_observer_needs_motion_capture():
    d = load(mission__estimator="observer", world__localisation="gnss")
    with pytest.raises(InputError, match="requires motion capture"):
        build_estimator(d)


def test_a_step_that_raises_ends_the_run_with_its_place(tmp_path):
    body = (
        "@staticmethod\ndef step(est: Estimate, cmd: Out[WrenchCommand]) -> None:\n"
        "    if est.t > 0.1:\n        raise ValueError('too late')"
    )
    vehicle = build_vehicle(load(mission__law=write_law(tmp_path, body)))
    with pytest.raises(SimulationError, match=r"law.*too late|too late.*law"):
        for _ in range(20):
            vehicle.tick()


# --- a step that never returns -----------------------------------------------------------------

ENDLESS = """
@staticmethod
def step(ref: Reference, est: Estimate, cmd: Out[WrenchCommand]) -> None:
    n = 0
    while est.t > 0.5:
        n += 1
        if n < 0:
            break
        n = n % 1000
    cmd.f_B[2] = 1.0
"""


@pytest.mark.parametrize("compiled", [True, False])
def test_a_law_that_never_returns_ends_the_run_and_leaves_its_recording(
    tmp_path, commands, compiled
):
    kind = write_law(tmp_path, f"compiled = {compiled}\n{ENDLESS}")
    out = tmp_path / "run"
    words = [
        "run", "waypoints", "--robot", "othex",
        "--set", f"mission.law={kind}", "--set", "mission.step_limit_s=1", "--out", str(out),
        "--set", f"mission.mode={'fast' if compiled else 'interactive'}",
    ]  # fmt: skip
    done = commands.run(words, tmp_path)
    assert done.returncode == 3, done.stderr + done.stdout
    says = "component law (Mine.step in mine.py) did not return within 1 s at t = 0.5"
    told = " ".join((done.stderr + done.stdout).split())
    assert says in told
    stored = load_run(out.with_name("run.partial"))
    assert stored.outcome == "diverged" and says in stored.reason
    assert 0.3 < stored.samples["t"][-1] < 0.6
