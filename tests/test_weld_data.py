"""`skywright weld` on files: the example, what real logs contain, and what must be refused."""

from __future__ import annotations

import importlib.util
import json
import math
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skywright.errors import InputError
from skywright.inspection.calibration import load_calibration, save_calibration
from skywright.inspection.scan_file import load_scan
from skywright.inspection.weld_data import process_file
from skywright.reports.weld_map import write_weld_map

EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "weld_data"


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_pipe_scan", EXAMPLE / "make_pipe_scan.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def rows() -> list[list[str]]:
    """Header and rows of a clean scan in SI columns, thinned."""
    table = [x.split(",") for x in (EXAMPLE / "pipe_scan.csv").read_text().splitlines()[1:]]
    clean = [[*r[:3], *(str(float(v) / 1e3) for v in r[3:6])] for r in table[1::2]]
    return [["t_s", "re", "im", "x_m", "y_m", "z_m"], *(r for r in clean if "nan" not in r)]


def write(path: Path, rows: list[list[str]], delimiter: str = ",") -> Path:
    path.write_text("\n".join(delimiter.join(r) for r in rows) + "\n")
    return path


def check_line(
    out: dict, maker: ModuleType, offset: float = 1.5e-3, angle_deg: float = 0.6
) -> None:
    """The estimated line against the weld that the generator drew, in the tracker's frame."""
    line, surface = out["line"], out["surface"]
    frame = maker.pipe_frame()
    axis = np.array(surface["axis"])
    assert abs(axis @ frame[:, 1]) > math.cos(math.radians(1.0))
    # the angle turns with neither the axis' sign nor its own: both flip together
    assert line["angle_deg"] == pytest.approx(math.degrees(maker.WELD_ANGLE), abs=angle_deg)
    p = frame.T @ (np.array(line["point_m"]) - maker.AXIS_POINT)
    c = maker.RADIUS * math.atan2(p[2], -p[0])
    d = (p[1] - maker.WELD_OFFSET) * math.cos(maker.WELD_ANGLE) - c * math.sin(maker.WELD_ANGLE)
    assert abs(d) < offset
    assert math.hypot(p[0], p[2]) == pytest.approx(maker.RADIUS, abs=2e-3)


def test_example_file_gives_its_weld(maker: ModuleType) -> None:
    report = process_file(EXAMPLE / "pipe_scan.csv", calibrate="0:7")
    out = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert {"contact_fraction", "crossings", "line", "surface", "thresholds"} <= set(out)
    assert len(out["crossings"]) == 5
    assert all(set(x) == {"t_s", "p_m", "line"} and len(x["p_m"]) == 3 for x in out["crossings"])
    assert set(out["line"]) == {
        "point_m", "points_m", "angle_deg", "std_offset_m", "std_angle_deg", "lag_s", "std_lag_s",
        "lean", "crossings",
    }  # fmt: skip
    assert out["lines"] == [out["line"]] and out["line"]["crossings"] == 5
    assert set(out["thresholds"]) == {"lift_off", "weld", "detection"}
    assert out["thresholds"]["detection"] >= 0.99 * out["thresholds"]["weld"]
    assert len(out["contrasts"]) == 1 and out["contrasts"][0] > 2.0
    check_line(out, maker)
    # the line is told from its first to its last crossing
    seen = np.array([x["p_m"] for x in out["crossings"]])
    ends = np.array(out["line"]["points_m"])[[0, -1]]
    assert np.max(np.min(np.linalg.norm(seen - ends[:, None], axis=2), axis=1)) < 5e-3
    along = np.linalg.norm(seen - seen[0], axis=1).max()
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(along, abs=5e-3)
    std = out["surface"]["std"]
    assert abs(out["surface"]["radius_m"] - maker.RADIUS) < 3 * std["radius_m"] + 1e-4
    text = " | ".join(out["notes"])
    for word in ("temperature_c", "duplicate time", "without a usable number", "gaps", "tilt"):
        assert word in text


