"""Tables of readings, local points and DICONDE-style results: written, read back, refused."""

from __future__ import annotations

import csv
import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pydicom
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from skywright.cli import main
from skywright.errors import InputError
from skywright.inspection.files.gauge_table import load_readings
from skywright.inspection.files.nde import EddyScan, read_nde, write_nde
from skywright.inspection.files.weld_scan import build_eddy_scan
from skywright.inspection.history.entries import Calibrated, Indication, Reading
from skywright.inspection.history.store import InspectionStore
from skywright.inspection.weld_data import process_file

START = datetime(2026, 3, 1, tzinfo=UTC)
HEAD = "t_s,x_m,y_m,z_m,thickness_mm,u95_mm\n"


def call(*args: object) -> tuple[int, str]:
    done = CliRunner().invoke(main, ["records", *map(str, args)])
    return done.exit_code, done.output


def build_store(path: Path, simulated: bool = True) -> tuple[str, InspectionStore]:
    store = InspectionStore(path, create=True)
    pipe = store.add_component("tank", "pipe", material="steel", nominal_mm=9.5, required_mm=6.0)
    flight, _ = store.add_flight(
        structure="tank", mission="thickness-survey", robot="othex", seed=1, run="",
        started=START, simulated=simulated, registration_std_m=0.01,
    )  # fmt: skip
    gauge = Calibrated("UT", "gauge", "42", "before", "wedge", {"velocity_mps": 5920.0}, True)
    calibration = store.add_calibration(flight, START, gauge)
    good = Reading("thickness", 9.123456789, "mm", 0.1, 0.1, 0.2, 0.3, 0.004, spot="P1")
    bad = good._replace(value=None, u95=None, accepted=False, reason="air under the probe")
    store.add_readings(flight, [(START, good), (START, bad)], component=pipe,
                       calibration=calibration)  # fmt: skip
    crack = Indication("crack", 0.1, 0.2, 0.3, 0.005, 6.0, 1.1, 0.4, 55.0, "% FSH")
    store.add_indication(flight, START, crack, component=pipe)
    return flight, store


def test_what_is_exported_reads_back_in_every_format(tmp_path: Path) -> None:
    path = tmp_path / "r.db"
    flight, store = build_store(path)
    files = [tmp_path / name for name in ("r.csv", "r.parquet", "r.json", "r.dcm")]
    for flag, file in zip(("--csv", "--parquet", "--local"), files, strict=False):
        code, out = call(path, *(("--readings",) if flag == "--csv" else ()), flag, file)
        assert code == 0, out
    code, out = call(path, "--dicom", files[3], "--flight", flight, "--component", "pipe")
    assert code == 0, out
    with files[0].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["origin"] for row in rows] == ["SIMULATED"] * 2
    assert float(rows[0]["value"]) == 9.123456789 and rows[1]["value"] == ""
    for file in files[:2]:
        (one, other) = load_readings(file, START).rows
        stored = store.find_readings()
        assert one.time == START and one.reading.value == pytest.approx(9.123456789)
        for a, b in zip((one, other), stored, strict=True):
            assert a.reading[6:10] == b.reading[6:10]  # place u95, acceptance, reason, spot
            assert a.reading[4:7] == pytest.approx(b.reading[4:7])
    points = json.loads(files[2].read_text())
    assert points["note"] == "SIMULATED" and len(points["points"]) == 3
    assert points["points"][2]["point_m"] == [0.1, 0.2, 0.3]
    assert points["points"][2]["indication"]["depth_mm"] == 1.1
    store.close()


@pytest.mark.parametrize("simulated", [True, False])
def test_a_diconde_style_result_holds_the_tags(tmp_path: Path, simulated: bool) -> None:
    path = tmp_path / "r.db"
    flight, store = build_store(path, simulated)
    store.close()
    file = tmp_path / "r.dcm"
    assert call(path, "--dicom", file, "--flight", flight, "--component", "pipe")[0] == 0
    d = pydicom.dcmread(file)
    assert str(d.PatientName) == "pipe^tank" and d.PatientSex == "O"  # E2339: the component
    assert d.StudyDate == "20260301" and d.Modality == "US" and d.MaterialThickness == 9.5
    assert ("SIMULATED" in d.ImageComments) == simulated
    assert d.SeriesDescription == ("SIMULATED" if simulated else "measured")
    items = d.EvaluatorSequence[0].IndicationSequence
    assert "9.123 mm +- 0.100" in items[0].IndicationDescription
    assert "refused: air under the probe" in items[1].IndicationDescription
    assert items[2].IndicationDisposition == "OPEN" and items[2].IndicationType == "CRACK"
    assert "velocity_mps 5920" in d.CalibrationSettingsSequence[0].CalibrationProcedure
    assert d.DeviceSerialNumber == "42"


