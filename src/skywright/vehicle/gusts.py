"""What gusts do to a platform that holds its place with a link hanging from it."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from skywright.description.world.spec import Wind


class GustMotion(NamedTuple):
    """In one wind."""

    place: float  # m, rms, level
    swing: float  # rad, rms of the joint
    settle: Callable[[float], float]  # share of the angle of a link let go -> s until it is below


GustModel: TypeAlias = Callable[[Wind], GustMotion]
