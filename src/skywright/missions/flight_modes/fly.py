"""The three flight modes of Sanchez-Cuevas 2020, section 5.3, one after the other (Fig. 20).

Standard stabilisation holds attitude and height as a coplanar robot would; position is left alone.
Command position translates with the attitude held level, command angle tilts with the position
held. The last two are one law with different references.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skywright.core.rotations import exp_so3, rot_z
from skywright.core.spec import Positive, Spec
from skywright.core.types import MODE_POSE, MODE_STANDARD
from skywright.description.loader import Description
from skywright.description.mission.spec import Mission
from skywright.description.world.wind import compute_direction, compute_speed
from skywright.errors import InputError
from skywright.missions.skills.moves import build_move, set_rest
from skywright.models.hover_tilt import compute_hover_tilt
from skywright.models.rigid_body import posture
from skywright.run.flight import Flight
from skywright.run.planning import MissionPlan

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

Array = NDArray[np.float64]

NEEDS = frozenset({"uav", "whole_body"})

CALM_FRACTION, WINDY_FRACTION = 0.85, 0.7
"""Of the computed hover tilt that must be held; the rest is for gusts and errors of the model."""
LEAST_TILT = math.radians(9.0)
"""To be held in calm air, where the limit allows."""
LAG = math.radians(0.5)
"""By which the attitude stays behind on the average of a hold, while the integral learns the
torque of the new attitude: it is asked for on top, up to the limit."""


class ModesTask(Spec):
    """How far each mode goes."""

    tilt_deg: float | None = Field(default=None, gt=0, le=30)  # default: see plan()
    distance_m: float = Field(default=1.0, gt=0, le=20)
    standard_tilt_deg: float = Field(default=2.0, gt=0, le=15)
    standard_s: float = Field(default=0.5, gt=0, le=3)  # tilted; it drifts meanwhile
    hold_s: Positive = 2.0


class FlightModesMission(Mission):
    """A mission of the kind "flight-modes"."""

    task: ModesTask = ModesTask()


class ModesPlan(NamedTuple):
    """What is asked for, and what could be."""

    tilt: float  # rad, reference
    due: float  # rad, to be held
    limit: float  # rad, computed hover tilt, in the wind of the world
    calm: bool


def plan(d: Description) -> MissionPlan:
    """Compute the tilt limit; refuse a tilt beyond it."""
    began = time.perf_counter()
    assert isinstance(d.mission, FlightModesMission)
    law = d.mission.law or d.robot.control.law
    if law != "backstepping":
        raise InputError(
            f"mission {d.mission.name!r} needs mission.law = 'backstepping', which knows the "
            f"modes; not {law!r}"
        )
    task = d.mission.task
    wind = compute_speed(d.world.wind) * compute_direction(d.world.wind)
    limit = compute_hover_tilt(
        d.robot, posture(d.robot, "folded"), d.world.gravity_mps2,
        wind=rot_z(math.radians(d.mission.start_yaw_deg)).T @ wind,
        air_density=d.world.air_density_kg_m3,
    )  # fmt: skip
    calm = d.world.wind.kind == "none"
    due = max(CALM_FRACTION * limit, min(LEAST_TILT, limit)) if calm else WINDY_FRACTION * limit
    if task.tilt_deg is not None:
        due = math.radians(task.tilt_deg)
    tilt = max(due, min(due + LAG, limit))
    blocked, air = None, "" if calm else f" in {compute_speed(d.world.wind):.1f} m/s of wind"
    if math.isnan(limit):
        blocked = f"{d.robot.name} cannot hover level{air} (skywright capability)"
    elif limit <= 0.0:
        blocked = f"{d.robot.name} cannot tilt in place{air}: it has no lateral force"
    elif due > limit:
        blocked = (
            f"a tilt of {math.degrees(due):.1f} deg exceeds the {math.degrees(limit):.1f} deg at "
            f"which {d.robot.name} can hover in place{air} (skywright capability)"
        )
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began, 60.0, math.nan, math.nan, {}, None,
        0.0, 0.0, ModesPlan(tilt, due, limit, calm),
    )  # fmt: skip


def fly(s: Supervisor) -> Flight:
    """Standard stabilisation (in calm air), command position, command angle."""
    way, mission, vehicle = s.plan.task, s.mission, s.vehicle
    assert isinstance(way, ModesPlan) and isinstance(mission, FlightModesMission)
    task = mission.task
    level = np.array(vehicle.reference["R_WB"])
    home = np.array(vehicle.reference["p_WB"])

    def go(phase: str | None, p: Array, R: Array, mode: int = MODE_POSE) -> None:
        start = set_rest(vehicle.reference)
        end = np.array(start)
        end["p_WB"], end["R_WB"], end["mode"] = p, R, mode
        if phase is not None:
            s.begin(phase)
        move = build_move(vehicle.model, vehicle.n_joints, start, end, speed=0.5)
        s.body.track(move)
        s.until_arrived()

    if s.plan.task.calm:  # a wind would carry it off at once: that is what the mode lacks
        go("standard stabilisation", home, level, MODE_STANDARD)
        s.wait(1.0)
        for sign in (1.0, -1.0, 0.0):
            tilted = turn_about(level, 1, sign * math.radians(task.standard_tilt_deg))
            go(None, home, tilted, MODE_STANDARD)
            s.wait(task.standard_s)
        drifted = np.array(vehicle.estimate["p_WB"])
        drifted[2] = home[2]
        s.begin("take over")  # where it is now
        row = set_rest(vehicle.reference)
        row["p_WB"], row["R_WB"], row["mode"] = drifted, level, MODE_POSE
        s.body.track(row[None])
        s.wait(3.0)
        go(None, home, level)
        s.wait(task.hold_s)
    for axis in (0, 1):
        go("command position", home + task.distance_m * level[:, axis], level)
        s.wait(task.hold_s)
        go("command position", home, level)
        s.wait(task.hold_s)
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            go("command angle", home, turn_about(level, axis, sign * way.tilt))
            s.begin("hold angle")
            s.wait(task.hold_s)
        go("command angle", home, level)
        s.wait(1.0)
    return Flight(True, "")


def turn_about(R: Array, axis: int, angle: float) -> Array:
    """Return R turned by `angle` (rad) about its own axis."""
    turn, out = np.zeros(3), np.empty((3, 3))
    turn[axis] = angle
    exp_so3(turn, out)
    return np.asarray(R @ out)