def test_columns_maps_the_names_and_units_of_another_header(tmp_path: Path, rows: Any) -> None:
    head = ["Time [ms]", "Real", "IMAG", "X", "Y (mm)", "Z", "x_m"]  # the last is another thing's
    table = [
        [str(1e3 * float(r[0])), r[1], r[2], *(str(1e3 * float(v)) for v in r[3:6]), "0"]
        for r in rows[1:400]
    ]
    spec = "t=time[ms],re=Real,im=imag,x=X[mm], y = y [mm],z=Z[mm]"
    scan = load_scan(write(tmp_path / "s.csv", [head, *table], ";"), spec)
    plain = load_scan(write(tmp_path / "p.csv", rows[:400]))
    short = load_scan(tmp_path / "s.csv", "t=Time,re=Real,im=Imag,x=X[mm],y=Y,z=Z[mm]")
    assert np.array_equal(short.t, scan.t) and np.array_equal(short.p_WT, scan.p_WT)
    assert np.allclose(scan.p_WT, plain.p_WT) and np.allclose(scan.t, plain.t)
    assert np.array_equal(scan.ec, plain.ec) and "x_m" in scan.notes[0]
    for wrong, says in (
        ("q=Time", "valid: QUANTITY=NAME"),
        ("x=X[furlong]", "valid units: m, mm"),
        ("re=Real[V]", "valid units: none"),
        ("x=X,x=Y", "x is given twice"),
        ("x=X,y=Y,re=Real,im=Imag,t=Time[s]", "'time [ms]' states ms, but s is given"),
        (spec + ",qw=W", "no column 'w'; found: time [ms], real"),
    ):
        with pytest.raises(InputError, match=re.escape(says)):
            load_scan(tmp_path / "s.csv", wrong)
    words = ["Time_milliseconds", "Real", "Imag", "X_millimeters", "Y (mm)", "Z_mm"]
    write(tmp_path / "w.csv", [words, *(r[:6] for r in table)], ";")
    names = "t=Time_milliseconds,re=Real,im=Imag,x=X_millimeters,y=Y,z=Z_mm"
    named = load_scan(tmp_path / "w.csv", names)
    assert np.array_equal(named.t, scan.t) and np.array_equal(named.p_WT, scan.p_WT)
    write(tmp_path / "w.csv", [["Time_hours", *words[1:]], *(r[:6] for r in table)], ";")
    with pytest.raises(InputError, match="'time_hours' states h; valid units: s, ms"):
        load_scan(tmp_path / "w.csv", names.replace("milliseconds", "hours"))
    write(tmp_path / "h.csv", [["Time [h]", *head[1:]], *table], ";")
    with pytest.raises(InputError, match=r"'time \[h\]' states h; valid units: s, ms"):
        load_scan(tmp_path / "h.csv", spec)


def test_weld_is_found_in_other_draws_of_a_foreign_model(maker: ModuleType, tmp_path: Path) -> None:
    for seed in (1, 2, 3):
        names, table = maker.make_scan(seed)
        np.savetxt(tmp_path / "s.csv", table, delimiter=",", header=",".join(names), comments="")
        out = process_file(tmp_path / "s.csv").to_json()  # the approach is found by itself
        check_line(out, maker)
        assert len(out["crossings"]) == 5
        assert any("approach found" in note for note in out["notes"])


def delay_signal(table: np.ndarray, lag: float) -> np.ndarray:
    """The table of a scan whose signal was logged `lag` (s) after the position."""
    late, t = table.copy(), table[:, 0]
    late[:, 1], late[:, 2] = (np.interp(t - lag, t, table[:, k]) for k in (1, 2))
    return late


