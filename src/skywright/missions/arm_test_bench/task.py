"""Keys of a mission of the kind "arm-test-bench"."""

from pydantic import Field

from skywright.core.spec import NonNegative
from skywright.description.mission.spec import Task
from skywright.missions.bridge_contact.task import PressForces


class BenchTask(Task):
    """The staircase of forces, and the paper's two poses as its gamma_1, gamma_2."""

    # joint angles of the folded arm (gamma_1, gamma_2)
    rest_deg: list[float] = Field(default=[95.0, 152.0], min_length=2, max_length=2)
    # joint angles in front of the plate (gamma_1, gamma_2)
    inspection_deg: list[float] = Field(default=[61.0, 55.0], min_length=2, max_length=2)
    forces_n: PressForces = [2.0, 4.0, 6.0, 8.0]  # forces of the staircase, in this order
    ramp_s: float = Field(default=1.0, ge=0.1, le=60)  # time to change from one force to the next
    settle_s: NonNegative = 3.0  # wait after each ramp, before the force is measured
    # usable share of the computed largest press; errors of lengths and encoders take 10 to 13 %
    force_fraction: float = Field(default=0.85, gt=0, le=1)
    hold_s: float = Field(default=4.0, ge=0.2, le=600)  # time over which each force is measured
