"""Components of an environment that run in the compiled tick: action, observation, reward.

The action changes the reference before the law reads it (robot's side). The observation is computed
from the robot's records (the assembly refuses records of the plant there). The reward is computed
from the true state (plant's side). A step of an environment therefore costs one tick of the
vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, NamedTuple

from skywright.core.record import Array, Record
from skywright.vehicle.component import Component, Output, helper

MAX_ACTIONS, MAX_SIGNALS, MAX_VALUES = 4, 16, 4
LOST = -1.0
"""`Judgement.ended` of a robot that no longer follows its reference (guard LOST_CONTROL)."""
LIMIT = 10.0
"""Bound of observations, in units of `Signal.size`."""


class Signal(NamedTuple):
    """An entry of an observation, an action or an `info`."""

    name: str
    unit: str
    size: float
    """Value that corresponds to an observation of 1 or an action of 1."""
    meaning: str = ""


class Steered(Output):
    """State of the reference as modified by the action."""

    values: Annotated[Array, MAX_ACTIONS]


class Observation(Output):
    """Observation of the learner, each signal divided by its size."""

    values: Annotated[Array, MAX_SIGNALS]


class Judgement(Output):
    """Reward and end of the last step; the environment clears it before each step."""

    ticks: float  # control ticks since it was cleared
    reward: float  # sum over the ticks
    ended: float  # index into the environment's reasons, or LOST; 0: continues
    success: float  # 1: the goal is reached
    values: Annotated[Array, MAX_VALUES]  # sums over the ticks; `info` contains the means


class Act(Component):
    """Base of the component that applies an action; its step changes Reference."""

    slot = "reference"
    signals: ClassVar[Sequence[Signal]] = ()

    class Me(Record):
        dt: float  # s, control period
        on: float  # 1: episode; 0: the mission flies unchanged
        action: Annotated[Array, MAX_ACTIONS]  # -1 to 1, written between mission ticks
        size: Annotated[Array, MAX_ACTIONS]

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Initialize the fields that all actions have."""
        me.dt = context.dt
        me.size[: len(self.signals)] = [s.size for s in self.signals]


class Observe(Component):
    """Base of the component that fills Observation."""

    slot = "derive"
    signals: ClassVar[Sequence[Signal]] = ()

    class Me(Record):
        dt: float  # s, control period
        inverse: Annotated[Array, MAX_SIGNALS]  # 1 over the size of each signal

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Initialize the fields that all observations have."""
        me.dt = context.dt
        me.inverse[: len(self.signals)] = [1.0 / s.size for s in self.signals]


class Judge(Component):
    """Base of the component that fills Judgement from the true state, in every control tick."""

    slot, side = "derive", "plant"

    class Me(Record):
        dt: float  # s, control period

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Initialize the fields that all judges have."""
        me.dt = context.dt


@helper
def see(me: Any, out: Any, i: int, value: float) -> None:
    """Write a signal into an observation."""
    out.values[i] = min(max(value * me.inverse[i], -LIMIT), LIMIT)


@helper
def low_pass(old: float, new: float, share: float) -> float:
    """Return the filtered value; `share` is the time step divided by the time constant."""
    return old + share * (new - old)


@helper
def dot(a: Any, b: Any) -> float:
    """Return a . b of (3,) arrays."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