def test_a_lag_of_the_signal_is_found_between_passes_both_ways(
    maker: ModuleType, tmp_path: Path
) -> None:
    names, table = maker.make_scan(4)
    late = delay_signal(table, 0.4)  # 3.6 mm either way
    np.savetxt(tmp_path / "s.csv", late, delimiter=",", header=",".join(names), comments="")
    out = process_file(tmp_path / "s.csv", calibrate="0:7").to_json()
    check_line(out, maker)
    assert len(out["crossings"]) == out["line"]["crossings"] == 5
    assert out["line"]["lag_s"] == pytest.approx(0.4, abs=0.08)
    assert any("s behind the position, as passes in opposite" in note for note in out["notes"])


def test_a_lag_that_one_way_passes_cannot_show_is_in_the_deviation(
    maker: ModuleType, tmp_path: Path
) -> None:
    names, table = maker.make_scan(4)
    table = delay_signal(table, 0.1)
    frame = maker.pipe_frame()
    s = (table[:, 3:6] / 1e3 - maker.AXIS_POINT) @ frame[:, 1]
    back = np.gradient(np.convolve(s, np.ones(25) / 25, mode="same")) < 0.0
    back &= (table[:, 0] > 9.0) & (np.abs(s) < 0.08)
    np.savetxt(tmp_path / "s.csv", table[~back], delimiter=",", header=",".join(names), comments="")
    out = process_file(tmp_path / "s.csv", calibrate="0:7").to_json()
    line = out["line"]
    assert line["crossings"] == 3 and line["std_lag_s"] > 0.05
    assert 0.5e-3 < line["std_offset_m"] < 1.5e-3  # 0.1 s at 9 mm/s
    check_line(out, maker, offset=2.0 * line["std_offset_m"], angle_deg=1.5)
    assert any("scan in both directions" in note for note in out["notes"])


def test_example_file_is_what_its_generator_makes(maker: ModuleType) -> None:
    _, table = maker.make_scan()
    scan = load_scan(EXAMPLE / "pipe_scan.csv")
    again = {round(float(t), 3): x for t, x in zip(table[:, 0], table[:, 1], strict=True)}
    found = [abs(again[round(float(t), 3)] - x) for t, x in zip(scan.t, scan.ec[:, 0], strict=True)]
    assert max(found) < 1e-2


def test_calibration_and_surface_files(maker: ModuleType, tmp_path: Path) -> None:
    first = process_file(EXAMPLE / "pipe_scan.csv", calibrate="0:7")
    save_calibration(first.result.calibration, tmp_path / "cal.toml")
    frame = maker.pipe_frame()
    (tmp_path / "pipe.toml").write_text(
        f"axis_point_m = {maker.AXIS_POINT.tolist()}\naxis = {(-3 * frame[:, 1]).tolist()}\n"
        f"radius_m = {maker.RADIUS}\n"
    )
    report = process_file(
        EXAMPLE / "pipe_scan.csv",
        calibration_file=tmp_path / "cal.toml",
        surface_file=tmp_path / "pipe.toml",
        weld_threshold=7.0,
    )
    out = report.to_json()
    check_line(out, maker, offset=5e-4)
    assert out["surface"]["std"]["radius_m"] == 0.0
    assert out["thresholds"]["weld"] == 7.0
    assert out["thresholds"]["lift_off"] == first.result.calibration.lift_off_threshold
    # with the surface known, the lift-off threshold never admits more than 1 mm
    capped = process_file(
        EXAMPLE / "pipe_scan.csv", calibrate="0:7", surface_file=tmp_path / "pipe.toml"
    )
    check_line(capped.to_json(), maker, offset=5e-4)


