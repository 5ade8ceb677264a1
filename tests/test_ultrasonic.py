"""Ultrasonic thickness: the physics of an A-scan, and thousands of readings without a flight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import j1

from skywright.errors import InputError
from skywright.inspection.echoes import Pulse, find_echoes, measure_delay
from skywright.inspection.thickness import Rules, ThicknessGauge, check_gauge, set_up_gauge
from skywright.models.ultrasonic import (
    CLIP,
    SAMPLE_RATE,
    Coupling,
    Transducer,
    build_face,
    compute_ascan,
    compute_curvature,
    compute_diffraction,
    compute_echoes,
    compute_film_factor,
    compute_roughness,
    compute_squeeze,
    compute_tilt_factor,
    find_tilt_null,
)

PROBE = Transducer()
PULSE = Pulse(PROBE.frequency, PROBE.bandwidth, SAMPLE_RATE, PROBE.ready, CLIP)
STEPS = (0.005, 0.0125)


def db(x: float) -> float:
    return 20 * math.log10(x)


def scan(wall, coupling: Coupling | None = None, seed: int = 0, probe: Transducer = PROBE, **kw):
    echoes = compute_echoes(probe, coupling or Coupling(), np.atleast_1d(wall))
    return compute_ascan(probe, echoes, np.random.default_rng(seed), place_seed=seed, **kw)


def set_up(seed: int = 0, **changes):
    scans = (scan(STEPS[0], seed=seed), scan(STEPS[1], seed=seed + 1))
    return set_up_gauge(scans, STEPS, PULSE, **changes)


# -- physics -------------------------------------------------------------------------------------


def test_a_film_by_the_transfer_matrix() -> None:
    """The closed form against the product of the layer's own matrix (Brekhovskikh)."""
    for z, v, h in ((1.7e6, 1620.0, 3e-5), (412.0, 343.0, 1e-8)):
        kl = 2 * math.pi * 5e6 * h / v
        front, back = 3.2e6, 46.4e6
        m = np.array([[math.cos(kl), 1j * z * math.sin(kl)],
                      [1j * math.sin(kl) / z, math.cos(kl)]])  # fmt: skip
        p, u = m @ [1.0, 1.0 / back]
        arriving = 0.5 * (p + front * u)
        energy = (1.0 / back) / (abs(arriving) ** 2 / front)
        at_zero = 4 * front * back / (front + back) ** 2
        found = compute_film_factor(h, 5e6, velocity=v, impedance=z)
        assert found == pytest.approx(energy / at_zero, rel=1e-9)


def test_air_kills_the_echo() -> None:
    def air(h):
        return db(compute_film_factor(h, 5e6, velocity=343.0, impedance=412.0))

    assert air(1e-9) == pytest.approx(-3.2, abs=0.3) and air(1e-7) == pytest.approx(-73, abs=1)
    assert compute_echoes(PROBE, Coupling(air=True), np.array([0.01])).amplitudes.max() < 1e-4


def test_tilt_by_direct_integration_over_the_face() -> None:
    """The plane-wave limit: the mean of exp(2 j k_c x sin(theta)) over the disc."""
    x = build_face(1.0)[:, 0]
    u = np.linspace(-1, 1, 20001)
    weight = np.sqrt(1 - u**2)
    k = 2 * math.pi * PROBE.frequency / 1620.0
    for tilt in np.radians([0.2, 0.8, 1.5]):
        direct = abs(np.sum(weight * np.exp(2j * k * PROBE.radius * u * math.sin(tilt))))
        assert compute_tilt_factor(PROBE, tilt) == pytest.approx(direct / weight.sum(), abs=1e-3)
    assert abs(x.mean()) < 1e-12
    assert math.degrees(find_tilt_null(PROBE)) == pytest.approx(1.9, abs=0.05)
    assert compute_tilt_factor(PROBE, find_tilt_null(PROBE)) < 1e-4
    assert j1(3.8317) == pytest.approx(0.0, abs=1e-4)


