"""Check the file of a user's law before any flight."""

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
    """Build and compile the mission's law if it is a user's. Raises InputError for errors in its
    file.

    If the law or its robot refuses the mission, the flights report it. This check therefore ignores
    an InputError that the law's own code raises, or that occurs before its code runs.
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
