"""Double-sided tape on a carried sensor: bonds under pressure, releases at its weaker side."""

from typing import Literal

from skywright.core.spec import Positive
from skywright.description.world.thing import Thing


class Tape(Thing):
    """Tape between a sensor and what it is pressed on; it has no place in W.

    The bond grows with the pressing: strength * (1 - exp(-impulse / press)). While the hand pulls
    back, tape and holder stretch until the weaker of bond and holder lets go: the holder, and the
    sensor stays on the surface; the bond, and it comes off again.
    """

    kind: str = "tape"
    hand: Literal["left", "right"] = "left"
    strength_n: Positive = 5.0  # of the bond, in tension, pressed for long
    press_n_s: Positive = 4.0  # N s of pressing after which 63 % of it are reached
    release_n: Positive = 1.0  # pull at which the holder lets go of the sensor
    stiffness_n_per_m: Positive = 1000.0  # of tape and holder together

    def describe(self) -> str:
        """The sensor that carries it."""
        return f"tape in the {self.hand} hand that bonds with up to {self.strength_n:g} N"
