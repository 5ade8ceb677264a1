"""The thickness survey: one flight, and what it refuses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from plant_parts import build_context, build_plant
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.inspection.files.nde import UltrasonicScan, read_nde
from skywright.inspection.history.store import InspectionStore
from skywright.inspection.thickness import Reading
from skywright.missions.thickness_survey.figures import FIGURES
from skywright.missions.thickness_survey.gauge import build_gauge, find_probe, set_up
from skywright.missions.thickness_survey.metrics import (
    SpotReading,
    describe_readings,
    judge_readings,
)
from skywright.missions.thickness_survey.plan import plan
from skywright.recordings.recording import read_recording
from skywright.reports.inspection_report import build_inspection_report
from skywright.reports.replay import build_replay_data
from skywright.run.flight import Flown
from skywright.run.records import FlightRecords
from skywright.run.run import run_mission
from skywright.run.setup import Setup
from skywright.vehicle.plant import Surface
from skywright.vehicle.sensors.ultrasonic import Ultrasonic, rebuild_ascans


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory):
    """One spot on the sound wall and one on the thinned patch, under 0.4 mm of paint."""
    sets = [
        "mission.task.spots=[{name='a'},{name='b',x_m=0.2}]",
        "world.things.steel.paint_m=0.0004",
        "world.things.steel.velocity_m_per_s=5935.0",
    ]
    d = load_description("thickness-survey", sets=sets)
    folder = tmp_path_factory.mktemp("ut")
    return run_mission(d, out=folder / "run", records=folder / "r.db")


def test_it_measures_the_wall_through_paint(flown) -> None:
    assert flown.outcome == "succeeded", (flown.reason, flown.metrics)
    assert flown.metrics["thickness.accepted_fraction"] == 1.0
    found = {r["spot"]: r for r in flown.found["readings"] if r["accepted"]}
    # 0.25 % of velocity that the block does not have
    assert found["a"]["thickness_mm"] == pytest.approx(10.0 * 5920 / 5935, abs=0.02)
    assert found["b"]["thickness_mm"] == pytest.approx(8.0 * 5920 / 5935, abs=0.02)
    for r in found.values():
        assert abs(r["thickness_mm"] - (10.0 if r["spot"] == "a" else 8.0)) < r["u95_mm"]
    assert flown.found["procedure"]["block_thick_m"] == 0.0125
    assert flown.found["block_after"]["reasons"] == []


def test_the_database_holds_readings_block_and_spots(flown) -> None:
    store = InspectionStore(flown.directory.parent / "r.db")
    flight, readings = store.list_flights()[0], store.find_readings(component="steel")
    assert [r.reading.spot for r in readings if r.reading.accepted] == ["a", "b"]
    told = {r["spot"]: r for r in flown.found["readings"] if r["accepted"]}
    for r in readings:
        one = r.reading
        if not one.accepted:
            assert one.reason
            continue
        assert one.value == pytest.approx(told[one.spot]["thickness_mm"], abs=1e-3)
        assert one.u95 == pytest.approx(told[one.spot]["u95_mm"], abs=1e-3)
        # where the robot believes to be: off the truth by what the map errs by and its place
        true = told[one.spot]["u_m"], told[one.spot]["v_m"]
        off = math.dist((one.x_m, one.y_m), true)
        assert 0.0 < off < 2 * math.sqrt(3) * r.registration_std_m + 3 * one.place_u95_m
        assert abs(one.z_m) < 0.004
        scan = read_nde(flown.directory / one.data.split("#")[0])
        assert isinstance(scan, UltrasonicScan) and scan.u[0] == pytest.approx(one.x_m)
        assert any(
            np.allclose(scan.ascan[0, 0], np.clip(d.ascan, -1, 1), atol=1e-4)
            for d in flown.details if d.spot == one.spot
        )  # fmt: skip
        assert r.calibration == store.list_calibrations(flight.id)[0].id
    before, after = (c.calibrated for c in store.list_calibrations(flight.id))
    assert before.settings["velocity_mps"] == pytest.approx(5920, rel=0.002)
    assert after.passed and (before.stage, after.stage) == ("before", "after")
    assert store.list_coverages(flight.id)[0].coverage == ("spots", 2.0, 2.0, ())
    part = store.list_components()[0]
    assert (part.name, part.nominal_mm) == ("steel", 10.0)
    page = build_inspection_report(store, flight.id)
    assert page.procedure is not None and "steady_count = 5" in page.procedure.text
    assert sum(what.endswith(".nde") for what, _ in page.hashes) == len(readings)
    store.close()


def test_a_flight_that_ends_early_keeps_what_it_read(flown, tmp_path) -> None:
    """Cut after the first spot: its reading stays, the second spot is missed with the reason."""
    first = next(i for i, p in enumerate(flown.phases) if p.name == "free release")
    phases = flown.phases[: first + 1]
    samples = flown.samples[flown.samples["t"] < phases[-1].end_s]
    setup = Setup(flown.description)
    records = FlightRecords(tmp_path / "r.db", setup)
    records.start(tmp_path)
    records.close()
    records.add(Flown(setup, flown.plan, samples, phases))
    store = InspectionStore(tmp_path / "r.db")
    cover = store.list_coverages(store.list_flights()[0].id)[0].coverage
    good = {r.reading.spot for r in store.find_readings() if r.reading.accepted}
    assert len(good) <= 1 and cover.inspected == len(good)
    assert {m.reason.split(":")[0] for m in cover.missed} == {"a", "b"} - good
    assert "b: not reached" in cover.missed[-1].reason
    assert (tmp_path / "ascans" / "001.nde").is_file()
    store.close()


def test_the_replay_draws_readings_in_the_colour_of_the_wall(flown) -> None:
    marks = FIGURES.marks(flown)
    assert marks[0].name == "datum mark, as seen"
    marks = marks[1:]
    good = [m for m in marks if m.name != "reading refused"]
    assert [m.name for m in good] == ["10.0 mm", "8.0 mm"]
    assert sum(good[0].colour) > sum(good[1].colour)  # a thin wall is dark
    tip = flown.samples["p_WT"]
    assert all(np.min(np.linalg.norm(tip - m.p_W, axis=1)) < 0.01 for m in marks)
    assert {"8.0 mm", "10.0 mm"} <= {text for _, text in build_replay_data(flown)["legend"]}


def test_ascans_are_kept_and_rebuilt_bit_for_bit(flown) -> None:
    """What the evaluation reads is what the probe's stream recorded."""
    recording = read_recording(flown.directory / "recording.mcap", ["/sensors/thickness"])
    stream = recording.streams["/sensors/thickness"]
    d = flown.description
    probe = find_probe(Setup(d))
    t, scans, _ = rebuild_ascans(flown.samples, probe.true, d.true_world, d.mission.seed)
    assert len(t) == len(stream) > 50
    assert np.array_equal(scans, stream["ascan"])
    assert np.allclose(t, stream["t"], atol=1e-6)


