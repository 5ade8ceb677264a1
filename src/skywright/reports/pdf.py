"""A page as PDF, printed by an installed Chromium."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from skywright.errors import InputError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE_S = 120.0


def write_pdf(page: Path, path: Path) -> None:
    """Print an HTML page to `path`, atomically.

    Raises InputError without one of BROWSERS, and if printing fails.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise InputError(
            f"{path}: a PDF needs Chromium or Chrome ({', '.join(BROWSERS)}); valid without: "
            ".html, printed from any browser"
        )
    with tempfile.TemporaryDirectory() as folder:
        printed = Path(folder) / "page.pdf"
        command = [
            browser, "--headless", "--disable-gpu", "--no-first-run", "--no-pdf-header-footer",
            f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}",
            *(["--no-sandbox"] if os.geteuid() == 0 else []), page.resolve().as_uri(),
        ]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(f"{path}: {browser} did not print: {error}") from None
        if not printed.is_file() or printed.read_bytes()[:5] != b"%PDF-":
            raise InputError(f"{path}: {browser} did not print (exit code {done.returncode})")
        partial = path.with_name(path.name + ".partial")
        shutil.copyfile(printed, partial)
        partial.replace(path)
