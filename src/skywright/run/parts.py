"""Builds the components that a description selects: law, estimator, sensors and effects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from skywright.core.find import blame, find, list_kinds
from skywright.core.streams import build_stream
from skywright.description.loader import Description
from skywright.description.parts import Part, build_part, list_parts
from skywright.description.robot.limbs import list_servos, takes_torque
from skywright.description.robot.spec import Robot
from skywright.description.world.thing import Placed
from skywright.description.world.things import find_marker
from skywright.errors import InputError
from skywright.models.nominal import Nominal
from skywright.run.faults._rule import RESPONSES, Rule
from skywright.vehicle.component import Component, Estimator, Fault, Law


def choose_law(nominal: Nominal) -> str:
    """Return the default law of a run whose mission and robot select none."""
    return "push_and_slide" if nominal.allocator.full else "thrust_vectoring"


def get_law(description: Description[Any], nominal: Nominal) -> Part:
    """Return the law of a run: the mission's, the robot's, or the default for its rotors."""
    return description.law or Part(kind=choose_law(nominal))


def build_law(description: Description[Any], nominal: Nominal) -> Law:
    """Build the law; raises InputError if the robot lacks what it requires."""
    part = get_law(description, nominal)
    law: Law = build_part("law", part, "law")
    if law.needs_full_actuation and not nominal.allocator.full:
        fit = _list_laws(lambda cls: not cls.needs_full_actuation)
        raise InputError(
            f"control law {part.kind!r} requires a fully actuated platform; the rotors of "
            f"{nominal.robot.name!r} produce no lateral force; valid: {fit}"
        )
    _check_servos(part.kind, law, nominal.robot)
    law.check_robot(nominal.robot)
    return law


def _list_laws(fits: Callable[[type[Law]], bool]) -> str:
    """Return the names of the laws whose class fits."""
    return ", ".join(name for name in list_kinds("law") if fits(find("law", name).cls))


def _check_servos(kind: str, law: Law, robot: Robot) -> None:
    """Raise InputError if the law commands a quantity that the servos do not accept."""
    if not list_servos(robot) or law.commands_torque == takes_torque(robot):
        return
    told = "torques" if law.commands_torque else "speeds"
    fit = _list_laws(lambda cls: cls.commands_torque != law.commands_torque)
    raise InputError(
        f"control law {kind!r} commands {told} of the arm, but its servos have another "
        f"mode (robot.arm.{list_servos(robot)[0][0]}.mode of {robot.name!r}); laws that "
        f"command {('speeds' if law.commands_torque else 'torques')}: {fit}"
    )


def build_estimator(description: Description[Any]) -> Estimator:
    """Build the estimator; raises InputError if it does not support the localisation."""
    d, part = description, description.mission.estimator
    estimator: Estimator = build_part("estimator", part, "estimator")
    if not d.world.tracks_markers and estimator.needs_motion_capture:
        raise InputError(
            f"world.localisation = {d.world.localisation!r} measures position and heading only: "
            f"mission.estimator = {part.kind!r} requires motion capture; use 'filter'"
        )
    check_localisation(d)
    return estimator


def check_localisation(description: Description[Any]) -> None:
    """Raise InputError if a robot cannot use the world's localisation."""
    robot, world = description.robot, description.world
    localised = world.localisation
    if world.tracks_markers:
        return
    says = f"world.localisation = {localised!r} measures position and heading only: "
    if find_marker(world.things) and robot.camera is None:
        raise InputError(f"{says}world.marker requires motion capture or robot.camera")
    if world.pipe is not None and world.pipe.tracked:
        raise InputError(f"{says}world.pipe.tracked requires motion capture")
    for name, thing in world.things.items():
        if isinstance(thing, Placed) and thing.tracked and not thing.is_marker:
            raise InputError(f"{says}world.things.{name}.tracked requires motion capture")
    if robot.probe is not None and (localised == "gnss" or robot.force_sensor is None):
        raise InputError(
            f"{says}the probe of {robot.name!r} requires motion capture of its markers"
        )
    if localised == "gnss":
        return
    missing = [
        f"[robot.{part}]" for part in ("prism", "tracking_camera") if getattr(robot, part) is None
    ]
    if missing:
        raise InputError(
            f"world.localisation = {localised!r}: robot {robot.name!r} has no "
            f"{' and no '.join(missing)}; add it, or set world.localisation='mocap'"
        )


def build_named(description: Description[Any]) -> list[Component]:
    """Build the sensors, actuators, effects and faults that robot, world and plant define."""
    robot, world = description.robot, description.world
    tables = {"sensor": robot.sensors, "actuator": robot.actuators, "effect": world.effects}
    faults: list[Fault] = [
        build_part("fault", part, name)
        for name, part in list_parts(description.plant.faults).items()
    ]
    rng = build_stream(description.mission.seed, "faults")  # shared by all random faults, in order
    return [
        *(
            build_part(group, part, name)
            for group, table in tables.items()
            for name, part in list_parts(table).items()
        ),
        *(fault.resolve(robot, world, rng) for fault in faults),
    ]


def build_rules(description: Description[Any]) -> list[Rule]:
    """Build the rules for faults; raises InputError for an invalid rule of a user."""
    tables, out = list_parts(description.mission.faults), []
    for name, part in tables.items():
        key, cls = f"mission.faults.{name}", find("rule", part.kind).cls
        if cls.look is Rule.look:
            raise InputError(f"{key}.kind: {cls.__name__} has no method look(self, v)")
        if not isinstance(cls.every, int) or cls.every < 1:
            raise InputError(
                f"{key}.kind: {cls.__name__}.every is {cls.every!r}; valid: whole numbers from 1"
            )
        with blame(cls, key):
            rule: Rule = build_part("rule", part, name)
        if rule.table.response not in RESPONSES:  # a default of the class
            raise InputError(
                f"{key}.response is {rule.table.response!r}; valid: {', '.join(RESPONSES)}"
            )
        out.append(rule)
    return out


def build_default_rules() -> list[Rule]:
    """Build the built-in rules with their own limits."""
    return [find("rule", kind).cls(kind) for kind in list_kinds("rule")]


def uses_truth(description: Description[Any]) -> bool:
    """Whether the robot receives the simulator's truth as its estimate."""
    return bool(find("estimator", description.mission.estimator.kind).cls.is_truth)
