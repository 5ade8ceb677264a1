"""`skywright new WHAT NAME`: commented files that run unchanged.

The templates are the folders of `templates/`: each contains the files of one template. In names and
contents @NAME@ becomes the name, @MODULE@ and @CLASS@ the same as a Python module and class; a
suffix `.in` of a file's name is removed.
"""

from __future__ import annotations

import re
from pathlib import Path

from skywright.errors import InputError, neighbours

TEMPLATES = Path(__file__).parent / "templates"


def list_templates() -> list[str]:
    """List the names of the templates."""
    return sorted(folder.name for folder in TEMPLATES.iterdir() if folder.is_dir())


def write_template(what: str, folder: Path) -> list[Path]:
    """Write the template of `what` into a folder with the name of the new object; return its files.

    Raises InputError if the name is not a plain name, or if one of the files exists.
    """
    if what not in list_templates():
        raise InputError(f"no template for {what!r}; valid: {neighbours(what, list_templates())}")
    name = folder.name
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9._-]{0,63}", name):
        raise InputError(
            f"{what} name {name!r}: use letters, digits, dots, dashes and underscores (at most "
            "64), a letter first"
        )
    words = [word for word in re.split(r"[._-]+", name) if word]
    marks = {
        "@NAME@": name,
        "@MODULE@": "_".join(words).lower(),
        "@CLASS@": "".join(word[0].upper() + word[1:] for word in words),
    }
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