def test_diffraction_roughness_curvature_film() -> None:
    large = Transducer(radius=0.005)
    assert db(compute_diffraction(large, 0.012, 5920)) == pytest.approx(-1.5, abs=0.1)
    assert db(compute_diffraction(large, 0.1, 5920)) == pytest.approx(-4.8, abs=0.1)
    assert db(compute_curvature(large, 0.2)) == pytest.approx(-1.6, abs=0.1)
    assert db(compute_curvature(PROBE, 0.057)) == pytest.approx(-2.5, abs=0.1)
    # a Gaussian surface, drawn: the coherent part of 2 k h
    rng = np.random.default_rng(0)
    k = 2 * math.pi * 5e6 / 5920
    h = 1e-4 * rng.standard_normal(200_000)
    drawn = abs(np.mean(np.exp(2j * k * h)))
    assert compute_roughness(PROBE, Coupling(roughness_back=1e-4))[1] == pytest.approx(drawn, 0.01)
    # a 10 mm face at 5 N on 1 Pa s: 0.5 mm to 50 um in 0.117 s
    s = 1 / 0.0005**2 + 5.0 * 0.117 * compute_squeeze(1.0, 0.005)
    assert 1 / math.sqrt(s) == pytest.approx(50e-6, rel=0.01)


def test_film_and_paint_read_as_steel_from_one_echo_and_not_from_two() -> None:
    setup = set_up()
    single = ThicknessGauge(setup, 0.0095, mode="single")
    double = ThicknessGauge(setup, 0.0095)
    bare = single.add([0.0], scan(0.0095))[0].thickness
    for coupling, more in (
        (Coupling(film=70e-6), 50e-6 * 5920 / 1620),
        (Coupling(paint=2e-4), 2e-4 * 5920 / 2350),
    ):
        x = scan(0.0095, coupling)
        assert single.add([0.0], x)[0].thickness - bare == pytest.approx(more, abs=3e-5)
        assert double.add([0.0], x)[0].thickness == pytest.approx(0.0095, abs=3e-5)


def test_v_path_of_a_dual_probe() -> None:
    dual = Transducer(separation=0.003, dead=0.03e-6)
    pulse = PULSE._replace(gate_start=dual.ready)
    at = [compute_echoes(dual, Coupling(), np.array([d])).times[0, 0] for d in (0.002, 0.01)]
    plain = [compute_echoes(Transducer(), Coupling(), np.array([d])).times[0, 0]
             for d in (0.002, 0.01)]  # fmt: skip
    extra = (np.array(at) - plain) * 5920 / 2
    assert extra == pytest.approx([0.5e-3, 0.11e-3], rel=0.03)
    scans = tuple(scan(d, seed=i, probe=dual) for i, d in enumerate((0.002, 0.0125)))
    setup = set_up_gauge(scans, (0.002, 0.0125), pulse, separation=0.003)
    gauge = ThicknessGauge(setup, 0.005, mode="single")
    for d in (0.003, 0.005):
        read = gauge.add([0.0], scan(d, seed=7, probe=dual))[0]
        assert read.thickness == pytest.approx(d, abs=3e-5)


def test_a_single_element_misses_a_pit_that_takes_its_echo_apart() -> None:
    face = build_face(PROBE.radius)
    inside = np.hypot(*face.T) < 0.0012
    walls = np.where(inside, 0.0095 - 0.002, 0.0095)
    gauge = ThicknessGauge(set_up(), 0.0095)
    read = gauge.add([0.0], scan(walls))[0]
    assert read.reason or abs(read.thickness - 0.0095) < 1e-4  # the wall beside it, or refused


# -- statistics ----------------------------------------------------------------------------------


