"""Procedures of an inspection: agreed on before the flight, and stated in its report."""

from __future__ import annotations

from typing import Any

import tomli_w
from pydantic import Field

from skywright.core.spec import Fraction, Spec
from skywright.inspection.history.entries import Procedure


class ThicknessProcedure(Spec):
    """Procedure of a wall thickness measurement: reference block and acceptance criteria."""

    name: str = "contact thickness, echo to echo"  # title in the report
    revision: str = "0"  # of the procedure, in the report
    block_thin_m: float = Field(default=0.005, ge=0.0005, le=0.5)  # thin step of the block
    block_thick_m: float = Field(default=0.0125, ge=0.0005, le=0.5)  # thick step of the block
    velocity_m_per_s: float = Field(default=5920.0, ge=500, le=15000)  # of the block's steel
    nominal_m: float = Field(default=0.01, ge=0.0005, le=0.5)  # nominal wall thickness
    # standard deviation of the wall's velocity from the block's
    velocity_fraction: float = Field(default=0.003, ge=0, le=0.1)
    snr_db: float = Field(default=12.0, ge=0, le=60)  # of each echo over the noise
    least_height_fraction: Fraction = 0.2  # of full screen, first echo
    steady_m: float = Field(default=5e-5, ge=1e-6, le=0.01)  # largest range of readings that agree
    # number of readings that agree
    steady_count: int = Field(default=5, ge=2, le=100)
    steady_s: float = Field(default=0.3, ge=0, le=60)  # least duration of these readings


class CrackProcedure(Spec):
    """Procedure of a search for surface cracks: reference block, threshold and coverage."""

    name: str = "eddy-current surface scan"  # title in the report
    revision: str = "0"  # of the procedure, in the report
    notch_m: float = Field(default=0.001, ge=1e-5, le=0.05)  # depth of the reference notch
    coating_m: float = Field(default=0.0, ge=0, le=0.002)  # of the part; a shim at the set-up
    threshold_percent: float = Field(default=15.0, ge=1, le=100)  # of full screen height
    gap_max_m: float = Field(default=0.0005, ge=1e-5, le=0.002)  # largest gap that counts
    overlap_fraction: Fraction = 0.1  # of a coil's width, between passes
    coverage_fraction: Fraction = 0.95  # required fraction of the sector
    hole_max_m: float = Field(default=0.005, ge=1e-4, le=1.0)  # largest circle without a coil
    # standard deviation of a pass, across it, without gusts; the mission adds that of its wind
    lateral_std_m: float = Field(default=0.0005, ge=0, le=0.02)
    track_std_m: float = Field(default=0.0015, ge=1e-5, le=0.1)  # of a place, without the datum


def write_procedure(
    procedure: ThicknessProcedure | CrackProcedure, instrument: Spec, keys: tuple[str, ...],
    **more: Any,
) -> Procedure:  # fmt: skip
    """Return a procedure with its text: its own keys, the `keys` of the instrument, and `more`.

    `more` are values of the task, such as the speed. Values that only the simulation has, such as
    the noise of the instrument, are not part of a procedure.
    """
    table = instrument.model_dump()
    tables = {
        "procedure": procedure.model_dump(),
        "instrument": {key: table[key] for key in keys},
        "task": more,
    }
    return Procedure(procedure.name, procedure.revision, tomli_w.dumps(tables))
