"""Train a policy with PPO (stable-baselines3), and compare it with laws on fresh conditions.

    pip install "skywright[learn]"
    python examples/learning/train.py train --out runs/weld-press
    python examples/learning/train.py judge --policy runs/weld-press/policy.zip \
        --out runs/weld-press/judged.json

One process and one thread; the environment is that of skywright.envs. `train` writes the policy,
its curve and training.json. `judge` flies the policy and the classical laws, 100 episodes each, in
conditions and with noise that the training did not see; training.json beside the policy says which
it saw. `judge` refuses a policy whose training did not finish. Loading a policy executes code in
it. docs/howto/learn-a-policy.md shows a result.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skywright import InputError, __version__, envs
from skywright.analysis.campaign.distributions import parse_variations
from skywright.analysis.envs.registry import find_class
from skywright.cli.options import check_folder, check_writable
from skywright.evidence.bench.machine import read_commit
from skywright.vehicle.plant import MISSION_TICK

HERE = Path(__file__).parent
GUSTS = str(HERE / "gusts.csv")
EACH = 10
"""Episodes that are judged in a condition."""
SEED = 1
"""Of the campaign of conditions. Training flies its first ones, judging those that follow."""
FINISHED, UNFINISHED = "finished", "unfinished"
"""States in training.json."""
SEED_MAX = 2**32 - 1
"""Largest seed of NumPy's global generator, which stable-baselines3 seeds."""
ERROR = 0.15
"""N, mean force error below which an episode succeeds, in an environment without a goal."""
CURVE = ("steps", "seconds", "return", "noise")
"""Columns of curve.csv."""


def count(text: str) -> int:
    """Read a whole number from 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: a whole number from 1")
    return int(text)


def read_seed(text: str) -> int:
    """Read a seed of the learner."""
    if not (text.isascii() and text.isdecimal()) or int(text) > SEED_MAX:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: a whole number from 0 to {SEED_MAX}")
    return int(text)


def read_error(text: str) -> float:
    """Read the limit of the mean force error (N)."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: a force (N) above 0")
    return value


