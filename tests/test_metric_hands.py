"""Metrics of presses, hands, tools, bars and surveys, on recordings whose answer is known."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from constructed import DT, LEVEL, about, build_flown, build_samples
from skywright.core.rotations import quat_from_rot, rot_y, rot_z
from skywright.description.robot.limbs import list_joints
from skywright.description.world.structure import locate_point
from skywright.description.world.surface import Cylinder, level_axes
from skywright.description.world.things import list_movers, locate_thing
from skywright.inspection.indications import Indication
from skywright.inspection.notch_setup import SetupCheck
from skywright.inspection.thickness import Reading
from skywright.inspection.touches import FoundCylinder, TouchFit
from skywright.missions.bar_insertion.metrics import compute_metrics as judge_insertion
from skywright.missions.bar_transport.metrics import compute_metrics as judge_transport
from skywright.missions.bimanual_bench.metrics import compute_metrics as judge_bimanual
from skywright.missions.bridge_contact.metrics import compute_metrics as judge_contact
from skywright.missions.crack_scan import metrics as crack_metrics
from skywright.missions.crack_scan.cover import build_sector, compute_cover
from skywright.missions.crack_scan.judge import Flaw
from skywright.missions.crack_scan.search import Search
from skywright.missions.impact.metrics import compute_metrics as judge_impact
from skywright.missions.impact.metrics import compute_pitch_torque
from skywright.missions.scan.coverage import SCAN
from skywright.missions.sensor_install.metrics import compute_metrics as judge_install
from skywright.missions.skills.operated import measure_operated
from skywright.missions.skills.survey import Touch
from skywright.missions.skills.surveyed import Ball, Surveyed, judge_survey
from skywright.missions.skills.tool_handling import LOW
from skywright.missions.thickness_survey.gauge import find_probe, set_up
from skywright.missions.thickness_survey.metrics import (
    SpotReading,
    _find_place_error,
    list_spot_names,
)
from skywright.missions.thickness_survey.metrics import compute_metrics as judge_thickness
from skywright.missions.tool_install.metrics import compute_metrics as judge_tool
from skywright.missions.tool_install.plan import find_places
from skywright.models.deviation import build_socket_error
from skywright.models.things._build import find_offsets
from skywright.models.things.crack import Crack
from skywright.models.things.peg import Peg
from skywright.models.things.tape import Tape


def turn(p: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return rows (n, 3) of a frame R in W."""
    return np.asarray(p @ R.T)


def test_impact() -> None:
    n, hit = 200, 100
    t = np.arange(n) * DT
    place = np.zeros((n, 3))
    place[:, 0] = np.where(t < 1.0, 0.4 * (t - 1.0), 0.03 * np.minimum((t - 1.0) / 0.2, 1.0))
    speed = np.zeros((n, 3))
    speed[:, 0] = np.where(t < 1.3, 0.4, -0.1)
    pad = np.where((t >= 1.0) & (t < 1.2), 20.0, 0.0)
    pad[hit + 5] = 33.0
    q = np.tile(LEVEL, (n, 1))
    q[120], q[130] = about("y", -3.0), about("z", 2.0)
    joints = np.zeros((n, 9))
    joints[125, 0] = math.radians(8.0)
    wound = np.zeros((n, 8))
    wound[:, 3], wound[115, 3] = 0.1, 0.1 + math.radians(11.0)
    load, torque = np.zeros(n), np.zeros(n)
    load[hit + 2], torque[hit + 3] = 40.0, 2.0
    impulse = np.zeros((n, 3))
    impulse[:, 0] = np.cumsum(pad) * DT
    s, phases = build_samples(
        [("impact", 2.0)], p_WB=place, v_WB=speed, pad_f_peak=pad, q_WB=q, q=joints,
        deflection=wound, load_f_peak=load, load_t_peak=torque, pad_impulse_W=impulse,
        pad_touch_s=np.cumsum(pad > 0.0) * DT, left_p_WH=place,
    )  # fmt: skip
    sets = ["mission.task.part=arm", "mission.task.speed_mps=0.5"]
    q0 = np.zeros(9)
    way = {"ahead": np.array([1.0, 0.0, 0.0]), "q": q0, "lever": 0.5}
    run = build_flown("impact", s, phases, way, sets=sets)
    m = judge_impact(run)
    assert m["impact.speed_mps"] == pytest.approx(0.4)
    assert m["impact.speed_error_mps"] == pytest.approx(0.1)
    assert m["impact.speed_off"] == pytest.approx(0.2)
    assert m["impact.peak_force_n"] == 40.0 and m["impact.peak_torque_nm"] == 2.0
    assert m["impact.torque_share"] == pytest.approx(2.0 / compute_pitch_torque(run.setup, q0))
    assert m["impact.recoil_deg"] == pytest.approx(3.0)
    most = run.setup.robot.control.tilt_max_deg
    assert m["impact.recoil_share"] == pytest.approx(3.0 / most)
    assert m["impact.yaw_deg"] == pytest.approx(2.0)
    assert m["impact.swing_deg"] == pytest.approx(8.0)
    assert m["impact.deflection_deg"] == pytest.approx(11.0)
    assert m["impact.overrun_m"] == pytest.approx(0.03 + 0.4 * DT)
    # the contact opens after 0.2 s: 20 samples of 20 N, one of them 33 N
    assert m["impact.contact_s"] == pytest.approx(0.2)
    assert m["impact.contact_force_n"] == 33.0
    assert m["impact.impulse_ns"] == pytest.approx((19 * 20.0 + 33.0) * DT)


