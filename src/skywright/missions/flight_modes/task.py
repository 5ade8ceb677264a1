"""What a mission of the kind "flight-modes" may say."""

from pydantic import Field

from skywright.core.spec import Fraction, Positive
from skywright.description.mission.spec import Task


class ModesTask(Task):
    """How far each mode goes."""

    tilt_deg: float | None = Field(default=None, gt=0, le=30)  # default: see plan()
    # of the computed hover tilt that may be commanded: the rotors need the rest for errors of mass,
    # gain and drag
    calm_fraction: Fraction = 0.95
    tilt_fraction: Fraction = 0.75  # the same in wind
    distance_m: float = Field(default=1.0, gt=0, le=20)
    standard_tilt_deg: float = Field(default=2.0, gt=0, le=15)
    standard_s: float = Field(default=0.5, gt=0, le=3)  # tilted; it drifts meanwhile
    hold_s: Positive = 2.0
