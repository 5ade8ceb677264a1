"""Base of Gymnasium environments on the compiled vehicle, in contact or just before it.

A step is one mission tick (20 ms) of the whole vehicle (sensors, link, estimator, law, allocation,
plant), or several with the same action. Three components (parts.py) and a few class attributes
define a task.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from skywright.analysis.envs.arguments import read_whole
from skywright.analysis.envs.parts import (
    LIMIT,
    LOST,
    Act,
    Judge,
    Judgement,
    Observation,
    Observe,
    Signal,
)
from skywright.analysis.envs.starts import (
    SEED_MAX,
    Start,
    Wanted,
    build_conditions,
    build_starts,
)
from skywright.core.record import View
from skywright.errors import InputError, SimulationError, naming_arguments
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.vehicle.plant import MISSION_TICK

Numbers = NDArray[np.float32]
DIVERGED, ROBOT_LOST = "diverged", "robot lost"
ACT, OBSERVE, JUDGE = "env action", "env observation", "env judge"
"""Names of the three components."""


class ContactEnv(gymnasium.Env[Numbers, Numbers]):
    """Base class of the environments; see docs/howto/learn-a-policy.md."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # type: ignore[misc]
    mission: ClassVar[str]
    robot: ClassVar[str | None] = None  # None: the mission's robot
    sets: ClassVar[tuple[str, ...]] = ()
    phase: ClassVar[str]
    """Phase of the mission in which episodes begin."""
    spread_s: ClassVar[tuple[float, float]] = (0.0, 1.0)
    episode_s: ClassVar[float] = 5.0
    act: ClassVar[type[Act]]
    observe: ClassVar[type[Observe]]
    judge: ClassVar[type[Judge]]
    reasons: ClassVar[tuple[str, ...]] = ("",)
    """Reasons for the end of an episode, indexed by `Judgement.ended`; 0 continues."""
    values: ClassVar[tuple[Signal, ...]] = ()
    """Entries of `info`: means over the last step of `Judgement.values`, from the true state."""
    has_goal: ClassVar[bool] = True
    """Whether `Judgement.success` ends an episode; without a goal, users compare `values`."""
    penalty: ClassVar[float] = 20.0
    """Subtracted from the reward of a step that ends an episode early."""
    bonus: ClassVar[float] = 20.0
    """Added to the reward of the step that reaches the goal."""

    @naming_arguments(sets="--set")
    def __init__(
        self,
        *,
        vary: Sequence[str] = (),
        conditions: int = 1,
        states: int = 4,
        robot: str | None = None,
        world: str | None = None,
        sets: Sequence[str] = (),
        seed: int | None = None,
        episode_s: float | None = None,
        ticks: int = 1,
        first: int = 0,
        every: int = 1,
    ) -> None:
        """Fly `conditions` flights to the start of episodes; each provides `states` initial states.

        `vary` are `KEY=DISTRIBUTION` texts or CSV files of conditions, as in `skywright campaign`;
        condition i has the values of run i of that campaign with this `seed`. `sets` are
        `KEY=VALUE` texts. A step lasts `ticks` times 20 ms with one action; its reward is the mean
        over the ticks. In a vector of `every` environments, number `first` uses the conditions
        first, first + every, ...

        Raises InputError on wrong input, if possible before a flight.
        """
        conditions = read_whole("conditions", conditions, 1)
        states, ticks = read_whole("states", states, 1), read_whole("ticks", ticks, 1)
        first, every = read_whole("first", first, 0), read_whole("every", every, 1)
        length = self.episode_s if episode_s is None else episode_s
        is_number = isinstance(length, int | float | np.integer | np.floating)
        if not is_number or isinstance(length, bool) or not MISSION_TICK <= length < np.inf:
            raise InputError(
                f"episode_s = {episode_s!r}; valid: a duration (s), at least {MISSION_TICK:g}"
            )
        for name, told in (("robot", robot), ("world", world)):
            if not isinstance(told, str | None):
                raise InputError(f"{name} = {told!r}; valid: a text, a name or a file")
        texts = {"vary": vary, "sets": sets}
        for name, given in texts.items():
            if not isinstance(given, list | tuple) or any(not isinstance(x, str) for x in given):
                raise InputError(f"{name} = {given!r}; valid: a list of texts")
        self.ticks = ticks
        self.steps_max = max(round(length / (ticks * MISSION_TICK)), 1)
        acts, sees = self.act.signals, self.observe.signals
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(acts),), np.float32)
        self.observation_space = gymnasium.spaces.Box(-LIMIT, LIMIT, (len(sees),), np.float32)
        # of a vector, whose environments have the same ranges, the first one checks them
        checked = first + conditions * every if first % every == 0 else 0
        campaign = build_conditions(
            self.mission, vary, robot or self.robot, world, (*self.sets, *sets), seed, checked
        )
        wanted = Wanted(self.phase, self._build_parts, self._begin, self.spread_s)
        numbers = range(first, first + conditions * every, every)
        self.starts, self.refused = build_starts(campaign, wanted, numbers, states)
        """The conditions that reached the phase; `refused` has the reasons of the others."""
        self._places = [self._find(start) for start in self.starts]
        self.running = False

    @classmethod
    def _build_parts(cls) -> list[Any]:
        return [cls.act(ACT), cls.observe(OBSERVE), cls.judge(JUDGE)]

    @classmethod
    def _begin(cls, s: Supervisor[Any], setup: Setup[Any], plan: MissionPlan[Any]) -> None:
        vehicle: Any = s.vehicle
        memory = {name: vehicle.get_memory(name) for name in (ACT, OBSERVE, JUDGE)}
        cls.begin(s, setup, plan, memory[ACT], memory[OBSERVE], memory[JUDGE])
        memory[ACT].on = 1.0

    @classmethod
    def begin(
        cls, s: Supervisor[Any], setup: Setup[Any], plan: MissionPlan[Any], act: View,
        observe: View, judge: View,
    ) -> None:  # fmt: skip
        """Start tracking the reference of an episode, and initialize the records of the
        components."""
        raise NotImplementedError

    def _find(self, start: Start) -> tuple[Any, Any, Any]:
        """Return (action, observation, judgement) of a vehicle as views of its records."""
        records = start.vehicle.assembly.records
        action = records[self.act.Me, ACT]["action"][0][: len(self.act.signals)]
        seen = records[Observation, ""]["values"][0][: len(self.observe.signals)]
        judged = records[Judgement, ""].view(np.float64)
        return action, seen, judged

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Begin an episode with a drawn condition, a drawn state and new noise.

        `options` may select {"condition": i} among `starts`. Equal seeds and actions give
        bit-identical episodes.
        """
        if options is not None and not isinstance(options, dict):
            raise InputError(f"options = {options!r}; valid: a dict, {{'condition': NUMBER}}")
        if not self.starts:
            raise InputError("the environment was closed: make another")
        super().reset(seed=seed)
        rng = self.np_random
        chosen = None if options is None else options.get("condition")
        i = int(rng.integers(len(self.starts)))
        if chosen is not None:
            if chosen not in range(len(self.starts)):
                raise InputError(
                    f"options: condition = {chosen!r}; valid: 0 to {len(self.starts) - 1}"
                )
            i = int(chosen)
        self.start = start = self.starts[i]
        self.vehicle = vehicle = start.vehicle
        k, noise = int(rng.integers(len(start.states))), int(rng.integers(SEED_MAX))
        vehicle.restore(start.states[k], noise)  # its first tick draws noise, as every 50th does
        self._action, self._seen, self._judged = self._places[i]
        self._action[:] = 0.0
        self._left, self.running, self.broken = self.steps_max, True, ""
        return self._seen.astype(np.float32), {
            "condition": start.condition, "state": k, "noise": noise, "varied": dict(start.varied),
        }  # fmt: skip

    def step(self, action: Numbers) -> tuple[Numbers, float, bool, bool, dict[str, Any]]:
        """Fly `ticks` of 20 ms with an action, which is clipped to [-1, 1].

        A step in which the episode ends is shorter. Raises InputError for an action of another
        shape or with non-finite values, and if no episode is running.
        """
        self._take(action)
        self._left -= 1
        self.fly()
        return self.conclude(self._left <= 0)

    def fly(self) -> None:
        """Fly a step with the action that is in the vehicle; `conclude` returns the outcome."""
        judged = self._judged
        judged[:] = 0.0
        try:
            for _ in range(self.ticks):
                if self.vehicle.tick().fired:
                    judged[2] = LOST
                if judged[2] or judged[3]:  # ended, success
                    break
        except SimulationError as error:
            self.broken = str(error)

    def conclude(self, is_last: bool) -> tuple[Numbers, float, bool, bool, dict[str, Any]]:
        """Return the result of `step` for the step that was flown; `is_last`: of an episode."""
        if self.broken:
            self.running = False
            seen = np.clip(np.nan_to_num(self._seen), -LIMIT, LIMIT).astype(np.float32)
            return seen, -self.penalty, True, False, {"reason": DIVERGED, "why": self.broken}
        ticks, reward, ended, success, *sums = self._judged.tolist()
        info: dict[str, Any] = {v.name: x / ticks for v, x in zip(self.values, sums, strict=False)}
        reward /= ticks
        terminated = False
        if ended or success:
            reason = ROBOT_LOST if ended == LOST else self.reasons[int(ended)]
            terminated, info["reason"] = True, reason or "success"
            reward += self.bonus if success and not ended else -self.penalty
            info["success"] = bool(success and not ended)
        self.running = not (terminated or is_last)
        return self._seen.astype(np.float32), reward, terminated, is_last, info

    @property
    def places(self) -> tuple[Any, Any, Any]:
        """Arrays of action, observation and judgement in the current vehicle."""
        return self._action, self._seen, self._judged

    def close(self) -> None:
        """Release the vehicles; the environment cannot be used afterwards."""
        self.running, self.starts, self._places = False, [], []
        for name in ("start", "vehicle", "_action", "_seen", "_judged"):  # of the last episode
            self.__dict__.pop(name, None)

    def _take(self, action: Any) -> None:
        """Write an action into the vehicle. Raises InputError."""
        if not self.running:
            why = "call reset() first, and after an episode has ended"
            raise InputError(f"no episode runs: {why if self.starts else 'it was closed'}")
        try:
            given = np.asarray(action)
        except ValueError:  # lists of different lengths
            given = np.array(None)
        if given.dtype.kind not in "fiub":
            raise InputError(f"action: {action!r}; valid: real numbers from -1 to 1")
        if given.shape != self._action.shape:
            names = ", ".join(s.name for s in self.act.signals)
            raise InputError(
                f"action: {action!r} has the shape {given.shape}; valid: ({len(self._action)},), "
                f"each -1 to 1: {names}"
            )
        if not all(map(math.isfinite, given.tolist())):
            raise InputError(f"action: {given} is not finite; valid: numbers from -1 to 1")
        np.maximum(given, -1.0, out=self._action)  # np.clip takes five times as long
        np.minimum(self._action, 1.0, out=self._action)
