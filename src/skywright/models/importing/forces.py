"""Forces of MuJoCo's actuators at rest, and rotors that are actuators at sites.

The force of an actuator is gain * input + bias, cut to `forcerange`; its wrench is that force times
`gear` (MuJoCo documentation, Computation, "Actuation model"). The input is the control, or the
activation, which follows the control with the lag `dynprm`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError

SAME = 1e-6
"""Torque across the thrust over the thrust (m) that is ignored."""
FILTERS = {int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT)}
PLAIN = {int(mujoco.mjtDyn.mjDYN_NONE), *FILTERS}
"""Dynamics of actuators whose input at rest is the control."""
LINEAR = {int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE)}
CONSTANT = {int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)}


class Thrust(NamedTuple):
    """The wrench of an actuator at a site, in the frame of the site."""

    axis: Array  # (3,) of the thrust
    torque: float  # m, along the axis, over the thrust
    span: tuple[float, float]  # N of the thrust; infinite without limits
    lag: float  # s; 0 if the file has none


def find_force(model: mujoco.MjModel, a: int) -> tuple[float, float]:
    """Return the least and the largest force of an actuator at rest, before its gear.

    Infinite without a limit, or where only the position of its joint limits the force.
    """
    low, high = -math.inf, math.inf
    gain, bias = (row[a, :3] for row in (model.actuator_gainprm, model.actuator_biasprm))
    affine = model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE
    turning = model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_AFFINE
    # without refsite, the length of an actuator at a site is 0
    still = model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_SITE
    moved = (affine and np.any(bias[1:])) or (turning and np.any(gain[1:]))
    if _is_linear(model, a) and (still or not moved):
        ends = [float(gain[0]) * x for x in _find_input(model, a)] if gain[0] else [0.0, 0.0]
        low, high = (x + (float(bias[0]) if affine else 0.0) for x in sorted(ends))
    if model.actuator_forcelimited[a]:
        low, high = (float(np.clip(x, *model.actuator_forcerange[a])) for x in (low, high))
    return low, high


def find_thrust(model: mujoco.MjModel, a: int, where: str, notes: set[str]) -> Thrust | None:
    """Return the thrust of an actuator at a site; None if it makes none.

    `notes` receives what is left out. Raises InputError for a wrench that no rotor makes; `where`
    names the file.
    """
    gear, gain = model.actuator_gear[a], float(model.actuator_gainprm[a, 0])
    size = float(np.linalg.norm(gear[:3]))
    if size < 1e-12 or (gain == 0.0 and _is_linear(model, a)):
        return None
    site, other = (int(x) for x in model.actuator_trnid[a])
    name = model.actuator(a).name
    where = f"{where}: actuator {name!r}" if name else f"{where}: actuator of site"
    where += "" if name else f" {model.site(site).name!r}"
    advice = "; give the rotors with --rotor"
    if other >= 0:
        raise InputError(
            f"{where} has the refsite {model.site(other).name!r}, so it acts between two sites, "
            f"which no rotor does{advice}"
        )
    if not _is_linear(model, a):
        dyn, gain_type, bias_type = (
            str(kind.name)[6:].lower()
            for kind in (
                mujoco.mjtDyn(model.actuator_dyntype[a]),
                mujoco.mjtGain(model.actuator_gaintype[a]),
                mujoco.mjtBias(model.actuator_biastype[a]),
            )
        )
        raise InputError(
            f"{where} has dyntype {dyn}, gaintype {gain_type}, biastype {bias_type}; valid for "
            "rotors: dyntype none, filter or filterexact, gaintype fixed or affine, biastype none "
            f"or affine{advice}"
        )
    low, high = find_force(model, a)
    back = -low > high or (-low == high and gain < 0.0)
    axis = (-gear[:3] if back else gear[:3]) / size
    span = (size * -high, size * -low) if back else (size * low, size * high)
    torque = gear[3:] / size * (-1.0 if back else 1.0)
    along = float(torque @ axis)
    if np.linalg.norm(torque - along * axis) > SAME:
        raise InputError(f"{where} makes a torque across its thrust, which no rotor does{advice}")
    if model.actuator_gainprm[a, 2] or model.actuator_biasprm[a, 2]:
        notes.add("thrust that depends on the velocity (third number of gainprm and biasprm)")
    if -math.inf < span[0] < 0.0:
        notes.add(f"thrust below zero (the file has {span[0]:g} N): rotors push in one direction")
    lag = float(model.actuator_dynprm[a, 0]) if model.actuator_dyntype[a] in FILTERS else 0.0
    return Thrust(axis, along, span, lag)


def _is_linear(model: mujoco.MjModel, a: int) -> bool:
    """Whether the force at rest and at a given position is linear in the control."""
    return (
        int(model.actuator_dyntype[a]) in PLAIN
        and int(model.actuator_gaintype[a]) in LINEAR
        and int(model.actuator_biastype[a]) in CONSTANT
    )


def _find_input(model: mujoco.MjModel, a: int) -> tuple[float, float]:
    """Return the least and the largest input of an actuator: of its control and its activation."""
    low, high = -math.inf, math.inf
    control = int(model.actuator_ctrladr[a])  # some actuators have several
    if model.actuator_ctrllimited[control]:
        low, high = (float(x) for x in model.actuator_ctrlrange[control])
    if model.actuator_actlimited[a] and int(model.actuator_dyntype[a]) in FILTERS:
        low, high = (float(np.clip(x, *model.actuator_actrange[a])) for x in (low, high))
    return low, high
