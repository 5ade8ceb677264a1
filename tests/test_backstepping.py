"""The backstepping law: its PID identity, Lyapunov's derivative, the contact model (24)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skywright.core.record import View
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.contact_stance import find_free_stance
from skywright.models.rigid_body import build_body_model, compute_tip
from skywright.vehicle.bus import Body, Estimate, Reference
from skywright.vehicle.follower import Press
from skywright.vehicle.laws._tip_motion import (
    DAMPING,
    STOP_RATE,
    fill_tip_rows,
    invert_tip,
    slow_at_stops,
)
from skywright.vehicle.laws.backstepping import (
    Backstepping,
    backstep,
    compute_backstepping_gains,
    find_contact_wrench,
)

GAIN = st.floats(0.1, 20.0)
NUMBER = st.floats(-3.0, 3.0)


@given(k1=GAIN, k2=GAIN, lam=GAIN, e=NUMBER, de=NUMBER, chi=NUMBER)
def test_backstepping_is_a_pid(
    k1: float, k2: float, lam: float, e: float, de: float, chi: float
) -> None:
    """x'' = (1 + lambda + k1 k2) e + (k1 + k2) e' + k2 lambda int e."""
    pid = (1 + lam + k1 * k2) * e + (k1 + k2) * de + k2 * lam * chi
    size = 1 + abs(e) * k1**2 + abs(pid) + lam * k1 * abs(chi) + k1 * k2 * abs(e)
    assert backstep(e, de, chi, k1, k2, lam) == pytest.approx(pid, abs=1e-12 * size + 1e-9)


def test_the_law_makes_lyapunov_fall() -> None:
    """V = z1^2/2 + lambda chi^2/2 + z2^2/2 has V' = -k1 z1^2 - k2 z2^2 on the closed loop.

    With the printed signs, K = 1 - lambda^2 + k (28), it does not (E004-2).
    """
    import sympy as sp  # takes a second, in every worker if at the top

    k1, k2, lam, z1, chi, z1_dot = sp.symbols("k1 k2 lam z1 chi z1_dot", real=True)
    z2 = z1_dot + lam * chi + k1 * z1

    def fall(command: sp.Expr) -> sp.Expr:
        z1_ddot = -command  # x_d'' - x''
        z2_dot = z1_ddot + lam * z1 + k1 * z1_dot
        return sp.expand(z1 * z1_dot + lam * chi * z1 + z2 * z2_dot)

    wanted = -k1 * z1**2 - k2 * z2**2
    ours = (1 - k1**2 + lam) * z1 + (k1 + k2) * z2 - k1 * lam * chi
    printed = (1 - lam**2 + k1) * z1 + (k1 + k2) * z2 - k1 * lam * chi
    assert sp.simplify(fall(ours) - wanted) == 0
    assert sp.simplify(fall(printed) - wanted) != 0


@given(w=st.floats(1.5, 15.0), zeta=st.floats(1.0, 1.5), part=st.floats(0.01, 0.15))
def test_gains_make_the_pid_of_their_bandwidths(w: float, zeta: float, part: float) -> None:
    k1, k2, lam = compute_backstepping_gains(w, zeta, part * w)
    assert min(k1, k2, lam) > 0
    assert 1 + lam + k1 * k2 == pytest.approx(w * w)
    assert k1 + k2 == pytest.approx(2 * zeta * w)
    assert k2 * lam == pytest.approx(part * w**3)
    roots = np.roots([1.0, 2 * zeta * w, w * w, part * w**3])
    assert np.all(roots.real < 0)


def test_gains_that_do_not_exist_are_told() -> None:
    with pytest.raises(InputError, match="damping"):
        compute_backstepping_gains(10.0, 0.3, 0.1)


@given(g1=st.floats(-1.7, 1.7), g2=st.floats(0.4, 2.7), force=st.floats(0.0, 16.0))
def test_the_contact_wrench_is_equation_24(g1: float, g2: float, force: float) -> None:
    """(24) with the sign of its L1 term mended (E004-6), about the arm's base."""
    robot, _ = load_robot("f550-bridge")
    model = build_body_model(robot)
    q = np.array([g1 - math.pi / 2, -g2])
    p_BT, R_BT = compute_tip(model, q)
    records = (Backstepping.Me, Reference, Press, Estimate, Body)
    me, ref, press, est, body = (View(np.zeros(1, r.dtype)[0]) for r in records)
    press.press, est.f_tip, est.R_WB = 1.0, force, np.eye(3)
    body.p_BT, body.R_BT = p_BT, R_BT
    f, t = np.zeros(3), np.zeros(3)
    find_contact_wrench(me, ref, press, est, body, f, t)
    L1, base = 0.25, np.array([0.05, 0.0, 0.05])  # the shoulder
    assert f == pytest.approx([-force * math.sin(g1 - g2), 0.0, -force * math.cos(g1 - g2)])
    # about the shoulder: of the paper's t_y what its d (base to centre of mass) does not make
    about = t - np.cross(base, f)
    assert about[1] == pytest.approx(force * L1 * math.sin(g2), abs=1e-9)
    # virtual work: row 7 of (24), what the shoulder's servo feels, is the same
    step = 1e-6
    lever = (compute_tip(model, q + [step, 0])[0] - compute_tip(model, q - [step, 0])[0]) / (
        2 * step
    )
    assert f @ lever == pytest.approx(about[1], abs=1e-6)


