"""What an environment adds to a vehicle: three components that run in the compiled tick.

The action changes the reference before the law reads it (robot's side), the observation is made of
what the robot knows (robot's side: the assembly refuses the plant's records there), and the reward
is judged from the truth (plant's side). So a step of an environment costs a tick of the vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, NamedTuple

from skywright.core.record import Array, Record
from skywright.vehicle.component import Component, Output, helper

MAX_ACTIONS, MAX_SIGNALS, MAX_VALUES = 4, 16, 4
LIMIT = 10.0
"""Observations are bounded to this, in their units of size."""


class Signal(NamedTuple):
    """A number of an observation, an action or an `info`."""

    name: str
    unit: str
    size: float
    """What an observation of 1, or an action of 1, stands for."""
    meaning: str = ""


class Steered(Output):
    """What the action has made of the reference by now."""

    values: Annotated[Array, MAX_ACTIONS]


class Observation(Output):
    """What the learner sees, each signal over its size."""

    values: Annotated[Array, MAX_SIGNALS]


class Judgement(Output):
    """What the learner is told of its last step; the environment clears it before each."""

    ticks: float  # control ticks since it was cleared
    reward: float  # sum over them
    ended: float  # index into the environment's reasons, 0: goes on
    success: float  # 1: what was asked for is done
    values: Annotated[Array, MAX_VALUES]  # sums over the ticks of what `info` tells the mean of


class Act(Component):
    """Base of the component that applies an action; its step changes Reference."""

    slot = "reference"
    signals: ClassVar[Sequence[Signal]] = ()

    class Me(Record):
        dt: float  # s, control period
        on: float  # 1: an episode may run; on the way there the mission flies as it is
        action: Annotated[Array, MAX_ACTIONS]  # -1 to 1, written between mission ticks
        size: Annotated[Array, MAX_ACTIONS]

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Fill what all actions have."""
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
        """Fill what all observations have."""
        me.dt = context.dt
        me.inverse[: len(self.signals)] = [1.0 / s.size for s in self.signals]


class Judge(Component):
    """Base of the component that fills Judgement, from the truth."""

    slot, side = "derive", "plant"

    class Me(Record):
        dt: float  # s, control period

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Fill what all judges have."""
        me.dt = context.dt


@helper
def see(me: Any, out: Any, i: int, value: float) -> None:
    """Put a signal into an observation."""
    out.values[i] = min(max(value * me.inverse[i], -LIMIT), LIMIT)


@helper
def low_pass(old: float, new: float, share: float) -> float:
    """Return the filtered value; `share` is the step over the time constant."""
    return old + share * (new - old)


@helper
def dot(a: Any, b: Any) -> float:
    """Return a . b of (3,) arrays."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