def test_a_box_that_is_squeezed_and_lifted() -> None:
    run0 = build_flown("bimanual-bench", *build_samples([("x", 1.0)]))
    things = run0.setup.description.world.things
    i, stood = list_movers(things).index("box"), locate_thing(things, "box").p
    n = 200
    box = np.tile(stood, (n, 1))
    box[100:, 2] += 0.04
    box[150:, 0] += 0.003
    press = np.where(np.arange(n) % 2, 3.0, 5.0)
    force = np.zeros((n, 3))
    force[:, 1] = press
    s, phases = build_samples(
        [("squeeze box", 1.0), ("hold box", 1.0)],
        **{f"object{i}_p_WO": box, "right_f_W": force, "left_f_W": -force,
           "right_p_WH": stood, "left_p_WH": stood},
    )  # fmt: skip
    sets = [
        "mission.task.trials=['squeeze']",
        "mission.task.lift_m=0.05",
        "mission.task.squeeze_n=4",
    ]
    m = judge_bimanual(build_flown("bimanual-bench", s, phases, sets=sets))
    assert m["bench.box_lift_m"] == pytest.approx(0.04)
    assert m["bench.box_lift_share"] == pytest.approx(0.8)
    assert m["bench.box_slip_mm"] == pytest.approx(3.0)
    assert m["bench.squeeze_n"] == pytest.approx(4.0)
    assert m["bench.squeeze_error_n"] == pytest.approx(1.0)
    assert m["bench.squeeze_off"] == pytest.approx(0.25)


def test_a_plug_that_comes_free() -> None:
    run0 = build_flown("bimanual-bench", *build_samples([("x", 1.0)]))
    things = run0.setup.description.world.things
    i, was = list_movers(things).index("plug"), locate_thing(things, "plug").p
    n = 300
    plug = np.tile(was, (n, 1))
    plug[:, 0] += np.clip(0.001 * (np.arange(n) - 100), 0.0, 0.08)
    hands = plug.copy()
    plug[250:, 1] += 0.006
    s, phases = build_samples(
        [("approach", 1.0), ("pull", 1.0), ("unplugged", 1.0)],
        **{f"object{i}_p_WO": plug, "left_p_WH": hands, "right_p_WH": hands},
    )
    sets = ["mission.task.trials=['unplug']", "mission.task.unplug_threshold_m=0.0305"]
    m = judge_bimanual(build_flown("bimanual-bench", s, phases, sets=sets))
    # 31 mm after 31 samples of pulling, noticed after 1 s of it
    assert m["bench.unplug_delay_s"] == pytest.approx(1.0 - 0.31)
    assert m["bench.plug_slip_mm"] == pytest.approx(6.0)


def test_a_bar_that_is_led_and_a_base_that_drifts() -> None:
    run0 = build_flown("bimanual-bench", *build_samples([("x", 1.0)]))
    things = run0.setup.description.world.things
    i, lay = list_movers(things).index("bar"), locate_thing(things, "bar").p
    spans = [("hold bar", 1.0), ("lift bar", 2.0), ("turn bar", 2.0), ("drift", 4.0)]
    n = 900
    bar, q = np.tile(lay, (n, 1)), np.tile(LEVEL, (n, 1))
    lift = np.zeros((n, 3))
    lift[100:, 2] = 0.1
    bar += lift
    bar[150, 0] += 0.5  # on its way: not judged
    bar[299, 0] += 0.012
    q[450] = about("x", 4.0)
    t = np.arange(400) * DT
    base, hands = np.tile([0.3, -0.2, 1.0], (n, 1)), np.zeros((n, 3))
    sway = 0.02 * np.sin(2.0 * math.pi * t / 4.0)
    base[500:, 0] += sway
    hands[500:, 0] = -0.9 * sway  # a tenth is not felt
    aside, above = np.array([0.0, 0.2, 0.0]), lay + [0.01, 0.0, 0.02]  # poses count from there
    s, phases = build_samples(
        spans, **{
            f"object{i}_p_WO": bar, f"object{i}_q_WO": q, "p_WB": base, "est_p_WB": base,
            "left_ref_p_WH": above + lift + aside, "right_ref_p_WH": above + lift - aside,
            "left_est_p_WH": base + hands, "right_est_p_WH": base + hands,
        }
    )  # fmt: skip
    sets = ["mission.task.trials=['bar','position-sensor']", "mission.task.drift_m=0.02"]
    m = judge_bimanual(build_flown("bimanual-bench", s, phases, sets=sets))
    assert m["bench.bar_position_mm"] == pytest.approx(12.0)
    assert m["bench.bar_direction_deg"] == pytest.approx(4.0)
    rms = 0.02 / math.sqrt(2.0)
    assert m["bench.drift_rms_mm"] == pytest.approx(1e3 * rms)
    assert m["bench.drift_error_mm"] == pytest.approx(1e2 * rms)
    assert m["bench.drift_off"] == pytest.approx(0.1 * rms / 0.02)


def build_press(run0: Any, spans: list[tuple[str, float]], **changed: Any) -> Any:
    """Samples of a robot that presses 4 N on its first spot, the probe along the deck's normal."""
    deck = run0.setup.true.surface
    place, R = locate_point(deck, np.zeros(2))
    columns: dict[str, Any] = {
        "q_WT": about("x", 180.0), "f_contact": (0.0, 0.0, -4.0), "ref_force": 4.0,
        "force_meas": 4.0, "p_WB": np.zeros(3), "q_WB": LEVEL, "v_WB": np.zeros(3),
        "f_docking_W": np.zeros(3), "p_WT": place, "gap_max": 0.0, "off_s": 0.0,
    }  # fmt: skip
    return build_samples(spans, **columns | changed), R


