"""Disturbances: fan jet, Dryden turbulence, varying friction, wind limits with gusts, hops."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from scipy.signal import welch

from exact_map import EXACT
from plant_parts import build_context, build_plant, view
from skywright.core.record import View
from skywright.core.rotations import rot_z
from skywright.core.streams import build_stream
from skywright.description.loader import load_description
from skywright.description.world.spec import Dryden, Fan, Pipe, Wind
from skywright.description.world.wind import (
    FOOT,
    OUTLET,
    SPREAD,
    compute_dryden_scales,
    compute_gust_sigma,
    compute_mean_wind,
    jet_speed,
)
from skywright.errors import InputError
from skywright.missions.scan.metrics import find_lifts
from skywright.models.scene import Scene
from skywright.run.backends import build_vehicle
from skywright.run.limits import (
    compute_equivalent_wind,
    compute_wind_allowance,
    find_exceeded_push,
    find_exceeded_wind,
)
from skywright.run.planning import plan_mission
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.vehicle.bus import Clock, MuJoCo, Truth
from skywright.vehicle.effects.drag import Drag
from skywright.vehicle.effects.friction import Friction, compute_friction
from skywright.vehicle.effects.wind import NOISE, WindField, build_dryden_filter
from skywright.vehicle.plant import RotorState, Surface
from skywright.vehicle.plant import Wind as WindNow

DT = 0.002
HUBS = 0.4 * np.array([[math.cos(a), math.sin(a), 0.0] for a in np.arange(6) * math.pi / 3])


class Air(NamedTuple):
    """Air velocities over time: at the body (n, 3), at each hub (n, 6, 3)."""

    body: np.ndarray
    hubs: np.ndarray


_step = njit(WindField.step)


@njit
def _blow_over(me, clock, truth, gusts, wind, body, at_hubs):
    for k in range(body.shape[0]):
        clock[0].t = k * clock[0].dt
        _step(me[0], clock[0], truth[0], gusts[k], wind[0])
        for i in range(3):  # an assignment to a slice takes three seconds to compile
            body[k, i] = wind[0].body_W[i]
            for j in range(at_hubs.shape[1]):
                at_hubs[k, j, i] = wind[0].rotor_W[j, i]


def build_air(wind: Wind, dt: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return (1,) arrays of WindField.Me and of the air at the start."""
    me, now = np.zeros(1, WindField.Me.dtype), np.zeros(1, WindNow.dtype)
    context = SimpleNamespace(
        stream=lambda name: rng, rotors=SimpleNamespace(position=HUBS), dt=dt,
        records={(WindNow, ""): now},
    )  # fmt: skip
    WindField("wind", wind).build(View(me[0]), wind, context)
    return me, now


def blow_over(wind: Wind, seconds: float, dt: float = DT, p=(0.0, 0.0, 1.5), seed: int = 1) -> Air:
    """Step the wind at a resting robot."""
    me, now = build_air(wind, dt, build_stream(seed, "wind_start"))
    n = round(seconds / dt)
    gusts = build_stream(seed, "wind").standard_normal((n, NOISE)).view(WindField.Gusts.dtype)[:, 0]
    clock, truth = np.zeros(1, Clock.dtype), np.zeros(1, Truth.dtype)
    clock["dt"], truth["p_WB"], truth["R_WB"] = dt, p, np.eye(3)
    body, hubs = np.zeros((n, 3)), np.zeros((n, 6, 3))
    _blow_over(me, clock, truth, gusts, now, body, hubs)
    return Air(body, hubs)


# --- Dryden --------------------------------------------------------------------------------------


def test_dryden_scales_at_ten_feet_are_the_standard_s():
    """By hand at 10 ft: L_u = 10 / (0.177 + 0.00823)^1.2 ft, sigma_u / sigma_w = 1.963."""
    wind = Wind(kind="dryden", mean_mps=3.0, dryden=Dryden(severity="light"))
    scales = compute_dryden_scales(wind)
    assert scales.length[0] == pytest.approx(75.65 * FOOT, rel=2e-3)
    assert scales.length[2] == pytest.approx(3.048)
    assert scales.sigma[2] == pytest.approx(0.7717, rel=1e-3)  # a tenth of 15 knots
    assert scales.sigma[0] / scales.sigma[2] == pytest.approx(1.963, rel=1e-3)
    mean = compute_dryden_scales(Wind(kind="dryden", mean_mps=3.0))
    assert mean.sigma[2] == pytest.approx(0.1 * 3.0 * math.log(20 / 0.15) / math.log(10 / 0.15))
    own = Wind(kind="dryden", mean_mps=3.0, dryden=Dryden(sigma_mps=0.5, w20_mps=20.0))
    assert compute_dryden_scales(own).sigma[0] == 0.5


