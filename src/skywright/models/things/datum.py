"""A datum: a mark on the pipe or structure that is the origin of asset coordinates."""

from __future__ import annotations

from skywright.description.world.datum import DatumThing


class Datum(DatumThing):
    """A printed mark that the probe's camera measures (`[robot.probe.camera]`); no geometry.

    Touches do not measure the robot's position along and around a pipe, or along a wall. The mark
    does: its centre is at (`s_m`, `around_deg`) on the pipe, or at (`x_m`, `y_m`) in the frame S of
    the structure, in asset coordinates.
    """

    kind: str = "datum"
