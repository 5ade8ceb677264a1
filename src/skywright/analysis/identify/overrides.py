"""Robot file of an identification: the identified values on top of the base robot."""

import os
from pathlib import Path

import numpy as np

from skywright.analysis.identify.fit import unpack_inertia
from skywright.analysis.identify.identify import Identification
from skywright.description.dump import dump_robot, write_literal
from skywright.description.robot.inertia import check_inertia
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.loader import find_robot, load_robot
from skywright.errors import InputError
from skywright.models.part_masses import platform_inertia
from skywright.models.rigid_body import build_body_model, compute_body

WRITTEN = (
    "# This file contains the identified values only; all other values are those of the base robot."
)
"""Line by which `check_replaceable` recognises a robot file that `build_overrides` returned."""
WHOLE = "# The robot of the flights, which an identified robot extends: no file of it is known."
"""The same for the file that `choose_base` returns."""


def check_replaceable(file: Path, base: list[Path]) -> None:
    """Raise InputError if a robot file cannot be replaced by identified values.

    It must be absent or from an earlier identification, and none of `base`, the files of the robot
    that the new file extends; names of built-in robots in `base` are ignored.
    """
    if not file.exists():
        return
    if any(path.exists() and file.samefile(path) for path in base):
        raise InputError(
            f"{file}: is a file of the robot that --robot names and would be replaced; give "
            "another --out"
        )
    with file.open("rb") as stream:
        head = stream.read(10_000)
    if not {WRITTEN.encode(), WHOLE.encode()} & {*head.splitlines()}:
        raise InputError(
            f"{file}: already exists and is not from an earlier identification; give another "
            "--out or remove it"
        )


def choose_base(found: Identification, robot: str | None, file: Path) -> tuple[str, str]:
    """Return what the identified robot `file` extends, and the text of that base file.

    The base is a built-in name, a path relative to `file`, or, if the flights' robot is neither
    built in nor given as `robot` (name or path), a new file beside `file`. The text is "" unless
    the base is a new file.
    """
    if robot is not None:
        given = find_robot(robot)
        if given.label == f"robot {robot}":
            return robot, ""
        return Path(os.path.relpath(given.path.resolve(), file.parent.resolve())).as_posix(), ""
    name = found.robot.name
    try:
        if load_robot(name)[0] == found.robot:
            return name, ""
    except InputError:  # not a built-in robot
        pass
    return f"{file.stem}-base.toml", f"{WHOLE}\n\n{dump_robot(found.robot)}"


def build_overrides(found: Identification, base: str) -> str:
    """Return a robot file (TOML) that extends `base` with the identified values.

    A file has one thrust coefficient for all rotors, so individual gains become comments.
    Deviations of the mass distribution in the poses are attributed to the platform.
    """
    robot, fit = found.robot, found.fit
    values = {e.parameter.name: e for e in fit.estimates}
    note = "identified from " + ", ".join(found.logs)
    lines = [
        f"# {robot.name}, {note}.",
        WRITTEN,
        "",
        "[robot]",
        f"name = {write_literal(f'{robot.name}-identified')}",
        f"extends = {write_literal(base)}",
    ]

    def number(key: str, value: float, half: float | None = None) -> str:
        width = "" if half is None else f", +- {half:.2g}"
        return f'{key} = {{ value = {value:.6g}, source = "derived", note = "{note}{width}" }}'

    platform, left_out = _platform(found)
    if platform:
        lines += ["", "[robot.platform]", *(number(k, v) for k, v in platform.items()), *left_out]
    rotors = []
    gains = [e for n, e in values.items() if n.startswith("rotor_gain_")]
    if all(e.identified for e in gains):
        mean = float(np.mean([e.value for e in gains]))
        half = float(np.sqrt(np.mean([e.half_width**2 for e in gains])))
        k_f = robot.rotors.thrust_coefficient_n_per_rad2s2
        each = ", ".join(f"{e.value:.3f}" for e in gains)
        rotors.append(f"# gains of the single rotors: {each}")
        rotors.append(number("thrust_coefficient_n_per_rad2s2", k_f * mean, k_f * half))
        if found.command_lag is not None:  # commands are shares of the full speed
            full = robot.rotors.thrust_max_n
            rotors.append(number("thrust_max_n", full * mean, full * half))
    height = values["drag_height_m"]
    upright = not any((*robot.rotors.alpha_deg, *robot.rotors.beta_deg))
    if height.identified and upright:  # the height of upright rotors affects only their drag
        rotors.append(number("height_m", height.value, height.half_width))
    for key in ("torque_per_thrust_m", "drag_coefficient_n_per_rads_mps"):
        if values[key].identified and values[key].value > 0.0:
            rotors.append(number(key, values[key].value, values[key].half_width))
    spun = values["rotor_inertia_kgm2"]
    if spun.identified:  # below zero within its interval: rotors without inertia, as of a simulator
        rotors.append(number("rotor_inertia_kgm2", max(spun.value, 0.0), spun.half_width))
    lag = found.rotor_lag
    if lag is not None and lag.identified and lag.lag > 0.0:
        rotors.append(number("time_constant_s", lag.lag, lag.half_lag))
    elif found.command_lag:
        rotors.append(number("time_constant_s", found.command_lag))
    if rotors:
        lines += ["", "[robot.rotors]", *rotors]
    lines += _servos(found, number)
    return "\n".join(lines) + "\n"


