"""`skywright locate`: the demo end to end, roles, and bad input for every flag."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from page_checks import check_page
from skywright.analysis.locate import reach
from skywright.analysis.locate.demo import STATION_CLOCK
from skywright.analysis.locate.locate import locate
from skywright.analysis.locate.report import FILES, render_locate_page
from skywright.analysis.locate.trajectory_file import (
    format_table,
    format_tum,
    load_trajectory,
)
from skywright.cli import main
from skywright.core import bounded
from skywright.models.localisation.trajectory import Trajectory, interpolate_position
from skywright.vehicle.sensor_flight import build_inspection_path, simulate_flight


def call(*args: str) -> tuple[int, str, str]:
    out = CliRunner().invoke(main, ["locate", *map(str, args)])
    return out.exit_code, out.stdout, out.stderr


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo")
    code, out, err = call("--demo", "--out", folder)
    assert code == 0, err
    assert "locate.html" in out
    return folder


@pytest.fixture(scope="module")
def found(demo: Path) -> dict:
    return json.loads((demo / "locate.json").read_text())


@pytest.fixture(scope="module")
def plain(demo):
    return locate([str(demo / "station.csv"), str(demo / "camera.txt")])


def test_demo_finds_what_was_simulated(found):
    assert found["time_offset_s"] == pytest.approx(-STATION_CLOCK, abs=0.012)
    assert found["frame"]["scale"] == pytest.approx(1 / 0.95, rel=0.01)
    assert found["point"] == "prism" and found["station"] == "station.csv"
    assert found["rejected"] == 6 and found["calibration"]["geometry"] == "full"
    assert found["noise"]["station_mm"] == pytest.approx(1.7, rel=0.3)
    assert found["noise"]["drift_m_per_sqrt_m"] == pytest.approx(0.015, rel=0.3)
    (outage,) = found["outages"]
    assert outage["end_s"] - outage["start_s"] == pytest.approx(13.1, abs=0.3)
    errors = found["errors"]
    assert errors["fused"]["absolute_m"]["median"] < 0.006
    assert errors["fused"]["absolute_m"]["rms"] < 0.4 * errors["paper filter"]["absolute_m"]["rms"]
    assert errors["fused"]["alignment"] == "none"


def test_demo_writes_files_that_can_be_read_again(demo):
    for name in FILES:
        assert (demo / name).stat().st_size > 1000
    csv, tum = (load_trajectory(str(demo / f"trajectory.{kind}")) for kind in ("csv", "tum"))
    assert csv.p == pytest.approx(tum.p, abs=1e-5) and csv.q == pytest.approx(tum.q, abs=1e-4)
    truth = load_trajectory(str(demo / "truth.csv"))
    assert csv.t[0] == pytest.approx(truth.t[0] + STATION_CLOCK, abs=0.1)
    page = (demo / "locate.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "") and 'src="data:' in page
    assert "without the station" not in page and "Outages of the station" in page


def test_the_page_zooms_over_time_and_nothing_is_cut_off(demo, show_page):
    page = check_page(show_page, demo / "locate.html", has_plots=True)
    titles = page.locator(".panels h4").all_inner_texts()
    assert "Distance from the reference over time" in titles and len(titles) == 7
    jumps = page.evaluate("""Object.values(skywrightPlots).flatMap(c => c.plots)
        .filter(({panel}) => panel.marks.length).map(({panel}) => panel.label)""")
    assert jumps == ["drift (mm)"]
    one = page.evaluate("""(() => { const {u} = Object.values(skywrightPlots)
        .flatMap(c => c.plots).find(({panel}) => panel.log);
        return [1, 10, 100].map(y => u.valToPos(y, "y")); })()""")
    assert one[0] - one[1] == pytest.approx(one[1] - one[2], rel=1e-6)  # a logarithmic axis


def test_json_prints_one_object_and_writes_only_where_asked(demo, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = [str(demo / "station.csv"), str(demo / "camera.txt")]
    code, out, err = call(*files, "--json")
    assert code == 0, err
    printed = json.loads(out)
    assert printed["directory"] is None and printed["reference"] is None
    assert printed["errors"] == {} and printed["std_m"] < 0.02
    assert not list(tmp_path.iterdir())
    swapped = json.loads(call(*files[::-1], "--json")[1])  # the order does not matter
    assert swapped == printed


def test_the_prism_s_place_gives_the_camera_s(demo, plain):
    out = locate([str(demo / "station.csv"), str(demo / "camera.txt")], prism="0.05,0,0.12")
    assert out.point == "camera"
    at = interpolate_position(out.trajectory, plain.trajectory.t, 1.0)
    apart = np.linalg.norm(at - plain.trajectory.p, axis=1)
    apart = apart[np.isfinite(apart)]
    assert np.median(apart) == pytest.approx(math.hypot(0.05, 0.12), abs=0.02)


def test_the_time_consistent_frame_moves_the_result(demo, plain, tmp_path):
    known = {"A": (10.0, 0.0, 0.0), "B": (0.0, 12.0, 1.0), "C": (-9.0, -3.0, 0.5), "D": (4, -9, 0)}
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([100.0, 50.0, 2.0])
    for name, move in (("known", True), ("measured", False)):
        rows = [(k, *(turn @ np.array(p) + shift if move else p)) for k, p in known.items()]
        (tmp_path / f"{name}.csv").write_text(
            "name,x_m,y_m,z_m\n" + "".join("{},{},{},{}\n".format(*r) for r in rows)
        )
    data = [str(demo / "station.csv"), str(demo / "camera.txt")]
    frame = (tmp_path / "known.csv", tmp_path / "measured.csv")
    moved = locate(data, frame=frame)
    at = interpolate_position(moved.trajectory, plain.trajectory.t, 1.0)
    known_at = np.isfinite(at[:, 0])
    expected = plain.trajectory.p[known_at] @ turn.T + shift
    assert known_at.mean() > 0.99 and at[known_at] == pytest.approx(expected, abs=2e-3)
    page = render_locate_page(moved)
    assert "The time-consistent frame" in page and "found from" in page
    assert moved.to_json()["station_pose"]["p_m"] == pytest.approx(shift.tolist())
    code, out, err = call(*data, "--frame", *frame, "--out", tmp_path / "out")
    assert code == 0 and "in the time-consistent frame" in out, err


def test_a_trajectory_is_judged_by_a_reference(tmp_path):
    path = build_inspection_path(2, duration=30.0)
    rng = np.random.default_rng(0)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    noisy = path.p_WB[::10] + 0.01 * rng.normal(size=path.p_WB[::10].shape)
    (tmp_path / "est.txt").write_text(format_tum(Trajectory("", path.t[::10], noisy @ turn.T)))
    columns = [1e9 * (path.t + 1.4e9 + 0.3), *path.p_WB.T]
    (tmp_path / "gt.csv").write_text(
        format_table(["#timestamp [ns]", "x [m]", "y [m]", "z [m]"], columns, [0, 6, 6, 6])
    )
    report = locate([str(tmp_path / "est.txt")], reference=str(tmp_path / "gt.csv"))
    e = report.errors["trajectory"]
    assert e.absolute.rms == pytest.approx(0.01 * math.sqrt(3.0), rel=0.1)
    assert e.time_offset == pytest.approx(1.4e9 + 0.3, abs=0.01)
    code, out, err = call(tmp_path / "est.txt", "--reference", tmp_path / "gt.csv", "--out",
                          tmp_path / "judged")  # fmt: skip
    assert code == 0 and "rms from gt.csv" in out, err
    assert "Errors against the reference" in (tmp_path / "judged" / "locate.html").read_text()


# --- bad input ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def files(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A station's and two cameras' files, and some that are wrong."""
    folder = tmp_path_factory.mktemp("files")
    for name in ("station.csv", "camera.txt", "truth.csv"):
        shutil.copy(demo / name, folder)
    flight = simulate_flight(build_inspection_path(9, duration=40.0), 9)
    (folder / "other.txt").write_text(format_tum(flight.camera._replace(t=flight.camera.t + 5e5)))
    t = np.arange(0.0, 30.0, 0.1)
    names = ["t_s", "x_m", "y_m", "z_m"]
    line = [t, 2 * np.sin(t), 0 * t, 0 * t]
    (folder / "line.csv").write_text(format_table(names, line, [3, 5, 5, 5]))
    fast = np.arange(0.0, 30.0, 0.02)
    straight = Trajectory("", fast, np.stack([2 * np.sin(fast), 0 * fast, 0 * fast], axis=1))
    (folder / "straight.txt").write_text(format_tum(straight))
    (folder / "empty.csv").write_text("")
    (folder / "one.csv").write_text("t_s,x_m,y_m,z_m\n0,1,2,3\n")
    (folder / "few.csv").write_text("name,x_m,y_m,z_m\nA,1,2,3\nB,2,3,4\n")
    (folder / "short.csv").write_text("t_s,x_m,y_m,z_m\n" + "".join(
        f"{0.1 * k:.1f},{k},0,0\n" for k in range(20)))  # fmt: skip
    return folder


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("", "no data; valid: a station's and a camera's file, or --demo"),
        ("station.csv", "one trajectory only"),
        ("station.csv camera.txt truth.csv", "3 files for station and camera"),
        ("nothere.csv camera.txt", "No such file"),
        ("empty.csv camera.txt", "empty.csv: is empty"),
        ("one.csv camera.txt", "one.csv: 1 of 1 rows"),
        (". camera.txt", "is a directory"),
        ("station.csv camera.txt --reference empty.csv", "empty.csv: is empty"),
        ("camera.txt other.txt", "the station cannot be recognised"),
        ("station.csv other.txt", "do not overlap in time"),
        ("short.csv camera.txt", "at least 8 s"),
        ("station.csv camera.txt --align best", "--align best; valid: similarity"),
        ("station.csv camera.txt --compare best", "--compare best; valid: rigid"),
        ("station.csv camera.txt --calibrate 5", "is not a time span"),
        ("station.csv camera.txt --calibrate 9:5", "is not a time span"),
        ("station.csv camera.txt --calibrate 500:600", "a calibration requires at least 12"),
        ("station.csv camera.txt --time-offset nan", "--time-offset nan"),
        ("station.csv camera.txt --time-offset 1e6", "a calibration requires at least 12"),
        ("station.csv camera.txt --time-offset abc", "not a valid float"),
        ("station.csv camera.txt --reference-offset inf", "--reference-offset inf"),
        ("station.csv camera.txt --prism 1,2", "--prism: '1,2' is not a position"),
        ("station.csv camera.txt --prism 1,2,nan", "is not a position"),
        ("station.csv camera.txt --prism 1000,0,0", "is not a position"),
        ("station.csv camera.txt --frame few.csv few.csv", "2 points in common"),
        ("station.csv camera.txt --frame few.csv nothere.csv", "No such file"),
        ("station.csv camera.txt --frame station.csv few.csv", "found the header"),
        ("truth.csv --reference truth.csv --prism 0,0,0", "--prism needs a station"),
        ("truth.csv --reference truth.csv --calibrate 0:5", "--calibrate needs a station"),
        ("station.csv:/topic camera.txt", "is not an MCAP file"),
        ("--demo station.csv", "--demo generates its own files"),
        ("station.csv camera.txt --out camera.txt", "is a file"),
        ("station.csv camera.txt --out camera.txt/deep", "is a file"),
        ("station.csv nothere.txt --out fresh", "No such file"),
        ("station.csv camera.txt --station truth.csv", "3 files for station and camera"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_exit_2(files, monkeypatch, line, said):
    monkeypatch.chdir(files)
    before = sorted(p.name for p in files.iterdir())
    code, out, err = call(*line.split())
    assert code == 2 and out == ""
    assert said in err and err.count("\n") == 1
    assert sorted(p.name for p in files.iterdir()) == before


def test_a_straight_line_is_told(files, monkeypatch):
    monkeypatch.chdir(files)
    report = locate(["line.csv", "straight.txt"])
    assert any("nearly a straight line" in note for note in report.notes)
    assert math.degrees(report.fusion.calibration.rotation_std) > 10.0


def test_a_flat_calibration_is_told_where_it_matters(tmp_path):
    flight = reach.fly_climb(1)
    station, camera = flight.station, flight.camera
    (tmp_path / "s.csv").write_text(
        format_table(["t_s", "x_m", "y_m", "z_m"], [station.t, *station.p.T], [4, 5, 5, 5])
    )
    (tmp_path / "c.txt").write_text(format_tum(camera))
    data = [str(tmp_path / "s.csv"), str(tmp_path / "c.txt")]
    affine = locate(data, align="affine")
    assert any("nearly flat" in note and "--align similarity" in note for note in affine.notes)
    assert not any("nearly flat" in note for note in locate(data).notes)


def test_unreadable(files, monkeypatch):
    monkeypatch.chdir(files)

    def refuse(path, mode):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(bounded, "open", refuse, raising=False)
    code, _, err = call("station.csv", "camera.txt")
    assert code == 2 and "cannot be read (Permission denied)" in err


# --- reach --------------------------------------------------------------------------------------


def test_nominal_errors_are_millimetres_and_as_predicted():
    found = reach.measure_nominal(seeds=3)
    assert found.fused < 0.005
    assert found.fused == pytest.approx(found.predicted, rel=0.3)
    assert found.paper > 5.0 * found.fused


def test_outage_stays_near_the_floor_and_recovers():
    found = reach.measure_outage(seeds=8)
    assert found.lasted.min() > 12.5
    assert 0.5 < found.ratio < 1.6  # few seeds: benchmarks/bench_locate.py flies 50
    assert found.recovery_time(0.02) < 2.0
    assert np.mean(found.recovery_paper[40:]) > 0.05  # the paper's stays with the camera


def test_climb_from_a_plane():
    found = reach.measure_climb(seeds=5)
    assert found.flatness.max() < 0.1
    assert np.sqrt(np.mean(found.fused**2)) < 0.1
    assert np.median(found.affine) > 0.3


def test_a_point_is_found_again():
    found = reach.measure_revisit(flights=4)
    assert found.rms < 0.005
    assert found.found == found.moved == 1 and found.false_alarms == 0
    assert np.linalg.norm(found.untested[2]) > np.linalg.norm(found.errors[2])
