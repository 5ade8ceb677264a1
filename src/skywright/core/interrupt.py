"""Interrupts that are not lost.

Python raises KeyboardInterrupt at any point of the program. In a callback from C, as while numba
compiles, it is printed and discarded. It is therefore also stored, for loops to check.
"""

from __future__ import annotations

import signal
from typing import NoReturn

_noted = False


def listen() -> None:
    """Handle SIGINT, unless it is ignored, and SIGTERM, which ends a run as Ctrl-C does."""
    global _noted
    _noted = False
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, _interrupt)


def check_interrupt() -> None:
    """Raise KeyboardInterrupt if one occurred since the last call."""
    global _noted
    if _noted:
        _noted = False
        raise KeyboardInterrupt


def _interrupt(number: int, frame: object) -> NoReturn:
    global _noted
    _noted = True
    raise KeyboardInterrupt
