"""Keys of a mission of the kind "waypoints"."""

from pydantic import Field

from skywright.core.spec import Coordinate, Spec
from skywright.description.mission.spec import Task


class Waypoint(Spec):
    """A platform pose to reach and hold."""

    x_m: Coordinate  # position in W
    y_m: Coordinate  # position in W
    z_m: float = Field(gt=0, le=1000)  # height above the ground
    yaw_deg: float = 0.0  # heading
    # time for which the pose is held and evaluated
    hold_s: float = Field(default=2.0, ge=0, le=3600)
    actuators: dict[str, float | list[float]] = {}  # set when the pose is reached, by column


class Waypoints(Task):
    """Waypoints in the order of the flight."""

    points: list[Waypoint] = Field(min_length=1)  # waypoints in the order of the flight
    settle_s: float = Field(default=2.0, ge=0, le=60)  # rest before a hold: the robot comes to rest