def test_the_report_shows_readings_and_procedure(flown) -> None:
    assert all(chart.draw(flown) is not None for chart in FIGURES.charts.values())
    notes = " ".join(FIGURES.notes(flown))
    assert "steps of 5 and 12.5 mm" in notes and "simulated" in notes
    assert "2 of 2 spots" in FIGURES.describe(flown)


def test_metrics_of_readings_whose_answer_is_known(flown) -> None:
    """Four spots: right, 0.2 mm too thick, a doubling, and one with air that was refused."""

    def read(spot: str, mm: float, u95: float, reason: str = "", false: bool = False):
        reading = Reading(1.0, 1e-3 * mm, 1e-3 * u95, 0.5, 30.0, reason)
        return SpotReading(spot, 0.0, 0.0, reading, 0.01, false, np.zeros(4))

    found = [read("a", 10.01, 0.06), read("b", 10.2, 0.05, false=True), read("c", 20.0, 0.1),
             read("d", 1.0, 0.1, "no echo", True), read("a", 9.99, 0.06)]  # fmt: skip
    m = judge_readings(found, 4)
    assert m["thickness.accepted_fraction"] == 0.75
    assert m["thickness.false_accepts"] == 1.0
    assert m["thickness.skips"] == 1.0
    errors = np.array([0.01, 0.2, 10.0, -0.01])
    assert m["thickness.bias_mm"] == m["thickness.mean_error_mm"] == pytest.approx(errors.mean())
    thin = judge_readings([read("a", 9.96, 0.06)], 1)
    assert thin["thickness.mean_error_mm"] == pytest.approx(-0.04)
    assert thin["thickness.bias_mm"] == pytest.approx(0.04)
    assert m["thickness.error_p95_mm"] == pytest.approx(np.quantile(np.abs(errors), 0.95))
    assert m["thickness.u95_covers_fraction"] == 0.5
    assert m["thickness.u95_max_mm"] == pytest.approx(0.1)
    assert "thickness.bias_mm" not in judge_readings([found[3]], 1)
    # of the flight: two spots, a touch each or more, the block read to 20 um
    assert flown.metrics["thickness.spots"] == 2.0
    touches = sum(p.name.startswith(("hold ", "free hold ")) for p in flown.phases)
    assert flown.metrics["thickness.touches"] == touches >= 2
    assert 0.0 < flown.metrics["thickness.block_error_mm"] < 0.02
    assert flown.metrics["thickness.block_error_mm"] == pytest.approx(
        max(abs(e) for e in flown.found["block_after"]["errors_mm"]), abs=1e-4
    )
    assert flown.metrics["press.place_error_mm"] < 30.0


