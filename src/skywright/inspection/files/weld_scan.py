"""A weld scan of a run as the impedance of one coil over the pipe's unrolled surface."""

import numpy as np

from skywright.errors import InputError
from skywright.inspection.calibration import to_complex
from skywright.inspection.files.nde import EddyScan
from skywright.inspection.weld_data import WeldReport
from skywright.models.eddy_current import Instrument

WALL = 0.01
"""m; a world's pipe has no wall, and the format requires one (assumed)."""


def build_eddy_scan(report: WeldReport) -> EddyScan:
    """Return the samples of touch and scan with their places (s, c); u is s and v is c.

    Samples without a place, far from the surface, are left out. Raises InputError without any.
    """
    result, scan = report.result, report.scan
    placed = np.isfinite(result.s + result.c)
    if len(result.s) != len(scan.t) or np.count_nonzero(placed) < 2:
        raise InputError(f"{report.name}: no samples with a place on the surface for .nde")
    t = scan.t[placed]
    return EddyScan(
        to_complex(scan.ec[placed])[None, :], np.column_stack([result.s, result.c])[placed],
        np.zeros((1, 2)), Instrument().frequency, 1.0, 1.0 / float(np.median(np.diff(t))), WALL,
        ("simulated absolute coil", ""), True,
    )  # fmt: skip
