"""The linear model behind the gains: closed forms, an independent solver, and the shipped robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from skywright.description.loader import load_description
from skywright.evidence.loop import (
    NAMES,
    build_loop_model,
    compute_least_damping,
    compute_margins,
    compute_poles,
    compute_tip_rms,
    read_gains,
)

GUSTS = ["world.wind.kind=dryden", "world.wind.mean_mps=2.5"]


@pytest.fixture(scope="module")
def othex():
    d = load_description("pipe-weld-scan", sets=GUSTS)
    return build_loop_model(d), read_gains(d)


def free(model):
    """The robot away from the surface."""
    return model._replace(stiffness=0.0, friction=0.0, friction_damping=0.0)


def test_a_free_robot_has_the_margins_of_six_independent_loops(othex):
    """Axis by axis (kd s + kp + ki / s) e^-sT / (s^2 (lag s + 1)); a tip at C couples nothing."""
    model, g = othex
    model = free(model)._replace(p_CT=np.zeros(3), p_CB=np.zeros(3))
    found = {m.name: m for m in compute_margins(model, g)}
    for name, wn, zeta, wi in [
        ("y", g.position, g.position_damping, g.position_integral),
        ("pitch", g.attitude, g.attitude_damping, g.attitude_integral),
    ]:
        s = 1j * np.geomspace(1.0, 100.0, 200001)
        loop = (2 * zeta * wn * s + wn**2 * (1 + wi / s)) / s**2
        loop *= np.exp(-s * model.delay) / (1 + model.lag * s)
        k = int(np.argmin(np.abs(np.abs(loop) - 1.0)))
        assert found[name].crossover == pytest.approx(s[k].imag, rel=0.01)
        phase = 180.0 + math.degrees(np.angle(loop[k]))
        assert found[name].phase_deg == pytest.approx(phase, abs=0.5)


def test_gust_response_agrees_with_lyapunov_s_equation(othex):
    """First-order gusts on one axis of a mass with spring and damper, no lag and no integral."""
    model, g = othex
    model = free(model)._replace(
        p_CT=np.zeros(3), p_CB=np.zeros(3), lag=1e-9, delay=1e-9, along=1,
        sigma=np.array([0.0, 0.8, 0.0]), time=np.full(3, 2.0),
        drag=np.vstack([0.5 * np.eye(3), np.zeros((3, 3))]),
    )  # fmt: skip
    g = g._replace(position_integral=0.0)
    wn, zeta = g.position, g.position_damping
    a = np.array([[0, 1, 0], [-(wn**2), -2 * zeta * wn, 0.5 / model.mass], [0, 0, -0.5]])
    noise = np.diag([0.0, 0.0, 2 * 0.8**2 / 2.0])
    variance = solve_continuous_lyapunov(a, -noise)
    assert compute_tip_rms(model, g)[1] == pytest.approx(math.sqrt(variance[0, 0]), rel=0.01)


def test_poles_tell_an_unstable_loop(othex):
    """Routh: s^2 (lag s + 1) + kd s + kp is stable while kd > lag kp."""
    model, g = othex
    assert np.all(compute_poles(model, g).real < 0.0)
    limit = 2.0 * g.attitude_damping / model.lag  # of the bandwidth, without dead time
    fast = compute_poles(free(model), g._replace(attitude=1.05 * limit))
    assert np.max(fast.real) > 0.0


def test_the_othex_has_the_margins_that_its_file_states(othex):
    model, g = othex
    for m in (model, free(model)):
        for margin in compute_margins(m, g):
            assert margin.sensitivity < 2.0, NAMES
            assert margin.phase_deg > 30.0
    assert compute_least_damping(model, g) > 0.27


def test_a_faster_integral_hunts_where_friction_brakes(othex):
    """What limits the integral is not the fast crossover but pitch and tip height at 1 rad/s."""
    model, g = othex
    eager = g._replace(position_integral=2.0, attitude=11.0)
    assert compute_least_damping(model, eager) < 0.1 < compute_least_damping(model, g)
    worst = max(compute_margins(free(model), eager), key=lambda m: m.sensitivity)
    assert worst.sensitivity < 2.0  # in free flight nothing is wrong with it
