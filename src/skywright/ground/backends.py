"""Back ends that a page may choose, and why one cannot fly the requested mission.

A separate process answers this question: loading a mission takes seconds during which the station's
pages would stall. It reads one JSON object and writes one:

    python -m skywright.ground.backends < {"asked": Asked, "names": [NAME, ...]}
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from skywright.errors import InputError, SkywrightError
from skywright.ground.flights import Asked
from skywright.run.backends import (
    KINEMATIC,
    MAVLINK,
    PHYSICS,
    PX4,
    check_backend,
    choose_backend,
    split_backend,
)

WHAT = {
    PHYSICS: "simulation with forces, contact, sensors and wind",
    KINEMATIC: "references are followed exactly, without forces, contact or sensors",
    PX4: "the simulation, its platform flown by PX4: start PX4 beside it",
    MAVLINK: "a vehicle over MAVLink flies the platform",
}
NO_ADDRESS = "a page names no addresses; start the station with --backend mavlink:URL to offer it"
PATIENCE_S = 60.0
"""s, time limit of the answer."""
MOST_SAYS = 400  # characters, longest reason


def list_backends(given: Iterable[str]) -> dict[str, str]:
    """Return the choices of a page: name -> description; `given` are those of the command line.

    Raises InputError if one of these is invalid.
    """
    for name in given:
        choose_backend(name)
    linked = {name: WHAT[split_backend(name)[0]] for name in given}
    has_vehicle = any(split_backend(name)[0] == MAVLINK for name in given)
    return {k: v for k, v in WHAT.items() if k != MAVLINK or not has_vehicle} | linked


def find_refusals(asked: Asked, names: Iterable[str]) -> dict[str, str]:
    """Return the back ends that cannot fly the request, each with the reason.

    Raises SkywrightError if no back end can.
    """
    from skywright.description.loader import load_description
    from skywright.run.setup import Setup

    asked.check()
    setup = Setup(load_description(asked.mission, asked.robot, asked.world, asked.sets, asked.seed))
    found: dict[str, str] = {}
    for name in names:
        try:
            if name == MAVLINK:
                raise InputError(NO_ADDRESS)
            check_backend(setup, name)
        except SkywrightError as error:
            found[name] = str(error)[:MOST_SAYS]
    return found


async def ask(asked: Asked, names: Iterable[str]) -> dict[str, Any]:
    """Return {"refused": {NAME: REASON}}, or {"wrong": REASON} if no back end can fly it."""
    question = json.dumps({"asked": asked._asdict(), "names": list(names)}).encode()
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "skywright.ground.backends", stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        told, _ = await asyncio.wait_for(process.communicate(question), PATIENCE_S)
        return dict(json.loads(told))
    except (TimeoutError, ValueError):
        return {"wrong": "the back ends could not be judged; `skywright run` states the reason"}
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def main() -> None:
    """Answer the question on standard input."""
    question = json.load(sys.stdin)
    asked = Asked(**{**question["asked"], "sets": tuple(question["asked"]["sets"])})
    try:
        told: dict[str, Any] = {"refused": find_refusals(asked, question["names"])}
    except SkywrightError as error:
        told = {"wrong": str(error)[:MOST_SAYS]}
    print(json.dumps(told))


if __name__ == "__main__":
    main()
