"""Indications of a flaw scan on synthetic arrays, and one search for cracks in flight."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.cli import main
from skywright.description.loader import load_description
from skywright.description.world.surface import build_cylinder, roll_points, unroll_points, wrap
from skywright.errors import InputError
from skywright.inspection.files.nde import EddyScan, read_nde
from skywright.inspection.history.store import InspectionStore
from skywright.inspection.indications import COIL_WIDTH, FlawFinder, _join
from skywright.inspection.notch_setup import set_up
from skywright.missions.crack_scan.again import LEAST_HOLE, build_passes
from skywright.missions.crack_scan.cover import build_sector, compute_cover, list_gaps
from skywright.missions.crack_scan.display import find_array, set_up_display
from skywright.missions.crack_scan.figures import list_marks
from skywright.missions.crack_scan.judge import Flaw, match
from skywright.missions.crack_scan.plan import compute_pitch, compute_swath, plan
from skywright.models.block_scan import simulate_block_scan
from skywright.models.crack_signal import CELL, Metal, build_crack_table
from skywright.models.eddy_current import Coil, Instrument
from skywright.models.things.crack import Crack
from skywright.reports.inspection_report import build_inspection_report
from skywright.reports.replay import build_replay_data
from skywright.run.need import estimate_need
from skywright.run.records import FlightRecords
from skywright.run.run import run_mission
from skywright.run.setup import Setup

SCHEMAS = Path(__file__).parents[2] / "shared" / "data" / "nde"
SMALL = ["robot.battery.energy_wh=12"]
STEEL = Metal(5e6, 100.0)
COILS = np.linspace(-0.02, 0.02, 16)
DISPLAY = set_up(simulate_block_scan(STEEL, Coil(), Instrument(), np.random.default_rng(0)))


def scan(crack: Crack | None, rng: np.random.Generator, *, weld: bool = False, noise: float = 0.05):
    """One pass of 16 coils over 120 mm, in contact: t, signals in units, places."""
    s1 = np.linspace(-0.06, 0.06, 1200)
    s, c = np.meshgrid(s1, COILS, indexing="ij")
    z = noise * (rng.standard_normal(s.shape) + 1j * rng.standard_normal(s.shape))
    null = DISPLAY.null
    if crack is not None:
        table = build_crack_table(crack.length_m, crack.depth_m, STEEL, Coil(), Instrument()).signal
        turn = math.radians(crack.angle_deg)
        ds, dc = s - crack.s_m, c
        y = np.abs(ds * math.sin(turn) + dc * math.cos(turn)) / CELL
        x = np.abs(ds * math.cos(turn) - dc * math.sin(turn)) / CELL
        near = (x < table.shape[1] - 1) & (y < table.shape[2] - 1)
        z[near] += table[0][x[near].astype(int), y[near].astype(int)]
    if weld:  # across the path, 10 mm wide, 7.4 units against the crack
        z += (
            7.4
            * np.exp(1j * np.angle(-1.0 / DISPLAY.factor * 1j))
            * np.exp(-0.5 * ((s - 0.03) / 0.005) ** 2)
        )
    return 0.01 * np.arange(1200), z + null, s, c


def validate_nde(path: Path) -> None:
    """Check a file against the published schemas."""
    import fastjsonschema
    import h5py

    with h5py.File(path) as file:
        for name, place in (("Properties", "Properties"), ("Setup", "Public/Setup")):
            schema = json.loads((SCHEMAS / f"{name}-Schema-4.3.0.json").read_text())
            validate = fastjsonschema.compile(schema, formats={"date-time": r".*"})
            validate(json.loads(file[place][()]))


def search(t, z, s, c, **kw):
    finder = FlawFinder(**kw)
    finder.add(t, DISPLAY.show(z), s, c)
    return finder.find()


@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0])
def test_a_crack_is_found_where_it_is_whatever_its_direction(angle: float) -> None:
    crack = Crack(s_m=0.01, length_m=0.006, depth_m=0.001, angle_deg=angle)
    found = search(*scan(crack, np.random.default_rng(1)))
    assert [x.nature for x in found] == ["crack"]
    assert math.hypot(found[0].s - 0.01, found[0].c) < 0.0015 < found[0].u95
    assert 25.0 < found[0].height < 80.0


def test_heights_grow_with_depth_and_nothing_is_found_on_sound_metal() -> None:
    rng = np.random.default_rng(2)
    heights = [
        search(*scan(Crack(depth_m=d), rng), threshold=5.0)[0].height
        for d in (0.0003, 0.0006, 0.001, 0.002)
    ]
    assert np.all(np.diff(heights) > 3.0)
    assert not any(search(*scan(None, rng)) for _ in range(50))


def test_a_weld_is_wide_and_a_crack_beside_it_ambiguous() -> None:
    rng = np.random.default_rng(3)
    weld = search(*scan(None, rng, weld=True))
    assert {x.nature for x in weld if x.height < 0} == {"weld"}
    assert not [x for x in weld if x.nature == "crack"]
    far = search(*scan(Crack(s_m=-0.03), rng, weld=True))
    assert [x.nature for x in far if x.s < 0] == ["crack"]
    beside = search(*scan(Crack(s_m=0.018), rng, weld=True))
    assert [x.nature for x in beside if x.height > 0] == ["ambiguous"]


RADIUS = 0.2


def scan_around(height, start: float) -> FlawFinder:
    """One turn of 16 coils around a pipe, from c = `start`; c is given from -pi R to pi R.

    `height` returns the display's % FSH at (s, c) m, c within half a turn of 0.
    """
    rng, step = np.random.default_rng(11), 2e-4
    around = np.arange(start, start + 2 * math.pi * RADIUS, step)
    s, c = np.broadcast_arrays(COILS, wrap(around[:, None], RADIUS))
    up = height(s, c) + rng.normal(0.0, 0.5, s.shape)
    noise = rng.normal(0.0, 3e-4, (2, len(around), 1))
    finder = FlawFinder(radius_m=RADIUS)
    finder.add(0.01 * np.arange(len(around)), 1j * up, s + noise[0], wrap(c + noise[1], RADIUS))
    return finder


@pytest.mark.parametrize("place", [0.0, math.pi * RADIUS, 0.002 - math.pi * RADIUS])
def test_a_crack_on_the_cut_of_the_unrolled_pipe_is_one_crack(place: float) -> None:
    """A crack 12 mm around the pipe."""

    def height(s, c):
        beyond = np.maximum(np.abs(wrap(c - place, RADIUS)) - 0.006, 0.0)
        return 60.0 * np.exp(-0.5 * (np.hypot(s, beyond) / 0.0015) ** 2)

    found = scan_around(height, place - 0.3).find()
    assert [x.nature for x in found] == ["crack"]
    assert abs(wrap(found[0].c - place, RADIUS)) < 5e-4
    assert found[0].length == pytest.approx(0.017, abs=0.0015)
    assert abs(found[0].angle) < 0.1


def test_a_weld_beside_a_crack_may_lie_across_the_cut() -> None:
    """The crack is at c = 5 mm - pi R, 11 mm from the middle of the seam at pi R - 6 mm."""

    def height(s, c):
        crack = np.hypot(s, wrap(c + math.pi * RADIUS - 0.005, RADIUS)) / 0.0015
        seam = wrap(c - math.pi * RADIUS + 0.006, RADIUS) / 0.004
        return 50.0 * np.exp(-0.5 * crack**2) - 50.0 * np.exp(-0.5 * seam**2)

    found = scan_around(height, 0.0).find()
    assert {x.nature for x in found if x.height < 0} == {"weld"}
    assert [x.nature for x in found if x.height > 0] == ["ambiguous"]


def test_an_indication_around_most_of_the_pipe_is_cut_in_its_gap() -> None:
    """300 deg from -20 deg on, across the cut at 180 deg, most samples at the start."""
    around = np.radians(np.concatenate([np.linspace(-20, 0, 500), np.linspace(1, 280, 280)]))
    place = np.column_stack([np.zeros(780), wrap(RADIUS * around, RADIUS)])
    np.testing.assert_allclose(_join(place, RADIUS)[:, 1], RADIUS * around, atol=1e-12)
    np.testing.assert_array_equal(_join(place, math.inf), place)


def test_what_separates_a_crack_from_a_weld_grows_with_the_coil() -> None:
    """A coil of twice the size sees a crack twice as wide; of half the size a weld is no crack."""
    large = Coil(0.002, 0.005, 0.006, recess=0.001)
    wide = set_up(simulate_block_scan(STEEL, large, Instrument(), np.random.default_rng(0)))
    t, z, s, c = scan(None, np.random.default_rng(9))
    table = build_crack_table(0.012, 0.002, STEEL, large, Instrument()).signal[0]
    y, x = np.abs(c) / CELL, np.abs(s - 0.01) / CELL
    near = (x < table.shape[0] - 1) & (y < table.shape[1] - 1)
    z += wide.null - DISPLAY.null
    z[near] += table[x[near].astype(int), y[near].astype(int)]

    def look(width: float):
        finder = FlawFinder(coil_width_m=width)
        finder.add(t, wide.show(z), s, c)
        return finder.find()

    assert [x.nature for x in look(2 * COIL_WIDTH)] == ["crack"]
    assert "crack" not in {x.nature for x in look(COIL_WIDTH)}
    weld = search(*scan(None, np.random.default_rng(3), weld=True), coil_width_m=COIL_WIDTH / 2)
    assert {x.nature for x in weld if x.height < 0} == {"weld"}


def test_a_crack_beside_the_sector_is_no_false_call() -> None:
    t, z, s, c = scan(Crack(s_m=0.01), np.random.default_rng(7))
    found = search(t, z, s, c)
    assert match(found, [], [Flaw("a", Crack(), 0.01, 0.0, (0.01, 0.0))]) == ([], 0)
    assert match(found, [], [])[1] == 1


def test_noise_of_the_tracker_does_not_shorten_the_window() -> None:
    """A crack along the path lasts for 9 mm; measured places scatter by three samples' way."""
    rng = np.random.default_rng(8)
    t, z, s, c = scan(Crack(s_m=0.01, angle_deg=90.0), rng)
    quiet = search(t, z, s, c)
    noise = rng.normal(0.0, 0.0003, (2, len(t), 1))
    found = search(t, z, s + noise[0], c + noise[1])
    assert [x.nature for x in found] == ["crack"]
    assert found[0].height == pytest.approx(quiet[0].height, abs=2.0)


