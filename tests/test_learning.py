"""examples/learning/train.py: wrong input, one episode, fresh conditions, a short training."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright import envs

FILE = Path(__file__).parent.parent / "examples" / "learning" / "train.py"
SETS = (
    "mission.task.survey=false", *(f"plant.map_error_{x}=0" for x in ("m", "deg", "size_m")),
)  # fmt: skip
MASS = "plant.mass_error=uniform(0, 0.01)"
CALM = [word for text in SETS for word in ("--set", text)]


def load_example() -> Any:
    spec = importlib.util.spec_from_file_location("train_example", FILE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


train = load_example()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["train", "--envs", "0"], "--envs: '0'; valid: a whole number from 1"),
        (["train", "--steps", "-5"], "--steps"),
        (["train", "--conditions", "x"], "--conditions: 'x'; valid"),
        (["judge", "--episodes", "0"], "--episodes: '0'; valid"),
        (["train", "--seed", "-1"], "--seed: '-1'; valid: a whole number from 0 to 4294967295"),
        (["train", "--seed", "4294967296"], "--seed: '4294967296'; valid"),
        *((["judge", f"--error={x}"], f"--error: '{x}'; valid: a force (N) above 0")
          for x in ("nan", "inf", "-0.1", "0", "x")),
        (["fly"], "invalid choice"),
    ],
)  # fmt: skip
def test_wrong_words_end_with_exit_code_2(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        train.main([*words, "--out", str(tmp_path / "out")])
    assert ended.value.code == 2 and says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


TOLD = {"env": "WeldPress", "vary": ["gusts.csv"], "set": [], "conditions": 24, "refused": []}
"""What `train` writes of a training with its defaults."""


def write_training(folder: Path, **told: Any) -> list[str]:
    """Write what `train` writes of a policy that is none; returns the words that judge it."""
    (folder / "policy.zip").write_bytes(b"no zip")
    if told:
        (folder / "training.json").write_text(json.dumps(told))
    return ["judge", "--policy", str(folder / "policy.zip"), "--out", str(folder / "judged.json")]


@pytest.mark.parametrize(
    ("told", "more", "says"),
    [
        ({}, [], "training.json"),
        ({"env": "WeldPress"}, [], "KeyError('vary')"),
        (TOLD, ["--env", "WallSlide"], "--env WallSlide: the policy was trained in WeldPress"),
        ({**TOLD, "state": "unfinished"}, [],
         "state = 'unfinished': policy.zip may be of another training; valid: 'finished'"),
        (TOLD, ["--vary", MASS], f"--vary: ['{MASS}']; the policy was trained with ['gusts.csv']"),
        (TOLD, ["--set", "mission.seed=2"],
         "--set: ['mission.seed=2']; the policy was trained with []; give the same, or --other"),
        ({**TOLD, "conditions": 58, "refused": ["a"]}, [],
         "gusts.csv: 64 rows; the training used the first 59, and --episodes 100 needs 10 more; "
         "valid: --episodes up to 50, or a longer table"),
        ({**TOLD, "conditions": 80}, ["--other-conditions"],
         "used the first 64, and --episodes 100 needs 10 more; valid: a longer table, or"),
        ({**TOLD, "env": "PegInHole"}, ["--env", "PegInHole", "--error", "0.2"],
         "--error 0.2: the goal of PegInHole decides which episodes succeed; leave it out"),
        ({}, ["--policy", "nowhere.zip"], "--policy nowhere.zip: no such file"),
    ],
)  # fmt: skip
def test_a_policy_without_its_training_is_refused(
    told: dict[str, Any], more: list[str], says: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    assert train.main([*write_training(tmp_path, **told), *more]) == 2
    error = capsys.readouterr().err
    assert says in error and error.startswith("error: ") and error.count("\n") == 1
    assert not (tmp_path / "judged.json").exists()


def test_judging_begins_after_the_conditions_of_the_training(tmp_path: Path) -> None:
    """Whatever --envs and --conditions say now, and refused conditions counted."""
    told = {**TOLD, "conditions": 22, "refused": ["a", "b"]}
    words = write_training(tmp_path, **told)
    assert train.find_fresh(train.parse([*words, "--envs", "1", "--conditions", "1"])) == 24
    other = ["--vary", MASS, "--set", "mission.seed=2", "--other-conditions"]
    assert train.find_fresh(train.parse([*words, *other])) == 24
    words = write_training(tmp_path, **{**told, "conditions": 52})  # 10 of 64 rows are left
    assert train.find_fresh(train.parse(words)) == 54


class FakePPO:
    """A learner that learns nothing, and that is interrupted if asked."""

    num_timesteps, interrupted = 256, False

    def __init__(self, *args: Any, **options: Any) -> None:
        pass

    def learn(self, steps: int, callback: Any) -> None:
        if self.interrupted:
            raise KeyboardInterrupt

    def save(self, path: Path) -> None:
        path.write_bytes(b"new")

    load = classmethod(lambda cls, path, device: cls())


@pytest.fixture
def fake_learner(monkeypatch: pytest.MonkeyPatch) -> type[FakePPO]:
    """Put modules in the place of stable-baselines3 and PyTorch."""
    name = "stable_baselines3"
    for module, parts in (
        ("torch", {"set_num_threads": lambda n: None}), (name, {"PPO": FakePPO}),
        (f"{name}.common", {}), (f"{name}.common.callbacks", {"BaseCallback": object}),
        (f"{name}.common.vec_env", {
            "DummyVecEnv": lambda made: SimpleNamespace(envs=[make() for make in made]),
            "VecMonitor": lambda vector: vector, "VecNormalize": lambda vector, **_: vector,
        }),
    ):  # fmt: skip
        fake = ModuleType(module)
        fake.__dict__.update(parts)
        monkeypatch.setitem(sys.modules, module, fake)
    return FakePPO


def test_a_training_that_is_interrupted_is_not_judged(
    tmp_path: Path, fake_learner: type[FakePPO], monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Also in the folder of a training that finished, whose policy is still there."""
    monkeypatch.setattr(train.envs, "make", lambda *args, **options: SimpleNamespace(refused=[]))
    out = tmp_path / "out"
    words = ["--out", str(out), "--envs", "2"]
    assert train.main(["train", *words]) == 0
    first = json.loads((out / "training.json").read_text())
    assert first["state"] == "finished" and first["steps"] == 256 and first["conditions"] == 6
    monkeypatch.setattr(fake_learner, "interrupted", True)
    with pytest.raises(KeyboardInterrupt):
        train.main(["train", *words, "--conditions", "1"])
    second = json.loads((out / "training.json").read_text())
    assert second["state"] == "unfinished" and second["conditions"] == 2
    judged = ["--policy", str(out / "policy.zip"), "--out", str(tmp_path / "judged.json")]
    assert train.main(["judge", *judged]) == 2
    assert "state = 'unfinished'" in capsys.readouterr().err


