"""The three flight modes of Sanchez-Cuevas 2020, section 5.3, in sequence (Fig. 20).

Standard stabilisation is a linear cascade on attitude and height, as for a coplanar robot; it does
not control the position. Command position translates with a level attitude, command angle tilts at
a fixed position. The last two are one law with different references.
"""

import math
import time
from typing import NamedTuple

from skywright.core.find import find
from skywright.core.rotations import rot_z
from skywright.description.world.wind import compute_direction, compute_speed
from skywright.errors import InputError
from skywright.missions.flight_modes.task import ModesTask
from skywright.missions.skills.moves import compute_move_s
from skywright.models.hover_tilt import compute_hover_tilt
from skywright.models.rigid_body import posture
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

CALM_DUE, WINDY_DUE = 0.85, 0.7
"""Fraction of the computed hover tilt that must be held if the task gives no tilt."""
LEAST_TILT = math.radians(9.0)
"""Tilt to be held in calm air if the limit allows it."""
LAG = math.radians(0.5)
"""Mean attitude error of a hold while the integral adapts to the torque of the new attitude; it is
added to the reference."""


SPEED = 0.5  # m/s, of the translations


class ModesPlan(NamedTuple):
    """Reference, requirement and limit of the tilt."""

    tilt: float  # rad, reference
    due: float  # rad, tilt to be held
    limit: float  # rad, computed hover tilt in the world's wind
    calm: bool


def plan(setup: Setup[ModesTask]) -> MissionPlan[ModesPlan]:
    """Compute the tilt limit; refuse a tilt beyond it."""
    began = time.perf_counter()
    d, task = setup.description, setup.task
    law = None if d.law is None else d.law.kind
    if law is None or not find("law", law).cls.knows_modes:
        raise InputError(
            f"mission {d.mission.name!r} requires mission.law = 'backstepping', which has "
            f"flight modes; found {law!r}"
        )
    wind = compute_speed(d.world.wind) * compute_direction(d.world.wind)
    limit = compute_hover_tilt(
        d.robot, posture(d.robot, "folded"), d.world.gravity_mps2,
        wind=rot_z(math.radians(d.mission.start_yaw_deg)).T @ wind,
        air_density=d.world.air_density_kg_m3,
    )  # fmt: skip
    calm = d.world.wind.kind == "none"
    key = "calm_fraction" if calm else "tilt_fraction"
    share: float = getattr(task, key)
    most = share * limit - LAG  # tilt to be held
    due = max(CALM_DUE * limit, LEAST_TILT) if calm else WINDY_DUE * limit
    due = min(due, most) if task.tilt_deg is None else math.radians(task.tilt_deg)
    blocked, air = None, "" if calm else f" in {compute_speed(d.world.wind):.1f} m/s of wind"
    if math.isnan(limit):
        blocked = f"{d.robot.name} cannot hover level{air} (skywright capability)"
    elif limit <= 0.0:
        blocked = f"{d.robot.name} cannot tilt in place{air}: it has no lateral force"
    elif most <= 0.0:
        blocked = (
            f"{d.robot.name} can hover in place at up to {math.degrees(limit):.2f} deg{air}: "
            f"less than the steady attitude error of {math.degrees(LAG):g} deg"
        )
    elif due > most * (1.0 + 1e-9):
        blocked = (
            f"a tilt of {math.degrees(due):.1f} deg exceeds {math.degrees(most):.2f} deg, "
            f"which is {share:.0%} (mission.task.{key}) of the {math.degrees(limit):.1f} "
            f"deg at which {d.robot.name} can hover in place{air}, minus the attitude "
            f"error of {math.degrees(LAG):g} deg: lower mission.task.tilt_deg"
        )
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began, _sum_moves(task, due + LAG, calm),
        way=ModesPlan(due + LAG, due, limit, calm),
    )  # fmt: skip


def _sum_moves(task: ModesTask, tilt: float, calm: bool) -> float:
    """Return the duration (s) of the translations, and of the changes of the tilt (rad)."""
    once, twice = (compute_move_s(0.0, n * tilt, speed=SPEED) for n in (1, 2))
    moves = 4.0 * compute_move_s(task.distance_m, speed=SPEED) + 2.0 * (2.0 * once + twice)
    first = math.radians(task.standard_tilt_deg)
    once, twice = (compute_move_s(0.0, n * first, speed=SPEED) for n in (1, 2))
    return moves + (2.0 * once + twice if calm else 0.0)