def test_blocks_of_a_stream_give_what_the_file_gives() -> None:
    t, z, s, c = scan(Crack(s_m=0.01), np.random.default_rng(4))
    whole = search(t, z, s, c)
    live = FlawFinder()
    rings = [
        live.add(t[i : i + 100], DISPLAY.show(z[i : i + 100]), s[i : i + 100], c[i : i + 100])
        for i in range(0, 1200, 100)
    ]
    assert live.find() == whole
    assert np.argmax(rings) in (6, 7)  # the crack lies at 0.58 of the way
    assert sum(rings) > 0


def test_lost_contact_is_no_indication() -> None:
    t, z, s, c = scan(Crack(s_m=0.01), np.random.default_rng(5))
    display = DISPLAY.show(z)
    display[600:800] = np.nan
    finder = FlawFinder()
    finder.add(t, display, s, c)
    assert finder.find() == []


def test_wrong_blocks_are_told() -> None:
    t, z, s, c = scan(None, np.random.default_rng(6))
    with pytest.raises(InputError, match="valid: above 0"):
        FlawFinder(threshold=0.0)
    with pytest.raises(InputError, match="inf for a plane"):
        FlawFinder(radius_m=math.nan)
    with pytest.raises(InputError, match=r"three times \(n, k\)"):
        FlawFinder().add(t[:5], z, s, c)
    finder = FlawFinder()
    finder.add(t, z, s, c)
    with pytest.raises(InputError, match="a block of 4 coils after one of 16"):
        finder.add(t, z[:, :4], s[:, :4], c[:, :4])
    assert FlawFinder().find() == []


