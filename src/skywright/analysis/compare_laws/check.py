"""Whether the file of a law is right, told before anything flies."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import Any

from skywright.core.find import find
from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.run.backends import build_vehicle
from skywright.run.parts import build_law
from skywright.run.setup import Setup


def check_law(description: Description[Any]) -> None:
    """Build and compile the mission's law if it is a user's; raises InputError for its file.

    What a law or its robot refuses is a result of its flights, and none of this check: an
    InputError that the law's own code raises, or that comes before its code is asked.
    """
    part = description.law
    file = None if part is None else find("law", part.kind).file
    if file is None:
        return
    try:
        setup = Setup(description)
        build_law(description, setup)
    except InputError:
        return
    try:
        build_vehicle(description, setup=setup).close()
    except InputError as error:
        frames = traceback.extract_tb(error.__traceback__)
        if not any(Path(frame.filename) == file for frame in frames):
            raise InputError(f"mission.law: {file}: {error}") from error
