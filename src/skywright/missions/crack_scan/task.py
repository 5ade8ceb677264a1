"""Keys of a mission of the kind "crack-scan"."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from skywright.description.robot.spec import Robot
from skywright.missions.scan.task import Scan
from skywright.missions.skills.procedure import CrackProcedure


class CrackScan(Scan):
    """Search a sector of the pipe's surface for cracks, in passes whose pitch follows from the
    swath."""

    pattern: Literal["raster"] = "raster"  # axial passes, joined by steps
    passes: int = Field(default=0, ge=0, le=100)  # axial passes; 0: as many as the swath requires
    again: bool = True  # scan missed parts once more if the procedure requires it
    procedure: CrackProcedure = CrackProcedure()

    def get_least_pitch(self, robot: Robot) -> float:
        """Return the least distance (m) of passes: they overlap, down to 1 mm."""
        return 0.001

    def get_gap_limit(self) -> float | None:
        """Return the largest gap (m) that the procedure accepts."""
        return self.procedure.gap_max_m
