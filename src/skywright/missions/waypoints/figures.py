"""Figures of a report on a flight through waypoints: only those of any flight."""

import numpy as np

from skywright.description.loader import Description
from skywright.missions.waypoints.task import Waypoints
from skywright.reports.explain import format_value
from skywright.run.kind import Figures, Sketch
from skywright.run.result import RunResult


def describe(result: RunResult[Waypoints, None]) -> str:
    """Return a sentence on the flight."""
    d = result.description
    seconds = format_value(result.metrics.get("flight.duration_s"))
    points = d.mission.task.points
    return f"{d.robot.name} in world {d.world.name} flew {len(points)} way-points in {seconds} s"


def sketch(d: Description[Waypoints], way: None) -> Sketch:
    """Return the waypoints."""
    points = np.array([[p.x_m, p.y_m, p.z_m] for p in d.mission.task.points])
    return Sketch("way-points", points)


FIGURES = Figures(
    describe,
    sketch=sketch,
    phases={
        "waypoint *": "The robot flies to the next way-point.",
        "hold *": "The robot holds its position and heading at the way-point.",
    },
)
