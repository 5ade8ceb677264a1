"""What a mission of the kind "bridge-contact" may say."""

from typing import Annotated

from pydantic import AfterValidator, Field

from skywright.core.spec import Coordinate, NonNegative, Positive, Spec
from skywright.description.mission.spec import Task


def _check_forces(forces: list[float]) -> list[float]:
    for force in forces:
        if not 0.2 <= force <= 16.0:
            raise ValueError(f"a force of {force:g} N; valid: 0.2 to 16 N each")
    return forces


PressForces = Annotated[
    list[float], Field(min_length=1, max_length=50), AfterValidator(_check_forces)
]
"""N, the forces that a mission presses with, one after the other."""


class Spot(Spec):
    """A place to inspect, in the structure's frame S."""

    x_m: Coordinate = 0.0
    y_m: Coordinate = 0.0
    name: str = ""


class BridgeContact(Task):
    """Press the probe's tip on a structure with a profile of forces, docked or flying.

    Each force is reached over `ramp_s`, given `settle_s`, and held for `hold_s`: one measurement.
    """

    dock: bool = True  # rest the docking gear against the surface, which must face down
    without_gear: bool = True  # then press once more in flight, for the numbers beside
    spots: list[Spot] = Field(default=[Spot()], min_length=1, max_length=100)
    forces_n: PressForces = [2.0, 4.0, 6.0, 8.0]
    ramp_s: float = Field(default=1.5, ge=0.1, le=60)
    settle_s: NonNegative = 2.0
    hold_s: float = Field(default=3.0, ge=0.2, le=600)
    survey: bool | None = None  # touch it first; default: where plant.map_error_* is not zero
    stand_off_m: float = Field(default=0.4, ge=0.1, le=5)  # of the feet or the tip, before docking
    dock_speed_mps: float = Field(default=0.1, ge=0.02, le=0.3)
    force_fraction: float = Field(default=0.8, gt=0, le=1)  # of the computed press, slope or wind
    tilt_fraction: float = Field(default=0.85, gt=0, le=1)  # of the computed hover tilt
    # of the tip's way off the surface that friction must leave to a slide
    mobility_fraction: float = Field(default=0.5, ge=0, le=1)
    slide_sigmas: float = Field(default=3.0, ge=0, le=6)  # of the wobble, that a slide presses with
    calm_fraction: float = Field(default=0.95, gt=0, le=1)  # of it, level and in calm air
    slide_m: Coordinate = 0.0  # along the structure under force, in flight; 0: left out
    slide_force_n: Positive = 2.0
    slide_speed_mps: float = Field(default=0.05, ge=0.005, le=0.5)
