"""Update the plotting library in reports: `python scripts/vendor_uplot.py 1.6.32`.

npm fetches uPlot (MIT) from its configured registry; script, style sheet and licence are written to
src/skywright/reports/vendor.
"""

import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

VENDOR = Path(__file__).parent.parent / "src" / "skywright" / "reports" / "vendor"
FILES = {
    "package/dist/uPlot.iife.min.js": "uPlot.iife.min.js",
    "package/dist/uPlot.min.css": "uPlot.min.css",
    "package/LICENSE": "uPlot.LICENSE",
}

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["npm", "pack", f"uplot@{sys.argv[1]}"], cwd=folder, check=True)
        with tarfile.open(next(Path(folder).glob("*.tgz"))) as package:
            for inside, name in FILES.items():
                member = package.extractfile(inside)
                assert member is not None
                (VENDOR / name).write_bytes(member.read())
