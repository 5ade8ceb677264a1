"""Environments: steps relative to a vehicle tick and per second, a reset, and processes."""

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any

import numpy as np

from skywright.errors import InputError
from skywright.evidence.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.evidence.bench.timing import compute_ratios, interleave, read_clock

TICKS = 50
"""Ticks of one measurement: the length of a block of noise, so each draws one block."""
STEP_LIMIT, RESET_LIMIT, SHARE_LIMIT = 1.1, 1.0, 0.95
VECTOR, FEW, MANY = "WeldPress", 8, 32
"""Environment of the test with processes, and numbers of environments per process."""
COARSE_MS = 2
"""`mission.timestep_ms` of the measurement with coarse physics."""
LONG = 5
"""Ticks of a longer step, to share the cost of a message."""


def measure(session: Session) -> list[Row]:
    """Measure every environment in this process, and one in several processes."""
    if importlib.util.find_spec("gymnasium") is None:
        return [build_unmeasured_row("envs", "Gymnasium is not installed (extra 'envs')")]
    from skywright.analysis.envs.registry import PLACES, make

    rows, rounds = [], session.pick(3, 20, 60)
    for name in session.pick([VECTOR], list(PLACES), list(PLACES)):
        env = make(name, states=2)
        still = np.zeros(env.action_space.shape or (), np.float32)
        cases = {"tick": partial(_tick, env), "step": partial(_step, env, still)}
        try:
            coarse = make(name, states=2, sets=[f"mission.timestep_ms={COARSE_MS}"])
            cases["coarse"] = partial(_step, coarse, still)
        except InputError as error:  # a contact is too stiff for this time step
            rows.append(build_unmeasured_row(f"{name}.steps_{COARSE_MS}_ms", str(error)))
        times = interleave(cases, rounds)
        rows.append(
            build_row(
                f"{name}.step_over_tick", compute_ratios(times["step"], times["tick"]),
                limit=STEP_LIMIT, note="a step with observation and reward over vehicle.tick()",
            )
        )  # fmt: skip
        for case, physics_ms in (("step", 1), ("coarse", COARSE_MS)):
            if case not in times:
                continue
            note = f"steps of 20 ms a second on one core, physics of {physics_ms} ms"
            rates = [TICKS / t for t in times[case]]
            rows.append(build_row(f"{name}.steps_{physics_ms}_ms", rates, "1/s", note=note))
        spent = [1e3 * _reset(env) for _ in range(rounds)]
        rows.append(
            build_row(f"{name}.reset_ms", spent, "ms", limit=RESET_LIMIT, note="a restored state")
        )
    return rows + _measure_vector(session)


def _tick(env: Any) -> float:
    env.reset(seed=1)
    begin = read_clock()
    for _ in range(TICKS):
        env.vehicle.tick()
    return read_clock() - begin


def _step(env: Any, still: Any) -> float:
    env.reset(seed=1)
    begin = read_clock()
    for _ in range(TICKS):
        env.step(still)
    return read_clock() - begin


def _reset(env: Any) -> float:
    begin = read_clock()
    env.reset(seed=1)
    return read_clock() - begin


def _measure_vector(session: Session) -> list[Row]:
    """Measure a vector in wall time, in turns with processes that exchange no messages."""
    cases = [(FEW, 1), (FEW, LONG), (MANY, 1)]
    return [row for each, ticks in cases for row in _measure_share(session, each, ticks)]


def _measure_share(session: Session, each: int, ticks: int) -> list[Row]:
    """Return the rate of a vector over that of processes which step, and which only tick."""
    import time

    from skywright.analysis.campaign.local import count_cores
    from skywright.analysis.envs.vector import VectorEnv

    workers, steps = min(count_cores(), 2), TICKS // ticks
    vector = VectorEnv(VECTOR, each * workers, workers=workers, states=1, ticks=ticks)
    still = np.zeros(vector.action_space.shape or (), np.float32)

    def step() -> float:
        vector.reset(seed=1)
        begin = time.perf_counter()
        for _ in range(steps):
            vector.step(still)
        return time.perf_counter() - begin

    def step_alone() -> float:
        vector.reset(seed=1)
        return max(vector.step_alone(steps))

    cases = {"bare": lambda: max(vector.tick(TICKS)), "alone": step_alone, "vector": step}
    try:
        times = interleave(cases, session.pick(2, 10, 40))
    finally:
        vector.close()
    name = ("" if ticks == 1 else f"_{ticks}_ticks") + ("" if each == FEW else f"_{each}_each")
    note = f"{workers} processes of {each} environments, {ticks} ticks a step"
    return [
        build_row(
            f"share_of_{case}{name}", compute_ratios(times[key], times["vector"]),
            limit=SHARE_LIMIT, sense=">=", note=f"{note}, over {over}; idle machine",
        )
        for key, case, over in (
            ("bare", "bare_processes", "processes that only tick the vehicles"),
            ("alone", "processes_alone", "processes that step without messages"),
        )
    ]  # fmt: skip
