"""The array of a crack search and its display: set up before the flight, checked after it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array as Numbers
from skywright.core.streams import build_stream
from skywright.errors import InputError
from skywright.inspection.notch_setup import (
    NotchSetup,
    SetupCheck,
    check_block,
    check_setup,
    set_up,
)
from skywright.missions.skills.instrument import Carried, find_instrument
from skywright.models.block_scan import LIFT, BlockScan, compute_true_gain, simulate_block_scan
from skywright.models.crack_signal import Metal
from skywright.models.things.notch_block import NotchBlock
from skywright.run.setup import Setup
from skywright.vehicle.sensors.eddy_array import EddyArray

Array = Carried[EddyArray.Table]
SHIMS = 11
"""Number of thicknesses at which the lift-off is measured, 0 to 1 mm."""


def find_array(setup: Setup[Any]) -> Array:
    """Return the robot's array; raises InputError if it has none, or a differential one."""
    array: Array = find_instrument(setup, EddyArray, "eddy-current array")
    if array.table.layout == "differential":
        raise InputError(
            f"robot.sensors.{array.name}.layout: {array.table.layout!r} cannot be used to "
            "search for cracks; valid: 'absolute'"
        )
    return array


class Display(NamedTuple):
    """A display that was set up on a block."""

    setup: NotchSetup
    shims: Numbers  # (k,) m
    lifted: Numbers  # (k,) complex display units, over each shim on sound metal; 0 in air

    def measure_gaps(self, z: Any, air: Any) -> Numbers:
        """Return the gap (n, k) m under each coil from its lift-off, for signals `z` (n, k).

        `air` (k,) are the signals far from metal. The lift-off is measured from them, because the
        instrument is nulled elsewhere on the block. The coating is subtracted: the median reading
        of a coil counts as contact. The gap is NaN beyond the thickest shim.
        """
        size, known = np.abs(np.asarray(z) - air), np.abs(self.lifted)
        gap = np.interp(size, known[::-1], self.shims[::-1])
        gap[size < known[-1]] = np.nan
        some = np.isfinite(gap).any(axis=0)
        return np.asarray(gap - np.nanmedian(np.where(some, gap, 0.0), axis=0))


def set_up_display(setup: Setup[Any], array: Array) -> Display:
    """Set up the display on the block before the flight, and measure its lift-off over shims.

    The block is the world's (`kind = "notch_block"`), or one of the pipe's material. Raises
    InputError for a block of another material, or without the procedure's notch.
    """
    scan = _visit(setup, array, 0.0)
    done, shims = set_up(scan), np.linspace(0.0, LIFT, SHIMS)
    at = np.linspace(0, len(scan.lift) - 1, SHIMS).round().astype(int)
    lifted = np.array([np.mean(scan.lift[max(i - 1, 0) : i + 2]) for i in at])
    return Display(done, shims, lifted)


def check_display(setup: Setup[Any], array: Array, done: NotchSetup, seconds: float) -> SetupCheck:
    """Scan the block again, `seconds` after the set-up."""
    return check_setup(done, _visit(setup, array, seconds))


def _visit(setup: Setup[Any], array: Array, seconds: float) -> BlockScan:
    pipe, notch = setup.world.pipe, setup.task.procedure.notch_m
    assert pipe is not None
    metal = part = Metal(pipe.conductivity_s_per_m, pipe.relative_permeability)
    for thing in setup.world.things.values():
        if isinstance(thing, NotchBlock):
            metal = Metal(thing.conductivity_s_per_m, thing.relative_permeability)
            check_block(metal, part)
            if not any(abs(notch - depth) < 1e-6 for depth in thing.notches_m):
                raise InputError(
                    f"mission.task.procedure.notch_m: {notch:g}; the reference block has notches "
                    f"of {', '.join(f'{x:g}' for x in thing.notches_m)} m"
                )
    t = array.true
    when = "after" if seconds else "before"
    gain = compute_true_gain(
        t.gain_db, t.phase_deg, t.gain_drift_db, t.phase_drift_deg, seconds
    )  # fmt: skip
    return simulate_block_scan(
        metal, t.build_coil(), t.build_instrument(),
        build_stream(setup.description.mission.seed, "block", when),
        notch_depth=notch, gain=gain, paint=setup.task.procedure.coating_m,
    )  # fmt: skip


def place_coils(
    array: Array, s: Any, c: Any, R_WT: Any, R_WP: Any, phi: Any
) -> tuple[Any, Any]:  # fmt: skip
    """Return the places (n, k) m of the coils on the unrolled surface.

    `s`, `c` (n,) m are those of the tip; `R_WT` (n, 3, 3) is its attitude; `R_WP` (3, 3) that of
    the pipe; `phi` (n,) rad the angle around it.
    """
    table = array.table
    turn = np.radians(table.axis_deg)
    along = np.cos(turn) * R_WT[:, :, 0] + np.sin(turn) * R_WT[:, :, 1]
    around = np.sin(phi)[:, None] * R_WP[:, 0] + np.cos(phi)[:, None] * R_WP[:, 2]
    offset = np.zeros(1)
    if table.coils > 1:
        offset = np.linspace(-0.5, 0.5, table.coils) * table.width_m
    ds, dc = along @ R_WP[:, 1], np.sum(along * around, axis=1)
    return s[:, None] + ds[:, None] * offset, c[:, None] + dc[:, None] * offset
