"""The page that is handed over: what is stored stands in it, what is missing is told."""

from __future__ import annotations

import hashlib
import html
import json
import re
import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from playwright.sync_api import Page

from page_checks import check_page
from skywright.cli import main
from skywright.errors import InputError
from skywright.inspection.files.nde import UltrasonicScan, write_nde
from skywright.inspection.history.entries import (
    Calibrated,
    Coverage,
    Indication,
    Missed,
    Reading,
)
from skywright.inspection.history.store import InspectionStore
from skywright.reports.inspection_figures import choose_axes
from skywright.reports.inspection_report import build_inspection_report

START = datetime(2026, 3, 1, 9, tzinfo=UTC)


def build_database(folder: Path, *, complete: bool = True, simulated: bool = True) -> str:
    """A flight with two readings, one refused, and an indication; returns the flight."""
    store = InspectionStore(folder / "r.db", create=True)
    store.add_asset("tank <7>", "water tank", "centre of the ring")
    part = store.add_component("tank <7>", "shell", nominal_mm=9.5, required_mm=6.0)
    run = folder / "run"
    procedure = None
    if complete:
        run.mkdir()
        (run / "metrics.json").write_text(json.dumps({
            "outcome": "failed",
            "requirements": [{"name": "coverage.fraction", "value": 0.9, "limit": 0.98,
                              "sense": ">=", "unit": "", "passed": False}],
            "result": {"sector_m2": 0.5, "inspected_m2": 0.4, "missed": [
                {"from_m": [0.1, 0.2], "to_m": [0.1, 0.25], "length_m": 0.05}]},
        }))  # fmt: skip
        procedure = store.add_procedure("UT-1", "B", "[procedure]\ncouplant = 'gel'\n")
    flight, _ = store.add_flight(
        structure="tank <7>", mission="survey", robot="othex", seed=1, run=str(run),
        simulated=simulated, started=START, procedure=procedure,
        registration_std_m=0.01 if complete else None,
    )  # fmt: skip
    if complete:
        done = Calibrated("UT", "gauge", "42", "before", "wedge", {"velocity_mps": 5920.0}, True)
        store.add_calibration(flight, START, done)
        after = done._replace(stage="after", passed=False, note="drift of 0.8 %")
        store.add_calibration(flight, START, after)
        t = np.zeros((2, 1, 200))
        t[:, 0, 100] = 0.8
        write_nde(folder / "a.nde", UltrasonicScan(
            t, np.full((2, 1), 1e-6), 1e8, 0.0, (0.0, 0.1), (0.0, 0.1), 5920.0, 5e6, 0.006, 0.01,
            ("gauge", "42"), simulated,
        ))  # fmt: skip
    good = Reading("thickness", 9.1, "mm", 0.1, 2.0, 0.0, 1.0, 0.004, spot="P1", data="a.nde#0,0")
    bad = good._replace(value=None, u95=None, x_m=2.5, accepted=False, reason="air", data="")
    store.add_readings(flight, [(START, good), (START, bad)], component=part)
    row = store.add_indication(
        flight, START, Indication("pit", 2.2, 0.0, 1.1, 0.005, 4.0, 1.2, 0.3), component=part
    )
    store.decide(row, "monitor", "B. <script>Inspector")
    store.close()
    return flight


def write(folder: Path, flight: str, *more: str) -> str:
    page = folder / "page.html"
    args = ["records", str(folder / "r.db"), "--report", str(page), "--flight", flight, *more]
    done = CliRunner().invoke(main, args)
    assert done.exit_code == 0, done.output
    return page.read_text(encoding="utf-8")


def test_nothing_of_the_page_is_cut_off(tmp_path: Path, show_page: Callable[..., Page]) -> None:
    write(tmp_path, build_database(tmp_path), "--deviation", "wind 6 m/s, procedure allows 5")
    check_page(show_page, tmp_path / "page.html", has_plots=False)


def test_the_page_states_what_is_stored(tmp_path: Path) -> None:
    flight = build_database(tmp_path)
    page = write(tmp_path, flight, "--deviation", "wind 6 m/s, procedure allows 5")
    text = html.unescape(re.sub(r"<[^>]+>", " ", page))
    for said in (
        "SIMULATED: computed from models", "tank <7>: water tank", "centre of the ring",
        "10.0 mm (standard deviation)", "UT-1, revision B", "couplant = 'gel'",
        "velocity_mps 5920.0", "FAILED: drift of 0.8 %", "0.4000 of 0.5000 m² inspected (80.0 %)",
        "0.100, 0.200", "9.100", "no: air", "1.20 ± 0.30", "monitor (B.",
        "Nothing here is certified",
        "wind 6 m/s, procedure allows 5", "requirement coverage.fraction not met: 0.9",
        "the calibration after the flight failed (wedge): drift of 0.8 %",
        "1 of 2 readings refused: air", "2026-03-01T09:00:00",
    ):  # fmt: skip
        assert said in " ".join(text.split()) or said in text, said
    assert "<script>Inspector" not in page  # a name is text, never markup
    assert page.count("<figure>") == 2  # places and A-scans
    for name in ("run/metrics.json", "a.nde"):
        digest = hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()
        assert digest in page, name
    assert page.count('class="blank"') == 6  # nobody signed


