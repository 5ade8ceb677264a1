"""The law impedance, and the moment of the contact as a feed-forward of push_and_slide."""

from __future__ import annotations

import math

import numpy as np
import pytest

import law_parts
from law_parts import build_case
from skywright.core.rotations import rot_x, rot_y
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.models.rigid_body import compute_body, posture
from skywright.run.backends import build_vehicle
from skywright.run.limits import find_exceeded_push
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.laws.impedance import Impedance
from skywright.vehicle.laws.push_and_slide import PushAndSlide
from skywright.vehicle.simulated import SimulatedVehicle

MASS, W, ZETA = 2.25, 6.0, 1.2
KP, KD = MASS * W**2, 2.0 * ZETA * MASS * W
FRICTION = 0.2


@pytest.fixture
def b():
    """A tip that slides up a wall before it, 2 cm inside, off its place and moving."""
    out = build_case()
    me, ref, est = out["me"], out["ref"], out["est"]
    me["wi_p"], me["friction"] = 0.0, FRICTION
    me["stiffness"], me["share"] = 0.5 * KP, 1.0
    me["damper"] = 2.0 * ZETA * math.sqrt(0.5 * KP * MASS)
    ref["track_tip"], ref["dead_zone"], ref["R_WS"] = 1.0, 0.045, rot_y(-math.pi / 2)
    ref["p_WT"], ref["v_WT"] = [0.02, 0.004, -0.003], [0.0, 0.0, 0.01]
    est["v_WB"] = [0.02, -0.01, 0.03]
    out["body"]["p_BT"], out["body"]["p_BC"] = [0.6, 0.02, -0.1], [0.04, 0.0, 0.02]
    return out


def call(law, b) -> np.ndarray:
    for name in ("sigma", "theta"):
        b["me"][name] = 0.0
    law_parts.call(law, b)
    return b["cmd"]["f_B"].copy()


def test_with_the_numbers_of_law_4_it_is_law_4(b) -> None:
    b["me"]["stiffness"], b["me"]["damper"] = KP, KD
    own, torque = call(Impedance, b), b["cmd"]["t_B"].copy()
    np.testing.assert_allclose(own, call(PushAndSlide, b), atol=1e-12)
    np.testing.assert_allclose(torque, b["cmd"]["t_B"], atol=1e-12)


def test_spring_and_damper_across_the_surface_are_chosen_and_along_it_law_4s(b) -> None:
    paper, own = call(PushAndSlide, b), call(Impedance, b)
    D = 2.0 * ZETA * math.sqrt(0.5 * KP * MASS)
    assert own[0] == pytest.approx(0.5 * KP * 0.02 - D * 0.02)  # n is -x
    assert own[1] == pytest.approx(paper[1])
    up = 0.01 / math.hypot(0.01, 1e-3)
    assert paper[2] - own[2] == pytest.approx(FRICTION * 0.5 * KP * 0.02 * up)  # half the push


def test_in_the_air_it_is_law_4(b) -> None:
    b["ref"]["dead_zone"] = 0.0
    np.testing.assert_allclose(call(Impedance, b), call(PushAndSlide, b), atol=1e-12)


@pytest.mark.parametrize("factor", [0.8, 2.0])
def test_a_force_moves_the_chosen_mass(b, factor: float) -> None:
    """m a = f + F n with m_v a = D v + K e + F n, all along n."""
    b["me"]["share"] = 1.0 / factor
    b["est"]["f_tip"] = force = 3.0
    outward = -call(Impedance, b)[0]
    D, e, v = float(b["me"]["damper"]), -0.02, 0.02  # along n: the reference is inside, v^d - v
    wanted = (D * v + 0.5 * KP * e + force) / (factor * MASS)
    assert (outward + force) / MASS == pytest.approx(wanted)