def read_site(gauge: ThicknessGauge, wall, coupling: Coupling, seed: int):
    """Twelve A-scans at 20 Hz at one place, and the last of their readings."""
    rng = np.random.default_rng(seed)
    echoes = compute_echoes(PROBE, coupling, np.atleast_1d(wall))
    scans = np.stack([compute_ascan(PROBE, echoes, rng, place_seed=seed) for _ in range(8)])
    return gauge.add(0.05 * np.arange(8), scans)


def test_a_thousand_smooth_sites() -> None:
    """Accuracy, acceptance, u95 and cycle skips, over walls, velocities, films, tilts, paint."""
    rng = np.random.default_rng(11)
    errors, bounds, refused, skips, count = [], [], 0, 0, 1000
    setup = set_up()
    for i in range(count):
        wall = float(rng.uniform(0.0055, 0.012))
        coupling = Coupling(
            film=float(rng.uniform(5e-6, 30e-6)), share=float(rng.uniform(0.9, 1.0)),
            tilt=math.radians(abs(float(rng.normal(0.0, 0.3)))),
            paint=float(rng.choice([0.0, rng.uniform(0.0, 5e-4)])),
            curvature_radius=float(rng.uniform(0.15, 0.3)),
            velocity=5920.0 * (1.0 + 0.003 * float(rng.standard_normal())),
        )  # fmt: skip
        gauge = ThicknessGauge(setup, float(np.clip(wall, *STEPS)))
        last = read_site(gauge, wall, coupling, 1000 + i)[-1]
        if not last.accepted:
            refused += 1
            continue
        errors.append(last.thickness - wall)
        bounds.append(last.u95)
        skips += abs(errors[-1]) > 0.25e-3
    error = np.array(errors)
    assert refused < 0.1 * count
    assert skips == 0
    assert np.quantile(np.abs(error), 0.95) < 0.1e-3
    assert abs(np.mean(error)) < 0.05e-3
    covered = np.mean(np.abs(error) <= bounds)
    assert 0.93 <= covered <= 0.97, covered


def test_air_and_tilt_beyond_the_null_are_never_accepted() -> None:
    rng = np.random.default_rng(5)
    gauge = ThicknessGauge(set_up(), 0.0095)
    null = find_tilt_null(PROBE)
    for i in range(200):
        tilt = float(rng.uniform(null, math.radians(15.0)))
        for coupling in (Coupling(air=True, tilt=tilt / 20), Coupling(tilt=tilt, film=5e-6)):
            assert not any(r.accepted for r in read_site(gauge, 0.0095, coupling, i))
            gauge.leave_site()


def test_rough_and_thin_walls_are_refused_or_right() -> None:
    """The worst that may be there: rough backs, walls within the dead zone, pits."""
    rng = np.random.default_rng(8)
    setup, wrong, accepted = set_up(), 0, 0
    for i in range(300):
        wall = float(rng.uniform(0.0012, 0.011))
        coupling = Coupling(
            roughness_front=float(rng.uniform(0, 4e-5)), roughness_back=float(rng.uniform(0, 1e-4)),
            paint=float(rng.uniform(0, 5e-4)), film=float(rng.uniform(5e-6, 6e-5)),
        )  # fmt: skip
        last = read_site(ThicknessGauge(setup, 0.0095), wall, coupling, i)[-1]
        if last.accepted:
            accepted += 1
            wrong += abs(last.thickness - wall) > 0.25e-3
    assert accepted > 60
    assert wrong == 0


