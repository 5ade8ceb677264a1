"""What each estimator, each control law and the inertial unit cost in a control tick.

A stretch of a scan is flown and the inputs of every control tick are kept. They are then replayed
through one estimator or law after the other in compiled code, as the loop calls it: by address.
The copying alone is timed too and taken off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numba import carray, cfunc, njit
from numpy.typing import NDArray

from skywright.control.registry import ARMS_LAWS, CASCADED, LAWS, load_arms_law, load_law
from skywright.core.pointers import call_pointer
from skywright.core.signature import ON_BELIEF
from skywright.core.types import BELIEF
from skywright.errors import SimulationError
from skywright.estimation.contact_force import estimate_contact_force
from skywright.estimation.registry import ESTIMATORS, load_estimator
from skywright.estimation.wrench import estimate_wrench
from skywright.evidence.bench.flights import (
    count_ticks,
    fly_into_contact,
    fly_with_hands,
    load_scan,
    record_applied,
    run_ticks,
    step_bare,
)
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import Seconds, interleave, read_clock
from skywright.models.compliant_arms import fill_arms
from skywright.models.floating import fill_floating
from skywright.models.rigid_body import KINEMATICS, fill_kinematics
from skywright.sim.inertial import read_inertial, sense_inertial
from skywright.vehicle.simulated import SimulatedVehicle

Words = NDArray[np.int64]

ESTIMATOR_INPUTS = ("t", "meas", "est.q", "est.qd", "body", "cmd")
ARMS_INPUTS = ("t", "ref", "est", "body", "arms")
LAW_INPUTS = ("t", "ref", "est", "body", "cmd")
BEST_OF = 3
"""Replays a round, the best of which counts: they take a millisecond, and caches are shared."""
REPEAT = 20
"""Times that the samples of one control tick are sensed, to be longer than the clock's tick."""


@cfunc(ON_BELIEF, cache=True)
def idle_c(belief: Any) -> None:
    """Do nothing: what a replay costs without estimator or law."""
    carray(belief, 1)


@njit(cache=True, error_model="numpy")
def replay(
    function: int, address: int, belief: Words, rows: Words, starts: Words, sizes: Words
) -> None:
    """Copy the inputs of each tick (a row each) into the belief, and call `function` on it."""
    for k in range(rows.shape[0]):
        at = 0
        for i in range(starts.shape[0]):
            for j in range(sizes[i]):
                belief[starts[i] + j] = rows[k, at + j]
            at += sizes[i]
        call_pointer(function, address)


@njit(cache=True, error_model="numpy")
def sense_repeatedly(
    im: Any, meas: Any, qpos: Any, qvel: Any, speed: Any, n_steps: int, repeat: int
) -> None:
    """Take and read the inertial samples of one control tick, `repeat` times."""
    for _ in range(repeat):
        im[0].index = 0
        for _ in range(n_steps):
            sense_inertial(im[0], qpos, qvel, speed)
        read_inertial(im[0], meas[0])


def measure(session: Session) -> list[Row]:
    """Measure all of them beside a control tick of bare stepping."""
    vehicle = fly_into_contact(load_scan())
    ticks = count_ticks(session.pick(1.0, 2.0, 2.0))
    beliefs = record_beliefs(vehicle, ticks)
    n = len(beliefs) - 1
    applied = record_applied(vehicle, ticks)
    cases: dict[str, Callable[[], float]] = {
        "bare": partial(step_bare, vehicle, applied),
        "idle_estimator": partial(_time, idle_c.address, beliefs, ESTIMATOR_INPUTS),
        "idle_law": partial(_time, idle_c.address, beliefs, LAW_INPUTS),
        "inertial": partial(_time_inertial, vehicle, n),
    }
    estimators = [name for name in ESTIMATORS if name != "truth"]  # truth has the filter beneath
    for name in estimators:
        address = load_estimator(name).compiled.address
        cases[name] = partial(_time, address, beliefs, ESTIMATOR_INPUTS)
    laws = [name for name in LAWS if name not in CASCADED]  # they need their own robot's gains
    for name in laws:
        cases[name] = partial(_time, load_law(name).compiled.address, beliefs, LAW_INPUTS)
    times = interleave(cases, session.pick(2, 15, 40))
    rows = _build_rows("inertial", "inertial unit, all samples of a tick", times, n)
    for name in estimators:
        rows += _build_rows(name, f"estimator {name}", times, n, "idle_estimator")
    for name in laws:
        rows += _build_rows(name, f"law {name}", times, n, "idle_law")
    rows += measure_arms(ticks, session.pick(2, 15, 40))
    per_tick = [1e6 * t / n for t in times["bare"]]
    note = f"mj_step alone, {vehicle.n_steps} steps of 1 ms"
    return [*rows, build_row("bare_tick_us", per_tick, "us", note=note)]


def measure_arms(ticks: int, rounds: int) -> list[Row]:
    """Measure what a long-reach robot with two compliant arms adds to a tick, both hands busy."""
    vehicle = fly_with_hands("bimanual-longreach")
    beliefs = record_beliefs(vehicle, ticks)
    every = int(vehicle.plant[0]["servo_every"])
    cases = {
        "idle_arms": partial(_time, idle_c.address, beliefs, ARMS_INPUTS),
        "idle_law": partial(_time, idle_c.address, beliefs, LAW_INPUTS),
    } | {
        name: partial(_time, load_law(name).compiled.address, beliefs, LAW_INPUTS)
        for name in CASCADED
    }
    laws = {
        f"arms_{name}": partial(_time, load_arms_law(name).compiled.address, beliefs, ARMS_INPUTS)
        for name in ARMS_LAWS
    }
    estimators = {
        name: partial(_time_arms_estimator, vehicle, beliefs, part)
        for name, part in (("idle_estimator", 0), ("arms_estimator", 1), ("wrench_estimator", 2))
    }
    times = interleave(cases | laws | estimators, rounds)
    call = f"two arms, a call: every {every} ticks"
    told = (
        {name: ("idle_arms", f"arms' law {name[5:]}, {call}") for name in laws}
        | {
            "arms_estimator": ("idle_estimator", f"hands and their forces, {call}"),
            "wrench_estimator": (
                "idle_estimator",
                "forces on a robot with a swinging link, a tick",
            ),
        }
        | {name: ("idle_law", f"law {name}, a tick") for name in CASCADED}
    )
    rows = []
    for name, (idle, note) in told.items():
        net = [t - i for t, i in zip(times[name], times[idle], strict=True)]
        calls = [1e6 * t / (len(beliefs) - 1) for t in net]
        rows.append(build_row(f"{name}_us", calls, "us", note=note))
    return rows


