"""Plan of a thickness survey: a contact inspection with a gauge that can measure the wall."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

from skywright.errors import InputError
from skywright.inspection.thickness import GaugeSetup
from skywright.missions.bridge_contact.plan import ContactPlan
from skywright.missions.bridge_contact.plan import plan as plan_contact
from skywright.missions.thickness_survey.gauge import build_gauge, find_probe, set_up
from skywright.missions.thickness_survey.task import ThicknessSurvey
from skywright.run.need import find_lacking_energy
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.vehicle.sensors.ultrasonic import find_wall


class ThicknessWay(NamedTuple):
    """Gauge and contact plan of the survey."""

    contact: ContactPlan
    gauge: GaugeSetup  # set up on the block before the flight


def plan(setup: Setup[ThicknessSurvey]) -> MissionPlan[ThicknessWay]:
    """Check probe, block and wall, and place the robot at the spots.

    Raises InputError if probe, wall or block are missing or do not fit each other.
    """
    task = setup.task
    probe = find_probe(setup)
    find_wall(setup.world, probe.name)
    gauge = set_up(setup, probe, task.procedure)
    build_gauge(task.procedure, gauge)
    if task.slide_m:
        raise InputError("mission.task.slide_m: a thickness survey measures at spots; valid: 0")
    if task.without_gear:
        raise InputError(
            "mission.task.without_gear: a thickness survey measures each spot either docked or in "
            "flight (mission.task.dock = false); valid: false"
        )
    if len(task.forces_n) != 1:
        raise InputError(
            f"mission.task.forces_n has {len(task.forces_n)} forces: a thickness survey presses "
            "with one; valid: a list of one number"
        )
    found = plan_contact(cast(Any, setup))
    way = None if found.way is None else ThicknessWay(found.way, gauge)
    planned = cast(MissionPlan[ThicknessWay], found._replace(way=cast(Any, way)))
    if not planned.feasible:
        return planned
    lacking = find_lacking_energy(setup, planned, f"{len(task.spots)} spots")
    return planned._replace(feasible=lacking is None, blocked_by=lacking)
