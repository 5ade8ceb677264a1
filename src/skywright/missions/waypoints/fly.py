"""A flight through waypoints, with the arms folded."""

from skywright.missions.waypoints.task import Waypoints
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor


def fly(s: Supervisor[Waypoints], way: None) -> Flight:
    for i, (name, table) in enumerate(s.segments.items()):
        hold = s.task.points[i].hold_s if i < len(s.task.points) else 0.0
        # the rows of the plan include the hold, for clients that fly only the rows
        s.follow(name, table[table["t"] <= table["t"][-1] - hold + 1e-6])
        if i < len(s.task.points):
            for column, value in s.task.points[i].actuators.items():
                s.vehicle.actuators[column] = value
        if hold > 0.0:
            s.begin(f"hold {i + 1}")
            s.hold(hold)
    return Flight(True, "")
