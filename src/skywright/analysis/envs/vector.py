"""Several environments in several processes: a gymnasium.vector.VectorEnv.

The caller and each further process step their share of the environments, one environment after the
other. A process answers once per step, to limit the cost of messages. Observations and actions are
in shared memory. The caller flies as well, because its core would be idle while it waits.
"""

from __future__ import annotations

import os
import pickle
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from skywright.analysis.campaign.forks import Fork, start_fork
from skywright.analysis.campaign.local import count_cores
from skywright.analysis.envs.arguments import read_whole
from skywright.analysis.envs.env import DIVERGED
from skywright.analysis.envs.parts import LIMIT
from skywright.analysis.envs.registry import find_class, make
from skywright.analysis.envs.shared import Layout, map_arrays, open_file
from skywright.analysis.envs.worker import MORE, STEP, Info, Share
from skywright.errors import InputError, SimulationError

Numbers = NDArray[np.float32]


class _Worker(NamedTuple):
    process: Fork
    connection: Connection
    first: int
    n: int


class VectorEnv(gymnasium.vector.VectorEnv[Numbers, Numbers, Any]):
    """`num_envs` environments of skywright.envs in `workers` processes."""

    metadata: dict[str, Any] = {"render_modes": []}
    _begun = False
    """Whether every environment has begun an episode; before, a Share has no addresses."""

    def __init__(
        self, name: str, num_envs: int, *, workers: int | None = None,
        autoreset: str = "next_step", **options: Any,
    ) -> None:  # fmt: skip
        """Start the processes; `options` are those of the environment.

        `conditions` are flown for each environment. `workers` is the number of processes, including
        the caller (default: one per core). `autoreset`: an environment that ended is reset in the
        next step ("next_step") or in the same one ("same_step"), as in Gymnasium. Raises InputError
        on wrong input.
        """
        self._mine: Share | None = None
        self._workers: list[_Worker] = []
        cls = find_class(name)
        num_envs = read_whole("num_envs", num_envs, 1)
        most = min(count_cores(), num_envs)
        n = most if workers is None else read_whole("workers", workers, 1, most)
        modes = {"next_step": AutoresetMode.NEXT_STEP, "same_step": AutoresetMode.SAME_STEP}
        if not isinstance(autoreset, str) or autoreset not in modes:
            raise InputError(f"autoreset = {autoreset!r}; valid: {', '.join(modes)}")
        for key in ("first", "every"):
            if key in options:
                raise InputError(f"{key}: set by the vector for each environment")
        self.metadata = {**self.metadata, "autoreset_mode": modes[autoreset]}
        self.num_envs, self.values = num_envs, cls.values
        self._all = np.ones(num_envs, np.bool_)  # copied for the masks of a step
        acts, sees = len(cls.act.signals), len(cls.observe.signals)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (acts,), np.float32)
        self.single_observation_space = gymnasium.spaces.Box(-LIMIT, LIMIT, (sees,), np.float32)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        layout = Layout(num_envs, acts, sees, len(cls.values))
        file = open_file()
        self._shared = map_arrays(file, layout)
        starts = [k * num_envs // n for k in range(n + 1)]
        same = autoreset == "same_step"
        try:
            for first, last in pairwise(starts[1:]):
                self._workers.append(_start(file, first, last - first))
                self._workers[-1].connection.send(
                    (name, options, first, last - first, tuple(layout), same)
                )
            self._mine = Share(
                [make(name, **options, first=i, every=num_envs) for i in range(starts[1])],
                0, self._shared, same,
            )  # fmt: skip
            self.refused: list[str] = [r for env in self._mine.envs for r in env.refused]
            self.refused += self._hear_all()
            """What was said of conditions that never came to where episodes begin."""
        except BaseException:
            self.close()
            raise
        finally:
            os.close(file)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Numbers, dict[str, Any]]:  # fmt: skip
        """Begin an episode in each environment; environment i gets the seed `seed` + i.

        After an InputError of an environment, a step needs another reset.
        """
        n = self.num_envs
        if seed is None or not isinstance(seed, Sequence | np.ndarray):
            one = int(seed) if isinstance(seed, int | np.integer) else None
            if seed is not None and one is None:
                raise InputError(f"seed = {seed!r}; valid: whole numbers from 0")
            seeds: list[int | None] = [None if one is None else one + i for i in range(n)]
        else:
            seeds = list(seed)
        if len(seeds) != n:
            raise InputError(f"seed: {len(seeds)} seeds; valid: one, or {n}")
        if not all(x is None or (isinstance(x, int | np.integer) and x >= 0) for x in seeds):
            raise InputError(f"seed = {seed!r}; valid: whole numbers from 0")
        seeds = [None if x is None else int(x) for x in seeds]
        mine = self._check_open()
        self._begun = False  # an environment may refuse, after others have begun
        told = self._do(
            lambda w: (MORE, ("reset", seeds[w.first : w.first + w.n], options)),
            lambda: mine.reset(seeds[: len(mine.envs)], options),
        )
        self._begun = True
        return self._shared.seen.copy(), self._tell(told)

    def step(
        self, actions: Any
    ) -> tuple[Numbers, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Step all environments. Raises InputError for actions of another shape or with NaN, and
        unless every environment has begun an episode."""
        mine = self._check_begun()
        try:
            given = np.asarray(actions, np.float32)
        except (TypeError, ValueError):
            raise InputError("actions: not all are numbers; valid: from -1 to 1") from None
        if given.shape != self._shared.actions.shape:
            raise InputError(
                f"actions: the shape is {given.shape}; valid: {self._shared.actions.shape}"
            )
        if not np.isfinite(given).all():
            i = int(np.argwhere(~np.isfinite(given))[0, 0])
            raise InputError(f"actions: row {i} is not finite; valid: numbers from -1 to 1")
        self._shared.actions[:] = given
        told = self._do(lambda w: (STEP, None), mine.step)
        s, infos = self._shared, self._tell(told)
        with_values = self._all
        if told:  # an environment that was reset or diverged has no values
            with_values = with_values.copy()
            for i, what, info in told:
                if what == "reset" or info.get("reason") == DIVERGED:
                    with_values[i] = False
        for k, value in enumerate(self.values):
            infos[value.name] = s.values[:, k].copy()
            infos["_" + value.name] = with_values.copy()
        return (
            s.seen.copy(), s.reward.copy(), s.terminated.copy(), s.truncated.copy(), infos
        )  # fmt: skip

    def tick(self, n: int) -> list[float]:
        """Tick the vehicles of every process `n` times without environments; return the times (s).

        A step needs a reset afterwards.
        """
        mine = self._check_open()
        self._begun = False
        return self._do(lambda w: (MORE, ("tick", n)), lambda: mine.tick(n))

    def step_alone(self, n: int) -> list[float]:
        """Step every process `n` times with the last actions, without messages; return the times
        (s). Raises InputError as `step` does."""
        mine = self._check_begun()
        return self._do(lambda w: (MORE, ("step_alone", n)), lambda: mine.step_alone(n))

    def _check_open(self) -> Share:
        if self._mine is None:
            raise InputError("the vector is closed: build another one")
        return self._mine

    def _check_begun(self) -> Share:
        mine = self._check_open()
        if not self._begun:
            raise InputError("not every environment has begun an episode: call reset() first")
        return mine

    def _do(
        self, command: Callable[[_Worker], tuple[bytes, Any]], own: Callable[[], list[Any]]
    ) -> list[Any]:
        """Send the command, do the caller's share, and return all answers in order.

        Raises the first InputError after all processes have answered. Any other exception, such as
        an interrupt, closes the vector, because unread answers would be taken for those of the next
        command.
        """
        told, error = list[Any](), None
        try:
            for w in self._workers:
                self._send(w, *command(w))
            try:
                told = own()
            except InputError as found:
                error = found
            told += self._hear_all()
        except InputError as found:
            error = error or found
        except BaseException:
            self.close()
            raise
        if error is not None:
            raise error
        return told

    def _send(self, worker: _Worker, what: bytes, more: Any = None) -> None:
        with suppress(BrokenPipeError, ConnectionResetError):  # dead: _hear detects it
            worker.connection.send_bytes(what)
            if more is not None:
                worker.connection.send(more)

    def _hear_all(self) -> list[Any]:
        """Return all answers in order. Raises the first error after all have answered."""
        out, error = list[Any](), None
        for w in list(self._workers):
            try:
                out += self._hear(w)
            except InputError as found:
                error = error or found
        if error is not None:
            raise error
        return out

    def _hear(self, worker: _Worker) -> Any:
        try:
            told = worker.connection.recv_bytes()
            answer = pickle.loads(told) if told else []
        except (EOFError, OSError):
            code = worker.process.wait()
            last = worker.first + worker.n - 1
            self.close()
            raise SimulationError(
                f"the process of environments {worker.first} to {last} ended (exit code {code})"
            ) from None
        if isinstance(answer, InputError):
            raise answer
        return answer

    def _tell(self, told: list[Info]) -> dict[str, Any]:
        """Return the infos as Gymnasium's SyncVectorEnv: arrays, with a mask under `_key`."""
        infos: dict[str, Any] = {}
        same = self.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
        for i, what, info in told:
            if same and what == "ended":
                last = self._shared.last[i].copy()
                infos = self._add_info(infos, {"final_obs": last, "final_info": info}, i)
            else:
                infos = self._add_info(infos, info, i)
        return infos

    def close_extras(self, **kwargs: Any) -> None:
        """End the processes."""
        for w in self._workers:
            w.connection.close()
        for w in self._workers:
            try:
                w.process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                w.process.kill()
                w.process.wait()
        self._workers, self._mine = [], None

    def __del__(self) -> None:
        with suppress(Exception):
            self.close()


def _start(file: int, first: int, count: int) -> _Worker:
    ours, theirs = Pipe()
    process = start_fork(f"{__package__}.worker", [theirs.fileno(), file])
    theirs.close()
    return _Worker(process, ours, first, count)