def test_turbulence_in_hardly_any_wind_is_possible() -> None:
    for mean in (1e-6, 1e-5, 1e-3):
        wind = Wind(kind="dryden", mean_mps=mean)
        me, _ = build_air(wind, 0.002, np.random.default_rng(1))
        assert np.isfinite(me[0]["noise"]).all() and np.isfinite(me[0]["gust"]).all()


@given(h=st.floats(1e-5, 3.0), sigma=st.floats(0.01, 5.0), first=st.booleans())
def test_dryden_filter_keeps_its_variance_at_any_rate(h, sigma, first):
    """Stationary covariance P of the exact discretisation: phi P phi' + Q = P, output sigma^2."""
    phi, noise, out = build_dryden_filter(sigma, 1.0, h, first)
    p = np.diag([1.0, 0.0]) if first else np.eye(2) / 4.0
    np.testing.assert_allclose(phi @ p @ phi.T + noise @ noise.T, p, atol=1e-12)
    assert out @ p @ out == pytest.approx(sigma**2)


@pytest.mark.parametrize(("dt", "speed", "times"), [(0.002, 60.0, 2000.0), (0.02, 20.0, 2000.0)])
def test_dryden_variance_and_spectrum_match_the_closed_form(dt, speed, times):
    """MIL-F-8785C's spectra, one-sided per Hz, over many correlation times of the slowest part."""
    wind = Wind(kind="dryden", mean_mps=speed, toward_deg=30.0)
    scales = compute_dryden_scales(wind)
    lag = scales.length / speed
    air = blow_over(wind, times * lag[0], dt)
    axes = rot_z(math.radians(30.0)).T
    gust = air.body @ axes.T - [speed, 0.0, 0.0]
    np.testing.assert_allclose(gust.std(axis=0), scales.sigma, rtol=3.0 / math.sqrt(times))
    assert abs(np.corrcoef(gust.T)[0, 1]) < 0.1
    for axis in range(3):
        f, measured = welch(gust[:, axis], 1.0 / dt, nperseg=round(20.0 * lag[0] / dt))
        x2 = (2.0 * math.pi * f * lag[axis]) ** 2
        shape = 2.0 / (1.0 + x2) if axis == 0 else (1.0 + 3.0 * x2) / (1.0 + x2) ** 2
        expected = 2.0 * scales.sigma[axis] ** 2 * lag[axis] * shape
        for low, high in ((0.3, 1.0), (1.0, 3.0), (3.0, 10.0)):
            band = (f > low / (2 * math.pi * lag[axis])) & (f < high / (2 * math.pi * lag[axis]))
            band &= f < 0.1 / dt  # sampling folds the rest
            ratio = measured[band].sum() / expected[band].sum()
            assert ratio == pytest.approx(1.0, abs=0.2), (axis, low)


def test_dryden_starts_stationary():
    """Over seeds the first gust already has the full variance."""
    wind = Wind(kind="dryden", mean_mps=3.0)
    first = np.array([blow_over(wind, DT, seed=s).body[0] for s in range(400)])
    sigma = compute_dryden_scales(wind).sigma
    np.testing.assert_allclose(first.std(axis=0), sigma, rtol=0.12)
    np.testing.assert_allclose(first.mean(axis=0), [3.0, 0.0, 0.0], atol=0.2 * sigma.max())


def test_dryden_without_mean_wind_is_refused():
    with pytest.raises(InputError, match="mean_mps above 0"):
        load_description("pipe-weld-scan", sets=["world.wind.kind=dryden"])


# --- fan -----------------------------------------------------------------------------------------


def test_jet_keeps_its_momentum_and_spreads_linearly():
    """rho int u^2 dA is the outlet's at any distance; half the speed at the half-width."""
    d, u0 = 0.4, 6.0
    r = np.linspace(0.0, 6.0, 60001)
    for x in (0.1, 1.0, 3.0, 8.0):
        u = np.array([jet_speed(x, ri, d, u0) for ri in r])
        momentum = 2.0 * math.pi * np.trapezoid(u**2 * r, r)
        assert momentum == pytest.approx(u0**2 * math.pi * d**2 / 4.0, rel=1e-6)
        half = max(SPREAD * x, OUTLET * d)
        assert jet_speed(x, half, d, u0) == pytest.approx(0.5 * u[0])
    # far from the outlet U_c / U_0 = B d / x with B near 6 (Hussein et al. 1994: 5.8)
    assert jet_speed(8.0, 0.0, d, u0) * 8.0 / (u0 * d) == pytest.approx(6.0, abs=0.4)
    assert jet_speed(-0.1, 0.0, d, u0) == 0.0


