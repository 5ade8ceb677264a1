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
from skywright.analysis.envs.parts import LOST, Judgement
from skywright.analysis.envs.registry import make
from skywright.analysis.envs.shared import Layout, Shared, map_arrays
from skywright.core.pointers import as_pointer
from skywright.core.user_code import njit
from skywright.errors import InputError
from skywright.vehicle.free_ticks import build_call, count_free_ticks, explain, is_free
from skywright.vehicle.schedule import CALL, run_mission_tick

JUDGED_SIZE = Judgement.dtype.itemsize // 8
ACTION, SEEN, JUDGED, LEFT, FREE, FLIGHT = range(6)
"""Columns of the table of flights: addresses of action, observation and judgement, steps left of
the episode (0: none is running), mission ticks that need no Python; and the number of columns."""
FLOWN, PYTHON, FAILED, ENDS, IDLE = range(5)
"""States of an environment in a step: it has flown, it needs Python to fly, its simulation failed,
its episode ends, its episode ended before this step."""
STEP, MORE = b"", b"m"
"""Commands: a step, and one that is followed by its arguments. An empty message is not pickled."""
Info = tuple[int, str, dict[str, Any]]
"""Number of an environment, origin of the info ("reset", "ended"), and the `info`."""


@njit(cache=True, error_model="numpy", nogil=True)
def fly_free(
    flights: NDArray[np.int64], calls: NDArray[np.int64], states: NDArray[np.int8],
    actions: NDArray[np.float32], ticks: int,
) -> bool:  # fmt: skip
    """Fly a step of `ticks` mission ticks of each vehicle; return whether some need Python.

    `calls` (n, CALL) are those of run_mission_tick. Sets the `states` (n,), and reduces the free
    ticks in `flights` (n, FLIGHT). A vehicle with less of them is given its action only.
    """
    n, k = actions.shape
    all_flown = True
    for i in range(n):
        if flights[i, LEFT] <= 0:
            states[i] = IDLE
        else:
            action = carray(as_pointer(flights[i, ACTION]), k, np.float64)
            for j in range(k):
                action[j] = min(max(np.float64(actions[i, j]), -1.0), 1.0)
            states[i] = FLOWN if flights[i, FREE] >= ticks else PYTHON
        if states[i] == FLOWN:
            judged = carray(as_pointer(flights[i, JUDGED]), JUDGED_SIZE, np.float64)
            judged[:] = 0.0
            for _ in range(ticks):
                flights[i, FREE] -= 1
                fired = run_mission_tick(calls[i])
                if fired < 0:
                    states[i] = FAILED
                    break
                if fired:
                    judged[2] = LOST
                if judged[2] != 0.0 or judged[3] != 0.0:  # ended, success
                    break
        all_flown &= states[i] == FLOWN
    return not all_flown


@njit(cache=True, error_model="numpy")
def take_answers(
    flights: NDArray[np.int64], states: NDArray[np.int8], seen: NDArray[np.float32],
    reward: NDArray[np.float64], values: NDArray[np.float64], terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
) -> bool:  # fmt: skip
    """Read observations, rewards and the means for `info` of the vehicles that have flown.

    Returns whether an episode ends or begins.
    """
    all_go_on = True
    for i in range(len(states)):
        if states[i] == FLOWN:
            saw = carray(as_pointer(flights[i, SEEN]), seen.shape[1], np.float64)
            judged = carray(as_pointer(flights[i, JUDGED]), JUDGED_SIZE, np.float64)
            for j in range(seen.shape[1]):
                seen[i, j] = saw[j]
            terminated[i] = truncated[i] = False  # until the episode is concluded
            count = judged[0]
            reward[i] = judged[1] / count
            for j in range(values.shape[1]):
                values[i, j] = judged[4 + j] / count
            flights[i, LEFT] -= 1
            if flights[i, LEFT] <= 0 or judged[2] != 0.0 or judged[3] != 0.0:
                states[i] = ENDS
        all_go_on &= states[i] == FLOWN
    return not all_go_on


class Share:
    """The environments `first` to before `first + len(envs)` of a vector.

    One compiled call flies all environments that need no Python, another reads all results.
    """

    def __init__(self, envs: list[ContactEnv], first: int, shared: Shared, same: bool) -> None:
        """`same`: an environment that ended is reset in the same step, else in the next."""
        self.envs, self.first, self.same = envs, first, same
        mine, n = slice(first, first + len(envs)), len(envs)
        self.actions, self.seen, self.last = (a[mine] for a in shared[:3])
        self.reward, self.values = shared.reward[mine], shared.values[mine]
        self.terminated, self.truncated = shared.terminated[mine], shared.truncated[mine]
        self._flights = np.zeros((n, FLIGHT), np.int64)
        self._calls = np.zeros((n, CALL), np.int64)
        self._states = np.zeros(n, np.int8)
        self._are_free = [False] * n
        self._ticks = envs[0].ticks

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None) -> list[Info]:
        """Begin an episode in each environment."""
        return [self._begin(i, seeds[i], options) for i in range(len(self.envs))]

    def _begin(self, i: int, seed: int | None = None, options: Any = None) -> Info:
        env = self.envs[i]
        self.seen[i], info = env.reset(seed=seed, options=options)
        self.reward[i], self.terminated[i], self.truncated[i] = 0.0, False, False
        self._flights[i] = [a.ctypes.data for a in env.places] + [env.steps_max, 0]
        self._calls[i], self._are_free[i] = build_call(env.vehicle), is_free(env.vehicle)
        return self.first + i, "reset", info

    def step(self) -> list[Info]:
        """Step each environment with its action, or reset it if its episode has ended."""
        if fly_free(self._flights, self._calls, self._states, self.actions, self._ticks):
            for i in np.flatnonzero(self._states == PYTHON).tolist():
                self._fly_in_python(i)
        goes_on = not take_answers(
            self._flights, self._states, self.seen, self.reward, self.values, self.terminated,
            self.truncated,
        )  # fmt: skip
        if goes_on:
            return []
        out: list[Info] = []
        for i in np.flatnonzero(self._states).tolist():
            if self._states[i] == IDLE:
                self.values[i] = 0.0
                out.append(self._begin(i))
            else:
                out += self._end(i)
        return out

    def _fly_in_python(self, i: int) -> None:
        """Fly a step in Python, and count the ticks after it that need none."""
        env = self.envs[i]
        env.fly()
        self._states[i] = FAILED if env.broken else FLOWN
        self._flights[i, FREE] = count_free_ticks(env.vehicle) if self._are_free[i] else 0

    def _end(self, i: int) -> list[Info]:
        env = self.envs[i]
        if self._states[i] == FAILED:
            env.broken = env.broken or str(explain(env.vehicle))
        self.seen[i], reward, terminated, truncated, info = env.conclude(
            self._flights[i, LEFT].item() <= 0
        )
        self._flights[i, LEFT] = 0
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
