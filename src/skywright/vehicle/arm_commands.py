"""The vocabulary of a vehicle's arms: commands, and one table of what they need.

`ARM_TABLE` is read by `vehicle.commanded_arms.CommandedArms`, by the documentation
(docs/generate_commands.py) and by the tests. The tasks and equation numbers are those of Suarez
2020, section IV.
"""

from __future__ import annotations

from enum import StrEnum

from skywright.vehicle.commands import TABLE, Command, Entry, Need, State


class ArmCommand(StrEnum):
    """The commands of the arms."""

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
    A.REST_POSE: _entry("move the joints to the folded posture (take-off, landing)", N.ARMS),
    A.OPERATION_POSE: _entry("move the joints to the working posture", N.ARMS),
    A.MOVE_TO: _entry("move the joints to angles, in a given time or at full speed", N.ARMS),
    A.HANDS_TO: _entry("move the hands on straight lines to points in W: (23)", *_HANDS),
    A.HANDS_TO_MARKER: _entry(
        "move the hands to points in the frame of a visible marker: (23)", N.HANDS, N.MARKER
    ),
    A.PUSH: _entry(
        "exert forces until the next command: (25) to (28), with a position (31)", *_FORCE
    ),
    A.GRASP: _entry(
        "close grippers; without them press the hands together until the next command: (31), (32)",
        N.GRASPING,
    ),
    A.RELEASE: _entry("open grippers; without them part the hands", N.GRASPING),
    A.BAR_TO: _entry("move a bar held by both hands: (29), (30)", *_HANDS),
    A.TORQUES: _entry("control the joints of an arm by torque: (22)", *_FORCE),
    A.TORQUE_OFF: _entry("control the joints of an arm to zero torque: the arm yields", *_FORCE),
    A.TORQUE_ON: _entry("hold the joints of an arm", *_HANDS),
    A.SENSE_POSITION: _entry(
        "use a hand that rests on a surface as a position sensor of the platform",
        N.HANDS, N.TOUCH, interrupts=False,
    ),
    A.TARE: _entry("set the zero of the contact forces to their mean over a time", *_HANDS),
    A.SET_HANDS: _entry("follow a stream of points in W; if it stops, hold the hands", *_HANDS),
    A.HANDS_VELOCITY: _entry(
        "follow a stream of velocities in W: (24); if it stops, hold the hands", *_HANDS
    ),
    A.SET_FORCES: _entry(
        "follow a stream of forces in W: (25) to (28); if it stops, reduce them to zero", *_FORCE
    ),
}  # fmt: skip
"""Every command of the arms: where it is accepted, whether it interrupts, what it needs."""

ARM_STREAMS = (A.SET_HANDS, A.HANDS_VELOCITY, A.SET_FORCES)


def get_entry(command: Command | ArmCommand) -> Entry:
    """Return the entry of a command of the platform or of the arms."""
    return TABLE[command] if isinstance(command, Command) else ARM_TABLE[command]
