"""An interrupt that is not lost.

Python raises KeyboardInterrupt wherever the program happens to be. In a callback from C, as while
numba compiles, it is printed and forgotten; so it is also noted, and whoever loops asks.
"""

from __future__ import annotations

import signal
from typing import NoReturn

_noted = False


def listen() -> None:
    """Note SIGINT, unless it is ignored, and SIGTERM: a polite kill ends a run as Ctrl-C does."""
    global _noted
    _noted = False
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, _interrupt)


def check_interrupt() -> None:
    """Raise KeyboardInterrupt when one came since the last call."""
    global _noted
    if _noted:
        _noted = False
        raise KeyboardInterrupt


def _interrupt(number: int, frame: object) -> NoReturn:
    global _noted
    _noted = True
    raise KeyboardInterrupt
