"""Limits of a robot against the tilt of its rotors: `skywright capability --sweep tilt`.

All tilts of the robot file are scaled in proportion, so that their signs and ratio stay. For equal
sizes of alpha and beta this is the study of Sanchez-Cuevas et al. 2020, figures 4 and 5.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.rotors import build_rotors, compute_electrical_power
from skywright.models.statics import (
    UP,
    build_layout,
    compute_lateral_forces,
    compute_ray,
    compute_thrust,
    compute_tilt_limit,
    wrench_at,
)

TILT_MAX = 45.0  # deg
SIDES = np.radians([0.0, 90.0, 180.0, 270.0])
AXES = {"roll": np.array([1.0, 0.0, 0.0]), "pitch": np.array([0.0, 1.0, 0.0])}


class TiltSweep(NamedTuple):
    """Limits against the largest tilt angle of a rotor (m of them). NaN: cannot hover."""

    robot: str
    posture: str
    mass: float  # kg
    thrust_fraction: float
    tilts: Array  # (m,) rad
    own: float  # rad, of the robot file
    lateral_force: Array  # (m, 4) N toward +x, +y, -x, -y
    least_force: Array  # (m,) N over all directions
    hover_tilt: Array  # (m, 2) rad, roll and pitch, the smaller of both signs
    hover_power: Array  # (m,) W, avionics included
    payload: Array  # (m,) kg at B's origin

    def to_json(self) -> dict[str, Any]:
        """Return the command line's `--json` object; undefined values are null."""

        def plain(values: Array) -> list[float | None]:
            return [float(v) if math.isfinite(v) else None for v in values]

        sides = ("0", "90", "180", "270")
        return {
            "robot": self.robot,
            "posture": self.posture,
            "mass_kg": self.mass,
            "thrust_fraction": self.thrust_fraction,
            "sweep": "tilt",
            "tilt_deg": np.degrees(self.tilts).round(9).tolist(),
            "own_tilt_deg": math.degrees(self.own),
            "lateral_force_n": {
                name: plain(self.lateral_force[:, i]) for i, name in enumerate(sides)
            },
            "least_lateral_force_n": plain(self.least_force),
            "hover_tilt_deg": {
                name: plain(np.degrees(self.hover_tilt[:, i])) for i, name in enumerate(AXES)
            },
            "hover_power_w": plain(self.hover_power),
            "payload_kg": plain(self.payload),
        }


def tilt_rotors(robot: Robot, tilt: float) -> Robot:
    """Return the robot with its rotors' tilts scaled so that the largest is `tilt` (rad).

    Raises InputError if no rotor is tilted, because then there are no tilts to scale.
    """
    r = robot.rotors
    own = max(abs(a) for a in [*r.alpha_deg, *r.beta_deg])
    if own == 0.0:
        raise InputError(
            f"robot {robot.name!r} has parallel rotors, so there is no tilt to sweep; set "
            "tilts, e.g. --set robot.rotors.alpha_deg=[10,-10,10,-10,10,-10]"
        )
    scale = math.degrees(tilt) / own
    rotors = r.model_copy(
        update={
            "alpha_deg": [scale * a for a in r.alpha_deg],
            "beta_deg": [scale * b for b in r.beta_deg],
        }
    )
    return robot.model_copy(update={"rotors": rotors})


def compute_tilt_sweep(
    robot: Robot, *, posture_name: str = "extended", gravity: float = 9.81, air_density: float = 1.2
) -> TiltSweep:
    """Compute lateral force, hover tilt, hover power and payload against the rotors' tilt.

    Tilts from 0 to TILT_MAX in steps of 1 deg; posture "extended" or "folded".

    Raises InputError for a robot without tilted rotors.
    """
    tilts = np.radians(np.arange(0.0, TILT_MAX + 0.5, 1.0))
    q = posture(robot, "folded" if posture_name == "folded" else "working")
    mass, p_BC, _ = compute_body(build_body_model(robot, gravity), q)
    weight, level = mass * gravity, wrench_at(mass * gravity * UP, p_BC)
    every = np.radians(np.arange(0.0, 360.0, 10.0))
    m = len(tilts)
    force, least, lean = np.full((m, 4), np.nan), np.full(m, np.nan), np.full((m, 2), np.nan)
    power, payload = np.full(m, np.nan), np.full(m, np.nan)
    for i, tilt in enumerate(tilts):
        tilted = tilt_rotors(robot, float(tilt))
        try:
            layout = build_layout(build_rotors(tilted.rotors), robot.rotors.thrust_fraction)
        except InputError:  # not controllable at this tilt
            continue
        hover = compute_thrust(layout, level)
        if hover is None:
            continue
        force[i] = compute_lateral_forces(layout, weight, p_BC, SIDES)
        least[i] = np.min(compute_lateral_forces(layout, weight, p_BC, every))
        for k, axis in enumerate(AXES.values()):
            both = [compute_tilt_limit(layout, weight, p_BC, sign * axis) for sign in (1.0, -1.0)]
            lean[i, k] = min(both)
        power[i] = compute_electrical_power(layout.rotors, hover, air_density)
        power[i] += robot.battery.avionics_power_w
        payload[i] = max(compute_ray(layout, level, wrench_at(gravity * UP, np.zeros(3))).hi, 0.0)
    own = math.radians(max(abs(a) for a in [*robot.rotors.alpha_deg, *robot.rotors.beta_deg]))
    return TiltSweep(
        robot.name, "none" if robot.arm is None else posture_name, mass,
        robot.rotors.thrust_fraction, tilts, own, force, least, lean, power, payload,
    )  # fmt: skip


def strip_robot(robot: Robot) -> Robot:
    """Return the bare platform: no arm, probe or docking gear, centre of mass at the centre.

    It is compared with a paper's values for the platform alone. The batteries that balanced the arm
    are back in the middle.
    """
    platform = robot.platform.model_copy(update={"com_x_m": 0.0, "com_y_m": 0.0, "com_z_m": 0.0})
    none = {"arm": None, "probe": None, "force_sensor": None, "docking": None}
    return robot.model_copy(update={"platform": platform, **none})
