"""Every Python block of the pages runs, and imports nothing that may change without notice.

The blocks of a page that begin with an import run in their order, in one folder. The first line
`# not run: REASON` leaves one out. Blocks without imports are parts of scripts.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from skywright.models.ultrasonic import Coupling, Transducer, compute_ascan, compute_echoes

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
ELSEWHERE = {
    "docs/howto/read-a-recording.md": "test_recording.py, with a recording of its own",
    "docs/reference/python.md": "test_python_parts.py, as examples/parts",
}
"""Pages whose blocks another test runs."""
NOT_RUN = re.compile(r"# not run: \S")


def _list_blocks(page: Path) -> list[str]:
    """Return the blocks of a page that begin with an import, also those that are not run."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)
    return [b for b in blocks if re.match(r"(#[^\n]*\n)?(import|from) ", b)]


PAGES = {
    page.relative_to(ROOT).as_posix(): blocks
    for page in [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
    if (blocks := _list_blocks(page))
}


def _list_imports(block: str) -> set[tuple[str, str]]:
    """Return (module, name) of each import from a module of the package."""
    found = set()
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("skywright"):
            found |= {(node.module or "", alias.name) for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {(a.name, "") for a in node.names if a.name.startswith("skywright.")}
    return found


def _list_stable() -> set[tuple[str, str]]:
    """Return (module, name) of each row of the table of stable modules."""
    text = (DOCS / "reference" / "python.md").read_text("utf-8")
    rows = re.findall(r"^\| `(skywright\.[\w.]+)` \| ([^|]+) \|", text, re.M)
    return {(module, name) for module, names in rows for name in re.findall(r"`(\w+)`", names)}


@pytest.mark.parametrize("page", PAGES)
def test_a_page_imports_public_names_and_stable_modules_only(page: str) -> None:
    if Path(page).name.startswith("your-own-"):
        return  # base classes, which are stable by their pages
    import skywright.envs

    public = {("skywright", name) for name in skywright.__all__}
    public |= {("skywright.envs", name) for name in skywright.envs.__all__}
    used = set().union(*(_list_imports(block) for block in PAGES[page]))
    assert used - public - _list_stable() == set()


def test_every_stable_name_exists_and_its_page_uses_it() -> None:
    used = set().union(*(_list_imports(b) for blocks in PAGES.values() for b in blocks))
    text = "".join(page.read_text("utf-8") for page in DOCS.rglob("*.md"))
    for module, name in _list_stable():
        assert hasattr(__import__(module, fromlist=[name]), name), (module, name)
        assert (module, name) in used or text.count(f"`{name}`") > 1, (module, name)


def _write_ascans(folder: Path) -> None:
    """Write the signals that the page on thickness reads: a block of two steps, and a wall."""

    def scan(wall: float, seed: int) -> NDArray[np.float64]:
        echoes = compute_echoes(Transducer(), Coupling(), np.atleast_1d(wall))
        return compute_ascan(Transducer(), echoes, np.random.default_rng(seed), place_seed=seed)

    np.save(folder / "block.npy", np.array([scan(0.005, 0), scan(0.0125, 1)]))
    np.save(folder / "t.npy", 0.05 * np.arange(20))
    np.save(folder / "ascans.npy", np.array([scan(0.0095, 2)] * 20))


def _write_campaign(folder: Path) -> None:
    """Write the table of a campaign with one failed run."""
    table = folder / "campaigns" / "pipe-weld-scan" / "results.csv"
    table.parent.mkdir(parents=True)
    table.write_text("run,outcome,failed,reason,command\n3,failed,force,,skywright run\n", "utf-8")


NEEDS: dict[str, Callable[[Path], None]] = {
    "docs/howto/campaign.md": _write_campaign,
    "docs/howto/measure-thickness.md": _write_ascans,
}
"""Writes the files that the blocks of a page read."""


@pytest.mark.docs
@pytest.mark.parametrize("page", [page for page in PAGES if page not in ELSEWHERE])
def test_blocks_of_a_page_run(
    page: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    NEEDS.get(page, lambda folder: None)(tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    for block in PAGES[page]:
        if not NOT_RUN.match(block):
            exec(compile(block, page, "exec"), names)
    assert capsys.readouterr().out or page not in NEEDS
