"""Measure an installation without extras: `python scripts/measure_install.py [--extra NAME]`.

Creates a new environment in a temporary folder, installs this checkout into it with the versions of
requirements.lock, and prints its size on the disk with the largest packages, in MB as counted by
`du -m` (2^20 bytes). The exit code is 1 if it exceeds LIMIT_MB.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

LIMIT_MB = 740
ROOT = Path(__file__).resolve().parent.parent


def measure(folder: Path) -> float:
    """Return the disk space (MB) of all files below a folder."""
    files = (f.lstat() for f in folder.rglob("*"))
    return sum(s.st_blocks for s in files) * 512 / 2**20


def main() -> int:
    extras = sys.argv[sys.argv.index("--extra") + 1 :] if "--extra" in sys.argv else []
    with tempfile.TemporaryDirectory() as name:
        folder, pins = Path(name) / "venv", Path(name) / "pins.txt"
        lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
        pins.write_text("\n".join(re.findall(r"^(\S+==[^\\\n]+)", lock, re.M)), encoding="utf-8")
        venv.create(folder, with_pip=True)
        empty = measure(folder)
        what = f"{ROOT}[{','.join(extras)}]" if extras else str(ROOT)
        subprocess.run(
            [folder / "bin" / "python", "-m", "pip", "install", "--quiet", "-c", pins, what],
            check=True,
        )
        size = measure(folder)
        packages = next(folder.glob("lib/python*/site-packages"))
        largest = sorted((measure(p), p.name) for p in packages.iterdir() if p.is_dir())[::-1]
        for mb, package in largest[:10]:
            print(f"{mb:8.0f} MB  {package}")
        print(f"{size:8.0f} MB  in all, {empty:.0f} MB of it the empty environment with pip")
    return int(size > LIMIT_MB and not extras)


if __name__ == "__main__":
    sys.exit(main())