def test_files_as_loggers_write_them(
    rows: list[list[str]], tmp_path: Path, maker: ModuleType
) -> None:
    expected = process_file(write(tmp_path / "a.csv", rows)).to_json()
    check_line(expected, maker)
    comma = [[x.replace(".", ",") for x in r] if i else r for i, r in enumerate(rows)]
    order = [4, 2, 0, 5, 1, 3]
    milli = [["t_ms", "re", "im", "x_cm", "y_mm", "z_um"]] + [
        [str(float(v) * k) for v, k in zip(r, (1e3, 1, 1, 1e2, 1e3, 1e6), strict=True)]
        for r in rows[1:]
    ]
    shuffled = [rows[0], *np.random.default_rng(0).permutation(np.array(rows[1:])).tolist()]
    quoted = [[f'" {x.upper()} "' if not i else f'"{x}"' for x in r] for i, r in enumerate(rows)]
    variants = {
        "semicolon and decimal comma": write(tmp_path / "b.csv", comma, ";"),
        "tabs": write(tmp_path / "c.tsv", rows, "\t"),
        "spaces": write(tmp_path / "d.txt", rows, "  "),
        "order": write(tmp_path / "e.csv", [[r[i] for i in order] for r in rows]),
        "units": write(tmp_path / "f.csv", milli),
        "unordered": write(tmp_path / "g.csv", shuffled),
        "quoted": write(tmp_path / "h.csv", quoted),
    }
    (tmp_path / "bom.csv").write_bytes(b"\xef\xbb\xbf" + variants["tabs"].read_bytes())
    (tmp_path / "utf16.csv").write_text(variants["tabs"].read_text(), encoding="utf-16")
    (tmp_path / "crlf.csv").write_text(
        "# a comment\n\n" + variants["order"].read_text().replace("\n", "\r\n"), newline=""
    )
    variants |= {k: tmp_path / f"{k}.csv" for k in ("bom", "utf16", "crlf")}
    for name, path in variants.items():
        found = process_file(path).to_json()
        assert found["line"]["angle_deg"] == pytest.approx(
            expected["line"]["angle_deg"], abs=1e-2
        ), name
        assert found["line"]["point_m"] == pytest.approx(expected["line"]["point_m"], abs=1e-4), (
            name
        )


def test_flaws_in_rows_are_dropped_with_a_note(rows: list[list[str]], tmp_path: Path) -> None:
    bad = [r.copy() for r in rows]
    bad[300][1] = "nan"
    bad[301][3] = ""
    bad[302][2] = "overload"
    bad[303][0] = "inf"
    bad[304][4] = "1e300"
    bad[305] = bad[305][:3]
    bad.insert(400, bad[400])
    scan = load_scan(write(tmp_path / "a.csv", bad))
    assert len(scan.t) == len(rows) - 1 - 6
    text = " | ".join(scan.notes)
    assert "5 rows without" in text and "1 rows with a wrong" in text and "duplicate" in text
    assert np.all(np.isfinite(scan.p_WT)) and np.all(np.diff(scan.t) > 0)
    assert process_file(tmp_path / "a.csv").to_json()["line"] is not None


@pytest.mark.parametrize("kind", ["quaternion", "axis", "partial", "zero"])
def test_orientation(kind: str, rows: list[list[str]], tmp_path: Path) -> None:
    # a probe along +x of the file's frame: half a turn about the bisector of x and z
    extra = {
        "quaternion": (["qw", "qx", "qy", "qz"], ["0", "0.70710678", "0", "0.70710678"]),
        "axis": (["ax", "ay", "az"], ["2", "0", "0"]),
        "partial": (["qw", "qx"], ["1", "0"]),
        "zero": (["ax", "ay", "az"], ["0", "0", "0"]),
    }[kind]
    table = [[*r, *(extra[0] if not i else extra[1])] for i, r in enumerate(rows)]
    report = process_file(write(tmp_path / "a.csv", table))
    text = " | ".join(report.notes)
    if kind in ("quaternion", "axis"):
        assert report.scan.axis_W is not None and report.tilt is not None
        assert np.allclose(report.scan.axis_W, [1, 0, 0], atol=1e-6)
        touch = np.degrees(report.tilt[report.result.contact])
        assert 15 < np.median(touch) < 40  # the pipe's normal is turned by yaw and sector
    else:
        assert report.tilt is None and "ignored" in text


