"""Check of a docked press against the errors of the plant."""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.description.loader import Description
from skywright.description.world.wind import compute_speed
from skywright.missions.bridge_contact.stations import Station
from skywright.missions.bridge_contact.task import Contact
from skywright.models.docked import build_docked, find_stance
from skywright.models.docked_balance import SPREAD, compute_borne_press


def compute_borne(d: Description[Contact], station: Station, drag_B: Array) -> float:
    """Return the press (N) that the docked robot withstands with the plant's errors; NaN: none."""
    whole = build_docked(
        d.robot, thrust_fraction=1.0, gravity=d.world.gravity_mps2,
        air_density=d.world.air_density_kg_m3,
    )  # fmt: skip
    task = d.mission.task
    return compute_borne_press(
        whole, find_stance(whole), R_WB=station.R_dock, drag_B=drag_B,
        reserve=task.dock_rotor_reserve, friction=task.dock_friction_fraction,
    )  # fmt: skip


def check_borne(
    d: Description[Contact], largest: float, station: Station, drag_B: Array
) -> tuple[float, str]:
    """Return the press (N) that a docked robot withstands, and why not the largest press, or ""."""
    slope = math.acos(float(np.clip(station.R_dock[2, 2], -1.0, 1.0)))
    speed, name = compute_speed(d.world.wind), d.robot.name
    where = f"docked at {math.degrees(slope):.3g} deg and {speed:.1f} m/s of wind"
    if slope > station.tilt_limit * (1.0 + 1e-9):
        return math.nan, (
            f"{station.name}: {where}, the rotors cannot hold the attitude when the feet leave the "
            f"deck: {name} hovers at up to {math.degrees(station.tilt_limit):.1f} deg there"
        )
    most = compute_borne(d, station, drag_B)
    if largest <= most * (1.0 + 1e-9):
        return most, ""
    task = d.mission.task
    bound = f"exceeds {most:.2f} N" if most > 0.0 else "is not possible"
    remedy = "lower mission.task.forces_n" if most > 0.0 else "choose a spot with less slope"
    return most, (
        f"a press of {largest:g} N {where} {bound}: each rotor of {name} must keep "
        f"{task.dock_rotor_reserve:.0%} of its range (mission.task.dock_rotor_reserve) and each "
        f"foot may use {task.dock_friction_fraction:.0%} of its friction "
        f"(mission.task.dock_friction_fraction) with errors of {SPREAD.weight:.0%} of "
        f"weight and thrust, {1e3 * SPREAD.center:g} mm of the centre of mass and "
        f"{SPREAD.drag:.0%} of drag (plant): {remedy}"
    )


def refuse(
    force: float, limit: float, fraction: float, where: str, robot: str,
    key: str = "force_fraction",
) -> str:  # fmt: skip
    """Return the refusal of a press of `force` (N) above `fraction` (of `key`) of `limit` (N)."""
    if math.isnan(limit):
        return f"{robot} cannot stay {where}"
    return (
        f"a press of {force:g} N {where} exceeds {fraction * limit:.2f} N, {fraction:.0%} "
        f"(mission.task.{key}) of the {limit:.2f} N that {robot} can produce there "
        "(skywright capability)"
    )
