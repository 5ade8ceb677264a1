"""Initial states of episodes: fly a mission to a phase and save its vehicle there.

Every condition has its own vehicle, because masses, friction and positions are parts of its model,
and several saved states, which differ in flight time and noise. An episode begins by restoring a
state: records, physics and the state of the components. Blocks of noise are not copied; a new seed
draws them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from skywright.analysis.campaign.spec import (
    COMPANY,
    Campaign,
    build_campaign,
    check_variations,
    draw_run,
    load_run,
)
from skywright.core.threads import on_one_thread
from skywright.errors import InfeasibleError, InputError, SimulationError
from skywright.run.backends import build_vehicle
from skywright.run.planning import MissionPlan, plan_mission
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.vehicle.component import Component
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.saved import Saved
from skywright.vehicle.simulated import SimulatedVehicle

SEED_MAX = 2**48


class Start(NamedTuple):
    """A condition: its vehicle, and the initial states of its episodes."""

    vehicle: SimulatedVehicle
    states: list[Saved]
    condition: int
    varied: dict[str, Any]
    """Values that differ from the mission, by key."""
    seed: int


class Wanted(NamedTuple):
    """Requirements of an environment on its initial states."""

    phase: str
    parts: Callable[[], Sequence[Component]]
    begin: Callable[[Supervisor[Any], Setup[Any], MissionPlan[Any]], None]
    """Called at the phase: initializes the records of the parts and starts tracking."""
    spread_s: tuple[float, float]
    """s, range of the flight time without action before a state is saved; at least one mission
    tick is flown, which computes the first observation."""


class _ReachedError(Exception):
    """The phase has begun."""


def build_conditions(
    mission: str, vary: Sequence[str], robot: str | None, world: str | None,
    sets: Sequence[str], seed: int | None, checked: int,
) -> Campaign:  # fmt: skip
    """Return the conditions as a campaign.

    Raises InputError on a wrong key or file, and on an invalid range: the extremes of the first
    `checked` conditions are tried, none with 0.
    """
    campaign = build_campaign(mission, vary, robot=robot, world=world, sets=sets, seed=seed)
    if checked > 0:  # of few draws, a value that is valid only with some others would be refused
        check_variations(campaign, max(checked, COMPANY))
    return campaign


def build_starts(
    campaign: Campaign, wanted: Wanted, conditions: Sequence[int], states: int
) -> tuple[list[Start], list[str]]:
    """Fly each of the `conditions` (run numbers of the campaign) to the phase.

    Return the starts, and the errors of conditions that are refused as input or did not reach the
    phase. Raises InputError if no condition reached the phase.
    """
    out, refused = list[Start](), list[str]()
    for i in conditions:
        try:
            out.append(build_start(campaign, wanted, i, states))
        except (InfeasibleError, InputError, SimulationError, _NeverReachedError) as error:
            if isinstance(error, InputError) and not campaign.variations:
                raise  # the fixed input is wrong, in every condition
            why = str(error).removeprefix("--set: ").removeprefix("--set ")  # of varied keys, too
            refused.append(f"condition {i}: {why}")
    if not out:
        raise InputError(
            f"none of {len(conditions)} conditions of mission {campaign.mission!r} reached the "
            f"phase {wanted.phase!r}; the first: {refused[0]}"
        )
    return out, refused


class _NeverReachedError(Exception):
    """The flight ended before the phase."""


@on_one_thread
def build_start(campaign: Campaign, wanted: Wanted, i: int, states: int) -> Start:
    """Fly condition `i` to its phase; see build_starts."""
    one = draw_run(campaign, i)
    setup: Setup[Any] = Setup(load_run(campaign, one))
    description = setup.description
    plan = plan_mission(description, setup)
    if not plan.feasible:
        raise InfeasibleError(f"no plan: {plan.blocked_by}", str(plan.blocked_by))
    vehicle = build_vehicle(description, setup=setup, parts=wanted.parts())

    def on_tick(_: float, phase: str) -> None:
        if phase == wanted.phase:  # after its first tick: its reference is tracked
            raise _ReachedError

    supervisor: Supervisor[Any] = Supervisor(
        vehicle, description.mission, plan, description.robot.platform.gear_height_m,
        on_tick=on_tick, rules=(), surroundings=lambda: setup.clearance_aloft,
    )  # fmt: skip
    try:
        flight = supervisor.fly()
    except _ReachedError:
        pass
    else:
        raise _NeverReachedError(
            f"the flight ended before the phase {wanted.phase!r}: {flight.reason or 'done'}"
        )
    wanted.begin(supervisor, setup, plan)
    saved = save_states(vehicle, wanted.spread_s, states, one.seed)
    return Start(vehicle, saved, i, one.varied, one.seed)


def save_states(
    vehicle: SimulatedVehicle, spread_s: tuple[float, float], states: int, seed: int
) -> list[Saved]:
    """Fly `states` times from the current state for a time drawn from `spread_s` (s), each with
    other noise, and save the vehicle.

    At least one tick is flown: before it, the observation is that of the flight, or zero.
    """
    base, rng = vehicle.save(), np.random.default_rng(np.random.SeedSequence(seed))
    low, high = (max(round(t / MISSION_TICK), 1) for t in spread_s)
    saved = []
    for _ in range(states):
        vehicle.restore(base, int(rng.integers(SEED_MAX)))
        for _ in range(int(rng.integers(low, high + 1))):
            vehicle.tick()
        saved.append(vehicle.save())
    return saved