def test_a_diconde_style_result_keeps_the_letters_of_every_name(tmp_path: Path) -> None:
    """Also outside Latin-1; a backslash would divide a value into two, a ^ or = a name."""
    path, file = tmp_path / "r.db", tmp_path / "r.dcm"
    store = InspectionStore(path, create=True)
    part = store.add_component("Behälter\\2", "Rohr Ωx^=", material="Stahl №5")
    flight, _ = store.add_flight(
        structure="Behälter\\2", mission="m", robot="r", seed=1, run="", started=START
    )
    gauge = Calibrated("UT", "Prüfer\\A", "№\\7", "before", "Keil", {}, True)
    store.add_calibration(flight, START, gauge)
    reading = Reading("thickness", 9.0, "mm", 0.1, 0, 0, 0, spot="Ω\\1")
    store.add_reading(flight, START, reading, component=part)
    store.close()
    code, out = call(path, "--dicom", file, "--flight", flight, "--component", "Rohr Ωx^=")
    assert code == 0, out
    d = pydicom.dcmread(file)
    assert str(d.PatientName) == "Rohr Ωx//^Behälter/2" and d.PatientName.given_name == "Behälter/2"
    assert d.PatientID == "Behälter/2/Rohr Ωx^=" and d.MaterialNotes == "Stahl №5"
    assert (d.ManufacturerModelName, d.DeviceSerialNumber) == ("Prüfer/A", "№/7")
    (item,) = d.EvaluatorSequence[0].IndicationSequence
    assert item.IndicationLabel == "Ω/1"
    assert "Keil" in d.CalibrationSettingsSequence[0].CalibrationProcedure


def test_a_gauge_s_own_names_units_and_lag(tmp_path: Path) -> None:
    """A probe that moves 10 mm/s; its gauge answers 0.5 s late: places lie 5 mm back."""
    path = tmp_path / "g.csv"
    t = np.arange(0, 5000, 250)
    rows = [f"{k};{10 * k / 1000:.3f};0;1500;{9.0 + k / 1e5:.5f};0.1" for k in t]
    path.write_text("Zeit;X;Y;Z;Wand;U\n" + "\n".join(rows))
    spec = "t=Zeit[ms],x=X[mm],y=Y[mm],z=Z[mm],value=Wand[mm],u95=U[mm]"
    late, now = (load_readings(path, START, spec, lag).rows for lag in (0.5, 0.0))
    for a, b in zip(late[2:], now[2:], strict=True):
        assert a.reading.value == b.reading.value
        assert b.reading.x_m - a.reading.x_m == pytest.approx(0.005)
        assert a.reading.z_m == pytest.approx(1.5) and a.reading.u95 == pytest.approx(0.1)
    assert (now[-1].time - START).total_seconds() == pytest.approx(4.75)


@pytest.mark.parametrize(("lag", "x"), [(5.0, [0.0, 0.5, 1.5]), (-5.0, [0.5, 1.5, 2.0])])
def test_a_row_before_the_first_position_is_refused(
    tmp_path: Path, lag: float, x: list[float]
) -> None:
    """A probe that moves 0.1 m/s: at -5 and 25 s its position is unknown."""
    path = tmp_path / "g.csv"
    path.write_text(HEAD + "0,0,0,0,9,0.1\n10,1,0,0,8,0.1\n20,2,0,0,7,0.1\n")
    found = [row.reading for row in load_readings(path, START, lag_s=lag).rows]
    assert [r.x_m for r in found] == pytest.approx(x)
    lost = 0 if lag > 0 else 2
    assert [k for k, r in enumerate(found) if not r.accepted] == [lost]
    assert f"no position at the time of this value minus --lag {lag:g}" in found[lost].reason
    # a position at a time of the table is known in spite of rounding: 0.3 s - 0.1 s < 0.2 s
    path.write_text(HEAD + "0.2,0,0,0,9,0.1\n0.3,1,0,0,8,0.1\n0.4,2,0,0,7,0.1\n")
    late = [row.reading for row in load_readings(path, START, lag_s=0.1).rows]
    assert [r.accepted for r in late] == [False, True, True]


