"""The mission kind "waypoints"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.errors import InputError
from skywright.missions.waypoints.task import Waypoints
from skywright.run.folder_kind import FolderKind

if TYPE_CHECKING:
    from skywright.vehicle.interface import Backend


class WaypointsKind(FolderKind[Waypoints]):
    """Fly through waypoints."""

    task = Waypoints
    needs = frozenset({"uav"})

    def check_vehicle(self, vehicle: Backend, task: Waypoints) -> None:
        """Refuse values that are invalid for the vehicle's actuators."""
        for i, point in enumerate(task.points):
            for column, value in point.actuators.items():
                try:
                    vehicle.actuators.check(column, value)
                except InputError as error:
                    raise InputError(f"mission.task.points.{i}.actuators: {error}") from None