def test_each_report_is_a_flaw_or_a_false_call() -> None:
    t, z, s, c = scan(Crack(s_m=0.01), np.random.default_rng(7))
    found = search(t, z, s, c)
    here = Flaw("a", Crack(), 0.01, 0.0, (0.01, 0.0))
    assert match(found, [here])[1] == 0
    assert match(found, [here])[0][0] == pytest.approx(0.0, abs=0.0015)
    assert match(found, [here._replace(s=0.05)]) == ([None], 1)
    long = Flaw("b", Crack(length_m=0.04, angle_deg=90.0), -0.01, 0.0, (-0.01, 0.0))
    assert float(long.measure(np.array([0.01]), np.array([0.003]))[0]) == pytest.approx(0.003)


# -- in flight -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory):
    """One pass over a sector of two: what it misses is flown once more."""
    sets = ["mission.task.arc_deg=20", "mission.task.passes=1", "mission.task.pass_length_m=0.08",
            "mission.task.centre_s_m=0.09", "mission.timestep_ms=2"]  # fmt: skip
    d = load_description("crack-scan", sets=sets)
    folder = tmp_path_factory.mktemp("cracks")
    return run_mission(d, out=folder / "run", records=folder / "r.db")


def test_cracks_are_found_in_flight(flown) -> None:
    assert flown.outcome == "succeeded", (flown.reason, flown.metrics)
    m = flown.metrics
    assert (m["crack.expected"], m["crack.missed"], m["crack.false_calls"]) == (2.0, 0.0, 0.0)
    assert m["crack.indications"] >= 2.0 and m["crack.ambiguous"] == 0.0
    assert m["crack.position_error_mm"] < 5.0
    assert m["crack.block_drifted"] == 0.0
    assert m["crack.block_notch_percent"] == pytest.approx(80.0, abs=4.0)
    assert m["coverage.area_fraction"] > 0.95 and m["coverage.gap_max_mm"] < 5.0
    assert (m["coverage.passes"], m["coverage.again"]) == (1.0, 1.0)
    scans = [p for p in flown.phases if p.name == "scan"]
    first = flown.samples["t"] < scans[0].end_s
    place = flown.details.t < scans[0].end_s
    seen = compute_cover(flown.details.cover.sector, flown.details.s[place], flown.details.c[place])
    assert len(scans) == 2 and first.any() and seen.fraction < 0.7


