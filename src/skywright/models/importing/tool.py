"""The end of an imported arm: the link that carries the frame of the tip, and a gripper."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.arm import Hand
from skywright.errors import InputError
from skywright.models.importing.chain import Part
from skywright.models.importing.fingers import Gripper
from skywright.models.importing.values import PLACEHOLDER, Question, Value, imported
from skywright.models.part_masses import build_hand_body
from skywright.models.urdf import roll_pitch_yaw

TOOL_MASS = 1e-6
"""kg of an added link with the frame of the tip, if the last link cannot carry it; subtracted from
that link."""
TOOL_INERTIA = 1e-9
LINK_RADIUS = 0.02
FINGER, FINGER_RADIUS = 0.04, 0.01
"""m, of a gripper's fingers if the file does not show their shape."""


def take(part: Part, mass: float, com: Array, inertia: Array) -> Part:
    """Return the part without a body; the sum of both is unchanged."""
    left = part.mass - mass
    com_left = (part.mass * part.com - mass * com) / left
    rest = part.inertia - inertia
    for m, c in ((left, com_left), (mass, com)):
        d = c - part.com
        rest = rest - m * (d @ d * np.eye(3) - np.outer(d, d))
    return part._replace(mass=left, com=com_left, inertia=rest)


def turn_tool(way: Array, gripper: Gripper | None) -> Array:
    """Return the axes (3, 3) of a link along `way` (3,); y is the direction of a gripper's fingers.

    Rotating fingers turn about the link's z, and x points out of the hand.
    """
    way = way if gripper is None or gripper.turn is None else gripper.turn.way
    x = way / np.linalg.norm(way)
    y = np.eye(3)[int(np.argmin(np.abs(x)))] if gripper is None else gripper.axis
    y = np.cross(x, np.cross(y, x)) if gripper is not None else np.cross(y, x)
    y = y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def build_tool(parent: str, turn: Array, place: Array, length: float) -> dict[str, Value]:
    """Return the table of a link without a joint of its own.

    `turn` (3, 3) and `place` (3,) m are its pose in the parent.
    """
    note = "frame of the tip; its mass is taken off the link before"
    table = {"joint": Value("fixed"), "parent": Value(parent)}
    for axis, x in zip("xyz", place, strict=True):
        table[f"{axis}_m"] = Value(float(x), "derived", note)
    angles = roll_pitch_yaw(turn)
    for key, angle in zip(("roll_deg", "pitch_deg", "yaw_deg"), angles, strict=True):
        table[key] = Value(float(np.degrees(angle)), "derived", note)
    table["length_m"] = Value(length, "derived", "to the tip, or to the fingers")
    table["radius_m"] = Value(LINK_RADIUS, "assumed", "as the links before", (0.005, 0.1))
    table["mass_kg"] = Value(TOOL_MASS, "derived", note)
    table["com_x_m"] = Value(length, "derived", note)
    for a in "xyz":
        table[f"inertia_{a}{a}_kgm2"] = Value(TOOL_INERTIA, "derived", note)
    return {f"robot.arm.tool_link.{key}": value for key, value in table.items()}


def build_gripper(
    gripper: Gripper, part: Part, R: Array, end: Array,
    limits: Mapping[str, tuple[float | None, float | None]], questions: list[Question],
) -> tuple[dict[str, Value], Array, Part]:  # fmt: skip
    """Return the hand's table, the base of its fingers (3,) m, and the last part without them.

    `R` are the axes of the tool's link, `end` (3,) m is the tip. The fingers' mass is subtracted
    from the part as far as the part keeps a positive mass.
    """
    note = f"joints {' and '.join(gripper.joints)}"
    seen = float((end - gripper.middle) @ R[:, 0])
    if gripper.turn is None:
        length = min(seen if seen > 0.005 else FINGER, 0.6 * float(np.linalg.norm(end - part.p)))
    else:
        length = seen if seen > 0.005 else gripper.turn.length
    length = round(length, 4)
    lever = 1.0 if gripper.turn is None else length
    shape = _shape_fingers(gripper, length, note)
    R_LH = R @ np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    for share in (1.0, 0.3, 0.1, 0.03, 0.01):
        hand = Hand(
            kind="gripper", length_m=length, mass_kg=share * gripper.mass,
            **{key: value.value for key, value in shape.items()},
        )  # fmt: skip
        com, inertia = build_hand_body(hand)
        rest = take(part, hand.mass_kg, end + R_LH @ com, R_LH @ inertia @ R_LH.T)
        if np.linalg.eigvalsh(0.5 * np.trace(rest.inertia) * np.eye(3) - rest.inertia)[0] > 0.0:
            break
    else:
        raise InputError(
            f"{note}: without the fingers ({gripper.mass:g} kg), the link that carries them has no "
            f"valid inertia; freeze them with --weld {gripper.joints[0]}"
        )
    mass = imported(hand.mass_kg, note)
    if share < 1.0:
        mass = Value(hand.mass_kg, "derived", f"{share:g} of the fingers' mass; the palm is light")
    out = {"kind": Value("gripper"), **shape, "mass_kg": mass}
    out["length_m"] = Value(length, "assumed", "from the fingers' joints to the tip", (0.01, 0.2))
    out["friction"] = Value(0.5, "assumed", "rubber pads on a dry object", (0.2, 1.0))
    both = [limits.get(name, (None, None)) for name in gripper.joints]
    force, speed = (
        min((value for value in values if value is not None), default=None)
        for values in zip(*both, strict=True)
    )
    for key, value, factor, text, guess, usual in (
        ("grip_force_n", force, 1.0 / lever, "force of each finger of the gripper, N", 20.0,
         PLACEHOLDER),
        ("grip_speed_mps", speed, 2.0 * lever, "speed at which the gripper's opening changes "
         "without load, m/s", 0.1, 1.0 if gripper.turn is None else 50.0),
    ):  # fmt: skip
        if value is not None and 0.0 < value < usual:
            origin = "imported" if gripper.turn is None else "derived"
            by = "" if gripper.turn is None else f" at {length:g} m"
            out[key] = Value(factor * value, origin, f"limit of {note}{by}")
        else:
            span = (guess / 5.0, guess * 5.0)
            questions.append(Question(f"robot.arm.hand.{key}", text, guess, span))
    fingers_at = end - length * R[:, 0]
    return {f"robot.arm.hand.{key}": value for key, value in out.items()}, fingers_at, rest


def _shape_fingers(gripper: Gripper, length: float, note: str) -> dict[str, Value]:
    """Return the motion and the width of the fingers; raises InputError for invalid ones."""
    turn = gripper.turn
    if turn is None:
        radius = Value(FINGER_RADIUS, "assumed", "half the width of a finger", (0.003, 0.05))
        return {"stroke_m": imported(gripper.stroke, f"ranges of {note}"), "radius_m": radius}
    room = turn.pivot + length * float(np.sin(turn.open))
    radius = Value(
        round(min(FINGER_RADIUS, turn.pivot, 0.5 * room), 5), "assumed", "of the pads",
        (0.001, 0.05),
    )  # fmt: skip
    if radius.value < 1e-3:
        raise InputError(
            f"{note}: the pads of the fingers do not open at {length:g} m, the tip; freeze them "
            f"with --weld {gripper.joints[0]}"
        )
    way = f"limits of {note}, and the way to the centres of mass"
    return {
        "finger": Value("turn"),
        "pivot_m": imported(turn.pivot, f"places of {note}"),
        "open_deg": Value(float(np.degrees(turn.open)), "derived", way),
        "closed_deg": Value(float(np.degrees(turn.closed)), "derived", way),
        "radius_m": radius,
    }
