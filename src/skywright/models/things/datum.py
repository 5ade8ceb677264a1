"""A datum: a mark on the pipe or structure that is the origin of asset coordinates."""

from __future__ import annotations

from skywright.description.world.datum import DatumThing


class Datum(DatumThing):
    """A printed mark that the probe's camera measures (`[robot.probe.camera]`); it has no solid.

    Touches do not show where a robot is along a pipe and around it, or along a wall. The mark does:
    its middle lies at (`s_m`, `around_deg`) on the pipe, or at (`x_m`, `y_m`) in the frame S of the
    structure, by the asset's own count.
    """

    kind: str = "datum"
