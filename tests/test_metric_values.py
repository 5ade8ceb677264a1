"""Every metric of a flight has its value: on recordings whose answer is known beforehand.

The parts of a mission's own metrics that hands, bench and tools have are in test_metric_hands.py.
"""

from __future__ import annotations

import ast
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from constructed import DT, LEVEL, about, build_flown, build_samples
from skywright.description.world.surface import roll_points
from skywright.inspection.crossings import Crossing
from skywright.inspection.weld import WeldResult
from skywright.inspection.weld_line import WeldLine
from skywright.missions.flight_modes.metrics import compute_metrics as judge_modes
from skywright.missions.scan import metrics as scan_metrics
from skywright.missions.scan.coverage import compute_scan_coverage, judge_coverage
from skywright.missions.scan.welds import judge_welds
from skywright.run.faults._rule import Acted
from skywright.run.metrics import compute_common_metrics, compute_tracking

FLYING: dict[str, Any] = {
    "rotor_thrust": np.full(6, 5.0), "power": 0.0, "saturated": 0.0, "f_collision": 0.0,
    "p_WB": np.zeros(3), "est_p_WB": np.zeros(3),
}  # fmt: skip


def test_energy_duration_saturation_and_estimate_of_any_flight() -> None:
    away = np.zeros((1000, 3))
    away[300, 0], away[400, 1] = 0.003, -0.004
    n = np.arange(1000)
    cut = (n >= 950) | (abs(n - 100) < 10)
    s, phases = build_samples(
        [("take_off", 4.0), ("land", 6.0)], **FLYING
        | {"power": [360.0, 720.0], "saturated": cut * 1.0, "est_p_WB": away}
    )  # fmt: skip
    m = compute_common_metrics(s, phases)
    assert m["flight.duration_s"] == pytest.approx(9.99)
    # 4 s of 360 W and 6 s of 720 W, the first sample lasts no time
    assert m["flight.energy_wh"] == pytest.approx((360.0 * 3.99 + 720.0 * 6.0) / 3600.0)
    assert m["flight.saturated_s"] == pytest.approx(0.69)
    assert m["flight.saturated_max_s"] == pytest.approx(0.5)
    assert m["estimate.position_max_mm"] == pytest.approx(4.0)
    assert m["estimate.position_rms_mm"] == pytest.approx(5.0 / math.sqrt(1000.0))


def test_how_a_robot_comes_down_after_a_rule_acted() -> None:
    """Below or beside its reference it deviates; above it, as on the ground, it does not."""
    n = np.arange(600)
    off = np.zeros((600, 3))
    off[50] = [9.0, 0.0, 0.0]  # before the rule
    off[300], off[500] = [0.3, 0.0, -0.4], [0.0, 0.1, 2.0]
    s, phases = build_samples(
        [("hold 1", 2.0), ("land here", 3.0), ("let go", 1.0)],
        **FLYING | {"p_WB": off, "ref_p_WB": np.zeros(3)},
    )
    phases[0] = phases[0]._replace(outcome="failed")  # as missions and pilots end phases too
    assert "response.landed" not in compute_common_metrics(s, phases)
    acted = [Acted("gust", 1.99, 9.0, 8.0, "m/s", "land_here", "wind 9 m/s, limit 8 m/s")]
    m = compute_common_metrics(s, phases, acted=acted)
    assert m["response.landed"] == 0.0
    assert m["response.deviation_max_m"] == pytest.approx(0.5)
    s = s[n < 500]
    s["p_WB"][300] = 0.0
    s["p_WB"][450] = [0.0, 0.1, 2.0]
    m = compute_common_metrics(s, phases[:2], acted=acted)
    assert m["response.landed"] == 1.0
    assert m["response.deviation_max_m"] == pytest.approx(0.1)
    failed = [phases[0], phases[1]._replace(outcome="failed")]
    assert compute_common_metrics(s, failed, acted=acted)["response.landed"] == 0.0
    s["rotor_thrust"][200:] = 0.0  # the motors stopped before the response began
    fell = [phases[0], phases[1]._replace(name="let go")]
    assert compute_common_metrics(s, fell, acted=acted)["response.landed"] == 0.0