def test_defaults_are_half_of_law_4_and_another_mass_needs_a_sensor() -> None:
    d = load_description("pipe-weld-scan", sets=["mission.law=impedance"])
    law = build_law(d, Setup(d))
    assert law.compute_push_share(Setup(d)) == 0.5
    sets = ["mission.law=impedance", "mission.law.normal_mass=2"]
    d = load_description("pipe-weld-scan", sets=sets)
    with pytest.raises(
        InputError, match=r"normal_mass = 2 requires a measured probe force; 'othex'"
    ):
        build_law(d, Setup(d))
    d = load_description("pipe-weld-scan", robot="othex-force", sets=sets)
    build_law(d, Setup(d))


def fly(*sets: str, robot: str = "othex") -> SimulatedVehicle:
    return build_vehicle(load_description("pipe-weld-scan", robot=robot, sets=list(sets)))


def test_what_the_rotors_are_too_slow_for_is_refused() -> None:
    with pytest.raises(InputError, match=r"normal_stiffness_n_per_m = 4000, .* sensitivity of"):
        fly("mission.law=impedance", "mission.law.normal_stiffness_n_per_m=4000")
    with pytest.raises(InputError, match=r"normal_mass = 0\.1 have a sensitivity of"):
        fly("mission.law=impedance", "mission.law.normal_mass=0.1", robot="othex-force")


def test_the_stiffness_that_is_told_is_flown_and_counts_in_the_wind_limit() -> None:
    law = "mission.law=impedance"
    told = fly(law, "mission.law.normal_stiffness_n_per_m=30")
    me = told.assembly.records[Impedance.Me, "law"][0]
    mass = float(compute_body(told.model, posture(told.robot, "working"))[0])
    assert me["stiffness"] == 30.0 and me["share"] == 1.0
    assert me["damper"] == pytest.approx(2.0 * me["zeta_p"] * math.sqrt(30.0 * mass))
    gusts = ["world.wind.kind=dryden", "world.wind.mean_mps=2"]

    def refuses(*sets: str) -> bool:
        d = load_description("pipe-weld-scan", sets=[*gusts, *sets])
        return find_exceeded_push(Setup(d), 2.0) is not None

    assert not refuses() and refuses(law)  # half the push leaves half the room
    assert not refuses(law, f"mission.law.normal_stiffness_n_per_m={me['wn_p'] ** 2 * mass:.6g}")


@pytest.mark.parametrize(("what", "push"), [("friction", 0.0), ("contact", 1.0)])
def test_the_moment_of_the_contact_is_that_of_its_force_at_the_tip(
    b, what: str, push: float
) -> None:
    R = rot_x(0.1) @ rot_y(-0.2)
    b["est"]["R_WB"] = R
    force = call(PushAndSlide, b)
    torque = b["cmd"]["t_B"].copy()
    b["me"]["feed_friction"], b["me"]["feed_push"] = 1.0, push
    np.testing.assert_array_equal(call(PushAndSlide, b), force)
    normal = KP * 0.02
    up = np.array([0.0, 0.0, 0.01 / math.hypot(0.01, 1e-3)])
    f = R.T @ (push * normal * np.array([-1.0, 0.0, 0.0]) - FRICTION * normal * up)
    moment = np.cross(b["body"]["p_BT"] - b["body"]["p_BC"], f)
    np.testing.assert_allclose(torque - b["cmd"]["t_B"], moment, atol=1e-12)
    b["ref"]["p_WT"] = [-0.001, 0.0, 0.0]  # outside
    call(PushAndSlide, b)
    outside = b["cmd"]["t_B"].copy()
    b["me"]["feed_friction"] = 0.0
    call(PushAndSlide, b)
    np.testing.assert_array_equal(b["cmd"]["t_B"], outside)


def test_the_papers_law_feeds_no_moment_forward_unless_asked() -> None:
    for sets, flags in ([], (0.0, 0.0)), (["mission.law.moment_feed_forward=contact"], (1.0, 1.0)):
        me = fly("mission.law=push_and_slide", *sets).assembly.records[PushAndSlide.Me, "law"][0]
        assert (me["feed_friction"], me["feed_push"]) == flags
