"""Environments of Gymnasium: its checker, repeatable episodes, honest observations, bad input."""

from __future__ import annotations

import functools
import gc
import math
import re
import warnings
import weakref
from collections.abc import Iterator
from multiprocessing import Pipe
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import DictInfoToList

import skywright
from skywright import envs
from skywright.analysis.campaign.local import count_cores
from skywright.analysis.campaign.spec import draw_run, load_run
from skywright.analysis.envs import starts
from skywright.analysis.envs import vector as vectors
from skywright.analysis.envs.env import ACT, DIVERGED, JUDGE, OBSERVE
from skywright.analysis.envs.parts import Observation, Observe
from skywright.analysis.envs.registry import PLACES, find_class
from skywright.analysis.envs.vector import _Worker
from skywright.analysis.envs.weld_press import SeeContact
from skywright.analysis.envs.worker import Share
from skywright.errors import InputError, SimulationError
from skywright.run.backends import build_vehicle
from skywright.vehicle.assembly import BLOCK, FAST_BLOCK
from skywright.vehicle.bus import Clock, Reference, Truth
from skywright.vehicle.component import Out
from skywright.vehicle.free_ticks import count_free_ticks, is_free
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.recorder import SAMPLES, SAMPLES_A_TICK, Recorder

NO_SURVEY = ("mission.task.survey=false", *(f"plant.map_error_{x}=0" for x in ("m", "deg")))
QUICK: dict[str, tuple[str, ...]] = {
    "WeldPress": (*NO_SURVEY, "plant.map_error_size_m=0"),
    "WallSlide": (
        *NO_SURVEY, "mission.task.forces_n=[1.0]", "mission.task.hold_s=0.2",
        "world.structure.y_m=0.5",
    ),
    "PegInHole": (),
    "SensorInstall": (
        *NO_SURVEY, "plant.map_error_size_m=0", "mission.task.hover_s=0", "mission.task.swing_deg=0"
    ),
}  # fmt: skip
"""What shortens the flight to where episodes begin; the wall is away from the origin."""


@functools.cache
def build(name: str, first: int = 0) -> envs.ContactEnv:
    if name in ("WallSlide", "SensorInstall"):  # states that are saved as early as possible
        early = type(name, (find_class(name),), {"spread_s": (0.0, 0.0)})
        return early(sets=QUICK[name], states=2, first=first)
    return envs.make(name, sets=QUICK[name], states=2, first=first)


def fly(env: Any, seed: int, steps: int = 40, still: bool = False) -> tuple[Any, list[float]]:
    """Return what is seen and earned with actions drawn from a seed."""
    rng = np.random.default_rng(seed)
    seen, _ = env.reset(seed=seed)
    rows, rewards = [seen], []
    for _ in range(steps):
        action = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        seen, reward, terminated, truncated, _ = env.step(0 * action if still else action)
        rows.append(seen)
        rewards.append(reward)
        if terminated or truncated:
            break
    return np.array(rows), rewards


