"""Tables of the plant's components: the noise of true sensors differs from their data sheets."""

from __future__ import annotations

from typing import Any, TypeVar

from skywright.core.spec import Spec
from skywright.models.deviated_sensors import deviate_noise
from skywright.vehicle.component import Component, PlantContext

T = TypeVar("T", bound=Spec)


def get_true_table(table: T, sensor: str, context: PlantContext) -> T:
    """Return the table of a sensor of the plant with its true noise."""
    return deviate_noise(table, sensor, context.deviation.sensor_noise_error, context.seed)


def get_table(component: Component, context: Any) -> Any:
    """Return the table from which a component is built."""
    if component.group != "sensor" or not isinstance(context, PlantContext):
        return component.table
    return get_true_table(component.table, component.name, context)