def test_presses_under_a_deck() -> None:
    sets = [f"plant.map_error_{x}=0" for x in ("m", "deg")]
    run0 = build_flown("bridge-contact", *build_samples([("x", 1.0)]), sets=sets)
    n = 600
    force, feet = np.zeros((n, 3)), np.zeros((n, 3))
    force[:, 2] = 4.0  # the tip points up: its axis is -z of W
    force[100:200, 2], force[200:300, 2] = 4.3, 4.1
    force[400:450, 2], force[450:500, 2] = 3.6, 4.2  # the sensor says 4 N all the time
    place, R = locate_point(run0.setup.true.surface, np.zeros(2))
    tip = np.tile(place, (n, 1))
    tip[250] += 0.006 * R[:, 0] + 0.008 * R[:, 1] + 0.1 * R[:, 2]
    body, speed, q = np.tile([1.0, 2.0, 3.0], (n, 1)), np.zeros((n, 3)), np.tile(LEVEL, (n, 1))
    body[150, 1] += 0.004
    body[420] += [0.001, -0.002, 0.002]
    q[160] = about("y", 1.5)
    feet[50:, 2] = -5.0
    speed[:, 2], speed[49, 2], speed[52, 2] = 0.03, 0.07, 0.5  # just before, and as it bounces
    s, _ = build_press(
        run0,
        [("dock", 1.0), ("hold 4 N", 1.0), ("hold 4.1 N", 1.0), ("release", 1.0),
         ("free hold 4 N", 1.0), ("slide", 1.0)],
        f_contact=force, p_WT=tip, p_WB=body, q_WB=q, v_WB=speed, f_docking_W=feet,
        force_meas=[4.0, 4.2, 4.2, 0.0, 4.0, 4.0],
    )  # fmt: skip
    samples, phases = s
    way = {
        "stations": [type("S", (), {"place": np.zeros(2)})()],
        "largest": 4.1, "limit_n": 8.2, "survey": None,
    }  # fmt: skip
    run = build_flown(
        "bridge-contact", samples, phases, way, sets=[*sets, "mission.task.forces_n=[4,4.1]"]
    )
    # the axis of the probe: about x by 180 deg turns its z down, the force on the deck up
    samples["f_contact"] *= [1.0, 1.0, 1.0]
    m = judge_contact(run)
    assert m["force.rms_error_n"] == pytest.approx(0.3)
    assert m["force.mean_error_n"] == pytest.approx(0.3)
    assert m["force.sensor_error_n"] == pytest.approx(0.1)
    rms = math.sqrt((0.4**2 + 0.2**2) / 2)
    assert m["free.rms_error_n"] == m["free.sensor_error_n"] == pytest.approx(rms)
    assert m["free.mean_error_n"] == pytest.approx(0.1)
    assert m["dock.wander_mm"] == pytest.approx(4.0)
    assert m["dock.turn_deg"] == pytest.approx(1.5)
    assert m["dock.touch_speed_mps"] == pytest.approx(0.07)
    assert (m["press.limit_n"], m["press.fraction"]) == pytest.approx((8.2, 0.5))
    assert m["press.place_error_mm"] == pytest.approx(10.0)
    assert m["free.wander_mm"] == pytest.approx(3.0)


def test_a_slide() -> None:
    run0 = build_flown("wall-contact", *build_samples([("x", 1.0)]))
    n = 200
    gap, off, tip = np.zeros(n), np.zeros(n), np.zeros((n, 3))
    gap[120:125], off[130] = 0.5e-3, 0.04
    tip[100:, 0] = np.linspace(0.0, 0.3, 100)
    force = np.zeros((n, 3))
    force[:, 2] = np.where(np.arange(n) % 2, 3.8, 4.2)
    (samples, phases), _ = build_press(
        run0, [("approach", 1.0), ("slide", 1.0)], gap_max=gap, off_s=off, p_WT=tip, f_contact=force
    )
    way = {"stations": [type("S", (), {"place": np.zeros(2)})()], "survey": None}
    m = judge_contact(build_flown("wall-contact", samples, phases, way))
    assert m["slide.rms_error_n"] == pytest.approx(0.2)
    assert m["slide.lost_s"] == pytest.approx(0.05)
    assert m["slide.no_force_max_s"] == pytest.approx(0.04)
    assert m["slide.length_m"] == pytest.approx(0.3)
    assert m["slide.length_fraction"] == pytest.approx(1.0)


def test_a_slide_falls_short_where_the_tip_chatters_on_its_way_back() -> None:
    """What counts is how far the tip gets on the shorter way, not the path that it jitters."""
    run0 = build_flown("wall-contact", *build_samples([("x", 1.0)]))
    tip = np.zeros((200, 3))
    tip[:100, 0] = np.linspace(0.0, 0.3, 100)
    tip[100:, 0] = 0.3 - np.linspace(0.0, 0.15, 100) - 0.01 * (np.arange(100) % 2)
    (samples, phases), _ = build_press(run0, [("slide", 1.0), ("slide back", 1.0)], p_WT=tip)
    way = {"stations": [type("S", (), {"place": np.zeros(2)})()], "survey": None}
    m = judge_contact(build_flown("wall-contact", samples, phases, way))
    assert m["slide.length_fraction"] == pytest.approx(0.16 / 0.3)
    again = [
        phases[0]._replace(outcome="retry"),
        phases[1],
    ]  # that a slide was begun anew is no miss
    m = judge_contact(build_flown("wall-contact", samples, again, way))
    assert m["slide.length_fraction"] == pytest.approx(0.16 / 0.3)
    again = [phases[0], phases[1]._replace(outcome="retry")]
    m = judge_contact(build_flown("wall-contact", samples, again, way))
    assert m["slide.length_fraction"] == pytest.approx(1.0)


