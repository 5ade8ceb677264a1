"""Keys of a mission of the kind "thickness-survey"."""

from __future__ import annotations

from pydantic import Field

from skywright.core.spec import NonNegative
from skywright.missions.bridge_contact.task import Contact, PressForces
from skywright.missions.skills.procedure import ThicknessProcedure


class ThicknessSurvey(Contact):
    """Measure the wall's thickness at each of `spots` with an ultrasonic probe.

    The probe is pressed with the force of `forces_n`. A reading that is not accepted within
    `hold_s` is repeated with a new touch, `tries` times in all.
    """

    dock: bool = False  # measure while docked; the surface must face down
    without_gear: bool = False  # only false: spots are measured either docked or in flight
    forces_n: PressForces = [3.0]  # force of the probe on the wall
    settle_s: NonNegative = 0.5  # wait before the first reading: the couplant thins
    hold_s: float = Field(default=4.0, ge=0.2, le=600)  # longest time for a reading
    tries: int = Field(default=3, ge=1, le=20)  # largest number of touches at each spot
    procedure: ThicknessProcedure = ThicknessProcedure()
