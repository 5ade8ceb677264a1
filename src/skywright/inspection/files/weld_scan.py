"""Convert a run's weld scan to the impedance of one coil over the pipe's unrolled surface."""

import numpy as np

from skywright.errors import InputError
from skywright.inspection.calibration import to_complex
from skywright.inspection.files.nde import EddyScan
from skywright.inspection.weld_data import WeldReport
from skywright.models.eddy_current import Instrument
from skywright.recordings.period import compute_period

WALL = 0.01
"""m; assumed, because the format requires a wall and a world's pipe has none."""


def build_eddy_scan(report: WeldReport) -> EddyScan:
    """Return the samples of touch and scan at their positions (s, c); u is s and v is c.

    Samples whose (s, c) is not finite are left out. Raises InputError if fewer than two are left.
    """
    result, scan = report.result, report.scan
    placed = np.isfinite(result.s + result.c)
    if len(result.s) != len(scan.t) or np.count_nonzero(placed) < 2:
        raise InputError(f"{report.name}: no samples with a place on the surface for .nde")
    t = scan.t[placed]
    return EddyScan(
        to_complex(scan.ec[placed])[None, :], np.column_stack([result.s, result.c])[placed],
        np.zeros((1, 2)), Instrument().frequency, 1.0, 1.0 / compute_period(t), WALL,
        ("simulated absolute coil", ""), True,
    )  # fmt: skip
