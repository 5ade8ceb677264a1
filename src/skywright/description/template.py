"""`skywright new WHAT NAME`: commented files that run unchanged.

The templates are the folders of `templates/`: each contains the files of one template. In names and
contents @NAME@ becomes the name, @MODULE@ and @CLASS@ the same as a Python module and class; a
suffix `.in` of a file's name is removed.
"""

from __future__ import annotations

import keyword
import re
from pathlib import Path

from skywright.errors import InputError, neighbours

TEMPLATES = Path(__file__).parent / "templates"
LONGEST = 64  # characters of a name of a mission, a robot or a world


def list_templates() -> list[str]:
    """List the names of the templates."""
    return sorted(folder.name for folder in TEMPLATES.iterdir() if folder.is_dir())


def write_template(what: str, folder: Path) -> list[Path]:
    """Write the template of `what` into a folder with the name of the new object; return its files.

    Raises InputError if the name is not a plain name or belongs to a built-in part, or if one of
    the files exists.
    """
    if what not in list_templates():
        raise InputError(f"no template for {what!r}; valid: {neighbours(what, list_templates())}")
    name = folder.name
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9._-]{0,63}", name):
        raise InputError(
            f"{what} name {name!r}: use letters, digits, dots, dashes and underscores (at most "
            "64), a letter first"
        )
    _check_length(what, name)
    words = [word for word in re.split(r"[._-]+", name) if word]
    marks = {
        "@NAME@": name,
        "@MODULE@": "_".join(words).lower(),
        "@CLASS@": "".join(word[0].upper() + word[1:] for word in words),
    }
    _check_free(what, name, marks["@MODULE@"], marks["@CLASS@"])
    files = {}
    for source in sorted((TEMPLATES / what).iterdir()):
        text, target = source.read_text(encoding="utf-8"), source.name.removesuffix(".in")
        for mark, value in marks.items():
            text, target = text.replace(mark, value), target.replace(mark, value)
        files[folder / target] = text
    for file in files:
        if file.exists():
            raise InputError(f"{file}: already exists and is not overwritten")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return list(files)


def _check_length(what: str, name: str) -> None:
    """Raise InputError if the name of the template's mission, such as NAME-waypoints, is too
    long."""
    texts = (file.read_text(encoding="utf-8") for file in (TEMPLATES / what).iterdir())
    tails = [tail for text in texts for tail in re.findall(r'^name = "@NAME@(.*)"', text, re.M)]
    tail = max(tails, key=len, default="")
    if len(name) + len(tail) > LONGEST:
        raise InputError(
            f"{what} name {name!r}: at most {LONGEST - len(tail)} characters; its mission is named "
            f"{name}{tail}"
        )


def _check_free(what: str, name: str, module: str, class_name: str) -> None:
    """Raise InputError for a name that commands or Python would read as something else."""
    from skywright.core.find import list_kinds
    from skywright.description.loader import list_missions
    from skywright.description.robot.loader import list_robots
    from skywright.description.world.loader import list_worlds

    has_module = any("@MODULE@" in file.name for file in (TEMPLATES / what).iterdir())
    for word in (module, class_name):
        if has_module and keyword.iskeyword(word):
            raise InputError(f"{what} name {name!r}: {word} is a keyword of Python; choose another")
    listings = {"robot": list_robots, "world": list_worlds, "mission": list_missions}
    taken = {entry.name: kind for kind, listing in listings.items() for entry in listing()}
    if what not in listings:
        taken |= dict.fromkeys(list_kinds(what), what)
    for one in (name, module):
        if one in taken:
            raise InputError(
                f"{what} name {name!r}: {one} is the name of an existing {taken[one]}; choose "
                "another"
            )
