"""Rotor signals of a ULog: measured speeds, or thrusts from commands.

Four topics are read, the most direct first. A topic with a low rate is replaced by a faster one.

| topic | content |
|---|---|
| `esc_status` | measured speeds |
| `actuator_motors` | one command per rotor (PX4 1.13 and later) |
| `actuator_outputs` | pulse widths, between `PWM_MIN` and `PWM_MAX` |
| `actuator_controls_0` | roll, pitch, yaw and thrust, before PX4's mixer |
"""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.rotors import RotorSet, build_rotors

TURNING = 100.0  # rpm, and
PULSING = 0.02  # share of the command: minimum peak of a turning rotor
SLOW = 20.0  # Hz: twice the fit's band of 5 Hz, with a margin
TOPICS = ("esc_status", "actuator_motors", "actuator_outputs", "actuator_controls_0")


class _Signal(NamedTuple):
    name: str
    rate: float  # Hz
    values: Array  # (n, rotors) rad/s, or commands of 0 to 1
    measured: bool
    data: Any  # of the topic
    fields: list[str]  # of the data


def read_rotors(
    path: Path, topics: Iterable[Any], parameters: dict[str, float], robot: Robot,
    order: list[int], at: Any, notes: list[str],
) -> tuple[Array | None, Array | None]:  # fmt: skip
    """Return measured speeds (n, rotors) rad/s, or commanded thrusts (N) without measurements.

    `order` holds each rotor's index in the log. The gaps of the topic that is taken are left out of
    the time axis `at`. Raises InputError if no topic has the signals.
    """
    rotors = build_rotors(robot.rotors)
    found: list[_Signal] = []
    silent: list[str] = []
    for topic in topics:
        data = topic.data
        if topic.name not in TOPICS or len(data["timestamp"]) < 2:
            continue
        fields = _list_fields(topic.name, order)
        values = _read(topic.name, data, fields, parameters, rotors, at)
        if values is None:
            silent.append(f"{topic.name} lacks some of the {len(order)} rotors")
        elif np.max(values, initial=0.0) <= (TURNING / 9.5493 if _is_speed(topic) else PULSING):
            silent.append(f"in {topic.name} no rotor turns")
        else:
            span = float(data["timestamp"][-1] - data["timestamp"][0]) * 1e-6
            rate = (len(data["timestamp"]) - 1) / max(span, 1e-9)
            found.append(_Signal(topic.name, rate, values, _is_speed(topic), data, fields))
    if not found:
        why = "; ".join(silent) or "the log contains none of them"
        raise InputError(
            f"{path}: one of {', '.join(TOPICS)} is needed, of a flight in which the rotors turn: "
            f"{why}"
        )
    # among instances of one topic, the most variable one belongs to the motors
    found.sort(key=lambda s: (TOPICS.index(s.name), -float(np.ptp(s.values))))
    best = found[0]
    for other in found[1:]:
        if best.rate < SLOW and other.rate > 2.0 * best.rate:
            notes.append(f"{best.name} comes at {best.rate:.0f} Hz only: {other.name} is taken")
            best = other
    for field in best.fields:
        at.leave_out(best.data, field)
    if best.measured:
        return best.values, None
    notes += [f"{s}: not taken" for s in silent if s.startswith(("esc", "in esc"))]
    u = np.clip(best.values, 0.0, 1.0)
    f = float(parameters.get("THR_MDL_FAC", 0.0))
    notes.append(
        f"no rotor speeds in the log: thrust from {best.name} ({best.rate:.0f} Hz), by PX4's "
        f"thrust model with THR_MDL_FAC {f:g} and the robot file's largest thrust"
    )
    return None, rotors.thrust_max * (f * u**2 + (1.0 - f) * u)


def _is_speed(topic: Any) -> bool:
    return bool(topic.name == "esc_status")


def _list_fields(name: str, order: list[int]) -> list[str]:
    """Return the fields of a topic that hold the rotors' signals, or the mixer's inputs."""
    if name == "actuator_controls_0":
        return [f"control[{i}]" for i in range(4)]
    field = {"esc_status": "esc[{}].esc_rpm", "actuator_motors": "control[{}]"}
    return [field.get(name, "output[{}]").format(i) for i in order]


def _read(
    name: str, data: dict[str, Any], fields: list[str], parameters: dict[str, float],
    rotors: RotorSet, at: Any,
) -> Array | None:  # fmt: skip
    """Return speeds (rad/s) or commands (0 to 1) of the rotors; None if some are missing."""
    if any(field not in data for field in fields):
        return None
    x = np.column_stack([at(data, field) for field in fields])
    if not np.all(np.isfinite(x)):
        return None
    if name == "esc_status":
        return np.asarray(np.abs(x) * (2.0 * math.pi / 60.0))
    if name == "actuator_outputs" and np.max(x, initial=0.0) > 2.0:  # microseconds
        low = parameters.get("PWM_MAIN_MIN", parameters.get("PWM_MIN", 1000.0))
        high = parameters.get("PWM_MAIN_MAX", parameters.get("PWM_MAX", 2000.0))
        return np.asarray((x - low) / max(high - low, 1.0))
    if name == "actuator_controls_0":  # roll and pitch are also computed on the ground
        return x @ build_mixer(rotors).T * (x[:, 3:] > PULSING)
    return x


def build_mixer(rotors: RotorSet) -> Array:
    """Return PX4's mixer before 1.13, (rotors, 4): outputs of roll, pitch, yaw (FRD) and thrust.

    It is the pseudo-inverse of torques and total thrust of upright rotors, scaled as in PX4's
    `px_generate_mixers.py`: roll and pitch by their norm, yaw by its maximum, thrust to 1.
    """
    x, y, one = rotors.position[:, 0], rotors.position[:, 1], np.ones(len(rotors.spin))
    effect = np.vstack([y, x, 0.05 * rotors.spin, one])
    mix = np.linalg.pinv(effect)
    norm = np.linalg.norm(mix, axis=0)
    level = max(norm[0], norm[1]) / math.sqrt(len(mix) / 2.0)
    scale = np.array([level, level, np.max(np.abs(mix[:, 2])), mix[:, 3].mean()])
    return np.asarray(mix / np.where(np.abs(scale) < 1e-9, 1.0, scale))