def test_a_peg_beside_and_in_its_hole() -> None:
    sets = [f"plant.socket_{x}_error_deg=0" for x in ("roll", "pitch", "yaw")]
    run0 = build_flown("bar-insertion", *build_samples([("x", 1.0)]), sets=sets)
    d = run0.setup.description
    things, task = d.world.things, d.mission.task
    peg = d.world.find_thing(task.bar, Peg)
    p_WS, R = locate_thing(
        things, task.socket, offsets=find_offsets(things, build_socket_error(d.plant))
    )
    i, n = list_movers(things).index(task.bar), 400
    # the bar's y along the socket's: about z of S
    heading = math.degrees(math.atan2(R[1, 0], R[0, 0]))
    q = np.tile(about("z", heading), (n, 1))
    q[100:] = about("z", heading + 3.0)
    tip_S = np.zeros((n, 3))
    tip_S[:, 2] = 0.02
    tip_S[100] = [0.003, 0.004, 0.02]
    tip_S[300:] = [0.0, 0.0, -0.98 * peg.length_m]
    axis = np.array([0.0, 0.0, 1.0])
    p = p_WS + turn(tip_S, R) + peg.length_m * axis
    carry = np.zeros((n, 3))
    carry[:, 2] = 0.5 * peg.mass_kg * d.world.gravity_mps2
    left, right = carry.copy(), carry.copy()
    left[250, 0] = 2.5
    s, phases = build_samples(
        [("align", 1.0), ("lower", 1.0), ("insert", 1.0), ("return", 1.0)],
        **{f"object{i}_p_WO": p, f"object{i}_q_WO": q, "left_f_W": left, "right_f_W": right,
           "f_collision": 0.0},
    )  # fmt: skip
    assert R[2, 2] == pytest.approx(1.0)  # else peg and hole make an angle
    m = judge_insertion(build_flown("bar-insertion", s, phases, sets=sets))
    assert m["insert.tries"] == 1.0 and m["insert.done"] == 1.0
    assert m["insert.depth_mm"] == pytest.approx(980.0 * peg.length_m)
    assert m["insert.force_max_n"] == pytest.approx(2.5)
    assert m["insert.aim_error_mm"] == pytest.approx(5.0)
    assert m["insert.aim_angle_deg"] == pytest.approx(3.0)
    assert m["insert.time_s"] == pytest.approx(3.0)
    s[f"object{i}_p_WO"][300:] += 0.6 * peg.flange_m * R[:, 0]  # as deep, beside the hole
    assert judge_insertion(build_flown("bar-insertion", s, phases, sets=sets))["insert.done"] == 0.0


def test_a_bar_that_is_carried(monkeypatch: pytest.MonkeyPatch) -> None:
    from skywright.missions.bar_transport import metrics

    n = 300
    clear = np.full(200, 0.3)
    clear[50] = 0.15
    monkeypatch.setattr(metrics, "compute_clearances", lambda s, setup: clear)
    place, hand = np.zeros((n, 3)), np.zeros((n, 3))
    place[:] = [9.0, 0.0, 2.0]
    ref = place.copy()
    place[150, 1] = 0.06
    ref[-1] += [0.03, 0.0, 0.04]  # a plan that ends 5 cm beside the goal
    place[-1] = ref[-1] + [0.0, 0.06, 0.0]  # a platform that gives way in wind, under its bar
    hand[200, 2] = 0.02
    q, want = np.zeros((n, 9)), np.zeros((n, 9))
    q[120, 0] = math.radians(5.0)
    touch = np.zeros((n, 3))
    touch[180:185, 0], touch[50, 0] = 1.0, 1.0  # the second before the carrying
    touch[100, 0] = 1.0  # as it begins
    zero = np.zeros(3)
    s, phases = build_samples(
        [("hold", 1.0), ("transport", 2.0)], p_WB=place, ref_p_WB=ref, q_WB=LEVEL, q=q, ref_q=want,
        left_p_WH=hand + 1.0, right_p_WH=hand - 1.0, left_ref_p_WH=zero + 1.0,
        right_ref_p_WH=zero - 1.0, f_collision=0.0, left_f_W=touch, right_f_W=zero, power=360.0,
    )  # fmt: skip
    sets = ["mission.task.goal_x_m=9", "mission.task.goal_z_m=2", "mission.task.margin_m=0.2"]
    m = judge_transport(build_flown("bar-transport", s, phases, sets=sets))
    assert m["transport.contacts"] == 2.0
    assert m["transport.clearance_min_m"] == pytest.approx(0.15)
    assert m["transport.clearance_share"] == pytest.approx(0.75)
    assert m["transport.goal_error_m"] == pytest.approx(0.05)
    assert m["transport.duration_s"] == pytest.approx(2.0)
    assert m["transport.energy_wh"] == pytest.approx(360.0 * 2.0 / 3600.0)
    assert m["tip.tracking_max_m"] == pytest.approx(0.02)
    assert m["tip.tracking_rms_m"] == pytest.approx(0.02 / math.sqrt(200))
    assert m["platform.tracking_max_m"] == pytest.approx(0.06)
    assert m["swing.max_deg"] == pytest.approx(5.0)
    assert m["swing.rms_deg"] == pytest.approx(5.0 / math.sqrt(200))


