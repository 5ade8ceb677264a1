"""What a scan is judged by follows what was asked: pattern, sector, welds that are there or not."""

from __future__ import annotations

import cmath
import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit

from exact_map import EXACT
from skywright.description.loader import load_description
from skywright.description.world.spec import Weld
from skywright.description.world.surface import build_weld_curve, roll_points, unroll_points
from skywright.errors import InputError
from skywright.inspection.calibration import build_calibration
from skywright.inspection.crossings import Crossing, count_passes, separate_lines
from skywright.inspection.weld import process_scan
from skywright.inspection.weld_data import process_file
from skywright.missions.scan.coverage import compute_scan_coverage, judge_coverage, list_missed
from skywright.missions.scan.entries import build_entries
from skywright.missions.scan.fly import _calibrate as calibrate_touch
from skywright.missions.scan.inspected import find_inspected
from skywright.missions.scan.metrics import find_coverage, process_weld
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.welds import ERRORS, find_expected, judge_welds, list_waived
from skywright.models.eddy_current import build_probe_signal, ec_signal
from skywright.planning.patterns import build_pattern
from skywright.run.flight import PhaseRecord
from skywright.run.inspected import Inspected, read_inspected
from skywright.run.records import FlightRecords, RecordStore
from skywright.run.run import run_mission
from skywright.run.setup import Setup

RADIUS = 0.2


def build_run(
    centre_deg: float, keep: Any = lambda s, c: s < 9.0, sets: Any = (), **task: Any
) -> Any:
    """A scan that follows its pattern exactly wherever `keep` says."""
    sets = [
        *sets, "mission.task.side=angle", f"mission.task.centre_angle_deg={centre_deg}", *EXACT,
        *(f"mission.task.{k}={v}" for k, v in task.items()),
    ]  # fmt: skip
    setup = Setup(load_description("pipe-weld-scan", sets=sets))
    cylinder, asked = setup.true.cylinder, setup.task
    assert cylinder is not None
    corners = build_pattern(
        asked.pattern, cylinder.radius, cylinder.half_length, math.radians(centre_deg),
        math.radians(asked.arc_deg), asked.passes, asked.pass_length_m, asked.centre_s_m, 0.0
    ).corners  # fmt: skip
    way = ScanWay(0.03, 2.0, corners, corners)
    u = np.linspace(0.0, len(corners) - 1.0, 1500 * (len(corners) - 1))
    s = np.interp(u, np.arange(len(corners)), corners[:, 0])
    c = cylinder.radius * np.interp(u, np.arange(len(corners)), corners[:, 1])
    good = keep(s, c)
    samples = np.zeros(
        np.count_nonzero(good),
        [("p_WT", float, 3), ("gap_max", float), ("tilt", float), ("phase", int)],
    )
    samples["p_WT"] = roll_points(cylinder, s[good], c[good])[0]
    return SimpleNamespace(
        setup=setup, task=asked, way=way, samples=samples,
        phases=[PhaseRecord("scan", 0.0, 1.0, "done")],
    ), cylinder  # fmt: skip


@pytest.mark.parametrize("centre", [0.0, 90.0, 175.0, 180.0, -170.0])
def test_a_perfect_scan_covers_its_pattern_on_any_side(centre: float) -> None:
    run, cylinder = build_run(centre)
    found = judge_coverage(run, compute_scan_coverage(run, cylinder))
    assert found["coverage.fraction"] == 1.0 and found["coverage.missed_max_mm"] == 0.0
    assert found["coverage.pitch_mm"] == pytest.approx(1e3 * RADIUS * math.radians(40.0) / 3.0)


def test_a_detour_and_a_sample_off_the_surface_are_missed_parts() -> None:
    run, cylinder = build_run(0.0, lambda s, c: ~((np.abs(s) < 0.03) & (c > 0.06)))
    found = compute_scan_coverage(run, cylinder)
    (first,) = list_missed(found)  # the first pass lies at the top of the sector
    assert first[2] == pytest.approx(0.06 - 2 * 0.006, abs=0.003)
    run.samples["gap_max"][np.abs(run.samples["p_WT"][:, 1]) < 9.0] = 2e-3
    assert not np.any(compute_scan_coverage(run, cylinder).seen)