def test_the_report_maps_the_display(flown) -> None:
    from skywright.missions.crack_scan.figures import FIGURES

    assert all(chart.draw(flown) is not None for chart in FIGURES.charts.values())
    notes = " ".join(FIGURES.notes(flown))
    assert "notch of 1 mm at 80 %" in notes and "simulated" in notes and "crack" in notes
    assert "2 of 2 cracks" in FIGURES.describe(flown)


def test_the_database_holds_what_the_flight_knows(flown) -> None:
    """Indications on the map's pipe, both visits of the block, the area, the procedure."""
    store = InspectionStore(flown.directory.parent / "r.db")
    flight = store.list_flights()[0]
    cracks = store.find_indications(component="pipe")
    assert {i.indication.kind for i in cracks} == {"crack"}
    d = flown.description
    map_pipe = build_cylinder(d.world.pipe)
    assert flight.registration_std_m == pytest.approx(1e-3 * flown.metrics["datum.place_std_mm"])
    for name in ("crack1", "crack2"):
        true = d.world.things[name]
        c = map_pipe.radius * math.radians(true.around_deg)
        p = roll_points(map_pipe, true.s_m, c)[0][0]
        places = [(i.indication.x_m, i.indication.y_m, i.indication.z_m) for i in cracks]
        off = min(math.dist(p, place) for place in places)
        assert off < 2 * math.sqrt(3) * flight.registration_std_m + 0.005
        on_pipe = unroll_points(map_pipe, np.array(places))[2]
        assert np.max(np.abs(on_pipe)) < 1e-9
    stages = [(c.calibrated.stage, c.calibrated.passed) for c in store.list_calibrations(flight.id)]
    assert stages == [("before", True), ("after", True)]
    cover = store.list_coverages(flight.id)[0].coverage
    share = cover.inspected / cover.asked
    assert share == pytest.approx(flown.metrics["coverage.area_fraction"], abs=0.02)
    arc = math.radians(d.mission.task.arc_deg) * d.world.pipe.diameter_m / 2
    assert cover.asked == pytest.approx(0.08 * arc, rel=0.05)
    assert flight.procedure is not None
    text = tomllib.loads(store.get_procedure(flight.procedure).text)
    assert text["procedure"]["threshold_percent"] == 15.0
    assert text["instrument"]["coils"] == 16 and "noise" not in text["instrument"]
    page = build_inspection_report(store, flight.id)
    assert not page.deviations and page.coverages == [cover]
    store.close()