def test_a_servo_at_its_stall_torque_is_counted() -> None:
    n = np.arange(400)
    load = np.where(n < 2, 1.0, 0.3) + 0.7 * ((n >= 100) & (n < 160))  # a jerk at the start
    s, phases = build_samples([("take_off", 2.0), ("hold", 2.0)], **FLYING | {"servo_load": load})
    m = compute_common_metrics(s, phases)
    assert m["arm.saturated_s"] == pytest.approx(0.61)  # the first sample lasts no time
    assert m["arm.saturated_max_s"] == pytest.approx(0.6)
    bare, phases = build_samples([("take_off", 2.0), ("hold", 2.0)], **FLYING)
    assert "arm.saturated_s" not in compute_common_metrics(bare, phases)


def test_saturation_counts_where_a_robot_flies_and_not_where_it_stands_on_its_arms() -> None:
    n = np.arange(400)
    s, phases = build_samples(
        [("take_off", 2.0), ("hold", 2.0)], **FLYING
        | {"saturated": ((n >= 50) & (n < 300)) * 1.0, "f_collision": (n < 150) * 9.0}
    )  # fmt: skip
    for hanging, longest in ((False, 2.5), (True, 1.5)):
        m = compute_common_metrics(s, phases, hanging)
        assert m["flight.saturated_max_s"] == pytest.approx(longest)


def test_an_outage_is_judged_by_what_is_stated_in_it() -> None:
    n = np.arange(1000)
    out = (n >= 600) & (n < 800)
    error = np.zeros((1000, 3))
    error[:, 0] = np.where(out, 0.06, 0.01)
    error[700] = [0.0, 0.06, 0.08]  # one moment of 100 mm
    s, phases = build_samples(
        [("hold", 10.0)], **FLYING
        | {"est_p_WB": error, "pose_std": np.where(out, 0.02, 0.01), "fix_age": out * 1.0}
    )  # fmt: skip
    m = compute_common_metrics(s, phases)
    assert m["estimate.outage_s"] == pytest.approx(2.0)
    assert m["estimate.outage_max_mm"] == pytest.approx(100.0)
    # along one axis of three: 3 sigmas there are 3 / sqrt(3) of the root mean square
    away = (199 * 9.0 + 25.0) / 200
    assert m["estimate.outage_sigmas"] == pytest.approx(math.sqrt(away / 3.0))
    assert m["estimate.sigmas"] == pytest.approx(math.sqrt((0.8 * 1.0 + 0.2 * away) / 3.0))


def test_tracking_of_a_path() -> None:
    off = np.zeros((300, 3))
    off[:100, 2], off[150, 0] = 0.03, 0.05
    q = np.tile(LEVEL, (300, 1))
    q[120] = about("y", 12.0)
    s, phases = build_samples(
        [("waypoint 1", 1.0), ("hold 1", 2.0)],
        p_WB=off, ref_p_WB=np.zeros(3), q_WB=q, ref_q_WB=LEVEL,
    )  # fmt: skip
    m = compute_tracking(build_flown("waypoints", s, phases, segments={"waypoint 1": None}))
    assert m["position.max_m"] == pytest.approx(0.05)
    assert m["position.rms_m"] == pytest.approx(math.sqrt((100 * 0.03**2 + 0.05**2) / 300))
    assert m["position.final_error_m"] == pytest.approx(0.05 / 200)
    assert m["platform.tilt_max_deg"] == pytest.approx(12.0)


def test_the_final_error_is_that_of_the_last_hold_and_includes_oscillation() -> None:
    off = np.zeros((300, 3))
    off[:200, 2] = 0.4
    off[200:, 0] = np.tile([0.1, -0.1], 50)
    spans = [("hold 1", 1.0), ("waypoint 2", 1.0), ("hold 2", 1.0)]
    s, phases = build_samples(spans, p_WB=off, ref_p_WB=np.zeros(3), q_WB=LEVEL, ref_q_WB=LEVEL)
    run = build_flown("waypoints", s, phases, segments={"waypoint 2": None})
    assert compute_tracking(run)["position.final_error_m"] == pytest.approx(0.1)
    run.phases[:] = [p._replace(name="waypoint 2") for p in phases]  # nothing is held
    assert "position.final_error_m" not in compute_tracking(run)


