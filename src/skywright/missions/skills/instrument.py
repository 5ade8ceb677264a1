"""The instrument that a robot carries, according to its data sheet and as it truly is."""

from __future__ import annotations

from typing import Any, Generic, NamedTuple, TypeVar

from skywright.errors import InputError
from skywright.models.deviated_sensors import deviate_noise
from skywright.run.parts import build_named
from skywright.run.setup import Setup
from skywright.vehicle.component import Sensor

T = TypeVar("T")


class Carried(NamedTuple, Generic[T]):
    """An instrument with a table of the class T."""

    name: str  # of its table [robot.sensors.NAME]
    table: T  # according to its data sheet
    true: T  # with its true deviations


def find_instrument(setup: Setup[Any], kind: type[Sensor], what: str) -> Carried[Any]:
    """Return the robot's first sensor of a class; `what` names it in messages.

    Raises InputError if the robot has none.
    """
    d = setup.description
    for part in build_named(d):
        if isinstance(part, kind):
            error = setup.deviation.sensor_noise_error
            true = deviate_noise(part.table, part.name, error, d.mission.seed)
            return Carried(part.name, part.table, true)
    name = kind.__module__.rpartition(".")[2]
    raise InputError(
        f"robot {d.robot.name!r} has no {what}: add a table [robot.sensors.NAME] with "
        f'kind = "{name}"'
    )
