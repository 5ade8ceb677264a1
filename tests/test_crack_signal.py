"""Cracks under an eddy-current coil: reciprocity against direct integration and the instrument."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from numba import njit

from plant_parts import build_context, build_plant, take_samples
from skywright.description.world.spec import Pipe
from skywright.errors import InputError
from skywright.models.cap_gap import STEP, compute_cap_gap
from skywright.models.crack_signal import (
    CELL,
    GAPS,
    Metal,
    build_crack_table,
    compute_depth_factor,
    compute_display_gain,
    compute_long_crack,
    compute_skin_depth,
    compute_surface_field,
    compute_surface_impedance,
)
from skywright.models.eddy_current import (
    Coil,
    Instrument,
    compute_coil_height,
    compute_impedance_change,
)
from skywright.models.things.wall import Patch, Pit, Wall, build_wall_field, compute_wall
from skywright.vehicle.sensors.eddy_array import EddyArray, read_coil

COIL, INSTRUMENT, STEEL = Coil(), Instrument(), Metal(5e6, 100.0)
F = INSTRUMENT.frequency


def test_skin_depth_of_steel() -> None:
    # 503 sqrt(rho / (mu_r f)) m, the handbook's formula
    assert compute_skin_depth(STEEL, F) == pytest.approx(503.3 * math.sqrt(2e-7 / (100 * F)), 1e-3)


@pytest.mark.parametrize(("metal", "rel"), [(STEEL, 0.01), (Metal(3.5e7, 1.0), 0.06)])
def test_surface_field_gives_what_dodd_and_deeds_give(metal: Metal, rel: float) -> None:
    """Reciprocity: d(dZ) / d ln(sigma) = int dZs / d ln(sigma) H^2 dS, where delta << coil."""
    height = compute_coil_height(COIL, np.zeros(1), 0.0)
    step = 1e-3
    up, down = (
        compute_impedance_change(COIL, height, F, metal.conductivity * math.exp(x), metal[1])[0]
        for x in (step, -step)
    )
    r = np.linspace(0.0, 0.05, 20001)[1:]
    field = compute_surface_field(COIL, float(height[0]), metal, F, r)
    # Zs ~ sigma^(-1/2)
    change = -0.5 * compute_surface_impedance(metal, F)
    total = change * np.sum(field**2 * 2 * math.pi * r) * (r[1] - r[0])
    assert abs(total - (up - down) / (2 * step)) < rel * abs(total)


def test_a_shallow_crack_is_the_integral_of_the_field_squared() -> None:
    depth = 2e-6  # far below the coil's radius; the skin's factor is taken out
    y = np.linspace(-0.04, 0.04, 8001)
    height = float(compute_coil_height(COIL, np.zeros(1), 0.0)[0])
    field = compute_surface_field(COIL, height, STEEL, F, np.abs(y)) * np.sign(y)
    expected = 2 * compute_surface_impedance(STEEL, F) * depth * np.sum(field**2) * (y[1] - y[0])
    found = compute_long_crack(COIL, STEEL, F, [depth])[0]
    found /= compute_depth_factor(np.array([depth]), compute_skin_depth(STEEL, F))[0]
    assert abs(found - expected) < 2e-3 * abs(expected)


def test_depth_width_and_lift_off_of_a_long_notch() -> None:
    gain = compute_display_gain(COIL, STEEL, INSTRUMENT)
    depths = np.array([0.2, 0.5, 1.0, 2.0]) * 1e-3
    signal = gain * compute_long_crack(COIL, STEEL, F, depths)
    # without the skin's factor: 2.26, 5.5, 10.3 and 17.2 units
    plain = np.abs(signal / compute_depth_factor(depths, compute_skin_depth(STEEL, F)))
    assert plain == pytest.approx([2.26, 5.5, 10.3, 17.2], rel=0.02)
    assert np.all(np.diff(np.abs(signal)) > 0)
    for gap, db in ((1e-4, -1.1), (5e-4, -5.4), (1e-3, -10.3)):
        lifted = gain * compute_long_crack(COIL, STEEL, F, [1e-3], 0.0, gap)[0]
        assert 20 * math.log10(abs(lifted / signal[2])) == pytest.approx(db, abs=0.1)
    x = np.linspace(0.0, 3e-3, 61)
    across = [abs(compute_long_crack(COIL, STEEL, F, [1e-3], float(a))[0]) for a in x]
    assert 2e3 * np.interp(-0.5 * across[0], -np.array(across), x) == pytest.approx(3.44, rel=0.02)


def test_phase_does_not_part_cracks_from_permeability() -> None:
    """All act through the surface impedance: crack and mu lie within 20 deg, a weld opposite."""
    gain = compute_display_gain(COIL, STEEL, INSTRUMENT)
    height = compute_coil_height(COIL, np.zeros(1), 0.0)
    base, more, weld = (
        gain * compute_impedance_change(COIL, height, F, 5e6, mu)[0] for mu in (100.0, 102.0, 65.0)
    )
    crack = gain * compute_long_crack(COIL, STEEL, F, [2e-3])[0]
    assert abs(np.degrees(np.angle(crack / (more - base)))) < 20.0
    assert abs(np.degrees(np.angle(crack / (weld - base)))) > 150.0


def test_table_of_a_long_rectangle_is_the_long_notch() -> None:
    table = build_crack_table(0.06, 1e-3, STEEL, COIL, INSTRUMENT, "rectangle").signal
    gain = compute_display_gain(COIL, STEEL, INSTRUMENT)
    for g in (0, 4):
        for i in (0, 6):
            long = gain * compute_long_crack(COIL, STEEL, F, [1e-3], i * CELL, float(GAPS[g]))[0]
            assert abs(table[g, i, 0] - long) < 0.06 * abs(table[g, 0, 0])
    assert not table[-1].any()
    assert abs(table[0, 0, -1]) < 0.01 * abs(table[0, 0, 0])  # beyond its end: nothing


def test_a_short_crack_reads_less_than_a_long_one() -> None:
    tables = [
        abs(build_crack_table(length, 1e-3, STEEL, COIL, INSTRUMENT).signal[0, 0, 0])
        for length in (0.002, 0.006, 0.03)
    ]
    assert tables[0] < 0.5 * tables[1] < 0.5 * tables[2]
    with pytest.raises(InputError, match="length 0 m"):
        build_crack_table(0.0, 1e-3, STEEL, COIL, INSTRUMENT)
    with pytest.raises(InputError, match="valid: above 0"):
        compute_long_crack(COIL, STEEL, F, [math.nan])


def test_a_nose_over_a_cap() -> None:
    gap = compute_cap_gap(1e-3, 5e-3, 8e-3)
    assert gap[0] == pytest.approx(0.0, abs=1e-9)  # on the top, whose curvature is smaller
    assert gap[-1] == 0.0 and np.max(gap) > 2e-4
    toe = np.argmax(gap) * STEP
    assert 4e-3 < toe < 8e-3
    # beside the toe the sphere rests on the cap at a tangent: a rounder nose leaves more air
    assert np.max(compute_cap_gap(1e-3, 5e-3, 16e-3)) > np.max(gap)
    assert not np.any(compute_cap_gap(0.0, 5e-3, 8e-3))


def test_a_wall_is_a_field() -> None:
    wall = Wall(
        thickness_m=0.01, paint_m=2e-4,
        patches={"thin": Patch(u_m=0.1, size_u_m=0.02, thickness_m=0.006)},
        pits={"a": Pit(v_m=0.05, diameter_m=0.01, depth_m=0.004)}, random_pits=5, pit_seed=3,
    )  # fmt: skip
    field = build_wall_field(wall)
    assert np.array_equal(field.pits, build_wall_field(wall).pits)  # by its seed
    bare = field._replace(pits=field.pits[:1])
    thickness, paint = compute_wall(bare, np.array([0.0, 0.1, 0.0, 0.0]), [0.0, 0.0, 0.05, 0.0525])
    assert thickness == pytest.approx([0.01, 0.006, 0.006, 0.007])
    assert paint == pytest.approx([2e-4] * 4)


FLAW = ["world.weld.present=false", "world.things.flaw.kind=crack",
        "world.things.flaw.s_m=0.003", "world.things.flaw.angle_deg=90"]  # fmt: skip


def build_array(sets: list[str] | None = None, **table):
    context = build_context(sets=[*FLAW, *(sets or [])])
    plant = build_plant(context, EddyArray("eddy", EddyArray.Table(noise=0.0, **table)))
    me = plant.assembly.get(EddyArray.Me, "eddy")
    me["numbers"][3] = 0.0  # no texture
    return plant, me


@njit
def read(me, s, c):
    """One coil in contact, compiled as in flight."""
    re, im = read_coil(me, s, c, 0.0, 0.0)
    return complex(re, im)


def test_a_coil_adds_crack_paint_and_metal() -> None:
    _, me = build_array(["world.things.steel.kind=wall", "world.things.steel.paint_m=0.0003"])
    signal = build_crack_table(0.006, 1e-3, Metal(5e6, 100.0), COIL, INSTRUMENT).signal
    beside = read(me, 0.05, 0.0)
    over = read(me, 0.003, 0.0)
    assert over - beside == pytest.approx(signal[3, 0, 0], abs=1e-9)  # under 0.3 mm of paint
    # the mouth runs along s: 2 mm along it, then 1.5 mm across it, both sides alike
    for sign in (1.0, -1.0):
        along = read(me, 0.003 + sign * 0.002, 0.0) - beside
        across = read(me, 0.003, sign * 0.0015) - beside
        assert along == pytest.approx(signal[3, 0, 8], abs=1e-9)
        assert across == pytest.approx(signal[3, 6, 0], abs=1e-9)
    # the same place after a turn around the pipe
    turn = math.pi * Pipe().diameter_m
    again = read(me, 0.003, turn)
    assert again == pytest.approx(over, abs=1e-9)


def touch(sets: list[str], **table):
    """A plant whose tip touches the pipe level, and one sample of it."""
    context = build_context(sets=sets)
    probe = build_plant(context, EddyArray("eddy", EddyArray.Table(noise=0.0, **table)))
    data = context.sim.data
    data.qpos[context.scene.places.joint_qpos] = [-0.7, 0.7]
    mujoco.mj_forward(context.scene.model, data)
    probe.run(1)
    return take_samples(probe), probe, data.site_xpos[context.scene.places.tip_site].copy()


def test_coils_of_an_array_lie_along_its_axis() -> None:
    """A crack below the fifth of nine coils 5 mm apart shows in that one, and turned with it."""
    sets = ["world.weld.present=false", "world.pipe.x_m=4", "world.pipe.z_m=0.3"]
    _, _, tip = touch(sets)
    at = [
        f"world.pipe.x_m={tip[0] + 0.2 + 1e-5:.6f}",
        f"world.pipe.z_m={tip[2]:.6f}",
        f"world.pipe.y_m={tip[1]:.6f}",
        "world.weld.present=false",
        "world.pipe.supports=false",
        "world.things.flaw.kind=crack",
    ]
    plain, _, _ = touch(at[:-1], coils=9, axis_deg=90.0)
    clean = plain["eddy_array"][-1][:18]
    for around, s, axis in ((0.0, 0.01, 90.0), (math.degrees(0.01 / 0.2), 0.0, 0.0)):
        where = [f"world.things.flaw.s_m={s}", f"world.things.flaw.around_deg={around}",
                 f"world.things.flaw.angle_deg={90.0 - axis}"]  # fmt: skip
        found, _, _ = touch([*at, *where], coils=9, axis_deg=axis)
        reads = found["eddy_array"][-1][:18]
        seen = np.hypot(*(reads - clean).reshape(9, 2).T)
        assert int(np.argmax(seen)) in (2, 6)  # 10 mm from the middle, on one side of it
        assert np.sort(seen)[-2] < 0.3 * np.max(seen)


def test_wrong_arrays_are_told() -> None:
    with pytest.raises(InputError, match="low_pass_hz 1 must be above high_pass_hz 2"):
        build_array(low_pass_hz=1.0, high_pass_hz=2.0)
    with pytest.raises(InputError, match="the world has no pipe"):
        build_plant(build_context("wall-contact"), EddyArray("eddy"))
