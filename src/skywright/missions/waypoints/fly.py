"""A flight through way-points; any robot can fly it."""

from skywright.missions.waypoints.task import Waypoints
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor


def fly(s: Supervisor[Waypoints], way: None) -> Flight:
    for i, (name, table) in enumerate(s.segments.items()):
        s.follow(name, table)
        hold = s.task.points[i].hold_s if i < len(s.task.points) else 0.0
        if hold > 0.0:
            s.begin(f"hold {i + 1}")
            s.hold(hold)
    return Flight(True, "")