def test_no_weld_no_line(maker: ModuleType, tmp_path: Path) -> None:
    maker_weld, maker.WELD = maker.WELD, 0.02 * maker.WELD
    try:
        names, table = maker.make_scan(11)
    finally:
        maker.WELD = maker_weld
    np.savetxt(tmp_path / "s.csv", table, delimiter=",", header=",".join(names), comments="")
    report = process_file(tmp_path / "s.csv", calibrate="0:7")
    assert report.to_json()["line"] is None and report.to_json()["crossings"] == []
    write_weld_map(report, tmp_path / "map.png")


REFUSED = {
    "empty": ("", "empty"),
    "header only": ("t_s,re,im,x_m,y_m,z_m\n", "0 of 0 rows"),
    "no header": ("0,1,2,3,4,5\n" * 50, "t_s is missing"),
    "no z": ("t_s,re,im,x_m,y_m\n" + "0,1,2,3,4\n" * 50, "z_m is missing"),
    "two units": ("t_s,re,im,x_m,x_mm,y_m,z_m\n" + "0,1,2,3,4,5,6\n" * 50, "two columns"),
    "unknown unit": ("t_s,re,im,x_ft,y_m,z_m\n" + "0,1,2,3,4,5\n" * 50, "x_m is missing"),
    "text": ("t_s,re,im,x_m,y_m,z_m\n" + "a,b,c,d,e,f\n" * 50, "0 of 50 rows"),
    "one time": ("t_s,re,im,x_m,y_m,z_m\n" + "0,1,2,3,4,5\n" * 50, "1 different times"),
    "decimal comma": ("t_s,re,im,x_m,y_m,z_m\n" + "0,1,1,2,3,4,5\n" * 50, "decimal commas"),
    "mixed": ("t_s;re;im;x_m;y_m;z_m\n" + "0,1;1.5;2;3;4;5\n" * 50, "decimal point"),
    "binary": ("\0\1\2" * 100, "not a text file"),
    "constant": (
        "t_s,re,im,x_m,y_m,z_m\n" + "".join(f"{i},1,2,3,4,5\n" for i in range(90)),
        "no approach",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_files_are_refused_in_one_line(case: str, tmp_path: Path) -> None:
    text, word = REFUSED[case]
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        process_file(tmp_path / "bad.csv")
    message = str(caught.value)
    assert word in message and "\n" not in message and len(message) < 500


def test_bad_arguments_are_refused(rows: list[list[str]], tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", rows)
    cases: list[tuple[dict, str]] = [
        ({"calibrate": "7"}, "T0:T1"),
        ({"calibrate": "7:0"}, "T0:T1"),
        ({"calibrate": "nan:1"}, "T0:T1"),
        ({"calibrate": "900:999"}, "no samples"),
        ({"calibrate": "40:60"}, "calibration"),
        ({"calibrate": "0:1"}, "calibration"),
        ({"calibrate": "0:1e9"}, "not searched for welds"),
        ({"calibrate": "0:7", "calibration_file": path}, "not both"),
        ({"calibration_file": tmp_path / "none.toml"}, "cannot be read"),
        ({"calibration_file": path}, "malformed TOML"),
        ({"surface_file": path}, "malformed TOML"),
        ({"lift_off_threshold": -1.0}, "above 0"),
        ({"weld_threshold": math.nan}, "above 0"),
        ({"lift_off_threshold": "15"}, "lift-off threshold '15'; valid: a number above 0"),
        ({"weld_threshold": [1.0, 2.0]}, "weld threshold [1.0, 2.0]; valid: a number above 0"),
        ({"columns": {"t": "Time[ms]"}}, "columns: {'t': 'Time[ms]'}; valid: a text such as"),
        ({"columns": {}}, "columns: {}; valid: a text"),
    ]
    for kwargs, word in cases:
        with pytest.raises(InputError) as caught:
            process_file(path, **kwargs)
        assert word in str(caught.value), kwargs
        assert "\n" not in str(caught.value)
    for target in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(InputError, match=r"cannot be read|cannot read .*recording"):
            process_file(target)


def test_a_calibration_span_over_most_of_the_scan_is_noted(
    rows: list[list[str]], tmp_path: Path
) -> None:
    path = write(tmp_path / "a.csv", rows)
    end = float(rows[-1][0])
    report = process_file(path, calibrate=f"0:{0.75 * end:.1f}")
    assert any("not searched for welds" in note for note in report.notes)
    assert not any("not searched" in note for note in process_file(path, calibrate="0:7").notes)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("radius_m = 0.2", "axis_point_m is missing"),
        ("axis_point_m = [0, 0, 0]\naxis = [0, 0, 0]\nradius_m = 0.2", "direction"),
        ("axis_point_m = [0, 0]\naxis = [0, 1, 0]\nradius_m = 0.2", "3 numbers"),
        ("axis_point_m = [0, 0, 0]\naxis = [0, 1, 0]\nradius_m = nan", "finite"),
        ("axis_point_m = [0, 0, 0]\naxis = [0, 1, 0]\nradius_m = -1", "radius"),
        ("axis_point_m = [0, 0, 0]\naxis = [0, 1, 0]\nradius_m = true", "a number"),
        ("axis_point_m = [0, 0, 0]\naxis = [0, 1, 0]\nradius_m = 0.2\nx = 1", "unknown key x"),
        ("axis_point_m = [9, 9, 9]\naxis = [0, 1, 0]\nradius_m = 0.2", "mm from the surface"),
    ],
)
def test_bad_surface_files_are_refused(
    text: str, word: str, rows: list[list[str]], tmp_path: Path
) -> None:
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(InputError, match=word):
        process_file(write(tmp_path / "a.csv", rows), surface_file=tmp_path / "s.toml")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"lift_off_axis": [1.0, 1.0]}, "length"),
        ({"excursion": 0.0}, "above 0"),
        ({"contact": [1.0]}, "2 numbers"),
        ({"weld_axis": "up"}, "2 numbers"),
        ({"gain": 2.0}, "unknown key gain"),
        ({"noise": None}, "noise is missing"),
    ],
)
def test_bad_calibration_files_are_refused(change: dict, word: str, tmp_path: Path) -> None:
    data: dict = {
        "contact": [0.0, 0.0],
        "lift_off_axis": [1.0, 0.0],
        "excursion": 60.0,
        "curve": [0.0, 0.0, 0.0],
        "noise": 0.1,
        "lift_off_threshold": 15.0,
        "weld_threshold": 1.4,
    }
    data |= change
    data = {k: v for k, v in data.items() if v is not None}
    (tmp_path / "c.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=word):
        load_calibration(tmp_path / "c.json")


CELL = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.sampled_from(["", "nan", "1e308", "-1e308", "1e-308", "x", "1,5", '"', "0", "٣", "1_0"]),
    st.text(max_size=6),
)
FUZZ = settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])