def test_the_signals_lie_in_the_run(flown) -> None:
    scan = read_nde(flown.directory / "array.nde")
    assert isinstance(scan, EddyScan) and scan.simulated
    z = flown.details.z
    assert np.allclose(scan.impedance, z.T) and scan.impedance.shape[0] == 16
    assert np.ptp(np.hypot(*scan.offsets.T)) > 0.015  # the array is 40 mm wide
    if SCHEMAS.is_dir():
        validate_nde(flown.directory / "array.nde")


def test_contact_is_known_from_the_lift_off(flown) -> None:
    """As the truth has it; a probe that is lifted by 0.7 mm over paint does not count."""
    setup = Setup(load_description("crack-scan"))
    array = find_array(setup)
    display = set_up_display(setup, array)
    at = np.linspace(0.0, 1e-3, 6)
    read = np.interp(at, display.shims, display.lifted.real) + 1j * np.interp(
        at, display.shims, display.lifted.imag
    )
    for paint in (0, 1):  # 0.2 mm
        z = np.full((40, 1), read[paint])
        z[30:, 0] = read[5]
        gap = display.measure_gaps(z, np.zeros(1))[:, 0]
        assert gap[:30] == pytest.approx(0.0, abs=1e-5)
        assert gap[30:] == pytest.approx(1e-3 - 2e-4 * paint, abs=3e-5)
    assert np.isnan(display.measure_gaps(np.zeros((3, 1)), np.zeros(1))).all()
    assert flown.details.counts.mean() > 0.97


def test_another_procedure_needs_another_revision(flown, tmp_path) -> None:
    path = tmp_path / "r.db"
    shutil.copy(flown.directory.parent / "r.db", path)
    sets = ["mission.task.procedure.threshold_percent=20"]
    with pytest.raises(InputError, match="is stored with another text; give it another revision"):
        FlightRecords(path, Setup(load_description("crack-scan", sets=sets)))
    store = FlightRecords(path, Setup(load_description(
        "crack-scan", sets=[*sets, "mission.task.procedure.revision=1"]
    )))  # fmt: skip
    store.close()
    assert len(InspectionStore(path).list_flights()) == 1  # nothing was flown


def test_a_run_is_imported_once(flown, tmp_path) -> None:
    done = CliRunner().invoke(main, ["records", str(tmp_path / "n.db"), "--import",
                                     str(flown.directory)])  # fmt: skip
    assert done.exit_code == 0 and "crack" in done.output, done.output
    one, two = (InspectionStore(p) for p in (tmp_path / "n.db", flown.directory.parent / "r.db"))
    assert [i.indication for i in one.find_indications()] == [
        i.indication for i in two.find_indications()
    ]
    one.close()
    for args, says in (((), "is in it as flight"), (("--structure", "x"), "not valid for a run")):
        done = CliRunner().invoke(
            main, ["records", str(tmp_path / "n.db"), "--import", str(flown.directory), *args]
        )
        assert done.exit_code == 2 and says in done.output
    path = tmp_path / "m.db"
    args = ["--dicom", str(tmp_path / "o.dcm"), "--component", "wrong"]
    command = ["records", str(path), "--import", str(flown.directory)]
    done = CliRunner().invoke(main, [*command, *args])
    assert done.exit_code == 2 and "no component 'wrong'" in done.output, done.output
    store = InspectionStore(path)  # the import was undone
    tables = ("flights", "readings", "indications", "contacts", "calibrations", "coverages")
    assert not any(store.read(f"SELECT * FROM {table}") for table in tables)
    store.close()
    assert CliRunner().invoke(main, command).exit_code == 0