def test_fan_blows_where_it_points_and_differs_over_the_robot():
    fan = Fan(x_m=0.0, y_m=-2.0, z_m=1.5, turbulence=0.0)
    wind = Wind(kind="fan", mean_mps=6.0, toward_deg=90.0, fan=fan)
    air = blow_over(wind, 0.1)
    np.testing.assert_allclose(air.body, [[0.0, 6.0, 0.0]] * len(air.body), atol=1e-12)
    mean = compute_mean_wind(wind, HUBS + [0.0, 0.0, 1.5])
    np.testing.assert_allclose(air.hubs[-1], mean, atol=1e-12)
    assert mean[0, 1] == pytest.approx(mean[3, 1])  # 0.4 m off the axis
    assert mean[0, 1] == pytest.approx(6.0 * 2.0 ** -((0.4 / (OUTLET * 0.4)) ** 2))


def test_fan_turbulence_has_its_intensity_and_is_correlated_over_the_robot():
    fan = Fan(x_m=0.0, y_m=-2.0, z_m=1.5, turbulence=0.2, diameter_m=1.5)
    wind = Wind(kind="fan", mean_mps=6.0, toward_deg=90.0, fan=fan)
    air = blow_over(wind, 120.0)
    np.testing.assert_allclose(air.body.std(axis=0), 0.2 * 6.0, rtol=0.12)
    mean = compute_mean_wind(wind, HUBS + [0.0, 0.0, 1.5])[:, 1]
    np.testing.assert_allclose(air.hubs.std(axis=0)[:, 0], 0.2 * mean, rtol=0.15)
    near = np.corrcoef(air.body[:, 0], air.hubs[:, 0, 0])[0, 1]
    far = np.corrcoef(air.hubs[:, 0, 0], air.hubs[:, 3, 0])[0, 1]
    assert near == pytest.approx(math.exp(-0.4 / 0.3), abs=0.1)
    assert far == pytest.approx(math.exp(-0.8 / 0.3), abs=0.1)
    # eddies pass in L / U: correlation 1/e after it
    u = air.body[:, 0] - air.body[:, 0].mean()
    lag = round(0.3 / 6.0 / DT)
    assert np.mean(u[lag:] * u[:-lag]) / np.mean(u * u) == pytest.approx(math.exp(-1), abs=0.08)


def test_oscillating_fan_sweeps_over_the_robot():
    fan = Fan(x_m=0.0, y_m=-2.0, z_m=1.5, turbulence=0.0, sweep_deg=40.0, sweep_period_s=6.0)
    wind = Wind(kind="fan", mean_mps=6.0, toward_deg=90.0, fan=fan)
    speed = np.linalg.norm(blow_over(wind, 12.0).body, axis=1)
    assert speed.max() == pytest.approx(6.0, rel=1e-3) and speed.min() < 0.1
    crossings = np.count_nonzero((speed[1:] > 3.0) != (speed[:-1] > 3.0))
    assert crossings == 8  # in and out of the jet twice a period


def test_a_jet_on_one_side_turns_the_robot():
    """Drag at the hubs of one side only: a yaw torque, that a uniform wind does not make."""
    sets = ["world.wind.kind=fan", "world.wind.mean_mps=6", "world.wind.fan.turbulence=0",
            "world.wind.fan.y_m=0.435", "world.wind.fan.z_m=1.0",
            "robot.rotors.rotor_inertia_kgm2=0"]  # fmt: skip
    context = build_context(sets=sets)
    plant, n = build_plant(context), 6
    plant.sim.qpos[:7] = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    plant.drives.rotors.speed[:n] = plant.read(RotorState).speed[:n] = 400.0
    plant.run(1)
    me, wind = plant.read(Drag.Me, "drag"), plant.read(WindNow)
    expected = np.zeros(3)
    for p, v, axis in zip(me.rotor_p[:n], wind.rotor_W, me.rotor_axis, strict=False):
        force = me.rotor_drag * 400.0 * (v - (v @ axis) * axis)
        expected += np.cross(p - me.com_B, force)
    v = wind.body_W
    drag = me.half_rho_area * np.linalg.norm(v) * v
    expected += np.cross(-me.com_B, drag)
    turn = plant.sim.xfrc[context.scene.places.platform_body, 3:]
    np.testing.assert_allclose(turn, expected, atol=1e-12)
    assert turn[2] < -0.1  # pushed forwards on the left: clockwise from above