def _platform(found: Identification) -> tuple[dict[str, float], list[str]]:
    """Return the identified values of the platform, and comments on those that are not used."""
    robot, fit = found.robot, found.fit
    p = robot.platform
    model = build_body_model(robot)
    values = {e.parameter.name: e for e in fit.estimates}
    out: dict[str, float] = {}
    left_out = []
    nominal, _, _ = compute_body(model, found.poses[0])
    mass = p.mass_kg + fit.mass - nominal
    if found.mass_given:
        out["mass_kg"] = mass
    moved = np.zeros(3)
    com_known = np.ones(3, dtype=bool)
    inertia = np.zeros((3, 3))
    known = np.ones(6, dtype=bool)
    for n, q in enumerate(found.poses):
        mass_q, com, I_B = compute_body(model, q)
        first = [values[f"pose_{n + 1}.com_{a}_m"] for a in "xyz"]
        com_known &= [e.identified for e in first]
        moved += fit.mass * np.array([e.value for e in first]) - mass_q * com
        second = [e for k, e in values.items() if k.startswith(f"pose_{n + 1}.inertia_")]
        known &= [e.identified for e in second]
        inertia += unpack_inertia(np.array([e.value for e in second])) - I_B
    count = len(found.poses)
    c0 = np.array([p.com_x_m, p.com_y_m, p.com_z_m])
    c = (p.mass_kg * c0 + moved / count) / mass
    c = np.where(com_known, c, c0)
    for i, axis in enumerate("xyz"):
        if com_known[i]:
            out[f"com_{axis}_m"] = float(c[i])
    I_0 = platform_inertia(p)
    I_0 = I_0 + p.mass_kg * (c0 @ c0 * np.eye(3) - np.outer(c0, c0)) + inertia / count
    own = np.diag(I_0 - mass * (c @ c * np.eye(3) - np.outer(c, c))).copy()
    if known[:3].all():
        own[2] = min(own[2], (1.0 - 1e-5) * (own[0] + own[1]))  # a body, within the error
    else:  # with the file's inertia about the other axes
        own = np.where(known[:3], own, np.diag(platform_inertia(p)))
    try:
        diagonal = float(own[0]), float(own[1]), float(own[2])
        check_inertia(*diagonal, p.inertia_xy_kgm2, p.inertia_xz_kgm2, p.inertia_yz_kgm2)
        rigid = bool(np.all(own > 0.0))
    except ValueError:
        rigid = False
    for axis, value, fitted in zip(("xx", "yy", "zz"), own, known[:3], strict=True):
        key = f"inertia_{axis}_kgm2"
        if fitted and rigid:
            out[key] = float(value)
        elif fitted:
            left_out.append(
                f"# {key} = {value:.6g} was identified, but no rigid body has it with the file's "
                "inertia about the other axes: correct those"
            )
    for axis in "xyz":
        e = values[f"drag_area_{axis}_m2"]
        if e.identified and e.value >= 0.0:
            out[f"drag_area_{axis}_m2"] = e.value
    return out, left_out


def _servos(found: Identification, number: object) -> list[str]:
    robot = found.robot
    if robot.arm is None:
        return []
    assert callable(number)
    joints = [limb.name for limb in list_joints(robot) if limb.servo >= 0]
    names = [name for name, _ in list_servos(robot)][: len(robot.arm.servos)]
    lines = []
    for joint, name in zip(joints, names, strict=False):
        lag = next((s for s in found.servos if s.name == joint and s.identified), None)
        if lag is None or lag.lag <= 0.0:
            continue
        # a velocity servo has two equal poles, so its lag is 2 T
        position = lag.unit == "rad"
        key = "position_time_constant_s" if position else "velocity_time_constant_s"
        factor = 1.0 if position else 0.5
        lines += ["", f"[robot.arm.{name}]", number(key, factor * lag.lag, factor * lag.half_lag)]
    return lines