def test_time_and_energy_are_told_before_take_off(flown) -> None:
    """The power of the estimate is that of the flight; a small battery is refused with the need."""
    plan_, m = flown.plan, flown.metrics
    power = m["flight.energy_wh"] / flown.timing["simulated_s"]
    assert plan_.need.energy_wh / (60 * plan_.need.minutes) == pytest.approx(power, rel=0.15)
    assert plan_.need.batteries == pytest.approx(plan_.need.energy_wh / (74.0 * 0.8))
    assert not plan(Setup(load_description("crack-scan", sets=SMALL))).feasible
    blocked = plan(Setup(load_description("crack-scan", sets=SMALL))).blocked_by
    assert re.match(
        r"battery: 3 passes of 120 mm takes 3\.\d min and 1\d Wh, .* 2 batteries", blocked
    )
    windy = Setup(load_description("crack-scan", sets=["world.wind.kind=steady",
                                                        "world.wind.mean_mps=8"]))  # fmt: skip
    calm = estimate_need(Setup(load_description("crack-scan")), 100.0)
    assert calm is not None
    more = estimate_need(windy, 100.0)
    assert more is not None and 1.0 < more.energy_wh / calm.energy_wh < 1.3


@given(st.lists(st.tuples(st.floats(0.04, 0.16), st.floats(-0.05, 0.05), st.floats(0.001, 0.05),
                          st.floats(0.001, 0.06)), min_size=1, max_size=4),
       st.sampled_from([0.00344, 0.04344]), st.integers(0, 99))  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_passes_over_missed_parts_cover_them(holes, swath: float, seed: int) -> None:
    """Wherever the holes lie, also with a lateral error of each pass."""
    task, std = load_description("crack-scan").mission.task, 0.0005
    sector = build_sector(task, 0.2, 0.00344)
    s, c = sector.cells.T
    hole = np.zeros(len(s), bool)
    for at_s, at_c, long, wide in holes:
        hole |= (np.abs(s - at_s) < long / 2) & (np.abs(c - at_c) < wide / 2)
    before = compute_cover(sector, s[~hole], c[~hole])
    pitch = swath - 2.33 * math.sqrt(2) * std
    passes = build_passes(before, swath, pitch, std)
    if before.hole_m <= LEAST_HOLE:
        assert not len(passes)
        return
    rng = np.random.default_rng(seed)
    coils = np.linspace(-0.5, 0.5, 16) * (swath - 0.00344) if swath > 0.01 else np.zeros(1)
    places = []
    for a, b in passes.reshape(-1, 2, 2):
        assert a[1] == b[1] and abs(a[0] - b[0]) > 0
        along = np.linspace(a[0], b[0], 300)
        at = np.stack(np.meshgrid(along, b[1] + coils + rng.normal(0, std), indexing="ij"), -1)
        places.append(at.reshape(-1, 2))
    flown = np.concatenate([*places, sector.cells[~hole]])
    after = compute_cover(sector, flown[:, 0], flown[:, 1])
    assert after.fraction > 0.985 and after.hole_m < 0.002


def test_gaps_are_told_with_their_rectangle() -> None:
    task = load_description("crack-scan").mission.task
    sector = build_sector(task, 0.2, 0.004)
    s, c = sector.cells.T
    hole = (np.abs(s - 0.1) < 0.01) & (np.abs(c) < 0.005)
    cover = compute_cover(sector, s[~hole], c[~hole])
    [gap] = list_gaps(cover)
    assert gap.hole_m == cover.hole_m == pytest.approx(0.006, abs=0.0015)
    assert gap.start == pytest.approx((0.092, -0.003), abs=0.0015)
    assert gap.end == pytest.approx((0.108, 0.003), abs=0.0015)
    assert gap.area_m2 == pytest.approx(cover.area_m2 * (1 - cover.fraction))
    nothing = compute_cover(sector, np.zeros(0), np.zeros(0))
    assert nothing.fraction == 0.0 and len(list_gaps(nothing)) == 1


