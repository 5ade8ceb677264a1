"""Double-sided tape on a carried sensor: it bonds under pressure and separates at a pull."""

from typing import Literal

from skywright.core.spec import Positive
from skywright.description.world.thing import Thing


class Tape(Thing):
    """Tape between a sensor and the surface on which it is pressed; it has no pose in W.

    The bond strength grows with the impulse of pressing: strength * (1 - exp(-impulse / press)).
    When the hand pulls back, tape and holder stretch until the weaker of bond and holder releases.
    If the holder releases, the sensor stays on the surface. If the bond releases, it comes off.
    """

    kind: str = "tape"
    hand: Literal["left", "right"] = "left"
    strength_n: Positive = 5.0  # of the bond, in tension, after long pressing
    press_n_s: Positive = 4.0  # N s, impulse of pressing that gives 63 % of the strength
    release_n: Positive = 1.0  # pull at which the holder releases the sensor
    stiffness_n_per_m: Positive = 1000.0  # of tape and holder together

    def describe(self) -> str:
        """Return a description with the hand and the bond strength."""
        return f"tape in the {self.hand} hand that bonds with up to {self.strength_n:g} N"
