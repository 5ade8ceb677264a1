"""The view of a run at a ground station, which started the run or is started beside it."""

from __future__ import annotations

import socket
from pathlib import Path

from skywright.errors import InputError
from skywright.ground.feed import Feed
from skywright.ground.page_operator import PageOperator
from skywright.ground.serve import Beside
from skywright.ground.server import Address
from skywright.links.pair import prepare
from skywright.run.backends import PHYSICS

WAIT_S, STAY_S = 20.0, 3.0
"""s for which a watched run waits for the first page, and for which it keeps its last picture."""


class Watching:
    """The feed of a run and, if started beside it, the station."""

    def __init__(
        self, person: object, station: str | None, address: Address | None = None,
        backend: str = PHYSICS,
    ) -> None:  # fmt: skip
        """`person` is at the stick, or None; `station` is FD:FOLDER of a station that already
        waits.

        `backend` flies.
        """
        self._beside: Beside | None = None
        if station is None:
            self._beside = Beside(address or Address())
            end, folder, stay_s = self._beside.end, self._beside.folder, STAY_S
        else:
            (end, folder), stay_s = _find_station(station), 0.0
        self.feed = Feed(end, folder, wait_s=WAIT_S, stay_s=stay_s, backend=backend)
        if isinstance(person, PageOperator):
            person.feed = self.feed

    def close(self) -> None:
        """Close the station."""
        if self._beside is not None:
            self._beside.close()
        else:
            self.feed.end.close()


def _find_station(text: str) -> tuple[socket.socket, Path]:
    number, _, folder = text.partition(":")
    try:
        end = socket.socket(fileno=int(number))
    except (ValueError, OSError):
        raise InputError(
            f"--station {text[:80]!r}: no such socket; this option is internal to `skywright serve`"
        ) from None
    prepare(end)
    return end, Path(folder)