def test_a_face_over_an_edge_reads_one_of_its_walls_or_is_refused() -> None:
    """Steps from a tenth of a wavelength on, anywhere under the face, held for 4 s."""
    rng = np.random.default_rng(3)
    setup, face, accepted, wrong, refused = set_up(), build_face(PROBE.radius), 0, [], set()
    for i in range(150):
        wall, step = float(rng.uniform(0.007, 0.012)), float(10 ** rng.uniform(-4.0, -2.4))
        thin = face[:, 0] < PROBE.radius * float(rng.uniform(-1.0, 1.0))
        walls = np.where(thin, wall - step, wall)
        gauge = ThicknessGauge(setup, 0.0095)
        noise, echoes = np.random.default_rng(i), compute_echoes(PROBE, Coupling(film=1e-5), walls)
        scans = (compute_ascan(PROBE, echoes, noise, place_seed=i) for _ in range(80))
        for k, x in enumerate(scans):
            (read,) = gauge.add([0.05 * k], x)
            if read.accepted:
                accepted += 1
                wrong.append(float(np.min(np.abs(read.thickness - walls))))
                break
        else:
            refused.add(read.reason.partition(" (")[0].partition(",")[0])
    assert accepted > 50  # faces that lie nearly wholly on one wall
    assert max(wrong) < 0.1e-3
    assert {"the echoes differ in shape", "two walls under the face"} <= refused


def test_an_ascan_without_noise_shows_one_wall() -> None:
    probe = PROBE._replace(noise=0.0, grass=0.0)
    gauge = ThicknessGauge(set_up(), 0.0095)
    for i in range(40):
        last = gauge.add([0.0], scan(0.006 + 1e-4 * i, seed=i, probe=probe))[0]
        assert last.reason in ("", "not yet steady")
        gauge.restart()


# -- rules, set-up, files ------------------------------------------------------------------------


def test_rules_name_their_reason() -> None:
    setup = set_up()

    def last(x, nominal: float = 0.0095, mode="echo-to-echo") -> str:
        return ThicknessGauge(setup, nominal, mode=mode).add([0.0], x)[0].reason

    assert last(scan(0.0095, Coupling(air=True))).startswith("no echo")
    assert last(scan(0.0095, probe=PROBE._replace(gain=3.0))).startswith("saturated")
    assert last(scan(0.0095, probe=PROBE._replace(gain=0.3))).startswith("low signal")
    assert last(scan(0.0095)) == "not yet steady"
    assert "outside the range" in last(scan(0.0075), 0.0055)
    assert last(scan(0.0095, samples=450)) == "one echo only"


def test_steadiness_needs_time_and_agreement() -> None:
    gauge = ThicknessGauge(set_up(), 0.0095)
    x = scan(0.0095)
    reasons = [r.reason for r in gauge.add(0.05 * np.arange(8), np.tile(x, (8, 1)))]
    assert reasons[:5] == ["not yet steady"] * 5 and reasons[-1] == ""
    moved = gauge.add([0.4], scan(0.0093))[0]
    assert moved.reason.startswith("not steady")
    slow = ThicknessGauge(set_up(), 0.0095)  # five readings within 0.2 s are not enough
    assert not any(r.accepted for r in slow.add(0.04 * np.arange(5), np.tile(x, (5, 1))))


def test_a_block_of_samples_is_a_stream() -> None:
    """One call with all A-scans, or one for each: the same readings."""
    scans = np.stack([scan(0.0095, seed=i) for i in range(10)])
    t = 0.05 * np.arange(10)
    whole = ThicknessGauge(set_up(), 0.0095).add(t, scans)
    live = ThicknessGauge(set_up(), 0.0095)
    assert [live.add([a], x)[0] for a, x in zip(t, scans, strict=True)] == whole


def test_twice_the_neighbours() -> None:
    """A lamination at half the wall: elsewhere it would be a wall of its own."""
    gauge = ThicknessGauge(set_up(), 0.0055, rules=Rules(most_fraction=3.0))
    for i in range(3):
        read_site(gauge, 0.005, Coupling(), i)
        gauge.leave_site()
    assert read_site(gauge, 0.01, Coupling(), 9)[-1].reason.startswith("twice its neighbours")