# --- friction ------------------------------------------------------------------------------------


def build_friction(pipe: Pipe, seed: int, scene: Scene) -> View:
    me = View(np.zeros(1, Friction.Me.dtype)[0])
    context = SimpleNamespace(stream=lambda name: build_stream(seed, name), scene=scene)
    Friction("friction", pipe).build(me, pipe, context)
    return me


def test_friction_field_has_mean_spread_and_correlation_length():
    pipe = Pipe(friction=0.2, friction_variation=0.3, friction_length_m=0.03)
    places = (0.0, 0.0), (0.03, 0.0), (0.1, 0.2)
    scene = build_context().scene
    fields = [build_friction(pipe, seed, scene) for seed in range(1500)]
    same, near, apart = ([compute_friction(f, s, c) for f in fields] for s, c in places)
    assert np.mean(same) == pytest.approx(0.2, rel=0.03)
    assert np.std(same) == pytest.approx(0.06, rel=0.1)
    logs = np.log([same, near, apart])
    assert np.corrcoef(logs)[0, 1] == pytest.approx(math.exp(-0.5), abs=0.06)
    assert abs(np.corrcoef(logs)[0, 2]) < 0.06


def test_friction_under_the_tip_reaches_mujoco_s_contact():
    context = build_context(sets=["world.pipe.friction_variation=0.5"])
    me = build_friction(context.world.pipe, 3, context.scene)
    pairs, touch = context.scene.model.pair_friction, context.scene.model.pair("touch").id
    assert len(pairs) > 1  # the arm with propellers
    mj = view(MuJoCo, pair_friction=pairs.ctypes.data, npair=len(pairs))
    Friction.step(me, view(Surface, s=0.05, c=0.02), mj)
    assert pairs[touch, 0] == pairs[touch, 1] == compute_friction(me, 0.05, 0.02) != 0.2
    others = np.delete(pairs, touch, axis=0)
    assert not np.any(others == pairs[touch, 0])
    before = pairs.copy()
    Friction.step(me, view(Surface, s=0.09, c=0.02, gap=0.1), mj)  # far away: left alone
    np.testing.assert_array_equal(pairs, before)


# --- limits and metrics --------------------------------------------------------------------------


def _refusal(*sets: str) -> str | None:
    return find_exceeded_wind(Setup(load_description("pipe-weld-scan", sets=list(sets))), {})


def test_gusts_count_with_three_sigma():
    """A steady wind that is allowed is refused with turbulence; a mean 1/(1 + 3 I) of it is not."""
    ahead = ["world.wind.toward_deg=0"]
    assert _refusal("world.wind.kind=steady", "world.wind.mean_mps=5", *ahead) is None
    told = _refusal("world.wind.kind=dryden", "world.wind.mean_mps=5", *ahead)
    assert told is not None and "with gusts (mean + 3 sigma, mission.gust_sigmas)" in told
    bold = ("mission.gust_sigmas=1", *ahead)
    assert _refusal("world.wind.kind=dryden", "world.wind.mean_mps=5", *bold) is None
    assert _refusal("world.wind.kind=dryden", "world.wind.mean_mps=3", *ahead) is None
    assert _refusal(
        "world.wind.kind=dryden", "world.wind.mean_mps=3", *ahead,
        "world.wind.dryden.severity=moderate",
    ) is not None  # fmt: skip


def test_only_gusts_slower_than_the_robot_count():
    """The eddies of a fan (0.05 s) are mostly too quick, those of the open air (7 s) are not."""
    fan = Wind(kind="fan", mean_mps=6.0)
    assert compute_gust_sigma(fan, 6.0)[0] == pytest.approx(1.2)
    assert compute_gust_sigma(fan, 6.0, 6.0)[0] == pytest.approx(1.2 * math.sqrt(0.3 / 1.3))
    air = Wind(kind="dryden", mean_mps=3.0)
    slow, all_ = compute_gust_sigma(air, 3.0, 6.0), compute_gust_sigma(air, 3.0)
    assert 0.98 < slow[0] / all_[0] < 1.0