def test_the_area_needs_passes_as_close_as_the_coil_is_wide() -> None:
    run, cylinder = build_run(0.0, pattern="raster", arc_deg=10, passes=8, pass_length_m=0.1)
    dense = judge_coverage(run, compute_scan_coverage(run, cylinder))
    assert dense["coverage.pitch_mm"] < dense["coverage.pitch_full_mm"]
    assert dense["coverage.area_fraction"] > 0.97
    run, cylinder = build_run(0.0)
    wide = judge_coverage(run, compute_scan_coverage(run, cylinder))
    share = wide["coverage.pitch_full_mm"] / wide["coverage.pitch_mm"]
    assert share < wide["coverage.area_fraction"] < 1.5 * share  # and the steps between passes


@pytest.mark.parametrize(
    ("weld", "crossings", "line"),
    [
        (Weld(angle_deg=0.0), 4, True),
        (Weld(angle_deg=-30.0), 4, True),
        (Weld(angle_deg=90.0, offset_m=0.0), 1, False),  # one of the three steps
        (Weld(angle_deg=0.0, offset_m=0.3), 0, False),
        (Weld(angle_deg=0.0, offset_m=0.096), 0, False),  # the passes end on it
        (Weld(angle_deg=90.0, offset_m=math.pi * RADIUS), 0, False),  # on the far side
    ],
)
def test_expected_crossings_come_from_pattern_and_weld(
    weld: Weld, crossings: int, line: bool
) -> None:
    run, cylinder = build_run(0.0)
    path = compute_scan_coverage(run, cylinder).path
    found = find_expected(build_weld_curve(weld, RADIUS), path[:, 0], path[:, 1])
    assert (len(found.crossings), found.shows_line) == (crossings, line)
    curve = build_weld_curve(weld, RADIUS)
    for s, c in found.crossings:
        assert abs(float(curve.measure_distance(s, c))) < 2e-3


def make_crossings(*lines: tuple[float, float], passes: int, noise: float) -> tuple[Any, Any, Any]:
    """Crossings of axial passes with lines (offset m, slope), and the path."""
    rng, out = np.random.default_rng(1), []
    cs = np.linspace(-0.07, 0.07, passes)
    for i, c in enumerate(cs):
        for offset, slope in lines:
            at = offset + slope * RADIUS * math.sin(c / RADIUS) + noise * rng.standard_normal()
            v = 0.01 * (-1.0) ** i
            out.append(Crossing(0.0, at, c, (0.0, 0.0, 0.0), 5.0, v, 0.0, 5e-4, 100))
    s = np.concatenate([np.linspace(-0.1, 0.1, 400)[:: (-1) ** i] for i in range(passes)])
    return out, s, np.repeat(cs, 400)


@pytest.mark.parametrize("passes", [2, 4, 8])
@pytest.mark.parametrize("apart", [0.03, 0.06])
def test_two_girth_welds_are_two_lines(passes: int, apart: float) -> None:
    crossings, s, c = make_crossings(
        (-apart / 2, 0.1), (apart / 2, 0.05), passes=passes, noise=5e-4
    )
    lines = separate_lines(crossings, RADIUS, s, c, np.ones(len(s), bool))
    assert [len(x.inliers) for x in lines] == [passes, passes]
    offsets = sorted(float(x.s - math.tan(x.angle) * x.c) for x in lines)
    np.testing.assert_allclose(offsets, [-apart / 2, apart / 2], atol=2e-3)


def test_false_crossings_make_no_second_line() -> None:
    crossings, s, c = make_crossings((0.0, 0.1), passes=6, noise=5e-4)
    stray = [crossings[k]._replace(s=at) for k, at in ((0, 0.06), (3, -0.05))]
    lines = separate_lines([*crossings, *stray], RADIUS, s, c, np.ones(len(s), bool))
    assert len(lines) == 1 and len(lines[0].inliers) == 6
    assert count_passes(lines[0], s, c, np.ones(len(s), bool)) == 6


@njit
def read_probe(ps, s, c, gap, noise):  # type: ignore[no-untyped-def]
    """The instrument's readings (n, 2) of an upright probe."""
    out = np.empty((len(s), 2))
    for i in range(len(s)):
        out[i, 0], out[i, 1] = ec_signal(ps, s[i], c[i], gap[i], 0.0, noise[i, 0], noise[i, 1])
    return out


