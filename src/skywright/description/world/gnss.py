"""Satellite navigation: accuracy of its fixes, by kind of fix."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from pydantic import Field

from skywright.core.spec import Fraction, NonNegative, Positive, Spec


class FixErrors(NamedTuple):
    """Errors (1 sigma) of a kind of fix; horizontal ones apply to each of x and y."""

    noise_level_m: float  # independent from fix to fix
    noise_up_m: float
    drift_level_m: float  # correlated in time: atmosphere, orbits, multipath
    drift_up_m: float
    drift_time_s: float  # correlation time of the drift
    heading_noise_deg: float
    heading_error_deg: float  # constant through a flight, drawn once


FIXES = {
    # A receiver of two frequencies with corrections from a base station (u-blox ZED-F9P's data
    # sheet: 0.01 m + 1 ppm CEP level and R50 up, so 0.0085 and 0.015 m a sigma an axis), and its
    # heading from two antennas 1 m apart (0.4 deg). How much of it is slow: assumed, carrier
    # multipath has a time constant of 0.5 to 2 minutes.
    "rtk": FixErrors(0.005, 0.0075, 0.007, 0.013, 60.0, 0.4, 0.1),
    # A receiver by itself (u-blox M8's data sheet: 2.5 m CEP, 2.1 m a sigma an axis; up 1.7 times
    # that, the usual ratio of the dilutions of precision), and the heading of a magnetometer. White
    # part, time constant (minutes, ionosphere and code multipath) and errors of the magnetometer
    # near steel: assumed.
    "plain": FixErrors(0.2, 0.35, 2.1, 3.5, 200.0, 1.0, 3.0),
}


class Gnss(Spec):
    """A receiver on the robot. Unset numbers are those of the kind of fix."""

    fix: Literal["rtk", "plain"] = "rtk"
    rate_hz: float = Field(default=10.0, gt=0, le=50)
    latency_s: float = Field(default=0.11, ge=0, le=0.2)  # PX4's default, EKF2_GPS_DELAY
    dropout_fraction: Fraction = 0.0
    noise_level_m: NonNegative | None = None
    noise_up_m: NonNegative | None = None
    drift_level_m: NonNegative | None = None
    drift_up_m: NonNegative | None = None
    drift_time_s: Positive | None = None
    heading_noise_deg: NonNegative | None = None
    heading_error_deg: NonNegative | None = None

    @property
    def errors(self) -> FixErrors:
        """Errors of the fixes, as set or by the kind of fix."""
        given = {n: getattr(self, n) for n in FixErrors._fields}
        return FIXES[self.fix]._replace(**{n: v for n, v in given.items() if v is not None})

    def fill(self) -> Gnss:
        """Return the table with all numbers set."""
        return self.model_copy(update=self.errors._asdict())

    @property
    def position_error_m(self) -> float:
        """Standard deviation of the distance (3-D) between a fix and the truth."""
        e = self.errors
        level = e.noise_level_m**2 + e.drift_level_m**2
        return math.sqrt(2.0 * level + e.noise_up_m**2 + e.drift_up_m**2)
