"""Where episodes begin: a mission is flown to a phase, and its vehicle saved there.

Every condition has a vehicle of its own, because masses, frictions and places are parts of its
model, and several saved states, each flown on for another time with other noise. To begin an
episode one of them is restored: records, physics and the state of the components. Blocks of
noise are not copied; a new seed draws them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from skywright.analysis.campaign.spec import Campaign, build_campaign, draw_run, load_run
from skywright.core.threads import on_one_thread
from skywright.errors import InfeasibleError, InputError, SimulationError
from skywright.run.backends import build_vehicle
from skywright.run.planning import MissionPlan, plan_mission
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.vehicle.component import Component
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.simulated import Saved, SimulatedVehicle

SEED_MAX = 2**48


class Start(NamedTuple):
    """A condition: its vehicle, and the states from which episodes begin."""

    vehicle: SimulatedVehicle
    states: list[Saved]
    condition: int
    varied: dict[str, Any]
    """What differs from the mission, by key."""
    seed: int


class Wanted(NamedTuple):
    """What a start needs of an environment."""

    phase: str
    parts: Callable[[], Sequence[Component]]
    begin: Callable[[Supervisor[Any], Setup[Any], MissionPlan[Any]], None]
    """Called at the phase: tells the parts what they need to know, and what is tracked."""
    spread_s: tuple[float, float]
    """s, least and most, for which a state is flown on with no action before it is saved."""


class _ReachedError(Exception):
    """The phase has begun."""


def build_conditions(
    mission: str, vary: Sequence[str], robot: str | None, world: str | None,
    sets: Sequence[str], seed: int | None,
) -> Campaign:  # fmt: skip
    """Return what is varied, as a campaign has it; raises InputError on a wrong key or file."""
    return build_campaign(mission, vary, robot=robot, world=world, sets=sets, seed=seed)


def build_starts(
    campaign: Campaign, wanted: Wanted, conditions: Sequence[int], states: int
) -> tuple[list[Start], list[str]]:
    """Fly each of the `conditions` (numbers of runs of the campaign) to where episodes begin.

    Returns the starts, and what was said of conditions that never came there. Raises InputError
    where none did.
    """
    out, refused = list[Start](), list[str]()
    for i in conditions:
        try:
            out.append(build_start(campaign, wanted, i, states))
        except (InfeasibleError, SimulationError, _NeverReachedError) as error:
            refused.append(f"condition {i}: {error}")
    if not out:
        raise InputError(
            f"none of {len(conditions)} conditions of mission {campaign.mission!r} reached the "
            f"phase {wanted.phase!r}; the first: {refused[0]}"
        )
    return out, refused


class _NeverReachedError(Exception):
    """A flight ended before the phase."""


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
        if phase == wanted.phase:  # after its first tick: what it follows is tracked
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
    base, rng = vehicle.save(), np.random.default_rng(np.random.SeedSequence(one.seed))
    low, high = (round(t / MISSION_TICK) for t in wanted.spread_s)
    saved = []
    for _ in range(states):
        vehicle.restore(base, int(rng.integers(SEED_MAX)))
        for _ in range(int(rng.integers(low, high + 1))):
            vehicle.tick()
        saved.append(vehicle.save())
    return Start(vehicle, saved, i, one.varied, one.seed)