@given(
    mm=st.floats(0.5, 100.0), unit=st.sampled_from(["m", "mm", "um", "in"]),
)  # fmt: skip
def test_units_are_read(tmp_path_factory: pytest.TempPathFactory, mm: float, unit: str) -> None:
    path = tmp_path_factory.mktemp("units") / "g.csv"
    scale = {"m": 1e-3, "mm": 1.0, "um": 1e3, "in": 1 / 25.4}[unit]
    path.write_text(f"spot,thickness_{unit}\nA,{mm * scale!r}\n")
    assert load_readings(path, START).rows[0].reading.value == pytest.approx(mm, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        ("", (), "is empty"),
        (HEAD, (), "no rows"),
        ("a,b\n1,2\n", (), "no column gives the value; found: a, b"),
        ("thickness_mm\n9\n", (), "no column gives the place"),
        (HEAD + "0,0,0,0,nine,0.1\n", (), "row 2: thickness_mm is 'nine'"),
        (HEAD + "0,0,0,0,nan,0.1\n", (), "row 2: thickness_mm is 'nan'"),
        (HEAD + "0,,0,0,9,0.1\n", (), "row 2: x_m is ''"),
        (HEAD + "0,0,0,9,0.1\n", (), "row 2 has 5 cells"),
        (HEAD + "soon,0,0,0,9,0.1\n", (), "'soon' is no time"),
        (HEAD + "0,0,0,0,9,-0.1\n", (), "row 2: u95_mm is '-0.1'; valid: 0 or more"),
        (HEAD + "0,0,0,0,9,0.1\n", ("--columns", "wall=X"), "valid: QUANTITY=NAME"),
        (HEAD + "0,0,0,0,9,0.1\n", ("--columns", "value=X"), "no column 'x'"),
        (HEAD + "0,0,0,0,9,0.1\n", ("--columns", "value=X[kg]"), "valid units: m, mm"),
        (HEAD + "0,0,0,0,9,0.1\n", ("--lag", "5"), "--lag 5: the times"),
        (HEAD + "0,0,0,0,9,0.1\n5,1,0,0,9,0.1\n", ("--lag", "5"), "span 5 s; valid: less"),
        ("t_s,spot,thickness_mm\n0,A,9\n9,B,9\n", ("--lag", "5"), "has no x, y or z"),
        (HEAD + "0,0,0,0,9,0.1\n1,0,0,0,9,0.1\n0.5,0,0,0,9,0.1\n", ("--lag", "0.1"), "increasing"),
        ("spot,thickness_mm,accepted\nA,9,perhaps\n", (), "accepted is 'perhaps'"),
        ("spot,thickness_mm,accepted\nA,,1\n", (), "accepted without a value"),
    ],
)
def test_bad_tables_are_told_and_store_nothing(
    tmp_path: Path, text: str, options: tuple[str, ...], says: str
) -> None:
    table, db = tmp_path / "g.csv", tmp_path / "r.db"
    table.write_text(text)
    more = ("--structure", "tank", "--component", "pipe", "--measured", "2026-03-01")
    code, out = call(db, "--import", table, *more, *options)
    assert code == 2 and says in out and len(out.strip().splitlines()) == 1, out
    store = InspectionStore(db)
    assert store.find_readings() == [] and store.list_flights() == []
    assert store.list_components() == [] and store.read("SELECT * FROM assets") == []
    store.close()


def test_a_table_becomes_history(tmp_path: Path) -> None:
    """Two files of a gauge, four years apart, and the rate between them."""
    db = tmp_path / "r.db"
    for year, mm in ((2022, 10.0), (2026, 8.0)):
        table = tmp_path / f"{year}.csv"
        table.write_text(f"spot,thickness_mm,u95_mm\nTML-1,{mm},0.2\nTML-2,9.9,0.2\n")
        code, out = call(
            db, "--import", table, "--structure", "tank", "--component", "pipe", "--measured",
            f"{year}-01-01", "--required", "6", "--registration", "0.01",
        )  # fmt: skip
        assert code == 0 and "2 readings" in out and "SIMULATED" not in out
    code, out = call(db, "--thickness", "--json")
    one, two = json.loads(out)["locations"]
    assert one["long_term"]["mm_per_year"] == pytest.approx(0.5, rel=1e-3)
    assert one["life_years"] == pytest.approx(4.0, rel=1e-3) and two["life_years"] is None
    for args, says in (
        (("--import", tmp_path / "2022.csv"), "requires --structure"),
        (("--lag", "1"), "valid with --import"),
        (("--dicom", tmp_path / "x.dcm"), "requires --flight"),
        (("--parquet", tmp_path / "x.csv"), "unknown format"),
    ):
        code, out = call(db, *args)
        assert code == 2 and says in out, out


def test_a_damaged_parquet_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    path.write_bytes(b"PAR1 and nothing more")
    with pytest.raises(InputError, match="no complete Parquet file"):
        load_readings(path, START)


def test_an_export_without_its_package_says_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    db = tmp_path / "r.db"
    flight, store = build_store(db)
    store.close()
    for name in ("pyarrow", "pydicom", "pydicom.dataset", "h5py"):
        monkeypatch.setitem(sys.modules, name, None)
    code, out = call(db, "--parquet", tmp_path / "x.parquet")
    assert code == 2 and "skywright[parquet]" in out
    more = ("--flight", flight, "--component", "pipe")
    code, out = call(db, "--dicom", tmp_path / "x.dcm", *more)
    assert code == 2 and "skywright[dicom]" in out
    with pytest.raises(InputError, match=r"skywright\[nde\]"):
        write_nde(tmp_path / "x.nde", None)  # type: ignore[arg-type]


def test_a_scan_s_impedance_lies_where_the_weld_map_has_it(tmp_path: Path) -> None:
    path = Path(__file__).resolve().parent.parent / "examples" / "weld_data" / "pipe_scan.csv"
    report = process_file(path, calibrate="0:7")
    write_nde(tmp_path / "s.nde", build_eddy_scan(report))
    scan = read_nde(tmp_path / "s.nde")
    assert isinstance(scan, EddyScan)
    placed = np.isfinite(report.result.s + report.result.c)
    assert np.array_equal(scan.impedance[0].real, report.scan.ec[placed, 0])
    assert np.array_equal(scan.position[:, 1], report.result.c[placed])
    done = CliRunner().invoke(main, ["weld", str(path), "--nde", str(tmp_path / "x.nde")])
    assert done.exit_code == 2 and "--nde: valid for a RUN" in done.output
