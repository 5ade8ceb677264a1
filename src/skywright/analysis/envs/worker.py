"""A process of a vector of environments (campaign/forks.py).

Takes commands from a connection until the other end is gone. Actions and observations are in shared
memory; what goes through the connection is a byte, and what `info` says of episodes that ended.
"""

from __future__ import annotations

import time
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from skywright.analysis.envs.env import ContactEnv
from skywright.analysis.envs.registry import make
from skywright.analysis.envs.shared import Layout, Shared, map_arrays
from skywright.errors import InputError

STEP, MORE = b"", b"m"
"""Commands: a step, and one whose words follow. Nothing is read or pickled for an empty message."""
Info = tuple[int, str, dict[str, Any]]
"""Number of an environment, what it is of ("reset", "ended"), and the `info`."""


class Share:
    """The environments `first` to before `first + len(envs)` of a vector."""

    def __init__(self, envs: list[ContactEnv], first: int, shared: Shared, same: bool) -> None:
        """`same`: an environment that ended begins anew in the same step, else in the next."""
        self.envs, self.first, self.same = envs, first, same
        mine = slice(first, first + len(envs))
        self.actions, self.seen, self.last = (a[mine] for a in shared[:3])
        self.reward, self.values = shared.reward[mine], shared.values[mine]
        self.terminated, self.truncated = shared.terminated[mine], shared.truncated[mine]
        self._over = [False] * len(envs)

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None) -> list[Info]:
        """Begin an episode in each."""
        out = []
        for i, env in enumerate(self.envs):
            self.seen[i], info = env.reset(seed=seeds[i], options=options)
            self._over[i] = False
            out.append((self.first + i, "reset", info))
        self.reward[:] = 0.0
        self.terminated[:] = self.truncated[:] = False
        return out

    def step(self) -> list[Info]:
        """Step each with its action."""
        out: list[Info] = []
        for i, env in enumerate(self.envs):
            if self._over[i]:
                self._over[i] = False
                self.seen[i], info = env.reset()
                self.reward[i], self.terminated[i], self.truncated[i] = 0.0, False, False
                out.append((self.first + i, "reset", info))
                continue
            seen, reward, terminated, truncated, info = env.step(self.actions[i])
            self.reward[i], self.terminated[i], self.truncated[i] = reward, terminated, truncated
            for k, value in enumerate(env.values):
                self.values[i, k] = info.get(value.name, 0.0)
            if terminated or truncated:
                out.append((self.first + i, "ended", info))
                if self.same:
                    self.last[i] = seen
                    seen, info = env.reset()
                    out.append((self.first + i, "reset", info))
                else:
                    self._over[i] = True
            self.seen[i] = seen
        return out

    def tick(self, n: int) -> float:
        """Tick the bare vehicles `n` times; returns the time (s): what a step is measured by."""
        for env in self.envs:
            env.reset()
        began = time.perf_counter()
        for _ in range(n):
            for env in self.envs:
                env.vehicle.tick()
        return time.perf_counter() - began


def _serve(connection: Connection, file: int) -> None:
    """Build what is asked for, and answer until the other end is gone."""
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