def test_refused_readings_are_no_neighbours() -> None:
    """Sites read at twice the wall stay refused, however many of them follow each other."""
    gauge = ThicknessGauge(set_up(), 0.0055, rules=Rules(most_fraction=3.0))
    for i, wall in enumerate((0.005, 0.005, *[0.01] * 6)):
        last = read_site(gauge, wall, Coupling(), i)[-1]
        assert last.accepted == (wall == 0.005), (i, last)
        gauge.leave_site()
    unsteady = ThicknessGauge(set_up(), 0.0055, rules=Rules(most_fraction=3.0))
    for _ in range(3):  # two walls in turn, 5 and 6 mm: no reading is accepted
        scans = np.stack([scan(0.005 + 0.001 * (k % 2), seed=k) for k in range(8)])
        assert not any(r.accepted for r in unsteady.add(0.05 * np.arange(8), scans))
        unsteady.leave_site()
    assert read_site(unsteady, 0.011, Coupling(), 9)[-1].accepted


def test_two_steps_solve_velocity_and_zero() -> None:
    for velocity in (5850.0, 5920.0, 5990.0):
        fast = Coupling(velocity=velocity)
        scans = (scan(STEPS[0], fast), scan(STEPS[1], fast, 1))
        setup = set_up_gauge(scans, STEPS, PULSE)
        assert setup.velocity == pytest.approx(velocity, rel=5e-4)
        read = ThicknessGauge(setup, 0.009, mode="single").add([0.0], scan(0.009, fast, 4))[0]
        assert read.thickness == pytest.approx(0.009, abs=2e-5)
    held = check_gauge(set_up(), (scan(STEPS[0], seed=5), scan(STEPS[1], seed=6)))
    assert not held.reasons and max(map(abs, held.errors)) < 2e-5
    hot = Coupling(velocity=5920 * 0.985)
    drifted = check_gauge(set_up(), (scan(STEPS[0], hot), scan(STEPS[1], hot)))
    assert any("12.5 mm reads" in r for r in drifted.reasons)
    weak = PROBE._replace(gain=0.8)
    lost = check_gauge(set_up(), (scan(STEPS[0], probe=weak), scan(STEPS[1], probe=weak)))
    assert any("of what it was" in r for r in lost.reasons)


def test_wrong_set_ups_are_told() -> None:
    aluminium = Coupling(velocity=6320.0)
    with pytest.raises(InputError, match="use a block of the part's material"):
        set_up_gauge((scan(STEPS[0], aluminium), scan(STEPS[1], aluminium)), STEPS, PULSE)
    with pytest.raises(InputError, match="shows no echo above 20% of full screen"):
        set_up_gauge((scan(0.001), scan(STEPS[1], Coupling(air=True))), (0.001, 0.0125), PULSE)
    with pytest.raises(InputError, match="valid: above 0, growing"):
        set_up_gauge((scan(0.005), scan(0.005)), (0.01, 0.005), PULSE)
    with pytest.raises(InputError, match="valid: 5 to 12"):
        ThicknessGauge(set_up(), 0.02)
    thin = set_up()._replace(steps=(0.001, 0.0125))
    with pytest.raises(InputError, match="lies in the dead zone of 1"):
        ThicknessGauge(thin, 0.0012)
    with pytest.raises(InputError, match="more than the 91 before the gate"):
        find_echoes(np.zeros(20), PULSE, 0.1)
    with pytest.raises(InputError, match="finite ones"):
        find_echoes(np.full(500, np.nan), PULSE, 0.1)
    with pytest.raises(InputError, match="valid: above 0"):
        compute_echoes(PROBE, Coupling(), np.array([0.0]))


def test_delay_to_a_fraction_of_a_sample() -> None:
    quiet = Transducer(noise=0.0, grass=0.0)
    for d in (0.00712345, 0.0099):
        x = scan(d, probe=quiet)
        found = find_echoes(x, PULSE, 0.1)
        delay = measure_delay(x, PULSE, found.times[0], found.times[1])
        assert delay * 5920 / 2 == pytest.approx(d, abs=1e-6)
