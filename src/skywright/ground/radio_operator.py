"""An operator behind a radio link: views and sticks arrive late.

The operator's view is sent down as the newest state, or as the newest picture of a video; the stick
is sent up as a command at each mission tick. The robot judges the age of the newest stick by the
rules of the gateway: beyond 0.25 s more than the usual delay it counts as released.
"""

from __future__ import annotations

import math
from typing import Any

from skywright.description.world.radio import Radio
from skywright.links.radio import COMMAND, STATE, VIDEO, build_ways
from skywright.links.udp.packets import find_kind, get_size
from skywright.run.operator import STILL, Operator, Sight, Stick

STATE_BYTES, STICK_BYTES = get_size(find_kind("state")), get_size(find_kind("stick"))
LET_GO_S = find_kind("stick").old_s


class RadioOperator:
    """An operator (of run/operator.py) behind a radio link, in simulated time."""

    def __init__(self, operator: Any, radio: Radio, seed: int) -> None:
        """`radio` must be enabled; `seed` is the run's."""
        ways = build_ways(radio, seed)
        assert ways is not None
        self.operator, self.radio = operator, radio
        self._up, self._down = ways
        self._sight: Sight | None = None
        self._stick, self._stamp = STILL, -math.inf
        self._least = math.inf  # s, shortest delay of a received stick
        self._picture = 0.0  # s, time of the next picture
        self._began = False

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Return the stick that has reached the robot at `t` (s); zero if it is too old."""
        self._show(t, sight)
        for seen in self._down.receive(t):
            if seen is not None:
                self._sight = seen
        if self._sight is not None:
            stick = self.operator.read(t if self._began else 0.0, self._sight)
            self._began = True
            if stick is None:
                return None
            self._up.send(t, COMMAND, STICK_BYTES, (t, stick))
        for stamp, stick in self._up.receive(t):
            self._stick, self._stamp = stick, stamp
            self._least = min(self._least, t - stamp)
        heard = math.isfinite(self._stamp)
        return self._stick if heard and t - self._stamp - self._least <= LET_GO_S else STILL

    def _show(self, t: float, sight: Sight) -> None:
        """Send the view: the state, and pictures if there is a video."""
        video = self.radio.video_kbps > 0.0
        self._down.send(t, STATE, STATE_BYTES, None if video else sight)
        if video and t >= self._picture - 1e-9:
            self._picture = t + 1.0 / self.radio.video_rate_hz
            size = round(125.0 * self.radio.video_kbps / self.radio.video_rate_hz)
            self._down.send(t, VIDEO, size, sight)

    def close(self) -> None:
        """Close the operator."""
        close = getattr(self.operator, "close", None)
        if close is not None:
            close()


def add_radio(operator: Operator | None, radio: Radio, seed: int) -> Operator | None:
    """Return the operator, behind the radio if there is one."""
    if operator is None or not radio.present:
        return operator
    return RadioOperator(operator, radio, seed)
