"""The options `--ros2` and `--foxglove`, checked before anything is started."""

from __future__ import annotations

import math
import os
import re
from importlib.util import find_spec
from typing import NamedTuple

from skywright.errors import InputError, naming_arguments

DISTRO = "jazzy"
ENDPOINT, PORT = "tcp/127.0.0.1:7447", 8765
"""Default address of the Zenoh router of ROS 2 nodes, and default port of Foxglove."""
ADDRESS = re.compile(r"tcp/(\[[0-9a-fA-F:]+\]|[\w.-]+):(\d{1,5})")


OPTIONS = {
    "ros2": "--ros2", "distro": "--ros2-distro", "foxglove": "--foxglove", "wait_s": "--await",
}  # fmt: skip
"""Options of the command line by the attributes of Live."""


class Live(NamedTuple):
    """Publication of a flight: `Live(ros2=True)`, `Live(foxglove=8765)`."""

    ros2: str | bool | None = None
    """Zenoh endpoint; True: ENDPOINT."""
    distro: str | None = None
    """ROS 2 distribution; None: DISTRO."""
    foxglove: int | bool | None = None
    """Port, 0: a free one; True: PORT."""
    wait_s: float = 0.0
    """s, longest wait of the flight for the first subscriber."""
    domain: int = 0
    """ROS_DOMAIN_ID; set by `check`."""

    @property
    def wanted(self) -> bool:
        """Whether any publication is requested."""
        return self != Live()

    def list_arguments(self) -> tuple[str, ...]:
        """Return the equivalent options of `skywright run`."""
        given = {name: getattr(self, name) for name in OPTIONS} | {"wait_s": self.wait_s or None}
        return tuple(
            x for name, v in given.items() if v is not None for x in (OPTIONS[name], str(v))
        )

    @naming_arguments(**OPTIONS)
    def check(self) -> Live:
        """Return the options with the domain; raises InputError if an extra or `ros2` is missing,
        or if a value is wrong."""
        ros2, foxglove = self.ros2, self.foxglove
        if not 0.0 <= self.wait_s < math.inf:
            raise InputError(f"--await {self.wait_s}; valid: seconds, 0 or more")
        if not isinstance(ros2, str | bool | None):
            raise InputError(f"--ros2 {ros2!r}; valid: tcp/HOST:PORT")
        if not isinstance(foxglove, int | None) or not 0 <= (foxglove or 0) <= 65535:
            raise InputError(f"--foxglove {foxglove!r}; valid: a port, 0 to 65535")
        if isinstance(ros2, bool):
            ros2 = ENDPOINT if ros2 else None
        if isinstance(foxglove, bool):
            foxglove = PORT if foxglove else None
        if ros2 is None and foxglove is None:
            what = "--await" if self.distro is None else "--ros2-distro"
            raise InputError(f"{what} requires --ros2{' or --foxglove' * (what == '--await')}")
        if ros2 is not None:
            read_endpoint(ros2)
        _require("ros2", ros2 is not None, ("zenoh", "rosbags"))
        _require("foxglove", foxglove is not None, ("foxglove",))
        if ros2 is None:
            return self._replace(ros2=None, foxglove=foxglove)
        domain = os.environ.get("ROS_DOMAIN_ID", "") or "0"
        if not domain.isdecimal() or int(domain) > 232:
            raise InputError(f"ROS_DOMAIN_ID={domain[:40]!r}; valid: 0 to 232")
        return Live(ros2, self.distro or DISTRO, foxglove, self.wait_s, int(domain))


def read_endpoint(text: str) -> tuple[str, int]:
    """Return host and port of a Zenoh endpoint; raises InputError."""
    found = ADDRESS.fullmatch(text)
    if found is None or not 0 < int(found[2]) < 65536:
        raise InputError(f"--ros2 {text[:80]!r}; valid: tcp/HOST:PORT")
    return found[1], int(found[2])


def _require(extra: str, wanted: bool, modules: tuple[str, ...]) -> None:
    if wanted and any(find_spec(name) is None for name in modules):
        raise InputError(f"--{extra} needs the extra {extra!r}: pip install 'skywright[{extra}]'")
