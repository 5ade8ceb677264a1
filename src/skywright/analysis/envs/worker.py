"""A process of a vector of environments (campaign/forks.py).

Receives commands from a connection until the other end closes. Actions and observations are in
shared memory. The connection transfers one byte per step, and the `info` of episodes that ended.
"""

from __future__ import annotations

import time
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numba import carray
from numpy.typing import NDArray

from skywright.analysis.envs.env import ContactEnv
from skywright.analysis.envs.parts import Judgement
from skywright.analysis.envs.registry import make
from skywright.analysis.envs.shared import Layout, Shared, map_arrays
from skywright.core.pointers import as_pointer
from skywright.core.user_code import njit
from skywright.errors import InputError

JUDGED = Judgement.dtype.itemsize // 8
STEP, MORE = b"", b"m"
"""Commands: a step, and one that is followed by its arguments. An empty message is not pickled."""
Info = tuple[int, str, dict[str, Any]]
"""Number of an environment, origin of the info ("reset", "ended"), and the `info`."""


@njit(cache=True, error_model="numpy")
def give_actions(places: NDArray[np.int64], actions: NDArray[np.float32]) -> None:
    """Write the actions (n, k), clipped to -1 to 1, to the vehicles."""
    n, k = actions.shape
    for i in range(n):
        action = carray(as_pointer(places[i, 0]), k, np.float64)
        for j in range(k):
            action[j] = min(max(np.float64(actions[i, j]), -1.0), 1.0)


@njit(cache=True, error_model="numpy")
def take_answers(
    places: NDArray[np.int64], left: NDArray[np.int64], seen: NDArray[np.float32],
    reward: NDArray[np.float64], values: NDArray[np.float64],
) -> bool:  # fmt: skip
    """Read observations, rewards and the means for `info`; return whether an episode ends.

    `places` (n, 3) are addresses of action, observation and judgement. `left` (n,) are the
    remaining steps of the episodes; 0: no episode is running.
    """
    ends = False
    for i in range(len(left)):
        saw = carray(as_pointer(places[i, 1]), seen.shape[1], np.float64)
        judged = carray(as_pointer(places[i, 2]), JUDGED, np.float64)
        for j in range(seen.shape[1]):
            seen[i, j] = saw[j]
        ticks = max(judged[0], 1.0)
        reward[i] = judged[1] / ticks
        for j in range(values.shape[1]):
            values[i, j] = judged[4 + j] / ticks
        left[i] -= 1
        if left[i] <= 0 or judged[2] != 0.0 or judged[3] != 0.0:
            left[i] = min(left[i], 0)
            ends = True
    return ends


class Share:
    """The environments `first` to before `first + len(envs)` of a vector.

    Between the compiled ticks little Python runs, because caches are cold after 0.2 ms of compiled
    code: one call writes all actions, another reads all results.
    """

    def __init__(self, envs: list[ContactEnv], first: int, shared: Shared, same: bool) -> None:
        """`same`: an environment that ended is reset in the same step, else in the next."""
        self.envs, self.first, self.same = envs, first, same
        mine, n = slice(first, first + len(envs)), len(envs)
        self.actions, self.seen, self.last = (a[mine] for a in shared[:3])
        self.reward, self.values = shared.reward[mine], shared.values[mine]
        self.terminated, self.truncated = shared.terminated[mine], shared.truncated[mine]
        self._left = np.zeros(n, np.int64)
        self._places = np.zeros((n, 3), np.int64)

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None) -> list[Info]:
        """Begin an episode in each environment."""
        return [self._begin(i, seeds[i], options) for i in range(len(self.envs))]

    def _begin(self, i: int, seed: int | None = None, options: Any = None) -> Info:
        env = self.envs[i]
        self.seen[i], info = env.reset(seed=seed, options=options)
        self.reward[i], self.terminated[i], self.truncated[i] = 0.0, False, False
        self._left[i] = env.steps_max
        self._places[i] = [array.ctypes.data for array in env.places]
        return self.first + i, "reset", info

    def step(self) -> list[Info]:
        """Step each environment with its action, or reset it if its episode has ended."""
        flown = [env.running for env in self.envs]
        give_actions(self._places, self.actions)
        for env, flies in zip(self.envs, flown, strict=True):
            if flies:
                env.fly()
        ends = take_answers(self._places, self._left, self.seen, self.reward, self.values)
        if not ends and not any(env.broken for env in self.envs):
            return []
        out: list[Info] = []
        for i, (env, flies) in enumerate(zip(self.envs, flown, strict=True)):
            if not flies:
                self.values[i] = 0.0
                out.append(self._begin(i))
            elif self._left[i] <= 0 or env.broken:
                out += self._end(i)
        return out

    def _end(self, i: int) -> list[Info]:
        env = self.envs[i]
        self.seen[i], reward, terminated, truncated, info = env.conclude()
        self.values[i] = [info.get(value.name, 0.0) for value in env.values]
        out: list[Info] = [(self.first + i, "ended", info)]
        if self.same:
            self.last[i], self.values[i] = self.seen[i], 0.0  # the info has the values
            out.append(self._begin(i))
        self.reward[i], self.terminated[i], self.truncated[i] = reward, terminated, truncated
        return out

    def tick(self, n: int) -> list[float]:
        """Tick the vehicles `n` times without environments; return [time (s)], to benchmark a
        step."""
        for env in self.envs:
            env.reset()
        began = time.perf_counter()
        for _ in range(n):
            for env in self.envs:
                env.vehicle.tick()
        return [time.perf_counter() - began]

    def step_alone(self, n: int) -> list[float]:
        """Step the environments `n` times without messages; return [time (s)], for a benchmark."""
        began = time.perf_counter()
        for _ in range(n):
            self.step()
        return [time.perf_counter() - began]


def _serve(connection: Connection, file: int) -> None:
    """Build the environments and execute commands until the other end closes."""
    name, options, first, count, layout, same = connection.recv()
    try:
        envs = [make(name, **options, first=first + i, every=layout[0]) for i in range(count)]
    except InputError as error:
        connection.send(error)
        return
    share = Share(envs, first, map_arrays(file, Layout(*layout)), same)
    connection.send([r for env in envs for r in env.refused])
    while True:
        command = connection.recv_bytes()
        try:
            if command == STEP:
                answer: Any = share.step()
            else:
                what, *arguments = connection.recv()
                answer = getattr(share, what)(*arguments)
        except InputError as error:
            answer = error
        if command == STEP and answer == []:
            connection.send_bytes(STEP)
        else:
            connection.send(answer)


def serve(connection: int, file: int) -> None:
    """Serve the connection and the shared file with these descriptors."""
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the parent has no more work
        _serve(Connection(connection), file)