def process_signal(run: Any, cylinder: Any, blobs: tuple[float, ...] = ()) -> Any:
    """Process the instrument's signal along a perfect scan at 10 mm/s.

    `blobs` are distances (m) along the path with a false weld signal.
    """
    rng, s = np.random.default_rng(1), run.samples
    along, around, _ = unroll_points(cylinder, s["p_WT"])
    world = run.setup.true.world
    signal = build_probe_signal(world.pipe, world.list_welds(), rng)
    noise = rng.standard_normal((len(s) + 300, 2))
    approach, still = np.maximum(0.0, 0.05 - 2.5e-4 * np.arange(300)), np.ones(300)
    touch = read_probe(signal, along[0] * still, around[0] * still, approach, noise[:300])
    ec = read_probe(signal, along, around, np.zeros(len(s)), noise[300:])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(s["p_WT"], axis=0), axis=1))])
    real = build_probe_signal(world.pipe, [Weld()], rng)
    weld = ec_signal(real, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for blob in blobs:
        ec += np.exp(-0.5 * ((way - blob) / 0.003) ** 2)[:, None] * np.array(weld)
    calibration = build_calibration(touch, lift_off_threshold=15.0, weld_threshold=1.4)
    measured = s["p_WT"] + 1e-4 * rng.standard_normal((len(s), 3))
    return process_scan(100.0 * way, ec, measured, cylinder, calibration)


def read_signal(run: Any, cylinder: Any, blobs: tuple[float, ...] = ()) -> dict[str, float]:
    """Judge what is found in the signal of a perfect scan."""
    found = process_signal(run, cylinder, blobs)
    path = compute_scan_coverage(run, cylinder).path
    return judge_welds(run, found, (path[:, 0], path[:, 1]))


def add_welds(*welds: str) -> list[str]:
    return [f"world.welds.{x}" for x in welds]


@pytest.mark.parametrize(
    ("centre", "sets", "task", "expected", "lines"),
    [
        (0.0, [], {}, 4, 1),
        (180.0, ["world.weld.angle_deg=20"], {}, 4, 1),
        (172.0, ["world.weld.angle_deg=20"], {"arc_deg": 30}, 4, 1),
        (0.0, add_welds("b.offset_m=0.06"), {"pattern": "line"}, 2, 0),
        (0.0, add_welds("b.angle_deg=90"), {"passes": 6}, 7, 1),  # a seam, crossed by one step
        (0.0, add_welds("b.angle_deg=-10"), {}, 6, 2),  # they cross: two pairs have one peak
        (0.0, add_welds("b.offset_m=-0.05", "c.offset_m=0.05"), {"passes": 2}, 6, 3),
        (0.0, ["world.weld.present=false"], {}, 0, 0),
    ],
)
def test_all_that_the_pattern_crosses_is_found(
    centre: float, sets: list[str], task: dict[str, Any], expected: int, lines: int
) -> None:
    found = read_signal(*build_run(centre, sets=sets, **task))
    assert (found["weld.expected"], found["weld.crossings"]) == (expected, expected)
    assert found["weld.lines"] == lines
    assert found["weld.missed"] == found["weld.lines_missed"] == found["weld.false_alarms"] == 0.0
    assert max(found.get(name, 0.0) for name in ERRORS[:2]) < 1.0


@pytest.mark.parametrize("blobs", [(0.03,), (0.03, 0.07), (0.03, 0.06, 0.15)])
@pytest.mark.parametrize("welds", [[], ["world.weld.present=false"]])
def test_signals_without_a_weld_are_false_alarms(
    welds: list[str], blobs: tuple[float, ...]
) -> None:
    run, cylinder = build_run(0.0, sets=welds)
    found = read_signal(run, cylinder, blobs)
    assert found["weld.false_alarms"] == len(blobs) and found["weld.missed"] == 0.0


@pytest.mark.parametrize(
    ("sets", "lines", "unresolved"),
    [
        (add_welds("b.offset_m=0.004"), 1, 1),
        (add_welds("b.offset_m=0.008"), 1, 1),
        (add_welds("b.offset_m=0.012"), 1, 1),
        (add_welds("b.offset_m=0.016"), 2, 0),
        (add_welds("b.offset_m=0.02"), 2, 0),
        (add_welds("b.offset_m=0.016", "b.half_width_m=0.01"), 1, 1),
        ([f"world.weld.{x}" for x in ("permeability_change=0", "conductivity_change=0")], 0, 1),
        ([f"world.weld.{x}" for x in ("permeability_change=-0.05", "conductivity_change=0")], 0, 1),
        (["world.weld.permeability_change=-0.25"], 1, 0),
    ],
)
def test_welds_that_the_probe_cannot_tell_are_unresolved(
    sets: list[str], lines: int, unresolved: int
) -> None:
    sets = (
        ["world.weld.angle_deg=0", "world.welds.b.angle_deg=0", *sets] if "b." in sets[0] else sets
    )
    found = read_signal(*build_run(0.0, sets=sets))
    assert (found["weld.lines"], found["weld.unresolved"]) == (lines, unresolved)
    assert found["weld.lines_missed"] == found["weld.missed"] == found["weld.false_alarms"] == 0.0
    assert bool(list_waived(found)) == (not unresolved and not lines)


def inspect(run: Any, cylinder: Any, blobs: tuple[float, ...] = ()) -> Inspected:
    """What a scan of the constructed run says about the welds as flaws."""
    known = {
        find_coverage: compute_scan_coverage(run, cylinder),
        process_weld: process_signal(run, cylinder, blobs),
    }
    run.once = known.get
    return find_inspected(run)


def test_welds_are_flaws_with_their_contrast() -> None:
    """Strong and weak welds in one pipe; crossings of one weld are one datum."""
    weak = "b={offset_m=0.06,permeability_change=-0.03,conductivity_change=0.0}"
    found = inspect(*build_run(0.0, sets=add_welds(weak)))
    strong, faint = found.flaws
    assert strong.hit and strong.contact and strong.signal is not None and strong.signal > 4.0
    assert not faint.hit and faint.contact and faint.signal is not None and faint.signal < 2.0
    assert strong.sizes["contrast_units"] > 5 * faint.sizes["contrast_units"] > 0
    assert strong.sizes["width_mm"] == pytest.approx(10.0)
    assert strong.conditions["crossings"] == 4.0 and found.calls == 0
    # 4 passes of 0.2 m and the steps between, less 6 cm around each weld in each pass
    assert 8 <= found.sites <= 20
    assert read_inspected(json.loads(json.dumps(found.to_json()))) == found


def test_a_false_signal_is_a_call_and_no_hit() -> None:
    found = inspect(*build_run(0.0), blobs=(0.03,))
    assert found.calls == 1 and found.flaws[0].hit and len(found.flaws) == 1
    found = inspect(*build_run(0.0, sets=["world.weld.present=false"]))
    assert found.flaws == () and found.calls == 0 and found.sites > 20


def test_what_a_scan_found_goes_into_the_database(tmp_path: Path) -> None:
    """Crossings as indications: near the weld by their own u95, from what the robot knows."""
    run, cylinder = build_run(0.0)
    inspect(run, cylinder)
    found = build_entries(run)
    curve = build_weld_curve(run.setup.true.world.list_welds()[0], cylinder.radius)
    places = np.array([(i.x_m, i.y_m, i.z_m) for _, i in found.indications])
    s, c, _ = unroll_points(cylinder, places)
    off = np.abs(curve.measure_distance(s, c))
    u95 = [i.place_u95_m for _, i in found.indications]
    assert len(places) == 4 and max(off) < 1e-3 and min(u95) > 0 and max(u95) < 0.01
    records = FlightRecords(tmp_path / "r.db", run.setup)
    records.start(tmp_path / "run")
    records.close()
    records.add(run)
    store = RecordStore(tmp_path / "r.db")
    stored = store.find_indications(component="pipe")
    assert [i.indication for i in stored] == [i for _, i in found.indications]
    assert {i.disposition for i in stored} == {"open"} and all(i.simulated for i in stored)
    store.close()


def test_a_weld_where_the_probe_never_was_is_missed_without_contact() -> None:
    """The robot left out everything beyond s = 30 mm, where a second weld lies."""
    sets = add_welds("b.offset_m=0.06")
    run, cylinder = build_run(0.0, keep=lambda s, c: s < 0.03, sets=sets)
    first, second = inspect(run, cylinder).flaws
    assert first.hit and first.contact
    assert not second.hit and not second.contact and second.signal is None
    run.once = {}.get  # it never came to scanning
    assert [(f.hit, f.contact) for f in find_inspected(run).flaws] == [(False, False)] * 2


def test_a_pass_that_lies_on_a_seam_is_missed_not_waived() -> None:
    found = read_signal(*build_run(0.0, sets=["world.weld.angle_deg=90"], pattern="line"))
    assert found["weld.expected"] == found["weld.missed"] == 1.0 and not list_waived(found)


def test_a_line_is_judged_only_where_there_is_one_to_find() -> None:
    none = {
        "weld.lines": 0.0, "weld.lines_missed": 0.0, "weld.missed": 0.0, "weld.false_alarms": 0.0,
        "weld.unresolved": 0.0,
    }  # fmt: skip
    assert {"weld.line_error_mm", "weld.crossing_error_mm"} <= set(list_waived(none))
    assert "weld.crossing_error_mm" not in list_waived(none | {"weld.crossing_error_mm": 1.0})
    for name in ("weld.missed", "weld.false_alarms", "weld.unresolved"):
        assert not list_waived(none | {name: 1.0})
    for told in ({}, none | {"weld.lines_missed": 1.0}, none | {"weld.lines": 1.0}):
        assert "weld.line_error_mm" not in list_waived(told)


def test_no_weld_found_where_there_is_none_is_a_success(tmp_path: Path) -> None:
    sets = [*EXACT, "world.weld.present=false", "mission.task.passes=2",
            "mission.task.speed_mps=0.02", "mission.timestep_ms=2"]  # fmt: skip
    result = run_mission(load_description("pipe-weld-scan", sets=sets), out=tmp_path / "run")
    told = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    assert result.outcome == "succeeded" and "weld.line_error_mm" in told["waived"]
    assert told["result"]["lines"] == [] and told["result"]["missed"] == []
    assert told["metrics"]["weld.expected"] == 0.0


def test_two_welds_are_found_and_judged_each_with_its_line(tmp_path: Path) -> None:
    sets = [*EXACT, "world.welds.second.offset_m=0.06", "mission.task.speed_mps=0.02",
            "mission.timestep_ms=2"]  # fmt: skip
    folder = tmp_path / "run"
    result = run_mission(load_description("pipe-weld-scan", sets=sets), out=folder)
    assert result.outcome == "succeeded"
    assert result.metrics["weld.expected"] == 8.0 and result.metrics["weld.lines"] == 2.0
    told = result.found["lines"]
    assert [line["crossings"] for line in told] == [4, 4]
    # the recording alone, as an instrument's file, with a fitted surface
    for path in (folder, folder / "recording.mcap"):
        again = process_file(path).to_json()["lines"]
        assert [line["crossings"] for line in again] == [4, 4]
    apart = [min(math.dist(x["point_m"], y["point_m"]) for y in told) for x in again]
    assert max(apart) < 0.02
    with pytest.raises(InputError, match="recording"):
        process_file(tmp_path)


def test_a_recording_without_a_scan_is_told(tmp_path: Path) -> None:
    run_mission(
        load_description("waypoints", sets=["mission.hover_height_m=1.0"]), out=tmp_path / "run"
    )
    with pytest.raises(InputError, match="has no column ec"):
        process_file(tmp_path / "run")


def test_a_touch_calibrates_the_guard_of_a_display_that_is_turned_and_not_nulled() -> None:
    told: list[complex] = []
    s: Any = SimpleNamespace(probe=SimpleNamespace(calibrate=lambda *x: told.extend(x)))
    null, axis = complex(30.0, -45.0), cmath.rect(1.0, math.radians(200.0))
    lift = 80.0 * np.concatenate([np.ones(100), np.linspace(1.0, 0.0, 60), np.zeros(200)])
    w = null + axis * lift
    assert calibrate_touch(s, np.column_stack([w.real, w.imag]))
    assert told == [pytest.approx(null, abs=0.1), pytest.approx(axis, abs=1e-3)]
    told.clear()
    air = w[:100] + np.random.default_rng(1).normal(0.0, 0.2, 100)
    assert not calibrate_touch(s, np.column_stack([air.real, air.imag])) and not told
