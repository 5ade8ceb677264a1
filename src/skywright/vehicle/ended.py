"""The error of a vehicle that no longer accepts commands."""

from __future__ import annotations

from skywright.errors import SimulationError


class VehicleEnded(SimulationError):
    """The vehicle no longer follows commands, or refused to start; the mission ends.

    Raised by `tick` of a back end with a vehicle outside the simulation.
    """