def test_a_tip_at_a_joints_stop_stops_and_does_not_swing_aside() -> None:
    """The law asks for 30 mm/s along the probe until the elbow is at its stop, from a free press.

    One joint alone would swing the tip by centimetres: where friction holds it, the platform.
    """
    robot, _ = load_robot("f550-bridge")
    model = build_body_model(robot)
    low, high = model[0]["q_min"][:2], model[0]["q_max"][:2]

    def drive(obeys: bool) -> tuple[float, float]:
        """Return how far (m) the tip comes aside in 2 s, and how far (rad) past its stop."""
        q = find_free_stance(robot, "down").q.copy()
        start, axis = compute_tip(model, q)[0], compute_tip(model, q)[1][:, 2]
        aside, past, J, qd = 0.0, 0.0, np.zeros((2, MAX_JOINTS)), np.zeros(MAX_JOINTS)
        for _ in range(200):
            body = View(np.zeros(1, Body.dtype)[0])
            tip, body.R_BT = compute_tip(model, q)
            body.n_joints = 2
            for j in range(2):
                body.J_BT[:, j] = (compute_tip(model, q + 1e-6 * np.eye(2)[j])[0] - tip) / 1e-6
            fill_tip_rows(body, J)
            invert_tip(J, 2, 0.03, 0.0, qd)
            if obeys:
                slow_at_stops(low, high, q, 2, qd)
            q += 0.01 * qd[:2]
            off = compute_tip(model, q)[0] - start
            aside = max(aside, float(np.linalg.norm(off - (off @ axis) * axis)))
            past = max(past, float(np.max(q - high)), float(np.max(low - q)))
        return aside, past

    aside, past = drive(obeys=True)
    assert aside < 1e-3 and past < 1e-9
    aside, past = drive(obeys=False)
    assert past > math.radians(5.0)


@given(st.lists(st.floats(-0.5, 0.5), min_size=6, max_size=6), st.floats(-0.1, 0.1))
def test_tip_speeds_are_solved_by_damped_least_squares(levers: list[float], across: float) -> None:
    J, qd = np.zeros((2, MAX_JOINTS)), np.zeros(MAX_JOINTS)
    J[:, :3] = np.reshape(levers, (2, 3))
    invert_tip(J, 3, 0.03, across, qd)
    stacked = np.vstack([J[:, :3], math.sqrt(DAMPING) * np.eye(3)])
    expected = np.linalg.lstsq(stacked, [0.03, across, 0.0, 0.0, 0.0], rcond=None)[0]
    np.testing.assert_allclose(qd[:3], expected, rtol=1e-6, atol=1e-9)


ROOM = st.floats(-0.1, 2.0)


@given(speeds=st.lists(st.floats(-6.0, 6.0), min_size=3, max_size=3), q=st.lists(ROOM, min_size=3))
def test_no_joint_is_led_past_its_stop(speeds: list[float], q: list[float]) -> None:
    low, high = np.zeros(MAX_JOINTS), np.full(MAX_JOINTS, 1.9)
    asked, at = np.array([*speeds, 0.0]), np.array([*q[:3], 0.0])
    qd = asked.copy()
    slow_at_stops(low, high, at, 3, qd)
    scale = np.linalg.norm(qd) / max(float(np.linalg.norm(asked)), 1e-12)
    np.testing.assert_allclose(qd, scale * asked, atol=1e-12)  # the same direction
    assert scale <= 1.0 + 1e-12
    for j in range(3):  # no faster than it can be stopped, and away from a stop at will
        room = high[j] - at[j] if asked[j] > 0 else at[j] - low[j]
        assert abs(qd[j]) <= STOP_RATE * max(room, 0.0) + 1e-12
    far = STOP_RATE * np.minimum(at[:3], high[:3] - at[:3])
    if np.all(np.abs(asked[:3]) <= far):
        np.testing.assert_array_equal(qd, asked)
