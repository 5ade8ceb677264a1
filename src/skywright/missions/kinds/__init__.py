"""Kinds of missions: one module each.

A kind's module has
- `NEEDS`: what it commands of the vehicle (vehicle.interface), a frozenset of names;
- `plan(description) -> MissionPlan`;
- `fly(supervisor) -> Flight`: its phases between take-off and landing;
A kind that does not fly (a test bench) sets `FLIES = False`; its `fly` is then all of it. One whose
flight ends in the air sets `LANDS = False`. The table
`mission.task` of a kind is told by a subclass of `Mission` (missions/spec.py: TASKS).
"""
