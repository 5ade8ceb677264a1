"""Pages as a server offers them: those of a run, without its other files, and the built page.

This module does not import the drawing of figures, which takes a server a second.
"""

import html
import re
from importlib.resources import files
from pathlib import Path

from skywright.core.bounded import LARGEST_TABLE, read_text


def read_asset(name: str) -> str:
    """Return a file of the built page: station.html, station.js or station.css."""
    return (files("skywright.reports") / "station" / name).read_text(encoding="utf-8")


def read_report(path: Path) -> str:
    """Return the HTML of a run's page for a server; raises InputError if it cannot be read."""
    return unlink_files(read_text(path, LARGEST_TABLE), path.parent.resolve())


def unlink_files(page: str, folder: Path) -> str:
    """Return the HTML of a run's page for a server that does not offer the files beside it.

    The list of files states `folder` instead of linking to them.
    """

    def state(found: re.Match[str]) -> str:
        names = re.sub(r"</?a\b[^>]*>", "", found[1])
        return f"{names} They are in the folder <code>{html.escape(str(folder))}</code>.</p>"

    listed = r'(<p(?: id="files")?>Files of this run.*?)</p>'  # older reports have no id
    return re.sub(listed, state, page, count=1, flags=re.DOTALL)