def parse(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line; what is wrong in it ends the process with exit code 2."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("what", choices=("train", "judge"))
    p.add_argument("--env", default="WeldPress", help="of skywright.envs")
    p.add_argument("--vary", action="append", help="as of `skywright campaign`; default: gusts.csv")
    p.add_argument("--set", dest="sets", action="append", help="KEY=VALUE, may be repeated")
    p.add_argument("--steps", type=count, default=400_000, help="of the environment, to train")
    p.add_argument("--envs", type=count, default=8, help="beside each other, to train")
    p.add_argument("--conditions", type=count, default=3, help="flown for each of them, to train")
    p.add_argument("--episodes", type=count, default=100, help="to judge")
    p.add_argument(
        "--error", type=read_error,
        help=f"N, mean force error below which an episode succeeds (default: {ERROR:g}); only of "
        "environments without a goal",
    )  # fmt: skip
    p.add_argument("--laws", default="push_and_slide,direct_force", help="to compare with")
    p.add_argument("--policy", type=Path, help="to judge")
    p.add_argument(
        "--other-conditions", action="store_true",
        help="judge although --vary or --set differ from the training's",
    )  # fmt: skip
    p.add_argument("--seed", type=read_seed, default=1, help="of the learner, to train")
    p.add_argument("--out", type=Path, required=True)
    asked = p.parse_args(words)
    asked.vary, asked.sets = asked.vary or [GUSTS], asked.sets or []
    return asked


def import_learner() -> Any:
    """Return stable_baselines3, on one thread; raises InputError where it is not installed."""
    try:
        import stable_baselines3
        import torch
    except ImportError as error:
        raise InputError(f'{error}: install the extra, pip install "skywright[learn]"') from None
    torch.set_num_threads(1)
    return stable_baselines3


def describe_machine() -> dict[str, Any]:
    """Return what a time means: version, the processor's cores, and how busy they are."""
    return {
        "skywright": __version__, "commit": read_commit()["commit"],
        "cores": os.cpu_count(), "machine": platform.machine(),
        "load_1_min": round(os.getloadavg()[0], 1), "nice": os.nice(0),
    }  # fmt: skip


def describe_task(asked: argparse.Namespace) -> dict[str, Any]:
    """Return what was learned, without the paths of this machine."""
    vary = [Path(text).name if text.endswith(".csv") else text for text in asked.vary]
    return {"env": asked.env, "vary": vary, "set": asked.sets}


def train(asked: argparse.Namespace) -> None:
    """Train, and write policy.zip, curve.csv and training.json.

    Until the training has finished, training.json has the state "unfinished": policy.zip is
    written several times, and may still be that of an earlier training.
    """
    learner = import_learner()
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

    check_folder(asked.out)
    began = time.perf_counter()

    def build(i: int) -> Any:
        return lambda: envs.make(
            asked.env, vary=asked.vary, conditions=asked.conditions, seed=SEED, first=i,
            every=asked.envs, sets=asked.sets,
        )  # fmt: skip

    vector = DummyVecEnv([build(i) for i in range(asked.envs)])
    refused = [r for env in vector.envs for r in env.refused]
    built = time.perf_counter() - began
    asked.out.mkdir(parents=True, exist_ok=True)  # the input is right
    told = {
        **describe_task(asked), "state": UNFINISHED, "steps": 0, "seed": asked.seed,
        "envs": asked.envs, "conditions": asked.envs * asked.conditions - len(refused),
        "refused": refused, "build_s": round(built, 1),
    }  # fmt: skip
    write_json(told, asked.out / "training.json")
    vector = VecNormalize(VecMonitor(vector), norm_obs=False, norm_reward=True, gamma=0.98)
    rows: list[dict[str, float]] = []

    class Curve(BaseCallback):
        """Keep the mean return of the last 100 episodes after every rollout."""

        def _on_step(self) -> bool:
            return True

        def _on_rollout_end(self) -> None:
            last = [e["r"] for e in self.model.ep_info_buffer]
            if last:
                rows.append({
                    "steps": self.num_timesteps, "seconds": round(time.perf_counter() - began, 1),
                    "return": round(float(np.mean(last)), 2),
                    "noise": round(float(self.model.policy.log_std.exp().mean().detach()), 4),
                })  # fmt: skip
                if len(rows) % 20 == 0:
                    self.model.save(asked.out / "policy.zip")

    model = learner.PPO(
        "MlpPolicy", vector, seed=asked.seed, device="cpu", n_steps=256, batch_size=256, n_epochs=8,
        gamma=0.98, gae_lambda=0.95, learning_rate=3e-4, clip_range=0.2, ent_coef=0.0,
        policy_kwargs={"net_arch": [32, 32], "log_std_init": -1.0},
    )  # fmt: skip
    model.learn(asked.steps, callback=Curve())
    model.save(asked.out / "policy.zip")
    write_curve(rows, asked.out / "curve.csv")
    told |= {
        "state": FINISHED, "steps": model.num_timesteps,
        "wall_s": round(time.perf_counter() - began, 1),
        "cpu_s": round(time.process_time(), 1), **describe_machine(),
    }  # fmt: skip
    write_json(told, asked.out / "training.json")
    print(json.dumps(told))


def write_json(told: dict[str, Any], path: Path) -> None:
    """Write a file of JSON."""
    path.write_text(json.dumps(told, indent=1) + "\n")


def write_curve(rows: Sequence[dict[str, float]], path: Path) -> None:
    """Write a row a rollout; there is none where the training ended before an episode did."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, CURVE)
        writer.writeheader()
        writer.writerows(rows)


def find_fresh(asked: argparse.Namespace) -> int:
    """Return the first condition that the training of a policy did not see.

    Raises InputError if training.json does not tell, if the training was another one than asked
    for, and if a table has too few conditions.
    """
    if asked.policy is None or not asked.policy.is_file():
        raise InputError(f"--policy {asked.policy}: no such file; valid: one that `train` wrote")
    kept = asked.policy.parent / "training.json"
    try:
        told = json.loads(kept.read_text())
        before = {"env": str(told["env"]), "vary": list(told["vary"]), "set": list(told["set"])}
        seen = int(told["conditions"]) + len(told["refused"])
        state = told.get("state", FINISHED)  # a file without it was written at the end
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{kept}: {error!r}; `judge` reads in it which conditions the training saw"
        ) from None
    if state != FINISHED:
        raise InputError(
            f"{kept}: state = {state!r}: {asked.policy.name} may be of another training; valid: "
            f"{FINISHED!r}: run `train` to its end"
        )
    now = describe_task(asked)
    if before["env"] != now["env"]:
        raise InputError(f"--env {asked.env}: the policy was trained in {before['env']}")
    for key in ("vary", "set"):
        if sorted(before[key]) != sorted(now[key]) and not asked.other_conditions:
            raise InputError(
                f"--{key}: {now[key]}; the policy was trained with {before[key]}; give the same, "
                "or --other-conditions"
            )
    check_rows(asked, before["vary"], seen)
    return seen


def check_rows(asked: argparse.Namespace, before: Sequence[str], seen: int) -> None:
    """Raise InputError if a table of the training has too few rows for fresh conditions.

    Condition i has row i of a table; after the last row, the first one follows.
    """
    needed = count_conditions(asked)
    for text, name in zip(asked.vary, describe_task(asked)["vary"], strict=True):
        for variation in parse_variations([text]) if name in before else ():
            rows = len(variation.values)
            if variation.kind == "csv" and seen + needed > rows:
                left = max(rows - seen, 0)
                raise InputError(
                    f"--vary {text}: {rows} rows; the training used the first {min(seen, rows)}, "
                    f"and --episodes {asked.episodes} needs {needed} more; valid: "
                    + (f"--episodes up to {left * EACH}, or a longer table" if left
                       else "a longer table, or a training with fewer conditions")
                )  # fmt: skip


def count_conditions(asked: argparse.Namespace) -> int:
    """Return the number of conditions to judge in."""
    return -(-asked.episodes // EACH)


def fly(env: Any, choose: Any, seed: int, condition: int, error: float) -> dict[str, Any]:
    """Fly one episode; returns how it went. Forces are None where the environment has none.

    The goal of the environment decides whether it succeeded; without one, the mean force error is
    compared with `error` (N).
    """
    seen, begun = env.reset(seed=seed, options={"condition": condition})
    steps, errors, forces, total = 0, [], [], 0.0
    while True:
        seen, reward, terminated, truncated, info = env.step(choose(seen))
        total, steps = total + reward, steps + 1
        if "force_error_n" in info:
            errors.append(info["force_error_n"])
        if "force_n" in info:
            forces.append(info["force_n"])
        if terminated or truncated:
            break
    mean = summarize(np.mean, errors)
    if env.has_goal:
        done = bool(info.get("success"))
    else:
        done = not terminated and mean is not None and mean < error
    return {
        "condition": begun["condition"], "seed": seed, "return": round(total, 3),
        "force_error_n": mean, "force_std_n": summarize(np.std, forces),
        "force_mean_n": summarize(np.mean, forces), "seconds": round(steps * MISSION_TICK, 6),
        "reason": info.get("reason", ""), "success": done,
    }  # fmt: skip


def summarize(how: Any, values: Sequence[float]) -> float | None:
    """Return a rounded statistic of values, or None if there are none."""
    return round(float(how(values)), 4) if values else None


def find_common(flown: dict[str, Any]) -> list[int]:
    """Return the numbers of the conditions that all laws reached; raises InputError if none."""
    reached = [{start.condition for start in env.starts} for env in flown.values()]
    common = sorted(set.intersection(*reached))
    if not common:
        raise InputError(
            f"--laws {','.join(flown)}: no condition was reached by all; "
            + "; ".join(f"{law}: {text}" for law, env in flown.items() for text in env.refused[:1])
        )
    return common


def judge(asked: argparse.Namespace) -> None:
    """Fly the policy and the laws in the same fresh conditions; write how each episode went."""
    has_goal = find_class(asked.env).has_goal
    if has_goal and asked.error is not None:
        raise InputError(
            f"--error {asked.error:g}: the goal of {asked.env} decides which episodes succeed; "
            "leave it out"
        )
    error = ERROR if asked.error is None else asked.error
    first = find_fresh(asked)
    learner = import_learner()
    try:
        model = learner.PPO.load(asked.policy, device="cpu")
    except Exception as error:  # it raises what reading zip, JSON, pickle and tensors raises
        raise InputError(
            f"--policy {asked.policy}: {error}; valid: policy.zip that `train` wrote"
        ) from error
    check_writable(asked.out, (".json",))
    # all laws first: each may refuse other conditions, and only common ones are compared
    flown = {
        law: envs.make(
            asked.env, vary=asked.vary, conditions=count_conditions(asked), seed=SEED,
            sets=[*asked.sets, f"mission.law={law}"], first=first,
        )
        for law in asked.laws.split(",")
    }  # fmt: skip
    common = find_common(flown)
    found: dict[str, Any] = {
        **describe_task(asked), "error_n": None if has_goal else error, **describe_machine(),
        "refused": [f"{law}: {text}" for law, env in flown.items() for text in env.refused],
        "conditions": len(common),
    }  # fmt: skip
    rows = []
    for law, env in flown.items():
        still = np.zeros(env.action_space.shape, np.float32)
        players = {law: lambda _seen, still=still: still}
        if not rows:  # the policy steers the first law: that of the environment
            players["learned"] = lambda seen: model.predict(seen, deterministic=True)[0]
        index = {start.condition: i for i, start in enumerate(env.starts)}
        for name, choose in players.items():
            for k in range(asked.episodes):
                i = index[common[k % len(common)]]
                rows.append({"player": name, **fly(env, choose, 10_000 + k, i, error)})
    found["episodes"] = rows
    write_json(found, asked.out)
    for name in dict.fromkeys(r["player"] for r in rows):
        mine = [r for r in rows if r["player"] == name]
        errors = [r["force_error_n"] for r in mine if r["force_error_n"] is not None]
        force = f", median force error {np.median(errors):.3f} N" if errors else ""
        print(f"{name}: {sum(r['success'] for r in mine)} of {len(mine)}{force}")


def main(words: Sequence[str] | None = None) -> int:
    """Do what is asked, return the exit code; wrong input is one line and exit code 2."""
    asked = parse(words)
    try:
        {"train": train, "judge": judge}[asked.what](asked)
    except InputError as error:
        print(f"error: {error.with_options or error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
