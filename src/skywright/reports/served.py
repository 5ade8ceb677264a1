"""Pages of a run as a server offers them, without the other files of the run."""

import html
import re
from pathlib import Path


def unlink_files(page: str, folder: Path) -> str:
    """Return the HTML of a report for a server that does not offer the files beside it.

    The list of files states `folder` instead of linking to them.
    """

    def state(found: re.Match[str]) -> str:
        names = re.sub(r"</?a\b[^>]*>", "", found[1])
        return f"{names} They are in the folder <code>{html.escape(str(folder))}</code>.</p>"

    return re.sub(r'(<p id="files">.*?)</p>', state, page, count=1, flags=re.DOTALL)
