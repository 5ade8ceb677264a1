"""Machine, versions and load of a measurement."""

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from skywright.run.versions import collect_versions

BUSY = 0.25
"""Load average per core from which a result counts as noisy."""


def describe_machine() -> dict[str, Any]:
    """Return processor, usable cores, memory (GB) and operating system."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": _read_field("/proc/cpuinfo", "model name") or platform.processor(),
        "architecture": platform.machine(),
        "cores": cores,
        "memory_gb": _read_memory_gb(),
        "system": platform.system(),
    }


def collect_all_versions() -> dict[str, str]:
    """Return the versions of the dependencies of runs and of benchmarks."""
    out = collect_versions()
    for name in ("llvmlite", "scipy"):
        try:
            out[name] = version(name)
        except PackageNotFoundError:
            out[name] = "unknown"
    return out


def read_commit() -> dict[str, Any]:
    """Return the commit of this source, and whether tracked files differ; None outside a
    checkout."""
    folder = Path(__file__).parent

    def git(*args: str) -> str | None:
        try:
            done = subprocess.run(
                ["git", *args], cwd=folder, capture_output=True, text=True, timeout=10, check=True
            )
        except (OSError, subprocess.SubprocessError):
            return None
        return done.stdout.strip()

    # an installed package may be inside an unrelated repository
    if git("ls-files", "--error-unmatch", Path(__file__).name) is None:
        return {"commit": None, "changed": None}
    status = git("status", "--porcelain", "--untracked-files=no", "--", ".", "../..")
    return {"commit": git("rev-parse", "--short=10", "HEAD"), "changed": bool(status)}


def read_load() -> float | None:
    """Return the load average of the last minute; None if unavailable."""
    try:
        return round(os.getloadavg()[0], 2)
    except (OSError, AttributeError):
        return None


def _read_field(path: str, name: str) -> str:
    try:
        for line in Path(path).read_text(encoding="utf-8").splitlines():
            if line.startswith(name):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return ""


def _read_memory_gb() -> float | None:
    text = _read_field("/proc/meminfo", "MemTotal")
    return round(int(text.split()[0]) / 1e6, 1) if text else None
