"""The model-inversion law against the paper's model (3), and its gains against their poles."""

from __future__ import annotations

import numpy as np
import pytest

from skywright.core.record import View
from skywright.core.types import MAX_JOINTS
from skywright.description.loader import load_description
from skywright.models.body_records import Kinematics
from skywright.models.floating import fill_floating
from skywright.models.planar import build_planar_lrm, fill_equations, fill_terms
from skywright.models.rigid_body import build_body_model, fill_body, fill_kinematics
from skywright.models.scene import build_scene
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.arms.ports import Floating, Wrench
from skywright.vehicle.bus import Body, Estimate
from skywright.vehicle.laws import _cascade_gains
from skywright.vehicle.laws._cascade_gains import SwingModel, attitude_lag, place_swing_poles
from skywright.vehicle.laws.model_inversion import ModelInversion, invert_translation

G = 9.81


@pytest.mark.parametrize("seed", range(4))
def test_the_force_is_that_of_the_papers_model(seed):
    """(3) solved for the force with the passive joint free, against the law's closed form."""
    rng = np.random.default_rng(seed)
    d = load_description("bar-transport", sets={"mission.task.bar_length_m": 0.0})
    p = build_planar_lrm(build_scene(d.robot, d.world), d.robot)
    pitch, q0, q7, q8 = rng.uniform([-0.3, -0.4, -1.2, -1.5], [0.3, 0.4, 0.5, 0.0])
    rate, a1, a3 = rng.normal(size=3)

    q = np.array([0.0, 2.0, pitch, q0, q7, q8, q7, q8])
    u, s = np.zeros(8), np.empty(24)
    u[3] = rate
    M, rhs = np.zeros((8, 8)), np.zeros((8, 24))
    fill_equations(p, q, M, rhs)
    fill_terms(u, np.zeros(6), G, s)
    free = rhs @ s
    ud = np.array([a1, a3, 0, 0, 0, 0, 0, 0])
    ud[3] = (free[3] - M[3] @ ud) / M[3, 3]  # nothing turns the joint but what hangs on it
    force = (M @ ud - free)[:2]

    records = (ModelInversion.Me, Estimate, Body, Floating, Wrench)
    me, est, body, floating, wrench = (np.zeros(1, r.dtype)[0] for r in records)
    model, k, joints = (
        build_body_model(d.robot),
        np.zeros(1, Kinematics.dtype),
        np.zeros(MAX_JOINTS),
    )
    joints[:5] = [q0, q7, q8, q7, q8]
    floating["swing"], est["qd"][0] = 0, rate
    est["R_WB"] = [
        [np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)],
    ]  # fmt: skip
    me["f_external_max"] = 1.0
    fill_kinematics(model[0], joints, k[0])
    fill_body(model[0], k[0], body)
    body["gravity"] = G
    fill_floating(model[0], k[0], body, floating)
    f_W = np.empty(3)
    views = map(View, (me, est, body, floating, wrench))
    invert_translation(*views, np.array([a1, 0.0, a3]), f_W)
    np.testing.assert_allclose(f_W[[0, 2]], force, rtol=1e-9, atol=1e-9)
    assert f_W[1] == pytest.approx(0.0, abs=1e-12)


def test_gains_place_the_poles_with_the_pull_cancelled():
    """The characteristic polynomial of platform, link and attitude loop has the poles asked for."""
    m = SwingModel(6.92, 1.762, 1.710, G)

    def lag(s):
        return attitude_lag(s, 10.0, 20.0, 0.025)

    gains = place_swing_poles(m, lag, 1.5, 3.0, 0.25, -m.pull)
    reduced = m.mass * m.second - m.first**2
    s = np.poly1d([1.0, 0.0])
    feedback = m.mass * (
        (gains.position + gains.velocity * s) * np.poly1d([m.second, 0.0, m.first * G])
        + (-m.pull + gains.swing * s) * m.first * s * s
    )
    loop = np.poly1d([0.025, 1.0, 20.0, 200.0])
    free = s * s * np.poly1d([reduced, 0.0, m.mass * m.first * G]) * loop
    roots = (free + 200.0 * feedback).roots
    for pole in gains.poles:
        assert np.min(np.abs(roots - pole)) < 1e-6
    assert np.max(roots.real) < 0.0
    # a link that hangs still pulls the platform nowhere: its poles are slower than with it free
    assert abs(gains.poles[1]) < m.natural


def test_the_search_for_the_cascades_poles_is_as_it_was():
    m = SwingModel(6.92, 1.762, 1.710, G)
    gains = place_swing_poles(m, lambda s: attitude_lag(s, 10.0, 20.0, 0.025), 2.0, 4.0, 0.25)
    assert abs(gains.poles[1]) > _cascade_gains.SLOWEST_SWING * m.natural


def test_it_carries_the_bar():
    sets = {"mission.law": "model_inversion", "mission.task.planner_slices": 100,
            "mission.timestep_ms": 2}  # fmt: skip
    result = fly_and_evaluate(load_description("bar-transport", sets=sets))
    assert result.outcome == "succeeded", result.reason
    assert result.metrics["swing.max_deg"] < 5.0
