"""States and commands of a vehicle, and one table of the states in which each is accepted.

States and commands are those of UAL (Real, Torres-Gonzalez, Ramon-Soria, Capitan and Ollero 2018;
Suarez 2020, section III-A), plus `arm`, `disarm`, `hold`, `go_home` and the pilot's switch.
`vehicle.uav.Uav`, the documentation (docs/generate_commands.py) and the tests use `TABLE`. Gateways
and ground stations import the names from here.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class State(StrEnum):
    """State of a vehicle between the ground and free flight."""

    UNINITIALIZED = "uninitialized"  # no estimate yet
    LANDED_DISARMED = "landed_disarmed"  # motors off
    LANDED_ARMED = "landed_armed"  # motors turn, the robot stands on the ground
    TAKING_OFF = "taking_off"
    FLYING_AUTO = "flying_auto"  # commands are followed
    FLYING_MANUAL = "flying_manual"  # the pilot's stick is followed
    LANDING = "landing"


class Command(StrEnum):
    """The commands of a vehicle."""

    ARM = "arm"
    DISARM = "disarm"
    TAKE_OFF = "take_off"
    LIFT_OFF = "lift_off"
    GO_TO = "go_to"
    GO_TO_GEO = "go_to_geo"
    GO_HOME = "go_home"
    SET_POSE = "set_pose"
    SET_VELOCITY = "set_velocity"
    SET_ATTITUDE = "set_attitude"
    SET_JOINTS = "set_joints"
    HOLD = "hold"
    LAND = "land"
    SET_HOME = "set_home"
    TAKE_OVER = "take_over"
    STICK = "stick"
    RECOVER_FROM_MANUAL = "recover_from_manual"
    STOP_MOTORS = "stop_motors"


class ControlMode(StrEnum):
    """Source of the present references."""

    OFF = "off"  # motors off
    MOTION = "motion"  # a motion with an end: take-off, go_to, land
    HOLD = "hold"
    POSE = "pose"  # a stream of poses
    VELOCITY = "velocity"  # a stream of velocities
    ATTITUDE = "attitude"  # the pilot's stick, or a stream of attitudes and forces
    EXTERNAL = "external"  # tables of a mission or a plan


class Need(StrEnum):
    """Conditions of a command other than the state."""

    CHECKLIST = "checklist"  # the pre-flight checks pass
    STARTED = "started"  # no `arm` or `take_off` is under way before its motors may lift the robot
    FENCE = "fence"  # the goal lies within the geofence
    ORIGIN = "origin"  # the world has a geodetic origin
    HOME = "home"  # a home is set
    ESTIMATE = "estimate"  # the estimator has a position, from a fresh fix
    HOLDABLE = "holdable"  # attitude and speed allow the position loops to take over
    FREE_LINK = "free_link"  # no link of the robot lies on the ground
    CONFIRMED = "confirmed"  # `confirm = True` is given
    ARMS = "arms"
    HANDS = "hands"
    FORCE_SENSING = "force_sensing"
    GRASPING = "grasping"
    MARKER = "marker"
    TOUCH = "touch"


NEEDS: dict[Need, str] = {
    Need.CHECKLIST: "every check of the pre-flight checklist passes",
    Need.STARTED: "no `arm` or `take_off` is still folding the arms or checking the motors",
    Need.FENCE: "the goal lies within the geofence",
    Need.ORIGIN: "the world has `[world.origin]`",
    Need.HOME: "a home is set (the place of the first take-off, or `set_home`)",
    Need.ESTIMATE: "the estimator has a position, and its last fix is fresh",
    Need.HOLDABLE: "tilt and speed are within the limits of the position loops",
    Need.FREE_LINK: "a link that swings below the platform hangs free of the ground",
    Need.CONFIRMED: "`confirm=True` is given",
    Need.ARMS: "the back end offers arms",
    Need.HANDS: "the back end offers hands: compliant arms with the joints pitch, roll, yaw, elbow",
    Need.FORCE_SENSING: "joints of the arms measure their deflection",
    Need.GRASPING: "the arms end in grippers, or the hands measure their force",
    Need.MARKER: "the robot sees a marker, by its camera or by motion capture",
    Need.TOUCH: "the hand measures at least 0.3 N",
}
"""Meaning of each condition, for messages and the documentation."""


class Entry(NamedTuple):
    """When a command is accepted, and its effect on the state."""

    states: tuple[State, ...]  # states in which it is accepted
    during: State | None  # state during execution; None: unchanged
    after: State | None  # state after success; None: unchanged
    interrupts: bool  # whether it ends the present motion
    needs: tuple[Need, ...] = ()
    says: str = ""


S, C = State, Command
LANDED = (S.LANDED_DISARMED, S.LANDED_ARMED)
AUTO = (S.FLYING_AUTO,)
IN_AIR = (S.TAKING_OFF, S.FLYING_AUTO, S.FLYING_MANUAL, S.LANDING)

TABLE: dict[Command, Entry] = {
    C.ARM: Entry(
        (S.LANDED_DISARMED,), S.LANDED_DISARMED, S.LANDED_ARMED, False,
        (Need.ESTIMATE, Need.STARTED, Need.CHECKLIST),
        "start the motors; the robot stays on the ground",
    ),
    C.DISARM: Entry(
        (S.LANDED_ARMED, S.LANDED_DISARMED), None, S.LANDED_DISARMED, True, (), "motors off",
    ),
    C.TAKE_OFF: Entry(
        LANDED, S.TAKING_OFF, S.FLYING_AUTO, True,
        (Need.ESTIMATE, Need.CHECKLIST, Need.FENCE),
        "climb to a height; a disarmed vehicle is armed first",
    ),
    C.LIFT_OFF: Entry(
        (S.LANDED_ARMED,), None, S.FLYING_AUTO, False, (Need.ESTIMATE, Need.FREE_LINK),
        "let streams of references lift the robot off the ground",
    ),
    C.GO_TO: Entry(
        AUTO, S.FLYING_AUTO, S.FLYING_AUTO, True, (Need.FENCE,),
        "fly straight to a position and a heading",
    ),
    C.GO_TO_GEO: Entry(
        AUTO, S.FLYING_AUTO, S.FLYING_AUTO, True, (Need.ORIGIN, Need.FENCE),
        "the same by latitude, longitude and altitude",
    ),
    C.GO_HOME: Entry(
        AUTO, S.FLYING_AUTO, S.FLYING_AUTO, True, (Need.HOME, Need.FENCE),
        "fly above the home position at the present height",
    ),
    C.SET_POSE: Entry(
        AUTO, None, None, True, (Need.FENCE,),
        "follow a stream of poses; if the stream stops, hold the last pose",
    ),
    C.SET_VELOCITY: Entry(
        AUTO, None, None, True, (), "follow a stream of velocities; if the stream stops, hold",
    ),
    C.SET_ATTITUDE: Entry(
        AUTO, None, None, True, (),
        "follow a stream of attitudes and body forces; if the stream stops, level and brake",
    ),
    C.SET_JOINTS: Entry(
        AUTO, None, None, True, (),
        "follow a stream of joint angles, also beside another stream; if it stops, hold",
    ),
    C.HOLD: Entry(
        (S.TAKING_OFF, S.FLYING_AUTO, S.LANDING), S.FLYING_AUTO, S.FLYING_AUTO, True,
        (Need.FREE_LINK, Need.STARTED), "brake and hold the position",
    ),
    C.LAND: Entry(
        (S.TAKING_OFF, S.FLYING_AUTO), S.LANDING, S.LANDED_DISARMED, True, (Need.STARTED,),
        "descend to the ground and stop the motors",
    ),
    C.SET_HOME: Entry(
        (*LANDED, S.TAKING_OFF, S.FLYING_AUTO, S.FLYING_MANUAL, S.LANDING), None, None, False,
        (Need.ESTIMATE,), "make the present position the home position",
    ),
    C.TAKE_OVER: Entry(
        (S.LANDED_ARMED, *IN_AIR), None, S.FLYING_MANUAL, True, (),
        "give control to the pilot's stick",
    ),
    C.STICK: Entry(
        (S.FLYING_MANUAL,), None, None, False, (),
        "input of the pilot's stick; if it stops, level and hold the height",
    ),
    C.RECOVER_FROM_MANUAL: Entry(
        (S.FLYING_MANUAL,), S.FLYING_AUTO, S.FLYING_AUTO, True,
        (Need.ESTIMATE, Need.HOLDABLE, Need.FREE_LINK),
        "take control from the pilot: brake and hold the position",
    ),
    C.STOP_MOTORS: Entry(
        tuple(S), None, S.LANDED_DISARMED, True, (Need.CONFIRMED,),
        "stop the motors at once, also in the air: the robot falls",
    ),
}  # fmt: skip
"""Every command: the states that accept it, its effect on the state, whether it interrupts."""


def explain_refusal(command: str, entry: Entry, state: State) -> str:
    """Return why a command is not accepted in a state, "" if it is."""
    states = entry.states
    if state in states:
        return ""
    return f"{command} refused: the state is {state}; accepted in {', '.join(states)}"