@pytest.mark.parametrize("name", PLACES)
def test_gymnasiums_own_checker_finds_nothing(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*render.*")
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version.*")
        warnings.filterwarnings("ignore", message=".*spec.*")
        check_env(build(name), skip_render_check=True)


@pytest.mark.parametrize("name", PLACES)
def test_equal_seeds_and_actions_give_equal_episodes(name: str) -> None:
    env = build(name)
    first, again = fly(env, 5), fly(env, 5)
    assert np.array_equal(first[0], again[0]) and first[1] == again[1]
    other = fly(env, 6)
    assert not np.array_equal(first[0][:5], other[0][:5])


def test_a_longer_step_is_several_with_the_same_action(monkeypatch: pytest.MonkeyPatch) -> None:
    env = build("WeldPress")
    action = np.array([0.4], np.float32)
    env.reset(seed=7)
    short = [env.step(action) for _ in range(6)]
    monkeypatch.setattr(env, "ticks", 3)
    env.reset(seed=7)
    for k in range(2):
        seen, reward, terminated, truncated, info = env.step(action)
        mine = short[3 * k : 3 * k + 3]
        assert np.array_equal(seen, mine[-1][0]) and not (terminated or truncated)
        assert reward == pytest.approx(np.mean([x[1] for x in mine]), rel=1e-12)
        for value in env.values:
            mean = np.mean([x[4][value.name] for x in mine])
            assert info[value.name] == pytest.approx(mean, rel=1e-9)


@pytest.mark.parametrize("name", PLACES)
def test_actions_move_what_is_seen_and_a_rest_is_no_fault(name: str) -> None:
    env = build(name)
    rest, moved = fly(env, 5, still=True)[0], fly(env, 5)[0]
    assert len(rest) == 41
    assert not np.allclose(rest[-1], moved[-1], atol=1e-3)


def test_a_new_vector_flies_the_same_episodes_in_processes() -> None:
    env = build("WeldPress")
    vector = envs.VectorEnv(
        "WeldPress", 2, workers=min(2, count_cores()), sets=QUICK["WeldPress"], states=2,
        episode_s=0.24, autoreset="same_step",
    )  # fmt: skip
    try:
        still = np.zeros((2, 1))
        for options in (None, {"condition": 7}):  # 7 is refused by every environment
            if options is not None:
                with pytest.raises(InputError, match="condition = 7; valid: 0 to 0"):
                    vector.reset(seed=1, options=options)
            for step in (lambda: vector.step(still), lambda: vector.step_alone(1)):
                with pytest.raises(InputError, match=r"call reset\(\) first"):
                    step()
        seen, _ = vector.reset(seed=[5, 5])
        rows, rng = [seen[0]], np.random.default_rng(5)
        for _ in range(10):
            action = rng.uniform(-1, 1, (1,)).astype(np.float32)
            seen, reward, _, _, infos = vector.step(np.array([action, action]))
            rows.append(seen[0])
        assert np.array_equal(np.array(rows), fly(env, 5, 10)[0])
        assert not np.array_equal(seen[0], seen[1])  # another flight: the conditions go on
        assert reward[0] != reward[1] and infos["force_n"].shape == (2,)
        for truncated in (False, True):  # 12 steps are 0.24 s
            seen, _, _, ended, infos = vector.step(np.zeros((2, 1)))
            assert ended.tolist() == [truncated, truncated]
        assert abs(infos["final_obs"][0][2]) > 0.0 == seen[0][2]  # the push of a new episode
        assert infos["final_info"]["force_n"].shape == (2,) and "state" in infos
        vector.tick(1)  # it begins episodes of its own
        with pytest.raises(InputError, match=r"call reset\(\) first"):
            vector.step(still)
        vector.reset(seed=1)
        with pytest.raises(InputError, match=r"row 1 is not finite"):
            vector.step(np.array([[0.0], [np.nan]]))
        with pytest.raises(InputError, match=r"the shape is \(1,\)"):
            vector.step(np.zeros(1))
        for worker in vector._workers:  # none on one core
            worker.process.kill()
            with pytest.raises(SimulationError, match=r"environments 1 to 1 ended"):
                vector.step(np.zeros((2, 1)))
            with pytest.raises(InputError, match="the vector is closed"):
                vector.step(np.zeros((2, 1)))
    finally:
        vector.close()


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_a_vector_gives_the_infos_of_gymnasiums(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """In each step of two environments that end at different times; the second one diverges."""
    two = [build("WeldPress", i) for i in range(2)]
    for env, steps in zip(two, (3, 8), strict=True):
        monkeypatch.setattr(env, "steps_max", steps)
    monkeypatch.setattr(vectors, "make", lambda name, first, **options: two[first])
    actions = np.random.default_rng(3).uniform(-1, 1, (9, 2, 1)).astype(np.float32)

    def roll(vector: Any) -> list[Any]:
        listed = DictInfoToList(vector)
        out = [listed.reset(seed=5)]
        for k, action in enumerate(actions):
            if k == 4:
                two[1].vehicle.sim.qvel[:] = np.nan
            out.append(listed.step(action))
        return out

    vector = envs.VectorEnv("WeldPress", 2, workers=1, autoreset=mode)
    mine = roll(vector)
    sync = SyncVectorEnv(
        [lambda: two[0], lambda: two[1]],
        autoreset_mode=AutoresetMode[mode.upper()],
    )  # fmt: skip
    theirs = roll(sync)
    sync.closed = True  # the environments stay open for other tests
    for a, b in zip(mine, theirs, strict=True):
        np.testing.assert_equal(a[-1], b[-1])
        np.testing.assert_array_equal(a[0], b[0])
        for ours, others in zip(a[1:-1], b[1:-1], strict=True):  # reward, terminated, truncated
            np.testing.assert_array_equal(ours, others)
    infos = [x[-1] for x in mine[1:]]
    assert all("force_n" in x for x in infos[0]) and "force_n" not in infos[4][1]
    assert "state" in infos[3 if mode == "next_step" else 2][0]
    last = infos[4][1] if mode == "next_step" else infos[4][1]["final_info"]
    assert last["reason"] == DIVERGED and "the state is not finite" in last["why"]


@pytest.mark.parametrize(("ticks", "in_python"), [(1, [0, 100, 120]), (3, [0, 33, 40])])
def test_a_vector_flies_as_its_environment(
    ticks: int, in_python: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where random numbers are drawn and samples delivered, which needs Python."""
    options: Any = {
        "sets": QUICK["WeldPress"], "states": 2, "episode_s": 3.0, "ticks": ticks
    }  # fmt: skip
    env, called = build("WeldPress"), list[int]()
    monkeypatch.setattr(env, "ticks", ticks)
    monkeypatch.setattr(env, "steps_max", 150 // ticks)
    real = Share._fly_in_python
    monkeypatch.setattr(
        Share, "_fly_in_python", lambda share, i: (called.append(len(rewards)), real(share, i))[1]
    )
    vector = envs.VectorEnv("WeldPress", 1, workers=1, **options)
    rng, steps = np.random.default_rng(5), 129 // ticks
    mine, rewards = [vector.reset(seed=5)[0][0]], list[float]()
    for _ in range(steps):
        action = rng.uniform(-1, 1, (1, 1)).astype(np.float32)
        seen, reward, terminated, truncated, _ = vector.step(action)
        assert not (terminated or truncated)
        mine.append(seen[0])
        rewards.append(reward[0])
    theirs = fly(env, 5, steps)
    assert np.array_equal(np.array(mine), theirs[0]) and rewards == theirs[1]
    assert called[: len(in_python)] == in_python


def test_a_vector_ends_within_a_step_as_its_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """The contact is lost after some of the 20 ticks of a step."""
    env = build("WeldPress")
    monkeypatch.setattr(env, "ticks", 20)
    monkeypatch.setattr(env, "steps_max", env.steps_max // 20)
    vector = envs.VectorEnv(
        "WeldPress", 1, workers=1, sets=QUICK["WeldPress"], states=2, ticks=20
    )  # fmt: skip
    env.reset(seed=1), vector.reset(seed=1)
    away = np.array([-1.0], np.float32)
    for _ in range(env.steps_max):
        mine, theirs = vector.step(away[None]), env.step(away)
        assert [x[0] for x in mine[1:4]] == list(theirs[1:4])
        np.testing.assert_array_equal(mine[0][0], theirs[0])
        if theirs[2]:
            break
    assert theirs[4]["reason"] == mine[4]["reason"][0] == "contact lost"
    assert env.vehicle.t == vector._mine.envs[0].vehicle.t  # type: ignore[union-attr]
    assert int(env._judged[0]) % 200 != 0  # control ticks of the last step


def test_a_robot_that_no_longer_follows_ends_the_episode() -> None:
    """It tumbles: in the environment alone and in a vector, in the tick in which a guard fires."""
    env = build("WeldPress")
    vector = envs.VectorEnv("WeldPress", 1, workers=1, sets=QUICK["WeldPress"], states=2)
    env.reset(seed=1), vector.reset(seed=1)
    still = np.zeros((1, 1), np.float32)
    for k in range(50):
        if k == 3:  # the vector's vehicle flies without Python
            for one in (env, vector._mine.envs[0]):  # type: ignore[union-attr]
                one.vehicle.sim.qvel[3] = 60.0  # rad/s of roll
        mine, theirs = vector.step(still), env.step(still[0])
        if theirs[2] or mine[2][0]:
            break
    assert mine[2][0] and theirs[2] and k < 20
    assert mine[4]["reason"][0] == theirs[4]["reason"] == "robot lost"
    assert mine[1][0] == theirs[1] < -10.0


def test_free_ticks_end_with_random_numbers_or_room() -> None:
    vehicle = build("WeldPress").starts[0].vehicle
    saved, clock = vehicle.save(), vehicle.assembly.get(Clock)
    samples: Any = vehicle.find(Recorder)._me
    n, fast = vehicle.n_ticks, vehicle.n_ticks * vehicle.n_steps
    for block, steps, rows, free in (
        (BLOCK - 5 * n, 0, 0, 5), (BLOCK - 5 * n + 1, 0, 0, 4), (0, FAST_BLOCK - 7 * fast, 0, 7),
        (0, 0, SAMPLES - SAMPLES_A_TICK - 6, 3), (0, 0, SAMPLES, 0), (BLOCK, FAST_BLOCK, 0, 0),
    ):  # fmt: skip
        clock["block"], clock["fast"], samples.n = block, steps, rows
        assert count_free_ticks(vehicle) == free
    vehicle.restore(saved)
    assert is_free(vehicle)
    vehicle.watchdog._due = 1.0
    assert count_free_ticks(vehicle) == 0
    vehicle.watchdog._due = math.inf
    vehicle.n_ticks = 2.5  # as 20 ms at 125 Hz
    assert not is_free(vehicle)
    vehicle.n_ticks = n
    vehicle.interactive = True
    assert not is_free(vehicle)
    vehicle.interactive = False


def test_the_force_that_is_judged_is_the_plants_and_more_push_gives_more() -> None:
    env = build("WeldPress")
    env.reset(seed=1)
    for _ in range(100):
        *_, info = env.step(np.zeros(1, np.float32))
    before = info["force_n"]
    for _ in range(100):
        seen, *_, info = env.step(np.array([0.1], np.float32))
    true = env.vehicle.look(Truth).f_contact
    assert float(np.linalg.norm(true)) == pytest.approx(info["force_n"], rel=0.1)
    # 2 s at a tenth of 8 N/s, on the paper's stiffness: both the plant and the sensor have it
    assert info["force_n"] - before == pytest.approx(1.6, abs=0.3)
    assert seen[2] * SeeContact.signals[2].size == pytest.approx(1.6, abs=0.05)


def test_an_episode_ends_with_its_reason() -> None:
    env = build("WeldPress")
    env.reset(seed=1)
    for _ in range(env.steps_max):
        _, reward, terminated, truncated, info = env.step(np.array([-1.0], np.float32))
        if terminated or truncated:
            break
    assert terminated and info["reason"] == "contact lost" and not info["success"]
    assert reward < -10.0
    with pytest.raises(InputError, match=r"call reset\(\) first"):
        env.step(np.zeros(1, np.float32))


def test_a_slide_reaches_its_end_where_it_is_led() -> None:
    env = build("WallSlide")
    env.reset(seed=2)
    begun = env.step(np.array([0.4, 0.0], np.float32))
    assert abs(begun[4]["way_m"]) < 0.01 and not begun[2]  # from where the episode begins
    for _ in range(env.steps_max - 1):
        _, _, terminated, truncated, info = env.step(np.array([0.4, 0.0], np.float32))
        if terminated or truncated:
            break
    assert terminated and info["reason"] == "success" and 0.29 < info["way_m"] < 0.31


def test_a_hand_that_is_led_by_its_force_installs_the_sensor() -> None:
    env = build("SensorInstall")
    seen, _ = env.reset(seed=2)
    for _ in range(env.steps_max):
        action = [float(np.clip(-0.4 * seen[0] - 0.2 * seen[8], -0.4, 0.4)), 0.0, 0.0]
        seen, _, terminated, truncated, info = env.step(np.array(action, np.float32))
        if terminated or truncated:
            break
    assert info["force_error_n"] < 0.6


@pytest.mark.parametrize(("name", "error"), [("SensorInstall", -2.0), ("WallSlide", 0.0)])
def test_the_first_observation_is_that_of_the_episode(name: str, error: float) -> None:
    """Also if the state is saved at once. The slow force error begins at the force error: 2 N are
    missing before contact, none in contact."""
    env = build(name)
    seen, _ = env.reset(seed=1)
    after = env.step(np.zeros(env.action_space.shape or (), np.float32))[0]
    still = [k for k, s in enumerate(env.observe.signals) if s.unit in ("m", "")]
    assert np.any(seen) and np.allclose(seen[still], after[still], atol=0.1)
    assert seen[:2] == pytest.approx(error, abs=0.3)  # not filtered with a force of 0 N


def test_a_state_is_saved_after_a_tick_at_least() -> None:
    env = build("WeldPress")
    env.reset(seed=1)
    t = env.vehicle.t
    for saved in starts.save_states(env.vehicle, (0.0, 0.0), 2, 1):
        env.vehicle.restore(saved)
        assert env.vehicle.t == pytest.approx(t + MISSION_TICK)


def test_a_contradictory_combination_is_refused_and_a_wrong_range_before_a_flight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flown = []

    def load(campaign: Any, wanted: Any, i: int, states: int) -> Any:
        flown.append(i)
        load_run(campaign, draw_run(campaign, i))
        return starts.Start(None, [], i, {}, 0)  # type: ignore[arg-type]

    def begin(*vary: str, conditions: int = 2, seed: int = 1) -> Any:
        campaign = starts.build_conditions(
            "pipe-weld-scan", vary, "othex-force", None, (), seed, conditions
        )
        wanted: Any = None
        return starts.build_starts(campaign, wanted, range(conditions), 1)

    monkeypatch.setattr(starts, "build_start", load)
    gusts = ("world.wind.kind=choice(steady,dryden)", "world.wind.mean_mps=choice(0,1)")
    good, refused = begin(*gusts)
    assert len(good) == len(refused) == 1
    assert refused[0].startswith("condition 0: world.wind: kind = 'dryden'")  # not --set
    good, refused = begin(*gusts, conditions=1, seed=4)  # steady, 0: later draws have dryden, 1
    assert len(good) == 1 and not refused
    flown.clear()
    with pytest.raises(InputError, match=r"world.pipe.friction=uniform\(-0.1,0.5\)"):
        begin("world.pipe.friction=uniform(-0.1,0.5)")
    assert not flown


def test_an_observation_cannot_ask_for_the_truth() -> None:
    class Cheat(Observe):
        @staticmethod
        def step(me: Observe.Me, truth: Truth, ref: Reference, seen: Out[Observation]) -> None:
            seen.values[0] = truth.p_WB[0]

    description = skywright.load("pipe-weld-scan", robot="othex-force")
    with pytest.raises(InputError, match="cannot read Truth of the plant"):
        build_vehicle(description, parts=[Cheat(OBSERVE)])


def test_the_parts_have_their_sides() -> None:
    sides = {c.name: c.side for c in build("PegInHole").starts[0].vehicle.assembly.components}
    assert (sides[ACT], sides[OBSERVE], sides[JUDGE]) == ("robot", "robot", "plant")


def test_gymnasium_makes_them_by_name() -> None:
    assert "skywright/PegInHole-v0" in gymnasium.registry
    with pytest.raises(InputError, match=r"states = 0"):
        gymnasium.make("skywright/WeldPress-v0", states=0)


@pytest.fixture
def table(tmp_path: Path) -> Iterator[str]:
    file = tmp_path / "conditions.csv"
    file.write_text("world.wind.men_mps\n1.0\n")
    yield str(file)


def test_wrong_input_is_told_before_anything_flies(table: str) -> None:
    for options, says in (
        ({"vary": [table]}, "men_mps"),
        ({"vary": "plant.mass_error=uniform(0,1)"}, "valid: a list of texts"),
        ({"sets": None}, "sets = None; valid: a list of texts"),
        ({"robot": 3}, "robot = 3; valid: a text"),
        ({"vary": ["plant.mass_error=unform(0,1)"]}, "unknown distribution 'unform'"),
        ({"sets": ["mission.task.nothing=1"]}, "nothing"),
        ({"conditions": 0}, "conditions = 0"),
        ({"conditions": np.int64(0)}, "conditions = np.int64(0)"),
        ({"states": np.True_}, "states = np.True_"),
        ({"ticks": 2.0}, "ticks = 2.0"),
        ({"episode_s": float("nan")}, "episode_s = nan"),
        ({"episode_s": True}, "episode_s = True"),
        ({"robot": "no-such"}, "no-such"),
        ({"speed": 1}, "option 'speed' is unknown; valid: vary"),
    ):
        with pytest.raises(InputError, match=re.escape(says)):
            envs.make("WeldPress", **options)
    with pytest.raises(InputError, match=r"'WeldPres' is unknown; valid: .*WeldPress"):
        envs.make("WeldPres")
    for many in (0, np.int64(0), True, np.True_, 2.0, "2"):
        with pytest.raises(InputError, match=r"num_envs = .*; valid: a whole number from 1"):
            envs.VectorEnv("WeldPress", many)  # type: ignore[arg-type]
    for workers in (99, np.int64(99), True, 1.0):
        with pytest.raises(InputError, match=r"workers = .*; valid: 1 to "):
            envs.VectorEnv("WeldPress", 2, workers=workers)  # type: ignore[arg-type]
    for mode in ("never", ["next_step"], None):
        with pytest.raises(InputError, match=r"autoreset = .*; valid: next_step, same_step"):
            envs.VectorEnv("WeldPress", 2, autoreset=mode)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"seed": -1}, "seed: mission.seed is -1"),
        ({"sets": ["world.nothing=1"]}, "sets: unknown key world.nothing"),
        ({"sets": ["nothing"]}, "sets 'nothing': expected KEY=VALUE"),
        ({"vary": ["x"]}, "vary 'x': expected KEY=DIST, e.g. 'world.pipe"),
        ({"vary": ["world.wind.mean_mps=3"]}, "vary world.wind.mean_mps: '3' is not a"),
        (
            {"sets": ["world.pipe.friction=0"], "vary": ["world.pipe.friction=uniform(0,1)"]},
            "world.pipe.friction is fixed by sets and varied by vary",
        ),
    ],
)
def test_a_refusal_names_the_arguments_and_no_options(options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError) as refused:
        envs.make("WeldPress", **options)
    assert str(refused.value).startswith(says) and "--" not in str(refused.value)


def test_whole_numbers_of_numpy_are_whole_numbers() -> None:
    """In a vector and in the environments of which it consists."""
    one = np.int64(1)
    vector = envs.VectorEnv(
        "WeldPress", one, workers=np.int32(1), sets=QUICK["WeldPress"], conditions=one, states=one,
        ticks=np.int64(2), seed=one, episode_s=np.float32(0.4),
    )  # fmt: skip
    try:
        assert vector.reset(seed=1)[0].shape == (1, 8)
        assert vector._mine is not None and vector._mine.envs[0].steps_max == 10
    finally:
        vector.close()


def test_a_refusal_leaves_no_answer_for_the_next_command() -> None:
    """Of three processes two refuse: the first refusal is told, and no answer is left unread."""
    vector: Any = object.__new__(envs.VectorEnv)
    vector._workers = [_Worker(None, *Pipe(), k) for k in range(3)]  # type: ignore[arg-type]
    ends = [w.first for w in vector._workers]
    for end, answer in zip(ends, (["a"], InputError("one"), InputError("two")), strict=True):
        end.send(answer)
    with pytest.raises(InputError, match="one"):
        vector._hear_all()
    for end in ends:
        end.send(["b"])
    assert vector._hear_all() == ["b"] * 3


@pytest.mark.parametrize("when", ["_send", "own", "_hear"])
def test_an_interrupt_closes_the_vector(when: str) -> None:
    """The answers of the other processes would stay unread, and answer the next step."""
    vector: Any = object.__new__(envs.VectorEnv)
    ended = SimpleNamespace(wait=lambda timeout: 0)
    vector._mine, vector._workers = object(), [_Worker(ended, *Pipe()[:1], 1, 1)]  # type: ignore[arg-type]

    def interrupt(*args: Any) -> Any:
        raise KeyboardInterrupt

    vector._send = vector._hear = lambda *args: []
    setattr(vector, when, interrupt)
    with pytest.raises(KeyboardInterrupt):
        vector._do(lambda w: (b"", None), interrupt if when == "own" else list)
    with pytest.raises(InputError, match="the vector is closed"):
        vector.step(np.zeros((1, 1)))


def test_a_closed_vector_and_wrong_seeds_are_told() -> None:
    vector: Any = object.__new__(envs.VectorEnv)
    vector.num_envs, vector._workers, vector._mine = 2, [], None
    for seed in (-1, 1.5, "ab", [1, -2], np.array([0.5, 1.0])):
        with pytest.raises(InputError, match=r"seed = .* valid: whole numbers from 0"):
            vector.reset(seed=seed)
    for call in (vector.reset, lambda: vector.step(np.zeros((2, 1)))):
        with pytest.raises(InputError, match="the vector is closed"):
            call()


@pytest.mark.parametrize(
    "action, says",
    [
        (np.zeros(2), r"shape \(2,\); valid: \(1,\)"),
        (np.array([np.nan]), "not finite"),
        (np.array([np.inf]), "not finite"),
        (np.array([0.5 + 1j]), "valid: real numbers"),
        ("push", "valid: real numbers"),
        (None, "valid: real numbers"),
        ([[0.1], [0.1, 0.2]], "valid: real numbers"),
    ],
)
def test_wrong_actions_are_refused_and_never_flown(action: Any, says: str) -> None:
    env = build("WeldPress")
    env.reset(seed=1)
    t = env.vehicle.t
    with pytest.raises(InputError, match=says):
        env.step(action)
    assert env.vehicle.t == t
    env.step(np.array([5.0]))  # cut to 1
    with pytest.raises(InputError, match="valid: 0 to 0"):
        env.reset(options={"condition": 3})
    with pytest.raises(InputError, match=r"options = \[1\]; valid: a dict"):
        env.reset(options=[1])  # type: ignore[arg-type]


def test_a_closed_environment_flies_no_more() -> None:
    env = envs.make("WeldPress", sets=QUICK["WeldPress"], states=1)
    env.reset(seed=1)
    vehicle = weakref.ref(env.vehicle)
    env.close()
    env.close()
    gc.collect()
    assert vehicle() is None
    with pytest.raises(InputError, match="no episode runs: it was closed"):
        env.step(np.zeros(1, np.float32))
    with pytest.raises(InputError, match="was closed: make another"):
        env.reset()
