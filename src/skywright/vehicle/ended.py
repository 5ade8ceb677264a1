"""A vehicle that cannot be flown any further."""

from __future__ import annotations

from skywright.errors import SimulationError


class VehicleEnded(SimulationError):
    """What flies follows no command any more, or refused to begin: the mission is over.

    Raised by `tick` of a back end whose vehicle is not simulated here.
    """