@pytest.mark.parametrize(
    ("sets", "words"),
    [
        (["world.things.steel.kind=crack"], "has no wall to measure"),
        (["mission.task.procedure.nominal_m=0.02"], "valid: 5 to 12.5 mm"),
        (["mission.task.procedure.block_thin_m=0.0126"], "above 0, growing"),
        (["mission.task.procedure.block_thin_m=0.001"], "step of 1 mm shows|another|us longer"),
        (["mission.task.slide_m=0.1"], "valid: 0"),
        (["mission.task.without_gear=true"], "either docked or in flight"),
        (
            ["mission.task.procedure.velocity_m_per_s=3240"],
            "a block of 3240 m/s for a wall of 5920",
        ),
        (["robot.sensors.thickness.gain=0.01"], "shows no echo above 20% of full screen"),
    ],
)
def test_what_does_not_fit_is_told_before_take_off(sets: list[str], words: str) -> None:
    if sets[0].endswith("crack"):
        d = load_description("thickness-survey")
        world = d.world.drop_things("steel")
        setup = Setup(d._replace(world=world))
    else:
        setup = Setup(load_description("thickness-survey", sets=sets))
    with pytest.raises(InputError, match=words):
        plan(setup)


def test_a_robot_without_the_probe_is_told() -> None:
    d = load_description("wall-contact")
    with pytest.raises(InputError, match=r"has no ultrasonic probe: add a table \[robot.sensors"):
        find_probe(Setup(d))


def test_couplant_thins_under_the_true_force(flown) -> None:
    """The film of each A-scan against Stefan's equation over the recorded force of that touch."""
    s, table = flown.samples, Ultrasonic.Table()
    new = np.flatnonzero(np.diff(s["ut_scan"], prepend=0) > 0)
    force = np.linalg.norm(s["f_contact"], axis=1)
    a, checked = table.face_radius_m, 0
    for k in new:
        film, i = s["ut_film"][k], int(np.searchsorted(s["t"], s["ut_t"][k] + 1e-6)) - 1
        if s["ut_share"][k] == 0.0 or not 1.1 * table.film_end_m < film < 1e-4:
            continue
        start = i
        while s["gap"][start - 1] <= table.touch_m:
            start -= 1
        push = float(np.sum(force[start : i + 1])) / 100.0  # N s
        squeeze = 4 * push / (3 * math.pi * table.viscosity_pa_s * a**4)
        assert film == pytest.approx((table.film_start_m**-2 + squeeze) ** -0.5, rel=0.1)
        checked += 1
    assert checked >= 3


def test_no_ascan_in_free_flight() -> None:
    plant = build_plant(build_context("thickness-survey"), Ultrasonic("ut"))
    plant.run(20)
    assert plant.read(Surface).gap > 0.1
    assert plant.read(Ultrasonic.Reading).scan == 0.0


def test_readings_of_a_flight_cut_short_are_none(flown) -> None:
    early = flown.samples[:100]
    run = Flown(Setup(flown.description), flown.plan, early, [])
    assert describe_readings(run) == {}


def test_the_gauge_of_a_procedure(tmp_path: Path) -> None:
    setup = Setup(load_description("thickness-survey"))
    procedure = setup.task.procedure.model_copy(update={"steady_count": 2, "steady_s": 0.0})
    done = set_up(setup, find_probe(setup), procedure)
    gauge = build_gauge(procedure, done)
    read: list[Reading] = gauge.add([0.0, 0.05], np.stack([done.echo, done.echo]))
    assert [r.accepted for r in read] == [False, True]
    assert read[1].thickness == pytest.approx(0.005, abs=2e-5)


@pytest.mark.parametrize(("yaw", "feasible"), [(-94.6, False), (0.0, True)])
def test_a_straight_way_on_which_a_rotor_would_hit_the_pipe_is_refused(
    yaw: float, feasible: bool
) -> None:
    """The robot turns on its way; flown nevertheless, a rotor touched this pipe."""
    sets = [
        "world.structure.shape=cylinder", "world.structure.radius_m=0.2132",
        "mission.task.datum=false",
        f"world.structure.yaw_deg={yaw}", "plant.map_error_m=0.013",
        "mission.task.spots=[{x_m=-0.065,y_m=0.248},{x_m=-0.055,y_m=-0.122},{x_m=-0.091,y_m=-0.121}]",
    ]  # fmt: skip
    found = plan(Setup(load_description("thickness-survey", sets=sets)))
    assert found.feasible == feasible, found.blocked_by
    if not feasible:
        assert found.blocked_by is not None
        assert found.blocked_by.startswith("the way to the survey: propeller")
