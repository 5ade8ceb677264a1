"""Keys of a mission of the kind "bridge-contact"."""

from typing import Annotated

from pydantic import AfterValidator, Field

from skywright.core.spec import Coordinate, NonNegative, Positive, Spec
from skywright.missions.skills.clearances import Clearances
from skywright.missions.skills.operated import OperatedTask


def _check_forces(forces: list[float]) -> list[float]:
    for force in forces:
        if not 0.2 <= force <= 16.0:
            raise ValueError(f"a force of {force:g} N; valid: 0.2 to 16 N each")
    return forces


PressForces = Annotated[
    list[float], Field(min_length=1, max_length=50), AfterValidator(_check_forces)
]
"""Forces (N) of a mission, applied in sequence."""


class Spot(Spec):
    """A place to inspect, in the structure's frame S."""

    x_m: Coordinate = 0.0  # position in the frame S of the structure
    y_m: Coordinate = 0.0  # position in the frame S of the structure
    name: str = ""  # label in records


class Contact(Clearances):
    """Press the probe's tip on a structure with a profile of forces, docked or flying.

    Each force is reached over `ramp_s`, given `settle_s`, and held for `hold_s`: one measurement.
    """

    dock: bool = True  # press while docked; the surface must face down
    without_gear: bool = True  # after docking, press the same forces in flight for comparison
    spots: list[Spot] = Field(default=[Spot()], min_length=1, max_length=100)
    # forces of the profile; each one is one measurement
    forces_n: PressForces = [2.0, 4.0, 6.0, 8.0]
    ramp_s: float = Field(default=1.5, ge=0.1, le=60)  # time to reach a force
    settle_s: NonNegative = 2.0  # wait before a force is measured
    hold_s: float = Field(default=3.0, ge=0.2, le=600)  # time over which a force is measured
    survey: bool | None = None  # touch the structure first; default: if plant.map_error_* is not 0
    # measure the world's datum before the touches; places are relative to it
    datum: bool = True
    # distance of feet or tip from the structure before contact
    stand_off_m: float = Field(default=0.4, ge=0.1, le=5)
    # speed at which the feet approach the structure
    dock_speed_mps: float = Field(default=0.1, ge=0.02, le=0.3)
    # usable share of the computed largest force, on a slope or in wind
    force_fraction: float = Field(default=0.8, gt=0, le=1)
    # usable share of the computed hover tilt
    tilt_fraction: float = Field(default=0.85, gt=0, le=1)
    # share of each rotor's range that stays free in a docked press with the plant's stated errors:
    # a rotor's thrust varies by 1 % (one deviation)
    dock_rotor_reserve: float = Field(default=0.05, ge=0, le=0.5)
    # usable share of each foot's friction in a docked press with the plant's stated errors
    dock_friction_fraction: float = Field(default=0.5, gt=0, le=1)
    # least share of the tip's mobility off the surface that friction may leave to a slide
    mobility_fraction: float = Field(default=0.5, ge=0, le=1)
    # least force of a slide, in rms forces that the platform's motion causes
    slide_sigmas: float = Field(default=3.0, ge=0, le=6)
    # force_fraction on a level structure in calm air
    calm_fraction: float = Field(default=0.95, gt=0, le=1)
    slide_m: Coordinate = 0.0  # length of a slide along the structure in flight; 0: no slide
    slide_force_n: Positive = 2.0  # force on the structure during the slide
    # clearance from all obstacles where the robot turns around a structure: a tip that stands off
    # by stand_off_m has little more
    turn_clearance_m: float = Field(default=0.025, ge=0.002, le=0.5)
    slide_speed_mps: float = Field(default=0.05, ge=0.005, le=0.5)  # speed of the slide


class BridgeContact(Contact, OperatedTask):
    """Keys of `Contact`, and those of an operator who may press in flight."""
