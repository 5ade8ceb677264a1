"""Estimates the duration, energy and batteries of a mission before take-off."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from skywright.models.rigid_body import compute_body, posture
from skywright.models.rotors import compute_electrical_power
from skywright.models.statics import UP, build_layout, compute_thrust, wrench_at
from skywright.run.duration import estimate_duration, estimate_work_s
from skywright.run.limits import compute_wind_drag
from skywright.run.setup import Setup

if TYPE_CHECKING:
    from skywright.run.planning import MissionPlan


class Need(NamedTuple):
    """What a flight needs; an estimate, see `estimate_need`."""

    minutes: float
    energy_wh: float
    batteries: float  # usable energies of the robot's battery

    def tell(self) -> str:
        """Return a phrase for messages."""
        return (
            f"{self.minutes:.1f} min and {self.energy_wh:.0f} Wh, {self.batteries:.2f} of the "
            "battery's usable energy"
        )


def estimate_need(setup: Setup[Any], work_s: float) -> Need | None:
    """Return the need of a flight that works for `work_s` (s) between take-off and landing.

    The power is that of hovering with the arm at work in the mean wind: the thrust of level hover,
    increased by the drag perpendicular to it; P ~ T^(3/2). Contact forces and motion are neglected.
    None for a robot that does not hover level, and for work without a duration.
    """
    if not math.isfinite(work_s):
        return None
    robot, world = setup.robot, setup.world
    layout = build_layout(setup.rotors, robot.rotors.thrust_fraction, setup.allocator)
    mass, p_BC, _ = compute_body(setup.model, posture(robot, "working"))
    weight = mass * world.gravity_mps2
    thrust = compute_thrust(layout, wrench_at(weight * UP, p_BC))
    if thrust is None:
        return None
    power = compute_electrical_power(layout.rotors, thrust, world.air_density_kg_m3)
    drag = compute_wind_drag(setup) / weight
    power = power * (1.0 + drag**2) ** 0.75 + robot.battery.avionics_power_w
    seconds = estimate_duration(setup, work_s).total
    energy = power * seconds / 3600.0
    usable = robot.battery.energy_wh * robot.battery.usable_fraction
    return Need(seconds / 60.0, energy, energy / usable)


def find_lacking_energy(setup: Setup[Any], plan: MissionPlan[Any], what: str) -> str | None:
    """Return a message if one battery does not suffice for a plan, or None; `what` names it."""
    need = estimate_need(setup, estimate_work_s(setup, plan))
    if need is None or need.batteries <= 1.0:
        return None
    parts = math.ceil(need.batteries)
    return (
        f"battery: {what} takes {need.tell()}: {parts} batteries; divide the task into {parts} "
        "flights, or raise mission.task.speed_mps or the instrument's width"
    )
