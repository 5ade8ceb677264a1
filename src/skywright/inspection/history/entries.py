"""Records of the database, one class per kind of entry. Positions are in the frame of the asset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from skywright.inspection.files.nde import EddyScan, UltrasonicScan

DISPOSITIONS = ("open", "accept", "monitor", "repair", "false call")
STAGES = ("before", "after")
COVERAGE = 2.0
"""Coverage factor: ratio of u95 to the standard deviation."""


class Reading(NamedTuple):
    """One reading of an instrument at a position, accepted or refused with the reason."""

    quantity: str  # "thickness", "coating", "force"
    value: float | None  # None: no value could be read
    unit: str
    u95: float | None  # expanded uncertainty, 95 %, of the value
    x_m: float  # position in the frame of the asset
    y_m: float
    z_m: float
    place_u95_m: float | None = None  # within the flight, without the registration error
    accepted: bool = True
    reason: str = ""  # for accepting or refusing it
    spot: str = ""  # name of the location, if it has one
    data: str = ""  # file and path of the A-scan or the signal


class Indication(NamedTuple):
    """One indication of a flaw. Unknown sizes are None."""

    kind: str  # "crack", "pit", "weld"
    x_m: float
    y_m: float
    z_m: float
    place_u95_m: float | None = None
    length_mm: float | None = None
    depth_mm: float | None = None
    depth_u95_mm: float | None = None
    amplitude: float | None = None
    amplitude_unit: str = ""
    data: str = ""


class Datum(NamedTuple):
    """A mark on the asset, with its position in the frame of the asset or of a flight."""

    name: str
    x_m: float
    y_m: float
    z_m: float
    u95_m: float  # of each coordinate

    @property
    def place(self) -> tuple[float, float, float]:
        """Position (m)."""
        return self.x_m, self.y_m, self.z_m


class Calibrated(NamedTuple):
    """A calibration or its check, before or after a flight."""

    method: str  # "UT" or "ET"
    model: str
    serial: str
    stage: str  # "before" or "after"
    block: str
    settings: Mapping[str, float | str]  # velocity_mps, zero_us, gain_db, phase_deg, ...
    passed: bool
    note: str = ""


class Missed(NamedTuple):
    """A requested part that was not inspected: two opposite corners or ends on the surface."""

    reason: str
    start: tuple[float, float]  # m, along the surface's first coordinate and across it
    end: tuple[float, float]
    extent_m: float = 0.0  # largest extent; 0: a spot


class Coverage(NamedTuple):
    """The requested and the inspected amount of surface or spots of a flight."""

    unit: str  # "m2" of surface, or "spots"
    asked: float
    inspected: float
    missed: tuple[Missed, ...] = ()


class Procedure(NamedTuple):
    """An inspection procedure that was agreed before the flight, with its name and revision."""

    name: str
    revision: str
    text: str  # TOML


class Entries(NamedTuple):
    """Entries that one flight adds. Times are in seconds after its start."""

    component: str = ""
    readings: tuple[tuple[float, Reading], ...] = ()
    indications: tuple[tuple[float, Indication], ...] = ()
    calibrations: tuple[tuple[float, Calibrated], ...] = ()
    coverage: Coverage | None = None
    material: str = ""  # of the component; "": not stated
    nominal_mm: float | None = None  # nominal wall thickness of the component
    registration_std_m: float | None = None
    """Registration error of the flight's frame in that of the asset, if the flight saw a datum."""
    scans: tuple[tuple[str, UltrasonicScan | EddyScan], ...] = ()
    """(file name, signal) of each .nde file in the run's directory; `data` refers to the name."""


class StoredFlight(NamedTuple):
    """A stored flight."""

    id: str
    started_utc: str
    asset: str
    mission: str
    robot: str
    seed: int
    run: str
    simulated: bool
    procedure: int | None
    registration_std_m: float | None  # of the flight's frame in that of the asset; None: unknown


class StoredReading(NamedTuple):
    """A reading with its flight and component."""

    id: int
    flight: str
    asset: str
    component: str | None
    calibration: int | None
    time_utc: str
    simulated: bool
    registration_std_m: float | None
    reading: Reading


class StoredIndication(NamedTuple):
    """An indication with its flight, component, and the last disposition."""

    id: int
    flight: str
    asset: str
    component: str | None
    time_utc: str
    simulated: bool
    registration_std_m: float | None
    indication: Indication
    disposition: str  # "open" until somebody decides
    decided: str  # who, when and why, "" while it is open


class StoredComponent(NamedTuple):
    """A component with its nominal and required wall thickness."""

    id: int
    asset: str
    name: str
    material: str
    nominal_mm: float | None
    required_mm: float | None


class StoredProcedure(NamedTuple):
    """One revision of a procedure."""

    id: int
    name: str
    revision: str
    text: str
    sha256: str


class StoredCoverage(NamedTuple):
    """A coverage with its component."""

    id: int
    flight: str
    component: str | None
    coverage: Coverage


class StoredCalibration(NamedTuple):
    """A calibration with its instrument."""

    id: int
    flight: str | None
    time_utc: str
    calibrated: Calibrated