def test_laws_are_compared_in_the_conditions_that_all_reached(
    tmp_path: Path, fake_learner: type[FakePPO], monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    reached = {"a": [24, 25, 27], "b": [25, 26, 27], "c": [26]}

    def make(name: str, sets: list[str], **options: Any) -> Any:
        law = sets[-1].removeprefix("mission.law=")
        starts = [SimpleNamespace(condition=i) for i in reached[law]]
        space = SimpleNamespace(shape=(1,))
        return SimpleNamespace(starts=starts, refused=[f"not {law}"], action_space=space)

    def fly(env: Any, choose: Any, seed: int, condition: int, error: float) -> dict[str, Any]:
        number = env.starts[condition].condition
        return {"condition": number, "seed": seed, "success": True, "force_error_n": 0.1}

    monkeypatch.setattr(train.envs, "make", make)
    monkeypatch.setattr(train, "fly", fly)
    words = [*write_training(tmp_path, **TOLD), "--episodes", "4", "--laws"]
    assert train.main([*words, "a,b"]) == 0
    told = json.loads((tmp_path / "judged.json").read_text())
    assert told["conditions"] == 2 and told["refused"] == ["a: not a", "b: not b"]
    for player in ("a", "learned", "b"):
        flown = [r["condition"] for r in told["episodes"] if r["player"] == player]
        assert flown == [25, 27, 25, 27]
    assert "a: 4 of 4, median force error 0.100 N" in capsys.readouterr().out
    monkeypatch.setattr(
        train, "fly", lambda *args: {"condition": 25, "success": True, "force_error_n": None}
    )
    assert train.main([*words, "a,b"]) == 0
    assert capsys.readouterr().out.splitlines() == ["a: 4 of 4", "learned: 4 of 4", "b: 4 of 4"]
    assert train.main([*words, "a,c"]) == 2
    assert "--laws a,c: no condition was reached by all; a: not a; c: not c" in (
        capsys.readouterr().err
    )


def test_a_missing_extra_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("torch", "stable_baselines3"):
        monkeypatch.setitem(sys.modules, name, None)  # an import of it fails
    assert train.main(["train", "--out", str(tmp_path / "out")]) == 2
    assert 'pip install "skywright[learn]"' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_training_without_a_finished_episode_has_an_empty_curve(tmp_path: Path) -> None:
    train.write_curve([], tmp_path / "curve.csv")
    assert (tmp_path / "curve.csv").read_text().split() == ["steps,seconds,return,noise"]


def test_an_episode_is_judged_by_the_true_force() -> None:
    """A bound on the mean error decides, unless the episode ends early."""
    env = envs.make("WeldPress", sets=SETS, states=1, episode_s=0.4)
    still = np.zeros(env.action_space.shape, np.float32)
    good, bad = (train.fly(env, lambda _: still, 3, 0, error) for error in (1.0, 0.0))
    assert good["success"] and not bad["success"]
    assert good["seconds"] == pytest.approx(0.4) and 1.0 < good["force_mean_n"] < 3.0
    assert good["force_error_n"] == bad["force_error_n"]


class FakeEnv:
    """Episodes of three steps with the infos that are given."""

    def __init__(self, has_goal: bool, infos: list[dict[str, Any]]) -> None:
        self.has_goal, self.infos, self.k = has_goal, infos, 0

    def reset(self, **options: Any) -> Any:
        self.k = 0
        return None, {"condition": 0}

    def step(self, action: Any) -> Any:
        self.k += 1
        info = self.infos[self.k - 1]
        return None, 1.0, "success" in info, self.k == 3, info


FORCE = {"force_n": 2.0, "force_error_n": 0.1}


@pytest.mark.parametrize(
    ("has_goal", "infos", "success", "error"),
    [
        (True, [{"force_n": 2.0}] * 2 + [{"force_n": 2.0, "success": True}], True, None),
        (True, [{"force_n": 2.0}] * 3, False, None),
        (True, [FORCE] * 3, False, 0.1),  # a small error is not the goal
        (False, [FORCE] * 3, True, 0.1),
        (False, [FORCE, {**FORCE, "success": False}], False, 0.1),
        (False, [{"reason": "diverged", "success": False}], False, None),
    ],
)
def test_the_goal_of_an_environment_decides_and_missing_forces_are_null(
    has_goal: bool, infos: list[dict[str, Any]], success: bool, error: float | None,
    recwarn: pytest.WarningsRecorder,
) -> None:  # fmt: skip
    told = train.fly(FakeEnv(has_goal, infos), lambda seen: None, 1, 0, 0.15)
    assert told["success"] is success and told["force_error_n"] == error
    assert told["seconds"] == pytest.approx(0.02 * len(infos)) and not recwarn.list
    json.dumps(told, allow_nan=False)


@pytest.mark.parametrize(("name", "has_goal"), [("WeldPress", False), ("PegInHole", True)])
def test_an_environment_says_whether_it_has_a_goal(name: str, has_goal: bool) -> None:
    assert train.find_class(name).has_goal is has_goal


@pytest.mark.learn
def test_a_short_training_is_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Less than an episode long: no curve, yet a policy that flies in conditions of its own."""
    out = tmp_path / "out"
    words = [*CALM, "--vary", MASS, "--envs", "1", "--conditions", "1"]
    assert train.main(["train", *words, "--steps", "20", "--out", str(out)]) == 0
    told = json.loads((out / "training.json").read_text())
    assert told["conditions"] == 1 and told["steps"] == 256
    judged = out / "judged.json"
    words = [
        "judge",
        *CALM,
        "--vary",
        MASS,
        "--episodes",
        "2",
        "--laws",
        "push_and_slide",
        "--out",
        str(judged),
    ]
    assert train.main([*words, "--policy", str(out / "policy.zip")]) == 0
    rows = json.loads(judged.read_text())["episodes"]
    assert [r["player"] for r in rows] == ["push_and_slide"] * 2 + ["learned"] * 2
    assert {r["condition"] for r in rows} == {1}  # 0 is the training's
    (out / "policy.zip").write_bytes(b"no zip")
    assert train.main([*words, "--policy", str(out / "policy.zip")]) == 2
    assert "policy.zip that `train` wrote" in capsys.readouterr().err
