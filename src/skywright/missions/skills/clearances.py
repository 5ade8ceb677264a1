"""Clearances of missions in which hands or a probe touch something."""

from pydantic import Field

from skywright.description.mission.spec import Task


class Clearances(Task):
    """Keys of a task with paths through free air and work close to obstacles."""

    # clearance on the paths: in gusts (Dryden, 1.5 m/s) the platform of sensor-install deviates by
    # up to 0.05 m from its path, and by 0.09 m while its link swings
    way_clearance_m: float = Field(default=0.1, ge=0.01, le=1)
    # clearance near the work of all parts that do not touch: a hand deviates by up to 0.012 m in
    # hover
    near_clearance_m: float = Field(default=0.02, ge=0.002, le=0.3)
