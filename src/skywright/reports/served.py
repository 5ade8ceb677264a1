"""Pages of a run as a server offers them, without the other files of the run."""

import html
import re
from pathlib import Path

from skywright.core.bounded import LARGEST_TABLE, read_text


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

    files = r'(<p(?: id="files")?>Files of this run.*?)</p>'  # older reports have no id
    return re.sub(files, state, page, count=1, flags=re.DOTALL)