def test_the_replay_draws_swath_and_indications(flown) -> None:
    data = build_replay_data(flown)
    legend = {text for _, text in data["legend"]}
    assert {"edge of the swath", "indication: crack"} <= legend and "missed" not in legend
    times = [m["since"] for m in data["meshes"] if "since" in m]
    found = flown.details.indications
    assert len(times) == 5 + len(found)  # two edges of two scans, and the datum mark
    start = float(flown.samples["t"][0])
    assert all(min(abs(t - x.t + start) for t in times) < 0.02 for x in found)
    half = flown.details.cover.away.copy()
    half[: len(half) // 2] = 0.05
    cover = flown.details.cover._replace(away=half, covered=half < 0.001)
    marks = list_marks(flown._replace(details=flown.details._replace(cover=cover)))
    assert "missed" in {m.name for m in marks}


def test_passes_follow_swath_and_lateral_error() -> None:
    setup = Setup(load_description("crack-scan"))
    array, procedure = find_array(setup), setup.task.procedure
    swath = compute_swath(array)
    assert swath == pytest.approx(0.04344)
    pitch = compute_pitch(swath, array, procedure, procedure.lateral_std_m)
    assert pitch == pytest.approx(swath - 2.33 * math.sqrt(2) * 0.0005)
    assert compute_pitch(swath, array, procedure, 0.0) == pytest.approx(swath - 0.1 * 0.00344)


@pytest.mark.parametrize(
    ("sets", "words"),
    [
        (["mission.task.arc_deg=5"], "narrower than the swath of 43 mm"),
        (["world.things.block.relative_permeability=60.0"], "block of the part's material"),
        (["mission.task.procedure.notch_m=0.0015"], "has notches of 0.0005, 0.001, 0.002 m"),
        (["robot.sensors.eddy.layout=differential"], "cannot be used to search for cracks"),
        (["mission.task.procedure.lateral_std_m=0.015"], "use an array, or lower"),
        (["robot.sensors.eddy.noise=5.0"], "of noise; valid: 10 times"),
    ],
)
def test_what_does_not_fit_is_told_before_take_off(sets: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        plan(Setup(load_description("crack-scan", sets=sets)))


def test_a_robot_without_an_array_is_told() -> None:
    with pytest.raises(InputError, match="has no eddy-current array"):
        find_array(Setup(load_description("pipe-weld-scan")))


def test_a_shim_at_the_set_up_gives_back_what_paint_takes() -> None:
    """A notch under 0.5 mm of paint reads 80 % on a display that was set up on the shim."""
    plain, painted = (
        set_up_display(Setup(load_description("crack-scan", sets=sets)), COATED)
        for sets, COATED in (
            (s, find_array(Setup(load_description("crack-scan", sets=s))))
            for s in ([], ["mission.task.procedure.coating_m=0.0005"])
        )
    )
    rng = np.random.default_rng(3)
    notch = simulate_block_scan(STEEL, Coil(), Instrument(), rng, paint=5e-4)
    for display, lost in ((plain, 5.4), (painted, 0.0)):
        up = display.setup.show(notch.notch) - display.setup.show(np.median(notch.sound))
        assert 20 * math.log10(80.0 / np.max(up.imag)) == pytest.approx(lost, abs=0.5)
    # the shims are counted from the coating: contact reads no gap, 0.3 mm more reads 0.3 mm
    air = np.zeros(1)
    z = np.concatenate([np.repeat(painted.lifted[0], 9), painted.lifted[3:4]])[:, None]
    gap = painted.measure_gaps(z, air)
    assert gap[[0, -1], 0] == pytest.approx([0.0, 3e-4], abs=3e-5)
