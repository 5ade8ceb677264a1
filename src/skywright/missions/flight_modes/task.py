"""Keys of a mission of the kind "flight-modes"."""

from pydantic import Field

from skywright.core.spec import Fraction, Positive
from skywright.description.mission.spec import Task


class ModesTask(Task):
    """Amplitudes of the modes."""

    # tilt of the mode command angle; default: from the computed hover limit
    tilt_deg: float | None = Field(default=None, gt=0, le=30)
    # largest fraction of the computed hover tilt in calm air: the rest compensates errors of mass,
    # gain and drag
    calm_fraction: Fraction = 0.95
    tilt_fraction: Fraction = 0.75  # largest fraction of that limit in wind
    # length of the translation in the mode command position
    distance_m: float = Field(default=1.0, gt=0, le=20)
    # tilt of the mode standard stabilisation
    standard_tilt_deg: float = Field(default=2.0, gt=0, le=15)
    # duration of that tilt; the robot drifts meanwhile
    standard_s: float = Field(default=0.5, gt=0, le=3)
    hold_s: Positive = 2.0  # time for which each tilt or position is held