SCANNED: dict[str, Any] = {
    "gap_max": 0.0, "tilt": 0.0, "f_normal": 1.0, "ref_normal_W": (0.0, -1.0, 0.0),
    "p_WT": np.zeros(3), "ref_p_WT": np.zeros(3), "q_WB": LEVEL, "ref_q_WB": LEVEL,
    "p_WB": np.zeros(3), "ref_p_WB": np.zeros(3), "rotor_thrust": np.full(6, 2.0),
    "ec": np.zeros(2), "off_s": 0.0, "f_collision": 0.0,
}  # fmt: skip


def judge_scan(monkeypatch: pytest.MonkeyPatch, changed: dict[str, Any], **more: Any) -> Any:
    """Judge 1 s of touch and 4 s of scan; what instrument and touches show is left out."""
    s, phases = build_samples([("touch", 1.0), ("scan", 4.0)], **SCANNED | changed)
    for name in ("find_survey", "find_coverage", "process_weld"):
        monkeypatch.setattr(scan_metrics, name, lambda run: None)
    monkeypatch.setattr(scan_metrics, "calibrate_on_touch", lambda run: None)
    components = more.get("lift", np.zeros(400))
    monkeypatch.setattr(scan_metrics, "measure_lift_off", lambda z, c: components)
    run = build_flown("pipe-weld-scan", s, phases, sets=more.get("sets"))
    if "phases" in more:
        run.phases[:] = more["phases"](run.phases)
    return scan_metrics.compute_metrics(run)


def test_times_off_the_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    gap = np.zeros(500)
    gap[200:203], gap[300:302], gap[400:420] = 0.5e-3, 0.8e-3, 0.3e-3
    m = judge_scan(monkeypatch, {"gap_max": gap})
    assert m["contact.hops"] == 2.0 and m["contact.hop_max_mm"] == pytest.approx(0.8)
    assert m["contact.off_max_s"] == pytest.approx(0.2)
    assert m["contact.gap_max_mm"] == pytest.approx(0.8)
    gusty = ["world.wind.kind=dryden", "world.wind.mean_mps=1"]
    m = judge_scan(monkeypatch, {"gap_max": gap}, sets=gusty)
    assert m["contact.gap_max_mm"] == pytest.approx(0.3)  # hops are counted apart


def test_contact_of_a_scan_as_instrument_and_truth_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    lift = np.zeros(400)
    lift[50:80] = 16.0
    force = np.full(500, 2.0)
    force[300], force[301] = 0.5, 4.0
    tilt = np.zeros(500)
    tilt[250], tilt[50] = math.radians(7.0), math.radians(20.0)  # the second before the scan
    off = np.zeros(500)
    off[400] = 0.03
    m = judge_scan(
        monkeypatch, {"f_normal": force, "tilt": tilt, "off_s": off}, lift=lift,
        phases=lambda p: [p[0]._replace(outcome="retry"), p[1]],
    )  # fmt: skip
    assert m["contact.lost_s"] == pytest.approx(0.3)
    assert m["contact.duration_s"] == pytest.approx(4.0)
    assert m["contact.retries"] == 1.0
    assert m["contact.no_force_max_s"] == pytest.approx(0.03)
    assert m["contact.tilt_max_deg"] == pytest.approx(7.0)
    assert (m["force.min_n"], m["force.max_n"]) == pytest.approx((0.5, 4.0))
    assert m["force.mean_n"] == pytest.approx((398 * 2.0 + 4.5) / 400)


