"""OMPL's planners on the same problems, as fast as its Python package allows.

- The state space is a compound one whose own (C++) distance is the cost (6), so nearest
  neighbours, path lengths and pruning never call Python.
- Edges are checked by Skywright's compiled, certified check with one call per edge. It is exact, so
  there is no resolution that could be too coarse (unsafe) or too fine (slow).
- Time is the processor time of this thread, which a busy machine does not change.
"""

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.user_code import njit
from skywright.planning.motion.cost import path_cost
from skywright.planning.motion.edges import is_edge_free, is_state_free
from skywright.planning.motion.space import Scratch, Space, build_scratch


class Trace(NamedTuple):
    """Progress and result of a planner."""

    first_s: float  # until the first path; if optimising: until the first stop with one
    history: list[tuple[float, float]]  # time s, cost of (6), improving
    rows: Array  # (m, n) of the last path; empty: none


@njit(cache=True, error_model="numpy")
def _edge(space: Space, ends: Array, scratch: Scratch) -> bool:
    return is_edge_free(space[0], ends[0], ends[1], scratch[0])


@njit(cache=True, error_model="numpy")
def _state(space: Space, ends: Array, scratch: Scratch) -> bool:
    return is_state_free(space[0], ends[0], scratch[0])


@njit(cache=True, error_model="numpy")
def _cost(space: Space, rows: Array) -> float:
    return path_cost(space[0], rows, rows.shape[0])


def measure_cost(space: Space, rows: Array) -> float:
    """Return the cost (6) of a path, given as rows of coordinates."""
    return float(_cost(space, np.ascontiguousarray(rows)))


class _Setting(NamedTuple):
    """Parts of an OMPL problem that are reused between queries."""

    information: Any
    read: Callable[[Any, Array], None]
    write: Callable[[Any, Array], None]
    objective: Any
    keep: tuple[Any, ...]  # references that keep Python objects used by OMPL alive


def _build(space: Space, informed: bool) -> _Setting:
    """Build the state space; `informed` planners need one with sampling of an ellipsoid in OMPL.

    Otherwise it is a compound space whose own distance is the cost (6). An informed one is a plain
    vector space with coordinates scaled by their weights. Its Euclidean length never exceeds the
    cost (6), so the ellipsoid contains every better path; the cost itself is a call into Python.
    """
    from ompl import base as ob
    from ompl import util

    util.setLogLevel(util.LogLevel.LOG_NONE)  # it would write to standard output
    n, n_move = int(space["n"][0]), int(space["n_move"][0])
    low, high, weight = (space[0][name][:n].copy() for name in ("low", "high", "weight"))

    def vector_space(rows: list[int], scale: Array) -> Any:
        part = ob.RealVectorStateSpace(len(rows))
        bounds = ob.RealVectorBounds(len(rows))
        for k, i in enumerate(rows):
            bounds.setLow(k, float(low[i] * scale[i]))
            bounds.setHigh(k, float(high[i] * scale[i]))
        part.setBounds(bounds)
        return part

    if informed:
        states = vector_space(list(range(n)), weight)

        def read(state: Any, row: Array) -> None:
            for i in range(n):
                row[i] = state[i] / weight[i]

        def write(state: Any, row: Array) -> None:
            for i in range(n):
                state[i] = float(row[i] * weight[i])

    else:
        states = ob.CompoundStateSpace()
        states.addSubspace(vector_space(list(range(n_move)), np.ones(n)), float(weight[0]))
        for i in range(n_move, n):
            states.addSubspace(vector_space([i], np.ones(n)), float(weight[i]))

        def read(state: Any, row: Array) -> None:
            move = state[0]
            for i in range(n_move):
                row[i] = move[i]
            for i in range(n_move, n):
                row[i] = state[1 + i - n_move][0]

        def write(state: Any, row: Array) -> None:
            for i in range(n_move):
                state[0][i] = float(row[i])
            for i in range(n_move, n):
                state[1 + i - n_move][0] = float(row[i])

    information = ob.SpaceInformation(states)
    scratch, ends = build_scratch(space), np.zeros((2, n))

    class Motion(ob.MotionValidator):
        def checkMotion(self, a: Any, b: Any) -> bool:
            read(a, ends[0])
            read(b, ends[1])
            return bool(_edge(space, ends, scratch))

    class Cost(ob.PathLengthOptimizationObjective):
        def motionCost(self, a: Any, b: Any) -> Any:
            read(a, ends[0])
            read(b, ends[1])
            return ob.Cost(_cost(space, ends))

    def valid(state: Any) -> bool:
        read(state, ends[0])
        return bool(_state(space, ends, scratch))

    information.setStateValidityChecker(valid)
    motion = Motion(information)
    information.setMotionValidator(motion)
    information.setup()
    objective = Cost(information) if informed else ob.PathLengthOptimizationObjective(information)
    return _Setting(information, read, write, objective, (motion, valid))


