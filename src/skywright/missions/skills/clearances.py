"""Clearances that missions keep whose hands or probe touch something."""

from pydantic import Field

from skywright.description.mission.spec import Task


class Clearances(Task):
    """Keys of a task with ways through free air, and with work close to things."""

    # kept from everything on the ways: in gusts (Dryden, 1.5 m/s) the platform of sensor-install
    # strays by up to 0.05 m from its way, and 0.09 m while its link swings
    way_clearance_m: float = Field(default=0.1, ge=0.01, le=1)
    # kept near the work by all that does not touch: a hand strays by up to 0.012 m in hover
    near_clearance_m: float = Field(default=0.02, ge=0.002, le=0.3)