def find_lever(elbow_deg: float) -> float:
    """Return the lever of an arm of two equal links L, its other joints at zero, over 2 L.

    With the elbow at an angle e, the squared singular values of shoulder and elbow have the sum
    (3 + 2 cos e) L^2 and the product (L^2 sin e)^2. Both other joints move the hand out of the
    plane, by longer levers.
    """
    angle = math.radians(elbow_deg)
    total = 3.0 + 2.0 * math.cos(angle)
    return math.sqrt((total - math.sqrt(total**2 - 4.0 * math.sin(angle) ** 2)) / 2.0) / 2.0


def test_a_sensor_that_is_pressed_on() -> None:
    run0 = build_flown("sensor-install", *build_samples([("x", 1.0)]))
    pipe, world = run0.setup.true.cylinder, run0.setup.world
    assert pipe is not None
    pipe = pipe._replace(R_WP=level_axes(pipe.R_WP))  # below is where gravity has it
    tape = next(x for x in world.things.values() if isinstance(x, Tape))
    n = 700
    force = np.zeros((n, 3))
    force[100:300] = 2.0 * pipe.R_WP[:, 2]
    force[200:250] = 2.6 * pipe.R_WP[:, 2]
    force[299] = 0.0
    estimate = force + 0.1 * pipe.R_WP[:, 2]
    # the ball's centre is below the pipe, 0.03 rad ahead of its lowest line, and once 0.05 behind
    around = np.full(n, 0.03)
    around[150] = -0.05
    side = np.sin(around)[:, None] * pipe.R_WP[:, 0] - np.cos(around)[:, None] * pipe.R_WP[:, 2]
    hand = pipe.p_WP + (pipe.radius + 0.015) * side + 0.01 * pipe.R_WP[:, 1]
    hand[300:] -= 0.2 * pipe.R_WP[:, 2]
    lean = pipe.R_WP @ rot_y(math.radians(60.0))
    up = np.tile(quat_from_rot(lean), (n, 1))
    hand += 0.015 * lean[:, 2]  # the hand's end is before the ball, which leans 60 deg ahead
    body = np.zeros((n, 3))
    body[220, 0] = 0.025
    ref, stood = np.zeros((n, 3)), np.zeros((n, 3))
    stood[:, 1] = 0.01  # it stood aside before, too
    elbows = [j for j, x in enumerate(list_joints(run0.setup.robot)) if "elbow" in x.name]
    q = np.zeros((n, 9))
    q[:, elbows] = math.radians(-90.0), math.radians(-60.0)
    s, phases = build_samples(
        [("approach", 1.0), ("force", 2.0), ("hover check", 1.0), ("swing check", 3.0)],
        left_f_W=force, left_est_f_W=estimate, left_p_WH=hand, left_q_WH=up,
        left_ref_p_WH=hand + [0, 0, 0.002],
        p_WB=body + stood, ref_p_WB=ref, q=q, f_collision=0.0,
    )  # fmt: skip
    sets = ["mission.task.force_n=2"]
    m = judge_install(build_flown("sensor-install", s, phases, {"survey": None}, sets=sets))
    mean = (149 * 2.0 + 50 * 2.6) / 200
    assert m["force.mean_n"] == pytest.approx(mean)
    assert m["force.mean_error_n"] == pytest.approx(abs(mean - 2.0))
    assert m["force.rms_error_n"] == pytest.approx(math.sqrt((50 * 0.6**2 + 2.0**2) / 200))
    assert (m["force.min_n"], m["force.max_n"]) == pytest.approx((0.0, 2.6), abs=1e-9)
    assert m["force.estimate_error_n"] == pytest.approx(0.1)
    assert m["contact.lost_s"] == pytest.approx(0.01)
    assert m["sensor.around_mm"] == pytest.approx(1e3 * 0.05 * pipe.radius)
    assert m["sensor.along_mm"] == pytest.approx(10.0)
    impulse = (149 * 2.0 + 50 * 2.6) * DT
    bond = tape.strength_n * (1.0 - math.exp(-impulse / tape.press_n_s))
    assert m["sensor.bond_n"] == pytest.approx(bond)
    assert m["sensor.installed"] == float(bond >= tape.release_n)
    assert m["tip.hover_rms_mm"] == m["tip.hover_max_mm"] == pytest.approx(2.0)
    assert m["platform.hover_rms_mm"] == pytest.approx(10.0)
    assert m["platform.excursion_m"] == pytest.approx(0.025)
    bent = find_lever(-90.0)
    assert bent == pytest.approx((math.sqrt(5.0) - 1.0) / 4.0)
    assert m["arm.lever_min"] == pytest.approx(find_lever(-60.0))  # of the right arm, in the air
    assert m["arm.lever_felt_min"] == pytest.approx(bent)
    s["q"][500:600, elbows] = 0.0  # both arms stretched, after the press
    m = judge_install(build_flown("sensor-install", s, phases, {"survey": None}, sets=sets))
    assert m["arm.lever_min"] == pytest.approx(0.0, abs=0.01)
    assert m["arm.lever_felt_min"] == pytest.approx(bent)
    for elbow, counts in ((elbows[1], False), (elbows[0], True)):  # only the left hand presses
        s["q"][150:160, elbow] = 0.0
        m = judge_install(build_flown("sensor-install", s, phases, {"survey": None}, sets=sets))
        assert (m["arm.lever_felt_min"] < 0.01) == counts