def test_tip_and_platform_of_a_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    tip = np.zeros((500, 3))
    tip[100:, 1] = 0.05  # into the surface: no error along it
    tip[100:300, 0], tip[350, 2] = 0.003, -0.006
    q = np.tile(LEVEL, (500, 1))
    q[50], q[200] = about("z", 5.0), about("x", 2.0)
    thrust = np.full((500, 6), 2.0)
    thrust[10, 0], thrust[450, 3] = 12.0, 6.0  # the first before the scan
    place = np.zeros((500, 3))
    place[100:] = [0.0, 0.03, 0.04]
    m = judge_scan(monkeypatch, {"p_WT": tip, "q_WB": q, "rotor_thrust": thrust, "p_WB": place})
    assert m["tip.tangential_max_mm"] == pytest.approx(6.0)
    assert m["tip.tangential_rms_mm"] == pytest.approx(math.sqrt((200 * 9.0 + 36.0) / 400))
    assert m["platform.attitude_error_max_deg"] == pytest.approx(2.0)
    assert m["touch.attitude_error_max_deg"] == pytest.approx(5.0)
    assert m["platform.offset_rms_mm"] == pytest.approx(50.0)
    most = build_flown("pipe-weld-scan", *build_samples([("x", 1.0)])).setup.robot.rotors
    assert m["rotors.thrust_max_fraction"] == pytest.approx(6.0 / most.thrust_max_n)


def test_flight_modes() -> None:
    names = [
        "command position",
        "command angle",
        "hold angle",
        "hold angle",
        "standard stabilisation",
    ]
    spans = [(name, 2.0) for name in names]
    n, g = 1000, 9.81
    q = np.tile(LEVEL, (n, 1))
    q[100], q[400:600], q[600:800] = about("y", 1.5), about("y", 6.0), about("x", 5.0)
    q[800:] = about("y", 4.0)
    place, t = np.zeros((n, 3)), np.arange(200) * DT
    place[150, 1], place[500, 2] = 0.02, 0.03
    lean = math.sin(math.radians(4.0))
    place[800:, 0] = 0.5 * g * lean * t**2  # as a coplanar robot goes
    # in both holds it is accelerated by 0.3 times what its tilt would give, and so is its reference
    along = np.zeros((n, 3))
    along[400:600, 0] = 0.3 * g * math.sin(math.radians(6.0))
    along[600:800, 1] = -0.3 * g * math.sin(math.radians(5.0))
    ref = np.cumsum(np.cumsum(along, axis=0), axis=0) * DT**2
    ref[800:] = 0.0
    s, phases = build_samples(spans, q_WB=q, p_WB=place + ref, ref_p_WB=ref)
    way = {"due": math.radians(5.0), "limit": math.radians(8.0)}
    run = build_flown("flight-modes", s, phases, way, sets=[f"world.gravity_mps2={g}"])
    m = judge_modes(run)
    assert m["modes.tilt_fraction"] == pytest.approx(5.0 / 8.0)
    assert m["modes.tilt_deg"] == pytest.approx(5.0)
    assert m["modes.tilt_held"] == pytest.approx(1.0)
    assert m["modes.position_error_mm"] == pytest.approx(30.0)
    assert m["modes.translate_tilt_deg"] == pytest.approx(1.5)
    assert m["modes.track_error_mm"] == pytest.approx(20.0)
    assert m["modes.standard_coupling"] == pytest.approx(1.0, abs=0.02)
    assert m["modes.standard_drift_m"] == pytest.approx(0.5 * g * lean * 1.99**2)
    assert m["modes.angle_coupling"] == pytest.approx(0.3, abs=0.01)


