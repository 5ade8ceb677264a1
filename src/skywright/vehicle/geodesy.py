"""Places on the earth as places in W: WGS 84, by pymap3d."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.world.origin import Origin
from skywright.errors import InputError
from skywright.vehicle.arguments import check_number

Array = NDArray[np.float64]


class Geodetic(NamedTuple):
    """A place in WGS 84."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float  # above the same zero as that of the origin

    @classmethod
    def check(cls, latitude: float, longitude: float, altitude: float) -> Geodetic:
        """Return a position; raises InputError if it is invalid."""
        place = cls(
            check_number("latitude", latitude), check_number("longitude", longitude),
            check_number("altitude", altitude),
        )  # fmt: skip
        for name, limit in (("latitude_deg", 90.0), ("longitude_deg", 180.0)):
            value = getattr(place, name)
            if abs(value) > limit:
                raise InputError(f"{name[:-4]} = {value:g} deg; valid: {-limit:g} to {limit:g}")
        return place


def to_local(origin: Origin, place: Geodetic) -> Array:
    """Return the place (3,) m in W, whose origin lies at `origin` (x east, y north, z up)."""
    from pymap3d import geodetic2enu

    at = geodetic2enu(
        *place, origin.latitude_deg, origin.longitude_deg, origin.altitude_m
    )  # fmt: skip
    return np.array([float(x) for x in at])


def to_geodetic(origin: Origin, p: Array) -> Geodetic:
    """Return the WGS 84 position of the point p (3,) m in W."""
    from pymap3d import enu2geodetic

    at = enu2geodetic(*p, origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
    return Geodetic(*(float(x) for x in at))
