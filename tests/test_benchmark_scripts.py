"""Scripts of benchmarks/: a wrong argument ends them with one line and exit code 2, unchanged."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"


def list_times() -> dict[Path, int]:
    """When each result was changed last."""
    files = [p for p in FOLDER.rglob("*") if p.suffix in (".json", ".csv")]
    return {p: p.stat().st_mtime_ns for p in files}


@pytest.mark.parametrize(
    ("script", "args", "words"),
    [
        ("fly_laws.py", ["scans"], "scans: no such comparison; valid: scan, "),
        ("fly_laws.py", ["scan", "--runs", "-1"], "--runs -1 --workers 2; valid: 0 runs or more"),
        ("fly_laws.py", ["scan", "--workers", "0"], "valid: 0 runs or more, 1 worker or more"),
        ("fly_laws.py", ["scan", "--runs", "many"], "--runs: invalid int value: 'many'"),
        ("import_models.py", [], "the following arguments are required: folder"),
        ("import_models.py", ["nowhere"], "nowhere: has no file of MODELS; valid: a folder with"),
        ("print_evidence.py", ["impact"], "impact: no such table; valid: consistency, "),
        ("campaign_scale.py", ["--runs", "1"], "--runs 1 --turns 3; valid: 2 runs or more"),
        ("campaign_scale.py", ["--out", "nowhere/x.json"], "the folder nowhere does not exist"),
    ],
)
def test_wrong_arguments_end_a_script_with_one_line(
    script: str, args: list[str], words: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(FOLDER)
    monkeypatch.setattr(sys, "argv", [script, *args])
    before = list_times()
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(FOLDER / script), run_name="__main__")
    said = capsys.readouterr()
    assert ended.value.code == 2 and words in said.err.splitlines()[-1] and said.out == ""
    assert list(tmp_path.iterdir()) == [] and list_times() == before
