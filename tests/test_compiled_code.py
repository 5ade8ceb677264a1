"""Compiled code is found on disk; code whose callees changed is thrown away, and nothing else."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from skywright.core.compiled_code import drop_stale_code, find_dependents
from skywright.run.warm_up import is_cached

FILES = {
    "__init__.py": "",
    "core/__init__.py": "",
    "core/gain.py": "from numba import njit\n\n@njit(cache=True)\ndef gain():\n    return {}\n",
    "law.py": "from numba import njit\nfrom skywright.core.gain import gain\n\n"
    "@njit(cache=True)\ndef law(x):\n    return gain() * x\n",
    "other.py": "from numba import njit\n\n@njit(cache=True)\ndef other(x):\n    return x\n",
}
CALL = (
    "from pathlib import Path; import importlib.util as u; "
    "s = u.spec_from_file_location('c', {tool!r}); m = u.module_from_spec(s); "
    "s.loader.exec_module(m); m.drop_stale_code(Path('skywright').absolute()); "
    "from skywright.law import law; from skywright.other import other; "
    "print(law(2.0), other(1.0), sum(other.stats.cache_hits.values()))"
)
TOOL = Path(__file__).parents[1] / "src/skywright/core/compiled_code.py"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A small package called skywright, of its own."""
    for name, text in FILES.items():
        file = tmp_path / "skywright" / name
        file.parent.mkdir(exist_ok=True, parents=True)
        file.write_text(text.replace("{}", "3.0"), encoding="utf-8")
    return tmp_path / "skywright"


def call(package: Path, **more: str) -> list[str]:
    """Run law(2) and other(1) in a process; returns what it printed."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "NUMBA_CACHE_DIR")}
    run = subprocess.run(
        [sys.executable, "-c", CALL.format(tool=str(TOOL))],
        cwd=package.parent, env={**env, **more}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return run.stdout.split()


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_changed_callee_reaches_its_caller(package: Path, elsewhere: bool) -> None:
    """numba alone would go on with the old gain; what does not call it stays compiled."""
    more = {"NUMBA_CACHE_DIR": str(package.parent / "cache")} if elsewhere else {}
    assert call(package, **more)[:2] == ["6.0", "1.0"]
    assert call(package, **more) == ["6.0", "1.0", "1"]
    text = FILES["core/gain.py"].replace("{}", "50.0")
    (package / "core/gain.py").write_text(text, encoding="utf-8")
    assert call(package, **more) == ["100.0", "1.0", "1"]


def test_nothing_is_dropped_twice(package: Path) -> None:
    """The second process finds nothing to do; a touched leaf concerns its users only."""
    assert "skywright.law" in drop_stale_code(package)
    assert drop_stale_code(package) == []
    os.utime(package / "core/gain.py", ns=(1, 1))
    assert drop_stale_code(package) == ["skywright.core.gain", "skywright.law"]
    (package / "other.py").unlink()
    assert drop_stale_code(package) == ["skywright.other"]


def test_damaged_stamps_cost_a_compilation_only(package: Path) -> None:
    """A file of stamps that cannot be read counts as none."""
    drop_stale_code(package)
    (stamps,) = (package / "__pycache__").glob("*.json")
    stamps.write_text("{", encoding="utf-8")
    assert "skywright.other" in drop_stale_code(package)
    assert drop_stale_code(package) == []


def test_a_place_that_cannot_be_written_is_left_alone(package: Path) -> None:
    """A file stands where the folder of compiled code should be."""
    (package / "__pycache__").write_text("", encoding="utf-8")
    assert drop_stale_code(package) == []


def test_dependents_are_found_through_others() -> None:
    """Imports count however long the chain, and a circle ends."""
    imports = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": set[str]()}
    assert find_dependents({"c"}, imports) == {"a", "b", "c"}
    assert find_dependents({"d"}, imports) == {"d"}


def test_cache_of_compiled_code_is_recognised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "cold_module.py"
    source.write_text(
        "from numba import njit\n@njit(cache=True)\ndef add(a, b):\n    return a + b\n"
    )

    def load() -> object:
        spec = importlib.util.spec_from_file_location("cold_module", source)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "cold_module", module)
        spec.loader.exec_module(module)
        return module.add

    add = load()
    assert not is_cached(add)
    assert add(1, 2) == 3  # type: ignore[operator]
    assert is_cached(add)
    assert is_cached(load())  # from disk, as a second process finds it
