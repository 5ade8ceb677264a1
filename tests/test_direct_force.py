"""The law direct_force: its gains, its loop, and a robot that measures its probe's force."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from law_parts import build_case
from skywright.core.record import View
from skywright.core.rotations import rot_y
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.models.rigid_body import (
    build_body_model,
    compute_body,
    compute_kinematics,
    posture,
)
from skywright.planning.scan import fill_force
from skywright.run.limits import GUST_FREQUENCIES, compute_response_rms
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.follower import Press
from skywright.vehicle.laws.direct_force import (
    SENSITIVITY,
    Contact,
    DirectForce,
    build_contact,
    compute_gains,
    compute_gust_response,
    compute_sensitivity,
)
from skywright.vehicle.readings import WrenchSample
from skywright.vehicle.tip_force import TARE_S, WrenchTipForce, find_tip_sensor

DT = 0.002
OUTWARD = np.array([-1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def othex_force():
    return load_description("pipe-weld-scan", robot="othex-force")


@pytest.fixture(scope="module")
def contact(othex_force):
    return build_contact(othex_force.robot, othex_force.world, DirectForce.Table(), DT, 0.001)


def test_the_page_states_the_gains_of_othex_force(contact: Contact) -> None:
    page = Path(__file__).parent.parent / "docs/howto/press-with-a-force-sensor.md"
    lines = page.read_text(encoding="utf-8").splitlines()
    rows = [[cell.strip() for cell in x.split(" | ")] for x in lines if x.startswith("| ")]
    stated = {row[0].removeprefix("| "): row[2].removesuffix(" |") for row in rows}
    w, damper, kp, ki = compute_gains(contact, DirectForce.Table())
    assert stated["stiffness k"] == (
        f"{contact.k:.0f} N/m; {contact.k_hard:.0f} N/m with the slider at an end stop"
    )
    assert stated["bandwidth ω"] == f"{w:.1f} rad/s"
    assert stated["damping D"] == f"{damper:.0f} N s/m"
    assert stated["k_P"] == f"{kp:.2f}"
    assert stated["k_I"] == f"{ki:.1f} 1/s"
    times = (
        f"rotor lag ({1e3 * contact.lag:.0f} ms) and a dead time of {1e3 * contact.delay:.0f} ms ("
    )
    assert times in "".join(lines)


class Bench:
    """The law as plain Python on a mass that moves along x towards a spring at x = 0."""

    def __init__(self, contact: Contact, *, late: bool = False) -> None:
        self.c, gains = contact, compute_gains(contact, DirectForce.Table())
        self.gains, b = gains, build_case()
        me = np.zeros(1, DirectForce.Me.dtype)[0]
        for name in b["me"].dtype.names:
            if name in me.dtype.names:
                me[name] = b["me"][name]
        me["damper"], me["kp_force"], me["ki_force"] = gains.damper, gains.kp, gains.ki
        me["approach"] = 0.5 / math.sqrt(contact.k * contact.mass)
        me["approach_max"] = math.inf
        b["me"], b["press"] = me, np.zeros(1, Press.dtype)[0]
        b["body"]["mass"] = contact.mass
        b["ref"]["R_WS"] = rot_y(-math.pi / 2)
        np.testing.assert_allclose(b["ref"]["R_WS"][:, 2], OUTWARD, atol=1e-12)
        b["ref"]["track_tip"], b["ref"]["dead_zone"] = 1.0, 0.03
        self.b, self.x, self.v, self.u = b, 0.0, 0.0, 0.0
        steps = round(contact.delay / DT)
        self.way = [0.0] * (steps if late else 0)
        self.lag = contact.lag if late else 0.0

    def fly(self, asked: float, seconds: float, surface: bool = True) -> tuple:
        """Return force and speed (n,) of each control tick."""
        out, b = [], self.b
        b["press"]["force"] = asked
        for _ in range(round(seconds / DT)):
            force = max(self.c.k * self.x, 0.0) if surface else 0.0
            b["est"]["p_WT"][0], b["est"]["v_WB"][0], b["est"]["f_tip"] = self.x, self.v, force
            ports = ("me", "ref", "press", "est", "body", "allocated", "cmd")
            DirectForce.step(*(View(b[name]) for name in ports))
            self.way.append(float(b["cmd"]["f_B"][0]))
            told = self.way.pop(0)
            self.u += (told - self.u) * (-math.expm1(-DT / self.lag) if self.lag else 1.0)
            for _ in range(4):
                push = max(self.c.k * self.x, 0.0) if surface else 0.0
                self.v += DT / 4 * (self.u - push) / self.c.mass
                self.x += DT / 4 * self.v
            out.append((force, self.v))
        return tuple(np.array(out).T)


def test_the_force_answers_a_step_as_derived(contact):
    """F / F^d = w^2 (s + w_i) / (s^3 + 2 zeta w s^2 + w^2 s + w_i w^2), ideal rotors."""
    bench = Bench(contact)
    w, k, m = bench.gains.w, contact.k, contact.mass
    bench.fly(1.0, 4.0)
    force, _ = bench.fly(2.0, 2.0)
    ki = bench.gains.ki * k / m
    system = signal.TransferFunction([w**2, ki], [1.0, 2.0 * w, w**2, ki])
    t = DT * np.arange(len(force))
    _, expected = signal.step(system, T=t)
    np.testing.assert_allclose(force - 1.0, expected, atol=0.03)
    assert ki == pytest.approx(0.25 * w**3)


def test_behind_rotors_and_dead_time_the_force_settles_without_ringing(contact):
    bench = Bench(contact, late=True)
    bench.fly(1.0, 4.0)
    force, _ = bench.fly(2.0, 4.0)
    assert force.max() < 2.5
    np.testing.assert_allclose(force[round(1.5 / DT) :], 2.0, atol=0.05)
    np.testing.assert_allclose(force[-100:], 2.0, atol=2e-3)


def test_the_bandwidth_is_the_fastest_that_the_lag_allows(contact):
    table = DirectForce.Table()
    gains = compute_gains(contact, table)
    assert compute_sensitivity(contact, gains) <= SENSITIVITY
    faster = table.model_copy(update={"force_bandwidth_rad_s": 1.1 * gains.w})
    assert compute_sensitivity(contact, compute_gains(contact, faster)) > SENSITIVITY
    slow = compute_gains(contact._replace(delay=contact.delay + 0.008), table)
    assert 1.0 < slow.w < gains.w and slow.kp == 0.0


def test_the_dead_time_counts_the_link_both_ways(othex_force, contact):
    for table, age in (
        ({"delay_s": 0.004}, 0.004),
        ({"delay_s": 0.0041}, 0.006),  # until the next control tick
        ({"delay_s": 0.004, "loss_fraction": 0.5}, 0.006),  # one tick in the mean
        ({"delay_s": 0.004, "jitter_s": 0.002}, 0.00545),  # with the order of packets
    ):
        link = othex_force.world.link.model_copy(update=table)
        world = othex_force.world.model_copy(update={"link": link})
        slow = build_contact(othex_force.robot, world, DirectForce.Table(), DT, 0.001)
        assert slow.delay - contact.delay == pytest.approx(2.0 * age, rel=2e-3)
    assert slow._replace(delay=0.0) == contact._replace(delay=0.0)


def test_the_dead_time_counts_half_a_period_of_the_sensor():
    """A sensor at 100 instead of 500 Hz adds 4 ms."""
    delays = []
    for rate in (100.0, 500.0):
        d = load_description(
            "pipe-weld-scan",
            robot="othex-force",
            sets=[f"robot.sensors.probe_force.rate_hz={rate:g}"],
        )
        delays.append(build_contact(d.robot, d.world, DirectForce.Table(), DT, 0.001).delay)
    assert delays[0] - delays[1] == pytest.approx(0.5 * (1.0 / 100.0 - 1.0 / 500.0))


def test_sensitivity_and_gust_response_of_a_contact(contact):
    """Nyquist by hand at one frequency: m x'' = u - k x - gust, F = k x, u late and lagged."""
    gains, w = compute_gains(contact, DirectForce.Table()), np.array([7.0])
    s, worst, forces = 7j, 0.0, []
    for k in (contact.k, contact.k_hard, 0.0):
        plant = 1.0 / (contact.mass * s**2 + k)
        late = cmath.exp(-s * contact.delay) / (1.0 + contact.lag * s)
        law = gains.damper * s + k * (gains.kp + gains.ki / s)
        worst = max(worst, abs(1.0 / (1.0 + law * late * plant)))
        forces.append(abs(k * plant / (1.0 + law * late * plant)))
    assert compute_sensitivity(contact, gains, w) == pytest.approx(worst)
    assert compute_gust_response(contact, gains, w) == pytest.approx(max(forces))


def test_the_tip_gives_way_by_the_attitude_loops_stiffness_about_the_centre_of_mass(othex_force):
    """A loop of bandwidth w holds I_C w^2: twice as fast, a quarter of its part remains."""
    robot = othex_force.robot
    model, q = build_body_model(robot, 9.81), posture(robot, "working")
    m, c, inertia = compute_body(model, q)
    k = compute_kinematics(model, q)
    lever = np.cross(k["p_BT"] - c, k["R_BT"][:, 2])
    central = inertia - m * (c @ c * np.eye(3) - np.outer(c, c))
    gives, w = [], robot.control.attitude_bandwidth_rad_s
    for own in (w, 2.0 * w):
        table = DirectForce.Table(attitude_bandwidth_rad_s=own)
        gives.append(1.0 / build_contact(robot, othex_force.world, table, DT, 0.001).k_hard)
    wanted = 0.75 * lever @ np.linalg.solve(central, lever) / w**2
    assert gives[0] - gives[1] == pytest.approx(wanted, rel=1e-9)


def test_a_link_that_leaves_no_bandwidth_is_refused(contact):
    with pytest.raises(InputError, match=r"dead time of 45 ms .* no force bandwidth"):
        compute_gains(contact._replace(delay=0.045), DirectForce.Table())


def test_contact_is_found_again_without_slamming(contact):
    """In the air: at the speed whose impact makes half of the force, and nothing winds up."""
    bench = Bench(contact, late=True)
    bench.x = -0.05
    _, speed = bench.fly(2.0, 0.6, surface=False)
    approach = 0.5 * 2.0 / math.sqrt(contact.k * contact.mass)
    assert speed[-1] == pytest.approx(approach, rel=0.02) and speed.max() < 1.1 * approach
    assert abs(bench.b["me"]["sigma"][0]) < 1e-12
    bench.x = -0.005
    force, _ = bench.fly(2.0, 4.0)
    assert 1.9 < force.max() < 3.0
    assert force[-1] == pytest.approx(2.0, abs=0.01)


def test_where_no_surface_is_the_tip_stays_near_its_reference(contact):
    bench = Bench(contact, late=True)
    bench.fly(2.0, 3.0, surface=False)
    assert 0.0 < bench.x < 0.035


def test_rotors_at_their_limits_wind_nothing_up(contact):
    bench = Bench(contact)
    bench.fly(1.0, 1.0)
    before = float(bench.b["me"]["sigma"][0])
    bench.b["allocated"]["saturated"] = 1.0
    bench.fly(2.0, 0.2)
    assert bench.b["me"]["sigma"][0] == before


def test_a_robot_without_a_force_sensor_is_refused():
    d = load_description("pipe-weld-scan", sets=["mission.law=direct_force"])
    with pytest.raises(InputError, match="'othex' has no force sensor there") as told:
        build_law(d, Setup(d))
    assert "\n" not in str(told.value)


def test_gains_are_keys_of_the_law():
    sets = ["mission.law=direct_force", "mission.law.force_bandwidth_rad_s=5"]
    d = load_description("pipe-weld-scan", robot="othex-force", sets=sets)
    law = build_law(d, Setup(d))
    c = build_contact(d.robot, d.world, law.table, DT, 0.001)
    gains = compute_gains(c, law.table)
    assert gains.w == 5.0 and gains.damper == pytest.approx(2.0 * c.mass * 5.0)
    with pytest.raises(InputError, match="force_damping"):
        load_description("pipe-weld-scan", robot="othex-force", sets=[*sets, "mission.law.gain=1"])


def test_othex_flies_the_papers_law_and_othex_force_its_own(othex_force):
    paper = load_description("pipe-weld-scan")
    assert type(build_law(paper, Setup(paper))).__name__ == "PushAndSlide"
    assert isinstance(build_law(othex_force, Setup(othex_force)), DirectForce)
    assert find_tip_sensor(othex_force.robot).name == "probe_force"
    assert find_tip_sensor(load_description("pipe-weld-scan").robot) is None


def test_the_tare_takes_up_a_bias_and_no_contact():
    names = {"me": WrenchTipForce.Me, "measured": WrenchSample, "press": Press}
    b = {**build_case(), **{n: np.zeros(1, r.dtype)[0] for n, r in names.items()}}
    b["me"]["mass"], b["me"]["dt"] = 0.04, DT
    b["body"]["R_BT"] = np.eye(3)  # upright: the slider's weight is 0.39 N

    def feel(force: float, seconds: float) -> float:
        b["measured"]["force"][0] = -(force + 0.04 * 9.81 + 0.3)
        for _ in range(round(seconds / DT)):
            ports = ("me", "measured", "ref", "press", "body", "est")
            WrenchTipForce.step(*(View(b[name]) for name in ports))
        return float(b["est"]["f_tip"])

    assert feel(0.0, TARE_S + 1.0) == pytest.approx(0.0, abs=1e-6)
    assert feel(1.0, 5.0) == pytest.approx(1.0, abs=1e-3)  # touched where nothing was planned
    b["ref"]["dead_zone"] = 0.03
    assert feel(0.1, 5.0) == pytest.approx(0.1, abs=1e-3)


def test_a_plan_asks_for_the_force_where_it_is_inside(othex_force):
    from skywright.core.types import REFERENCE

    cylinder = Setup(othex_force).cylinder
    rows = np.zeros(4, REFERENCE)
    rows["dead_zone"] = [0.0, 0.03, 0.03, 0.03]
    n = cylinder.R_WP @ [-1.0, 0.0, 0.0]
    for row, gap in zip(rows, (-0.02, 0.01, -0.01, -0.02), strict=True):
        row["p_WT"] = cylinder.p_WP + (cylinder.radius + gap) * n
    fill_force(rows, cylinder, 0.02, 2.0)
    np.testing.assert_allclose(rows["force"], [0.0, 0.0, 1.0, 2.0], atol=1e-9)


def test_gusts_below_the_bandwidth_are_held(contact):
    """s k / (w_i m w^2) at low frequencies, about 1 far above; the rms against white noise."""
    gains = compute_gains(contact, DirectForce.Table())
    w = np.array([0.01, 300.0])
    low, high = compute_gust_response(contact, gains, w)
    assert low == pytest.approx(0.01 / gains.ki, rel=0.02) and high < 0.1
    flat = compute_response_rms(np.ones(len(GUST_FREQUENCIES)), 0.7, 7.0)
    assert flat == pytest.approx(0.7, rel=0.02)