def test_a_line_that_is_off_its_weld() -> None:
    """A girth weld at s = 20 mm; the line is 3 mm beside it and turned by 2 deg."""
    exact = [f"plant.map_error_{x}=0" for x in ("m", "deg", "size_m")]
    sets = [*exact, "world.weld.angle_deg=0", "world.weld.offset_m=0.02"]
    s, phases = build_samples([("scan", 1.0)])
    run = build_flown("pipe-weld-scan", s, phases, sets=sets)
    pipe = run.setup.true.cylinder
    assert pipe is not None
    lean = math.radians(2.0)
    crossings = tuple(
        Crossing(0.0, 0.023 + c * math.tan(lean), c, tuple(roll_points(
            pipe, np.array([0.023 + c * math.tan(lean)]), np.array([c]))[0][0]),
            10.0, 0.01, 0.0, 1e-4, 9, 0)
        for c in (-0.03, 0.0, 0.03)
    )  # fmt: skip
    line = WeldLine(0.023, 0.0, lean, 0.0012, math.radians(0.7), 0.0, 0.0, (0, 1, 2))
    none = np.zeros(0)
    calibration: Any = None
    weld = WeldResult(
        none, none, none, none, none, none, none, none, 0.97, crossings, (line,), calibration,
        pipe, (), 2.5, (4.0, 3.2),
    )  # fmt: skip
    c = np.concatenate([np.full(200, x) for x in (-0.03, 0.0, 0.03)])
    path = (np.tile(np.linspace(-0.05, 0.09, 200), 3), c)
    m = judge_welds(run, weld, path)
    assert (m["weld.crossings"], m["weld.expected"], m["weld.missed"]) == (3.0, 3.0, 0.0)
    assert (m["weld.lines"], m["weld.lines_missed"], m["weld.false_alarms"]) == (1.0, 0.0, 0.0)
    assert m["weld.contact_fraction"] == pytest.approx(0.97)
    assert m["weld.contrast"] == 3.2
    worst = 3.0 + 30.0 * math.tan(lean)
    assert m["weld.crossing_error_mm"] == pytest.approx(worst)
    assert m["weld.line_error_mm"] == pytest.approx(worst, rel=2e-3)
    assert m["weld.offset_error_mm"] == pytest.approx(3.0)
    assert m["weld.angle_error_deg"] == pytest.approx(2.0)
    assert m["weld.offset_std_mm"] == pytest.approx(1.2)
    assert m["weld.angle_std_deg"] == pytest.approx(0.7)


def test_pieces_of_a_pass_that_were_off_the_surface_or_tilted() -> None:
    """Points within 6 mm of an inspected one count, so each piece is 12 mm shorter than the gap."""
    sets = [f"plant.map_error_{x}=0" for x in ("m", "deg", "size_m")]
    line = [*sets, "mission.task.pattern=line", "mission.task.pass_length_m=0.2"]
    place = np.linspace(-0.1, 0.1, 2001)
    gap = np.where((place > -0.05) & (place < 0.03), 1.1e-3, 0.9e-3)
    tilt = np.where((place > 0.05) & (place < 0.08), math.radians(10.1), math.radians(9.9))
    s, phases = build_samples([("scan", 20.01)], p_WT=np.zeros(3), gap_max=gap, tilt=tilt)
    way = {"corners_sphi": np.array([[-0.1, 0.4], [0.1, 0.4]])}
    run = build_flown("pipe-weld-scan", s, phases, way, sets=line)
    pipe = run.setup.true.cylinder
    assert pipe is not None
    s["p_WT"] = roll_points(pipe, place, np.full(2001, 0.4 * pipe.radius))[0]
    m = judge_coverage(run, compute_scan_coverage(run, pipe))
    assert m["coverage.missed_max_mm"] == pytest.approx(80.0 - 12.0, abs=1.0)
    assert m["coverage.fraction"] == pytest.approx(1.0 - (68.0 + 18.0) / 200.0, abs=0.01)


def test_every_metric_has_a_test() -> None:
    """Some test of KNOWN compares it with `==`."""
    tests = Path(__file__).parent
    page = (tests.parent / "docs" / "reference" / "metrics.md").read_text(encoding="utf-8")
    names = set(re.findall(r"^\| `([a-z_0-9.]+)`", page, re.MULTILINE))
    equal = {name for file in KNOWN for name in find_compared(tests / f"{file}.py")}
    missing = names - equal - {"plan.wall_s"}  # what a clock reads has no known answer
    assert len(names) > 150 and not missing


KNOWN = (
    "test_metric_values", "test_metric_hands", "test_verdicts", "test_scan_verdicts", "test_datum",
    "test_survey_structure", "test_thickness_survey", "test_planning",
)  # fmt: skip
"""Files with tests of metrics on recordings, or on parts of them, whose answer is known."""


def find_compared(file: Path) -> set[str]:
    """Return the texts in comparisons with `==` that a file asserts."""
    return {
        part.value
        for statement in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(statement, ast.Assert)
        for compared in ast.walk(statement.test)
        if isinstance(compared, ast.Compare) and any(isinstance(o, ast.Eq) for o in compared.ops)
        for part in ast.walk(compared)
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    }