@pytest.mark.parametrize("start_deg", [10.0, -10.0])
def test_a_swing_that_dies_away_on_both_sides(start_deg: float) -> None:
    """A decaying cosine passes 1 deg for the last time on the side opposite to its start.

    After two thirds of the period the cosine is -1/2 and the decay, as chosen, 1/5: a tenth of the
    start. The next peak, after a whole period, is 10 / 5^1.5 = 0.9 deg.
    """
    last = 0.395  # s, between two samples
    period, decay, t = 1.5 * last, last / math.log(5.0), np.arange(300) * DT
    q = np.zeros((300, 9))
    swing = start_deg * np.exp(-t / decay) * np.cos(2.0 * math.pi * t / period)
    q[:, 0] = np.radians(2.0 + swing)  # about an angle at rest that is not zero
    s, phases = build_samples(
        [("swing check", 3.0)], left_f_W=np.zeros(3), left_p_WH=np.zeros(3), q=q
    )
    m = judge_install(build_flown("sensor-install", s, phases, {"survey": None}))
    assert m["swing.start_deg"] == pytest.approx(10.0, abs=1e-3)
    assert m["swing.decay_s"] == pytest.approx(0.39)


def test_a_tool_on_pipe_and_bench() -> None:
    sets = ["plant.map_error_m=0", "plant.map_error_deg=0"]
    run0 = build_flown("tool-install", *build_samples([("x", 1.0)]), sets=sets)
    world, task = run0.setup.true.world, run0.task
    i = list_movers(world.things).index(task.tool)
    bench, seat = find_places(world, task)
    pipe = run0.setup.true.cylinder
    assert pipe is not None
    n = 650
    yaw = math.degrees(math.atan2(pipe.R_WP[1, 0], pipe.R_WP[0, 0]))
    assert pipe.R_WP[2, 2] == pytest.approx(1.0)  # else tool and pipe make an angle
    p = np.tile(seat.p_WO + [0.003, 0.0, 0.004], (n, 1))
    q = np.tile(about("z", yaw + 2.0), (n, 1))
    p[100:200] = bench.p_WO + [0.0, 0.02, 0.0]
    q[100:200] = about("z", math.degrees(bench.yaw))
    hands = np.zeros((n, 3))
    stick = np.zeros((n, 4))
    stick[250:260, 0] = stick[520:530, 2] = 1.0
    left, right = np.zeros((n, 3)), np.zeros((n, 3))
    left[150], left[300], right[310] = [9.0, 0.0, 0.0], [3.0, 0.0, 4.0], [0.0, 2.0, 0.0]
    left[520], right[560], left[640] = [1.0, 2.0, 2.0], [0.0, 0.0, 3.5], [8.0, 0.0, 0.0]
    s, phases = build_samples(
        [("wait", 1.0), ("return", 1.0), ("install", 2.0), ("x", 1.0),
         ("hook", 0.5), ("lift off", 0.8), ("carry back", 0.2)],
        **{f"object{i}_p_WO": p, f"object{i}_q_WO": q, "f_collision": 0.0,
           "operator_stick": stick, "left_p_WH": hands + [0.0, 0.006, 0.0], "right_p_WH": hands,
           "left_ref_p_WH": hands, "right_ref_p_WH": hands, "left_f_W": left, "right_f_W": right},
    )  # fmt: skip
    run = build_flown("tool-install", s, phases, sets=sets)
    run.phases[2] = run.phases[2]._replace(outcome="retry")
    m = judge_tool(run)
    assert m["tool.seat_error_mm"] == pytest.approx(5.0)
    assert m["tool.seat_angle_deg"] == pytest.approx(2.0)
    assert m["tool.return_error_mm"] == pytest.approx(20.0) and m["tool.returned"] == 1.0
    assert m["tool.retries"] == 1.0
    assert m["operator.time_s"] == pytest.approx(2.0)
    assert m["operator.hand_error_mm"] == pytest.approx(3.0)
    assert m["operator.force_max_n"] == pytest.approx(5.0)  # the 9 N were felt before it
    assert m["operator.retrieval_time_s"] == pytest.approx(1.3)
    assert m["operator.retrieval_force_max_n"] == pytest.approx(3.5)  # the 8 N came after it


def test_a_tool_that_was_never_taken_is_not_returned() -> None:
    """A robot that cannot grasp it withdraws and flies home, in the same phase."""
    run0 = build_flown("tool-install", *build_samples([("x", 1.0)]))
    i = list_movers(run0.setup.true.world.things).index(run0.task.tool)
    bench, _ = find_places(run0.setup.true.world, run0.task)
    p = np.tile(bench.p_WO, (300, 1))
    s, phases = build_samples(
        [("lift", 1.0), ("return", 1.0), ("lift arms", 1.0)],
        **{f"object{i}_p_WO": p, f"object{i}_q_WO": about("z", math.degrees(bench.yaw))},
    )
    m = judge_tool(build_flown("tool-install", s, phases))
    assert m["tool.returned"] == 0.0 and "tool.return_error_mm" not in m
    s[f"object{i}_p_WO"][:100, 2] += 0.2  # lifted, and put down again
    m = judge_tool(build_flown("tool-install", s, phases))
    assert m["tool.returned"] == 1.0 and m["tool.return_error_mm"] == pytest.approx(0.0)


def test_time_under_operator_control_excludes_the_phases_between_its_stretches() -> None:
    s, _ = build_samples(
        [("press", 2.0), ("retract", 30.0), ("press", 3.0)], operator_stick=np.full(4, 0.5)
    )
    pressed = s[s["phase"] != 1]
    m = measure_operated(pressed, np.zeros(len(pressed)))
    assert m["operator.time_s"] == pytest.approx(5.0)