def test_gusts_that_could_lift_the_probe_are_refused():
    """At 3 m/s, 0.68 m/s rms: 3 sqrt(2) sigma (2 a v + b), a = 0.036 kg/m, b near 0.37 kg/s.

    That is 1.7 N, and 70 % of the push may be taken.
    """
    sets = ["world.wind.kind=dryden", "world.wind.mean_mps=3"]
    d = Setup(load_description("pipe-weld-scan", sets=sets))
    assert find_exceeded_push(d, 1.8 / 0.7) is None
    told = find_exceeded_push(d, 1.55 / 0.7)
    assert told is not None and "could lift the probe off the surface" in told and "2.21 N" in told
    assert find_exceeded_push(Setup(load_description("pipe-weld-scan")), 0.0) is None


def test_equivalent_wind_of_a_jet_is_weaker_than_its_axis_and_of_a_wide_jet_is_the_axis():
    sets = ["world.wind.kind=fan", "world.wind.mean_mps=6"]
    d = Setup(load_description("pipe-weld-scan", sets=sets))
    p = np.array([0.0, 0.0, 1.5])
    narrow = np.linalg.norm(compute_equivalent_wind(d, p, 0.0))
    assert 1.5 < narrow < 5.0
    wide = load_description("pipe-weld-scan", sets=[*sets, "world.wind.fan.diameter_m=50"])
    v = compute_equivalent_wind(Setup(wide), p, 0.0)
    np.testing.assert_allclose(v, [6.0, 0.0, 0.0], rtol=2e-3, atol=1e-6)
    assert np.linalg.norm(compute_wind_allowance(d)) < 6.0
    beside = compute_equivalent_wind(d, p + [0.0, 3.0, 0.0], 0.0)
    assert np.linalg.norm(beside) < 0.1


def test_lifts_are_found_with_their_length():
    gap = 1e-3 * np.array([0.0, 0.02, 1.5, 2.0, 0.0, 0.0, 0.3, 0.3, 0.3, 0.3, 0.3, 0.0, 0.2])
    lifts = find_lifts(gap, 0.01)
    assert [(a.start, a.end) for a in lifts] == [(2, 4), (6, 11), (12, 13)]
    assert [a.duration_s for a in lifts] == pytest.approx([0.02, 0.05, 0.01])
    assert lifts[0].gap == pytest.approx(2e-3)
    assert find_lifts(np.zeros(5), 0.01) == []


# --- the whole flight ----------------------------------------------------------------------------

GUSTY = ["world.wind.kind=dryden", "world.wind.mean_mps=2.5", "world.pipe.friction_variation=0.4"]
FAN = ["world.wind.kind=fan", "world.wind.mean_mps=6", "world.wind.fan.sweep_deg=30",
       "world.pipe.friction_variation=0.4"]  # fmt: skip


def _fly(*sets: str, ticks: int | None = None) -> np.ndarray:
    """Fly a short scan and return its samples; `ticks`: stand on the ground for so long instead."""
    short = [
        *EXACT,
        "mission.task.passes=1",
        "mission.task.pass_length_m=0.03",
        "mission.timestep_ms=2",
    ]
    d = load_description("pipe-weld-scan", sets=[*short, *sets])
    plan = plan_mission(d)
    assert plan.feasible, plan.blocked_by
    blocks: list[np.ndarray] = []
    vehicle = build_vehicle(d, blocks.append)
    for _ in range(ticks or 0):
        vehicle.tick()
    if ticks is None:
        flight = Supervisor(vehicle, d.mission, plan, d.robot.platform.gear_height_m).fly()
        assert flight.completed, flight.reason
    vehicle.flush()
    return np.concatenate(blocks)


@pytest.mark.parametrize("sets", [GUSTY, FAN])
def test_gusts_and_friction_are_bit_identical_both_ways_and_per_seed(sets):
    fast = _fly(*sets)
    assert fast.tobytes() == _fly(*sets, "mission.mode=interactive").tobytes()
    same, other = _fly(*sets, ticks=60), _fly(*sets, "mission.seed=2", ticks=60)
    assert np.array_equal(fast["f_wind_W"][:20], same["f_wind_W"][:20])
    assert not np.array_equal(fast["f_wind_W"][:100], other["f_wind_W"][:100])
    assert np.ptp(fast["f_wind_W"][:, 0]) > 0.2


def test_a_fan_needs_a_speed() -> None:
    with pytest.raises(ValueError, match="the speed at its outlet"):
        Wind(kind="fan")