@FUZZ
@given(st.binary(max_size=400))
def test_any_bytes_are_refused_or_read(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "f.csv").write_bytes(data)
    with pytest.raises(InputError):
        process_file(tmp_path / "f.csv")
    for loader in (load_calibration, lambda p: process_file(p, calibration_file=p)):
        with pytest.raises(InputError):
            loader(tmp_path / "f.csv")


@FUZZ
@given(
    st.permutations(["t_s", "re", "im", "x_mm", "y_m", "z_cm"]),
    st.sampled_from([",", ";", "\t", " "]),
    st.lists(st.lists(CELL, min_size=5, max_size=7), min_size=28, max_size=45),
    st.randoms(use_true_random=False),
)
def test_any_cells_are_refused_or_processed(
    tmp_path: Path, names: list[str], delimiter: str, cells: list[list[str]], random: object
) -> None:
    (tmp_path / "f.csv").write_text(
        "\n".join([delimiter.join(names), *(delimiter.join(r) for r in cells)]),
        encoding="utf-8",
        errors="ignore",
    )
    try:
        out = process_file(tmp_path / "f.csv", calibrate="-1e9:1").to_json()
    except InputError as error:
        assert "\n" not in str(error)
    else:
        json.dumps(out, allow_nan=False)


@FUZZ
@given(
    st.integers(0, 2**31),
    st.floats(-9, 9),
    st.floats(-9, 9),
    st.floats(0, 1),
    st.booleans(),
)
def test_extreme_numbers_never_escape(
    tmp_path: Path,
    seed: int,
    signal_power: float,
    length_power: float,
    share: float,
    approach: bool,
) -> None:
    rng = np.random.default_rng(seed)
    n = 80
    t = np.cumsum(rng.exponential(0.1, n))
    ec = rng.standard_normal((n, 2)) * 10.0**signal_power
    if approach:
        ec[: n // 3] += 100 * 10.0**signal_power
    p = rng.standard_normal((n, 3)) * 10.0**length_power
    p[:, 2] *= share
    table = np.column_stack([t, ec, p])
    np.savetxt(
        tmp_path / "f.csv", table, delimiter=",", header="t_s,re,im,x_m,y_m,z_m", comments=""
    )
    try:
        out = process_file(tmp_path / "f.csv").to_json()
    except InputError as error:
        assert "\n" not in str(error)
    else:
        json.dumps(out, allow_nan=False)


def disturb(path: Path, columns: list[int], amplitude: float, width: int = 1) -> Path:
    """The example with 80 samples, or stretches of `width` samples, disturbed in `columns`."""
    lines = (EXAMPLE / "pipe_scan.csv").read_text().splitlines()[1:]
    table = [x.split(",") for x in lines]
    rng = np.random.default_rng(5)
    for k in 5 + 30 * rng.choice(100, 80, replace=False) + rng.integers(0, 20, 80):
        for column in columns:
            by = amplitude * float(rng.choice([-1.0, 1.0]))
            for row in table[k : k + width]:
                row[column] = str(float(row[column]) + by)
    return write(path, table)


@pytest.mark.parametrize(
    ("columns", "amplitude", "said"),
    [
        ([1, 2], 30.0, "spikes of one or two samples in the signal, the first at 0."),
        ([1, 2], 1e6, "80 spikes of one or two samples in the signal, the first at 0."),
        ([3, 4, 5], 300.0, "80 rows dropped in which the position jumps and returns"),
    ],
)
def test_isolated_spikes_are_left_out_and_counted(tmp_path, maker, columns, amplitude, said):
    report = process_file(disturb(tmp_path / "a.csv", columns, amplitude), calibrate="0:7")
    assert any(said in note for note in report.notes), report.notes
    check_line(report.to_json(), maker)
    assert len(report.result.crossings) == 5


def test_clean_data_have_no_spikes():
    assert not any("spikes" in note for note in process_file(EXAMPLE / "pipe_scan.csv").notes)


@pytest.mark.parametrize(("width", "amplitude"), [(6, 1e4), (12, 30.0)])
def test_spikes_that_cannot_be_left_out(tmp_path, width, amplitude):
    path = disturb(tmp_path / "a.csv", [1, 2], amplitude, width)
    if amplitude > 1e3:
        with pytest.raises(InputError, match=r"contains 480 spikes, the first at 0.28 s, 480"):
            process_file(path, calibrate="0:7")
    else:  # as long as a weld: not told from one
        assert not any("480" in note for note in process_file(path, calibrate="0:7").notes)


def test_a_spike_is_kept_where_one_sample_may_be_a_weld(tmp_path):
    """Every fifth sample: 1.5 in a coil's footprint."""
    lines = disturb(tmp_path / "a.csv", [1, 2], 1e3).read_text().splitlines()
    path = tmp_path / "b.csv"
    path.write_text("\n".join([lines[0], *lines[1::5]]) + "\n")
    notes = process_file(path, calibrate="0:7").notes
    assert any("kept, because 1.5 samples within a coil's footprint" in note for note in notes)