def test_hands_that_hover_before_a_tool() -> None:
    run0 = build_flown("tool-install", *build_samples([("x", 1.0)]))
    i, n = list_movers(run0.setup.true.world.things).index(run0.task.tool), 200
    grip = SimpleNamespace(
        hands=[np.array([0.0, 0.15, 0.0]), np.array([0.0, -0.15, 0.0])],
        handle=np.array([0.1, 0.0, 0.2]), cradle=np.array([0.02, 0.0, 0.0]),
        mouth=np.array([0.0, 0.0, 1.0]),
    )  # fmt: skip
    tool = np.tile([1.0, 2.0, 3.0], (n, 1))
    goal = tool + turn(np.array([0.08, 0.0, 0.2 - LOW]), rot_z(math.pi / 2.0))
    side = turn(np.array([0.0, 0.15, 0.0]), rot_z(math.pi / 2.0))
    left, right, body = goal + side, goal - side, np.tile([5.0, 6.0, 7.0], (n, 1))
    left[:, 2] += 0.003
    right[n // 2, 1] += 0.02
    ref = body + [0.0, 0.03, 0.0]
    body[n // 2] += [0.0, 0.03, 0.04]
    ref[n // 2] += [0.0, 0.03, 0.04]
    s, phases = build_samples(
        [("hover check", 2.0)],
        **{f"object{i}_p_WO": tool, f"object{i}_q_WO": about("z", 90.0), "f_collision": 0.0,
           "left_p_WH": left, "right_p_WH": right, "p_WB": body, "ref_p_WB": ref},
    )  # fmt: skip
    m = judge_tool(build_flown("tool-install", s, phases, {"grip": grip}))
    assert m["tip.hover_rms_mm"] == pytest.approx(3.0)
    assert m["tip.hover_max_mm"] == pytest.approx(20.0)
    assert m["platform.hover_rms_mm"] == pytest.approx(30.0)
    assert m["platform.drift_max_mm"] == pytest.approx(50.0)


def test_readings_beside_their_spots() -> None:
    """The farthest of two, less what the map may err by."""
    samples = build_samples([("x", 1.0)])
    where = "mission.task.spots=[{name='a',x_m=0.1,y_m=-0.2},{name='b',x_m=0.3,y_m=0.1}]"
    run = build_flown("thickness-survey", *samples, sets=["plant.map_error_m=0.002", where])
    spots = dict(zip(list_spot_names(run.task), run.task.spots, strict=True))
    reading = Reading(1.0, 0.01, 1e-4, 0.5, 30.0, "")
    found = [
        SpotReading(name, spot.x_m + off[0], spot.y_m + off[1], reading, 0.01, False, np.zeros(4))
        for (name, spot), off in zip(spots.items(), ((0.003, 0.004), (-0.001, 0.0)), strict=True)
    ]
    assert _find_place_error(run, found) == pytest.approx(0.005 - 0.002)


@pytest.mark.parametrize("share", [1.01, 0.99])
def test_a_gauge_that_errs_by_a_hundredth_of_what_it_measures(share: float) -> None:
    """On the block's steps of 5 and 12.5 mm it is the thick one on which it errs most."""
    run0 = build_flown("thickness-survey", *build_samples([("x", 1.0)]))
    spans = ["free hold 4 N", "free release", "free hold 4 N", "free release", "free hold 4 N"]
    (samples, phases), _ = build_press(run0, [(name, 0.5) for name in spans])
    setup, stations = run0.setup, [SimpleNamespace(place=np.zeros(2))]
    gauge = set_up(setup, find_probe(setup), run0.task.procedure)
    way = {
        "contact": SimpleNamespace(stations=stations, survey=None),
        "gauge": gauge._replace(velocity=share * gauge.velocity),
    }
    where = "mission.task.spots=[{name='a'},{name='b',x_m=0.2},{name='c',x_m=-0.2},{name='d'}]"
    m = judge_thickness(build_flown("thickness-survey", samples, phases, way, sets=[where]))
    assert (m["thickness.spots"], m["thickness.touches"]) == (4.0, 3.0)
    assert m["thickness.block_error_mm"] == pytest.approx(0.125, abs=0.003)


def test_coils_that_tilt_or_lift_cover_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """All of the sector is swept, but for a disk of 4 cm radius in its middle."""
    task = build_flown("crack-scan", *build_samples([("scan", 1.0)])).task
    sector = build_sector(task, 0.2, 0.008)
    off = np.linalg.norm(sector.cells - sector.cells.mean(axis=0), axis=1) < 0.04
    n = len(sector.cells)
    samples, phases = build_samples([("scan", n * DT)], gap_max=0.0, tilt=0.0)
    way = {"scan": SimpleNamespace(survey=None), "pitch_m": 0.0065, "passes": 7}
    run = build_flown("crack-scan", samples, phases, way)
    s, c = sector.cells[:, :1], sector.cells[:, 1:]
    check = SetupCheck(80.0, 0.0, 0.0, ())
    known = Cylinder(np.zeros(3), np.eye(3), 0.2, 0.5)
    found = Search(
        s, c, s, [], s > 0, compute_cover(sector, s, c), s, samples["t"], sector.cells, known, check
    )
    whole = crack_metrics.judge_search(run, found)
    assert (whole["coverage.area_fraction"], whole["coverage.gap_max_mm"]) == (1.0, 0.0)
    for column, most in (("tilt", 1.0), ("gap_max", 1.0)):
        samples["tilt"] = samples["gap_max"] = 0.0
        samples[column][off] = most
        m = crack_metrics.judge_search(run, found)
        cell = 1e3 * math.hypot(*sector.size)
        assert m["coverage.gap_max_mm"] == pytest.approx(80.0 - 8.0, abs=2.0 * cell)
        assert 0.0 < m["coverage.area_fraction"] < 1.0 - 0.6 * np.mean(off)
    monkeypatch.setattr(crack_metrics, "judge_scan", lambda run: {})  # what it shares with a scan
    monkeypatch.setattr(crack_metrics, "find_search", lambda run: found)
    planned = crack_metrics.compute_metrics(run)
    assert planned["coverage.pitch_full_mm"] == pytest.approx(6.5)
    assert planned["coverage.passes"] == 7.0


def test_indications_beside_cracks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two cracks one is found 5 mm off and one is missed; one report is no crack."""
    samples, phases = build_samples(
        [("scan", 0.5), ("missed_move", 0.1), ("scan", 0.5)], gap_max=0.0, tilt=0.0
    )
    way = {"scan": SimpleNamespace(survey=None), "pitch_m": 0.0065, "passes": 7}
    run = build_flown("crack-scan", samples, phases, way)

    def report(s: float, c: float, nature: Any, height: float = 40.0) -> Indication:
        return Indication(s, c, height, 0.006, 0.003, 0.0, nature, 0.002, 1.0, 5)

    said = [
        report(0.003, 0.004, "crack"), report(0.09, 0.0, "crack"), report(0.05, 0.0, "weld"),
        report(0.06, 0.03, "ambiguous", -20.0), report(0.07, 0.0, "ambiguous"),
    ]  # fmt: skip
    flaws = [Flaw(str(s), Crack(), s, 0.0, (s, 0.0)) for s in (0.0, 0.2)]
    beside = [Flaw("beside", Crack(), 0.07, 0.0, (0.07, 0.0))]
    sector = build_sector(run.task, 0.2, 0.008)
    n = int(np.count_nonzero(SCAN.select(samples, phases)))
    none = np.zeros((n, 1))
    check = SetupCheck(71.0, 0.0, 0.0, ("the reference notch reads 71 % FSH",))
    found = Search(
        none, none, none, said, none > 0, compute_cover(sector, none, none), none, samples["t"],
        none, Cylinder(np.zeros(3), np.eye(3), 0.2, 0.5), check,
    )  # fmt: skip
    monkeypatch.setattr(crack_metrics, "list_flaws", lambda run: (flaws, beside))
    monkeypatch.setattr(crack_metrics, "judge_scan", lambda run: {})
    monkeypatch.setattr(crack_metrics, "find_search", lambda run: found)
    m = crack_metrics.compute_metrics(run)
    assert (m["crack.expected"], m["crack.missed"], m["crack.false_calls"]) == (2.0, 1.0, 1.0)
    assert (m["crack.indications"], m["crack.ambiguous"]) == (5.0, 2.0)
    assert m["crack.position_error_mm"] == pytest.approx(5.0)
    assert (m["crack.block_notch_percent"], m["crack.block_drifted"]) == (71.0, 1.0)
    assert m["coverage.again"] == 1.0


def test_a_survey_that_found_a_pipe_elsewhere() -> None:
    sets = [f"plant.map_error_{x}=0" for x in ("m", "deg", "size_m")]
    run = build_flown("pipe-weld-scan", *build_samples([("x", 1.0)]), sets=sets)
    true = run.setup.true.cylinder
    assert true is not None
    up = true.R_WP[:, 2]
    axis = rot_z(math.pi + math.radians(1.5))  # reversed: an axis has no direction
    moved = Cylinder(true.p_WP + 0.004 * up, true.R_WP @ axis, true.radius, true.half_length)
    drawn = true._replace(p_WP=true.p_WP - 0.0045 * up, radius=true.radius + 0.002)
    setup: Any = SimpleNamespace(cylinder=drawn, true=SimpleNamespace(cylinder=true))
    sigma = np.array([math.radians(0.5), math.radians(0.25), 0.001, 0.002, 0.003])
    x = np.array([math.radians(1.0), math.radians(2.0), 0.005, 0.006, 0.007])
    fit = TouchFit(x, np.diag(sigma**2), np.zeros(4), np.array([True, True, False, True]), True)
    touch = Touch(np.zeros(3), up, "")
    touches = [touch] * 4 + [Touch(np.zeros(3), up, "nothing was met")]
    found = Surveyed(FoundCylinder(moved, fit), touches, "")
    corners = np.array([[0.0, math.pi / 2.0]])  # where the surface's normal is z of the pipe
    m = judge_survey(setup, found, corners, Ball(0.01, 0.0, 0.001))
    assert m["survey.turn_up_deg"] == pytest.approx(1.0)
    assert m["survey.turn_aside_deg"] == pytest.approx(2.0)
    assert m["survey.ahead_mm"] == pytest.approx(5.0)
    assert m["survey.up_mm"] == pytest.approx(6.0)
    assert m["survey.radius_mm"] == pytest.approx(7.0)
    assert m["survey.turn_up_std_deg"] == pytest.approx(0.5)
    assert m["survey.turn_aside_std_deg"] == pytest.approx(0.25)
    assert m["survey.ahead_std_mm"] == pytest.approx(1.0)
    assert m["survey.up_std_mm"] == pytest.approx(2.0)
    assert m["survey.radius_std_mm"] == pytest.approx(3.0)
    assert (m["survey.touches"], m["survey.missed"], m["survey.left_out"]) == (4.0, 1.0, 1.0)
    assert m["survey.surface_error_mm"] == pytest.approx(4.0)
    assert m["survey.map_error_mm"] == pytest.approx(2.5)  # 4.5 mm too low, 2 mm too thick
    assert m["survey.axis_error_deg"] == pytest.approx(1.5)
    # up by 2 mm and a radius by 3 mm, both along the normal there
    assert m["survey.surface_std_mm"] == pytest.approx(math.hypot(2.0, 3.0), rel=1e-6)