def test_what_is_missing_is_a_deviation(tmp_path: Path) -> None:
    flight = build_database(tmp_path, complete=False)
    store = InspectionStore(tmp_path / "r.db")
    found = " / ".join(build_inspection_report(store, flight).deviations)
    store.close()
    for said in (
        "no procedure", "no calibration before", "no calibration after", "registration",
        "was not found",
    ):  # fmt: skip
        assert said in found
    page = write(tmp_path, flight)
    assert "No calibration is stored" in page and "<h2" in page


def test_a_measured_flight_is_not_called_simulated(tmp_path: Path) -> None:
    flight = build_database(tmp_path, simulated=False)
    assert "SIMULATED" not in write(tmp_path, flight)


def test_a_changed_entry_changes_the_hash(tmp_path: Path) -> None:
    flight = build_database(tmp_path)
    store = InspectionStore(tmp_path / "r.db")
    before = build_inspection_report(store, flight).hashes[0]
    assert build_inspection_report(store, flight).hashes[0] == before
    store.decide(1, "repair", "C")
    assert build_inspection_report(store, flight).hashes[0] != before
    store.close()


def test_wrong_requests_are_told(tmp_path: Path) -> None:
    flight = build_database(tmp_path)
    store = InspectionStore(tmp_path / "r.db")
    empty, _ = store.add_flight(structure="x", mission="m", robot="r", seed=1, run="")
    with pytest.raises(InputError, match="has no readings, indications, calibrations or coverage"):
        build_inspection_report(store, empty)
    with pytest.raises(InputError, match=f"no flight 'zz'; there are: {flight}"):
        build_inspection_report(store, "zz")
    store.close()
    for args, says in (
        (("--report", str(tmp_path / "p.html")), "--report requires --flight"),
        (("--report", str(tmp_path / "p.txt"), "--flight", flight), "unknown format"),
        (("--deviation", "x"), "valid with --report"),
    ):
        done = CliRunner().invoke(main, ["records", str(tmp_path / "r.db"), *args])
        assert done.exit_code == 2 and says in done.output


def test_a_flight_that_found_nothing_has_a_page(tmp_path: Path) -> None:
    store = InspectionStore(tmp_path / "r.db", create=True)
    part = store.add_component("pipe", "weld 3")
    flight, _ = store.add_flight(structure="pipe", mission="m", robot="r", seed=1, run="")
    missed = Missed("no contact", (0.1, 0.2), (0.15, 0.21), 0.05)
    row = store.add_coverage(flight, Coverage("m2", 0.02, 0.019, (missed,)), component=part)
    assert store.list_coverages(flight) == [
        (row, flight, "weld 3", Coverage("m2", 0.02, 0.019, (missed,)))
    ]
    with pytest.raises(InputError, match=r"0.03 of 0.02 m2; valid: 0 to what was asked"):
        store.add_coverage(flight, Coverage("m2", 0.02, 0.03))
    store.close()
    page = write(tmp_path, flight)
    assert "0.0190 of 0.0200 m² inspected (95.0 %)" in page and "no contact" in page
    assert "50.0" in page and "weld 3" in page


@pytest.mark.skipif(not shutil.which("chromium"), reason="no Chromium")
def test_the_same_page_as_pdf(tmp_path: Path) -> None:
    flight = build_database(tmp_path)
    args = ["records", str(tmp_path / "r.db"), "--flight", flight, "--report"]
    done = CliRunner().invoke(main, [*args, str(tmp_path / "p.pdf")])
    assert done.exit_code == 0, done.output
    data = (tmp_path / "p.pdf").read_bytes()
    assert data.startswith(b"%PDF-") and data.rstrip().endswith(b"%%EOF") and len(data) > 20_000


def test_without_a_browser_no_pdf_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flight = build_database(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    args = ["records", str(tmp_path / "r.db"), "--flight", flight, "--report"]
    done = CliRunner().invoke(main, [*args, str(tmp_path / "p.pdf")])
    assert done.exit_code == 2 and "needs Chromium or Chrome" in done.output
    assert not (tmp_path / "p.pdf").exists()


def test_the_map_shows_the_plane_of_the_places() -> None:
    r = np.random.default_rng(1)
    points = r.uniform(size=(20, 3)) * [1.0, 0.01, 3.0]
    assert choose_axes(points) == (0, 2) and choose_axes(points[:, [1, 0, 2]]) == (1, 2)
    assert choose_axes(np.zeros((0, 3))) == (0, 1)
