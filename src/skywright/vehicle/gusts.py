"""Motion of a hovering platform in gusts, with or without a hanging link."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from skywright.description.world.spec import Wind


class GustMotion(NamedTuple):
    """Motion in one wind."""

    place: float  # m, rms of the horizontal position
    swing: float  # rad, rms of the joint
    settle: Callable[[float], float]  # share of a released link's angle -> settling time (s)


GustModel: TypeAlias = Callable[[Wind], GustMotion]
