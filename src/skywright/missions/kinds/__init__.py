"""Kinds of missions: one module each.

A kind's module has
- `NEEDS`: what it commands of the vehicle (vehicle.interface), a frozenset of names;
- `plan(description) -> MissionPlan`;
- `fly(supervisor) -> Flight`: its phases between take-off and landing;
A kind that does not fly (a test bench) sets `FLIES = False`; its `fly` is then all of it. One whose
flight ends in the air sets `LANDS = False`; one that begins there sets `HELD = True`: the robot is
held at the hover point, as by a crane, and let go when its motors start. The table
`mission.task` of a kind is told by a subclass of `Mission` (missions/spec.py: TASKS).
"""
