"""Devices beside the robot that a mission may use: a kind of mission declares them.

They are not part of the robot: a helper who pushes it, a bench that moves its clamp, motion capture
that surveys a thing, the pads' force plates. A simulation has them all. Other back ends state which
they have, and a mission that declares others is refused before the flight.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.description.world.thing import Fixture, Placed
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.vehicle.given_forces import GivenForces
from skywright.vehicle.observers import gauges
from skywright.vehicle.targets import PIPE, Target, list_tracked

Array = NDArray[np.float64]
DEVICES = {
    "helper": "somebody who pushes a body of the robot: `push(body, f_W)`",
    "bench": "the bench that clamps the platform: `move(p_W, yaw)`",
    "surveyor": "motion capture that measures a tracked thing or the pipe: `survey(name)`",
    "gauges": "force plates of the pads: `zero()`",
}
"""Name -> description, for messages and the documentation."""


class Helper:
    """A person who pushes the robot."""

    def __init__(self, vehicle: Any) -> None:
        self._v = vehicle

    def push(self, body: str, f_W: Array) -> None:
        """Apply a force (3,) N to a body of the robot, at its centre of mass, until the next call.

        Raises InputError for an unknown body, and for a force that is not three finite numbers.
        """
        f_W = _read_vector("push", "f_W", f_W)
        self._v.find(GivenForces).push(body, f_W)


class Bench:
    """The fixture that clamps the platform."""

    def __init__(self, vehicle: Any) -> None:
        self._v = vehicle

    def move(self, p_W: Array, yaw: float = 0.0) -> None:
        """Move the clamp to p_W (3,) m, turned by `yaw` (rad); raises InputError if not finite."""
        p_W = _read_vector("move", "p_W", p_W)
        if not math.isfinite(yaw):
            raise InputError(f"move: yaw = {yaw}; valid: a finite number")
        w, _, y, _ = find_bench(self._v.world).q_WB
        data, c, s = self._v.sim.data, math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        data.mocap_pos[0] = p_W
        data.mocap_quat[0] = [c * w, -s * y, c * y, s * w]  # first about y, then about z


class Surveyor:
    """Motion capture that measures things."""

    def __init__(self, vehicle: Any) -> None:
        self._v = vehicle

    def survey(self, name: str) -> tuple[Array, Array]:
        """Return (p_WO, R_WO) of a tracked thing, or of the pipe (PIPE).

        It is the running mean of the samples (vehicle/targets.py), with the error of the targets.
        Raises InputError if nothing of that name is tracked, or if it has no sample yet.
        """
        v = self._v
        tracked = list_tracked(v.robot, v.world)
        if name not in tracked:
            placed = [n for n, thing in v.world.things.items() if isinstance(thing, Placed)]
            if name != PIPE and name not in placed:
                raise InputError(
                    f"world {v.world.name!r} has no {name!r} that can be surveyed; there are: "
                    f"{', '.join(placed) or 'none'}"
                )
            raise InputError(
                f"world {v.world.name!r}: motion capture does not track {name!r}; this "
                "requires tracked = true in a world with motion capture; tracked: "
                f"{', '.join(tracked) or '-'}"
            )
        found = v.read(Target, f"{name} target" if len(tracked) > 1 else "")
        if found.samples == 0.0:
            raise InputError(f"motion capture has not measured {name!r} yet, t = {v.t:.2f} s")
        return np.array(found.p_WO), np.array(found.R_WO)


class Gauges:
    """The force plates of a world's pads."""

    def __init__(self, vehicle: Any) -> None:
        self._v = vehicle

    def zero(self) -> None:
        """Tare the wrench on the platform and reset its peaks.

        Raises InputError without a plate.
        """
        try:
            found = self._v.find(gauges.Gauges)
        except InputError:
            world = self._v.world.name
            raise InputError(
                f"world {world!r} has no force plates: add a thing of kind 'pad'"
            ) from None
        found.zero()


class Devices:
    """The devices of a back end, or those of them that a mission has declared."""

    def __init__(self, vehicle: Any, names: frozenset[str], why: str = "") -> None:
        """`names` are the available devices; `why` is the reason why others are not."""
        self._v, self.names = vehicle, names
        self._why = why or "this back end does not have it"

    def grant(self, kind: str, declared: frozenset[str]) -> Devices:
        """Return the devices that a kind of mission declares."""
        return Devices(self._v, self.names & declared, f"mission kind {kind!r} does not declare it")

    @property
    def helper(self) -> Helper:
        """A person who pushes the robot."""
        return Helper(self._find("helper"))

    @property
    def bench(self) -> Bench:
        """The bench; raises InputError if the world has none."""
        find_bench(self._find("bench").world)
        return Bench(self._v)

    @property
    def surveyor(self) -> Surveyor:
        """Motion capture that measures things."""
        return Surveyor(self._find("surveyor"))

    @property
    def gauges(self) -> Gauges:
        """The force plates of the pads."""
        return Gauges(self._find("gauges"))

    def _find(self, name: str) -> Any:
        if name not in self.names:
            there = ", ".join(sorted(self.names)) or "none"
            raise InputError(f"device {name!r}: {self._why}; there are: {there}")
        return self._v


def _read_vector(what: str, name: str, given: Any) -> Array:
    try:
        out = np.asarray(given, float)
    except (TypeError, ValueError):
        out = np.zeros(0)
    if out.shape != (3,) or not np.isfinite(out).all():
        raise InputError(f"{what}: {name} = {given!r}; valid: three finite numbers")
    return out


def find_bench(world: Any) -> Fixture:
    """Return the fixture of a world; raises InputError if there is none."""
    bench = find_first(world.things, Fixture)
    if bench is None:
        raise InputError(f"world {world.name!r} has no bench: add a thing of kind 'bench'")
    return bench
