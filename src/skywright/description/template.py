"""`skywright new robot`: a commented robot file and a mission that flies it."""

from __future__ import annotations

import re
from pathlib import Path

from skywright.errors import InputError

TEMPLATE = Path(__file__).parent / "robot" / "template"


def write_robot_template(folder: Path) -> Path:
    """Write `robot.toml` and `mission.toml` into a new folder named after the robot.

    Raises InputError when the name is no plain name, or one of the files is there already.
    """
    name = folder.name
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", name):
        raise InputError(
            f"robot name {name!r}: use letters, digits, dots, dashes and underscores (at most 64)"
        )
    files = {f: (TEMPLATE / f).read_text(encoding="utf-8") for f in ("robot.toml", "mission.toml")}
    for file in files:
        if (folder / file).exists():
            raise InputError(f"{folder / file}: is there already and is not overwritten")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            (folder / file).write_text(text.replace("@NAME@", name), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return folder