@njit(cache=True, error_model="numpy")
def replay_arms_estimator(beliefs: Any, model: Any, kin: Any, stiff: Any, part: int) -> None:
    """Estimate once for each belief; part 0: kinematics only, 1: hands as well, 2: wrench."""
    for k in range(1, beliefs.shape[0]):
        b = beliefs[k]
        fill_kinematics(model[0], b.est.q, kin[0])
        if part == 1:
            fill_arms(b, model[0], kin[0], stiff[0])
            estimate_contact_force(b)
        elif part == 2:
            fill_floating(model[0], kin[0], b.body, b.wrench)
            estimate_wrench(b)


def _time_arms_estimator(vehicle: SimulatedVehicle, beliefs: NDArray[Any], part: int) -> float:
    """Seconds of the estimators of hands (part 1) or wrench (2), the best of a few."""
    kin, stiff = np.zeros(1, KINEMATICS), np.zeros(1, KINEMATICS)
    best = math.inf
    for _ in range(BEST_OF):
        work = beliefs.copy()
        begin = read_clock()
        replay_arms_estimator(work, vehicle.model, kin, stiff, part)
        best = min(best, read_clock() - begin)
    return best


def record_beliefs(vehicle: SimulatedVehicle, ticks: int) -> NDArray[Any]:
    """Fly and keep a copy of the BELIEF that the law was called with, at each control tick."""
    kept: list[NDArray[Any]] = []
    law = vehicle.law

    def keep_and_step(belief: Any) -> None:
        kept.append(belief.copy())
        law.step(belief)

    vehicle.law, vehicle.interactive = law._replace(step=keep_and_step, compiled=None), True
    try:
        run_ticks(vehicle, ticks)
    finally:
        vehicle.law, vehicle.interactive = law, False
    return np.concatenate(kept)


def replay_inputs(
    function: int, beliefs: NDArray[Any], inputs: tuple[str, ...]
) -> tuple[float, NDArray[Any]]:
    """Replay all ticks but the first, from the first belief; returns (seconds, last belief)."""
    width = BELIEF.itemsize // 8  # every field is made of 8-byte words
    words = beliefs.view(np.int64).reshape(len(beliefs), width)
    places = [_find_words(name) for name in inputs]
    starts, sizes = np.array([p[0] for p in places]), np.array([p[1] for p in places])
    columns = np.concatenate([np.arange(a, a + n) for a, n in zip(starts, sizes, strict=True)])
    rows = np.ascontiguousarray(words[1:, columns])
    belief = words[0].copy()
    begin = read_clock()
    replay(function, belief.ctypes.data, belief, rows, starts, sizes)
    return read_clock() - begin, belief.view(BELIEF)


def _find_words(name: str) -> tuple[int, int]:
    """Return the first word and the number of words of a field of BELIEF, such as "est.q"."""
    kind, start = BELIEF, 0
    for part in name.split("."):
        assert kind.fields is not None
        kind, offset = kind.fields[part][:2]
        start += offset
    return start // 8, kind.itemsize // 8


def _time(function: int, beliefs: NDArray[Any], inputs: tuple[str, ...]) -> float:
    """Seconds of a replay, the best of a few; raises SimulationError when it ends in nonsense."""
    found = [replay_inputs(function, beliefs, inputs) for _ in range(BEST_OF)]
    wall, end = min(spent for spent, _ in found), found[0][1]
    for name in ("est", "cmd"):
        if not np.isfinite(np.frombuffer(end[0][name].tobytes())).all():
            raise SimulationError(f"a replay ended with {name} not finite")
    return wall


def _time_inertial(vehicle: SimulatedVehicle, ticks: int) -> float:
    """Seconds that the inertial unit takes for as many control ticks."""
    im, meas, sim = vehicle.inertial.copy(), vehicle.belief["meas"].copy(), vehicle.sim
    speed = vehicle.plant["rotor_speed"][0].copy()
    begin = read_clock()
    for _ in range(-(-ticks // REPEAT)):
        sense_repeatedly(im, meas, sim.qpos, sim.qvel, speed, vehicle.n_steps, REPEAT)
    return (read_clock() - begin) * ticks / (-(-ticks // REPEAT) * REPEAT)


def _build_rows(
    name: str, note: str, times: dict[str, Seconds], ticks: int, idle: str | None = None
) -> list[Row]:
    """Rows of the time a control tick, and of its share of bare stepping."""
    none = [0.0] * len(times[name])
    net = [t - i for t, i in zip(times[name], times[idle] if idle else none, strict=True)]
    share = [100.0 * t / bare for t, bare in zip(net, times["bare"], strict=True)]
    return [
        build_row(f"{name}_us", [1e6 * t / ticks for t in net], "us", note=f"{note}, a tick"),
        build_row(f"{name}_percent", share, "%", note="of bare stepping"),
    ]
