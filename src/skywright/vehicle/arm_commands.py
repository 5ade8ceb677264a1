"""The vocabulary of a vehicle's arms: commands, and one table of what they need.

`ARM_TABLE` is read by `vehicle.commanded_arms.CommandedArms`, by the documentation
(docs/generate_commands.py) and by the tests. The tasks and equation numbers are those of Suarez
2020, section IV.
"""

from __future__ import annotations

from enum import StrEnum

from skywright.vehicle.commands import TABLE, Command, Entry, Need, State


class ArmCommand(StrEnum):
    """What may be asked of the arms."""

    REST_POSE = "rest_pose"
    OPERATION_POSE = "operation_pose"
    MOVE_TO = "move_to"
    HANDS_TO = "hands_to"
    HANDS_TO_MARKER = "hands_to_marker"
    PUSH = "push"
    GRASP = "grasp"
    RELEASE = "release"
    BAR_TO = "bar_to"
    TORQUES = "torques"
    TORQUE_OFF = "torque_off"
    TORQUE_ON = "torque_on"
    SENSE_POSITION = "sense_position"
    TARE = "tare"
    SET_HANDS = "set_hands"
    HANDS_VELOCITY = "hands_velocity"
    SET_FORCES = "set_forces"


A, N = ArmCommand, Need
_AUTO = (State.FLYING_AUTO,)


def _entry(says: str, *needs: Need, interrupts: bool = True) -> Entry:
    return Entry(_AUTO, None, None, interrupts, needs, says)


_HANDS, _FORCE = (N.HANDS,), (N.HANDS, N.FORCE_SENSING)
ARM_TABLE: dict[ArmCommand, Entry] = {
    A.REST_POSE: _entry("joints to the folded posture, as for take-off and landing", N.ARMS),
    A.OPERATION_POSE: _entry("joints to the working posture", N.ARMS),
    A.MOVE_TO: _entry("joints to angles, in a play time or as fast as they may", N.ARMS),
    A.HANDS_TO: _entry("hands on straight lines to points in W: (23)", *_HANDS),
    A.HANDS_TO_MARKER: _entry(
        "hands to places in the frame of a marker that is seen: (23)", N.HANDS, N.MARKER
    ),
    A.PUSH: _entry("hands exert forces, and go on: (25) to (28), with a place (31)", *_FORCE),
    A.GRASP: _entry("both hands press towards each other, and go on: (31), (32)", *_FORCE),
    A.RELEASE: _entry("loosen a grasp, then part the hands", *_FORCE),
    A.BAR_TO: _entry("lead a bar held by both hands: (29), (30)", *_HANDS),
    A.TORQUES: _entry("joints of an arm by torque: (22)", *_FORCE),
    A.TORQUE_OFF: _entry("joints of an arm by zero torque: it gives way", *_FORCE),
    A.TORQUE_ON: _entry("joints of an arm stay where they are", *_HANDS),
    A.SENSE_POSITION: _entry(
        "take a hand that rests on something as a sensor of the platform's place",
        N.HANDS, N.TOUCH, interrupts=False,
    ),
    A.TARE: _entry("call the contact forces that are estimated over a time zero", *_HANDS),
    A.SET_HANDS: _entry("follow a stream of points in W; without news the hands stay", *_HANDS),
    A.HANDS_VELOCITY: _entry(
        "follow a stream of velocities in W: (24); without news the hands stay", *_HANDS
    ),
    A.SET_FORCES: _entry(
        "follow a stream of forces in W: (25) to (28); without news they fall to zero", *_FORCE
    ),
}  # fmt: skip
"""Every command of the arms: where it is accepted, whether it interrupts, what it needs."""

ARM_STREAMS = (A.SET_HANDS, A.HANDS_VELOCITY, A.SET_FORCES)


def get_entry(command: Command | ArmCommand) -> Entry:
    """Return the entry of a command of the platform or of the arms."""
    return TABLE[command] if isinstance(command, Command) else ARM_TABLE[command]