def _rows(path: Any, read: Callable[[Any, Array], None], n: int) -> Array:
    rows = np.zeros((path.getStateCount(), n))
    for i in range(len(rows)):
        read(path.getState(i), rows[i])
    return rows


def _define(setting: _Setting, start: Array, goal: Array) -> Any:
    from ompl import base as ob

    ends = []
    for row in (start, goal):
        state = setting.information.allocState()
        setting.write(state, row)
        ends.append(state)
    problem = ob.ProblemDefinition(setting.information)
    problem.setStartAndGoalStates(*ends)
    problem.setOptimizationObjective(setting.objective)
    return problem


def run_planner(
    name: str,
    space: Space,
    start: Array,
    goal: Array,
    looks_s: Sequence[float],
    time_s: float,
    rewire: float | None = None,
) -> Trace:
    """Run an optimising planner for `time_s` of processor time, interrupted after each of
    `looks_s`.

    It continues with its tree after each interruption; no planner returns its path while it runs.
    `rewire` is its rewire factor. OMPL's default tries about a thousand neighbours of every node in
    four dimensions, as the proof of optimality requires; fewer may find better paths in practice.
    """
    from ompl import base as ob
    from ompl import geometric as og

    setting = _build(space, informed=name != "RRTstar")
    problem = _define(setting, start, goal)
    planner = getattr(og, name)(setting.information)
    planner.setProblemDefinition(problem)
    if rewire is not None:
        planner.setRewireFactor(rewire)
    planner.setup()
    spent, rows = 0.0, np.zeros((0, len(start)))
    history: list[tuple[float, float]] = []
    for look in [*(t for t in looks_s if t < time_s), time_s]:
        began = time.thread_time()
        planner.solve(ob.PlannerTerminationCondition(_clock_after(began + look - spent)))
        spent += time.thread_time() - began
        if not problem.hasExactSolution():
            continue
        rows = _rows(problem.getSolutionPath(), setting.read, len(start))
        cost = measure_cost(space, rows)
        if not history or cost < history[-1][1]:
            history.append((spent, cost))
    return Trace(history[0][0] if history else math.nan, history, rows)


def _clock_after(until: float) -> Callable[[], bool]:
    return lambda: time.thread_time() >= until


def run_connect(space: Space, start: Array, goal: Array, time_s: float) -> Trace:
    """Run RRT-Connect with OMPL's path simplifier repeatedly until `time_s`; return the best path.

    Every path is simplified to convergence (simplifyMax) before the next search.
    """
    from ompl import base as ob
    from ompl import geometric as og

    setting = _build(space, informed=False)
    began = time.thread_time()
    best, first = math.inf, math.nan
    rows = np.zeros((0, len(start)))
    history: list[tuple[float, float]] = []
    while time.thread_time() - began < time_s:
        problem = _define(setting, start, goal)
        planner = og.RRTConnect(setting.information)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(ob.PlannerTerminationCondition(_clock_after(began + time_s)))
        if not problem.hasExactSolution():
            break
        path = problem.getSolutionPath()
        if math.isnan(first):
            first = time.thread_time() - began
        simplifier = og.PathSimplifier(setting.information, problem.getGoal(), setting.objective)
        simplifier.simplify(path, ob.PlannerTerminationCondition(_clock_after(began + time_s)))
        found = _rows(path, setting.read, len(start))
        cost = measure_cost(space, found)
        now = time.thread_time() - began
        if cost < best:
            best, rows = cost, found
            history.append((now, cost))
    return Trace(first, history, rows)
