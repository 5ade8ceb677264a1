"""The set-up of an eddy-current inspection on a notch block, and its check."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.errors import InputError
from skywright.inspection.notch_setup import (
    GAIN_CHANGE,
    TARGET,
    check_block,
    check_setup,
    estimate_coating,
    set_up,
)
from skywright.models.block_scan import BlockScan, compute_true_gain, simulate_block_scan
from skywright.models.crack_signal import (
    Metal,
    compute_display_gain,
    compute_long_crack,
)
from skywright.models.eddy_current import (
    Coil,
    Instrument,
    compute_coil_height,
    compute_impedance_change,
)

STEEL = Metal(5e6, 100.0)
COIL, INSTRUMENT = Coil(), Instrument()


def visit(seed: int = 1, **changes) -> BlockScan:
    return simulate_block_scan(STEEL, COIL, INSTRUMENT, np.random.default_rng(seed), **changes)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(-180, 180), st.floats(-30, 30))
def test_notch_up_lift_off_level_whatever_the_instrument(seed, phase, db) -> None:
    scan = visit(seed, gain=compute_true_gain(db, phase, 0, 0, 0))
    setup = set_up(scan)
    shown = setup.show(scan.notch)
    assert np.max(shown.imag) == pytest.approx(TARGET, rel=0.04)
    assert np.median(np.abs(setup.show(scan.sound))) < 2.0
    early = setup.show(scan.lift)[3:50]
    assert abs(math.degrees(math.atan(np.polyfit(early.real, early.imag, 1)[0]))) < 5.0
    assert check_setup(setup, scan).holds


def test_heights_of_other_notches_follow_the_physics() -> None:
    setup = set_up(visit())
    gain = compute_display_gain(COIL, STEEL, INSTRUMENT)
    depths = np.array([0.5e-3, 1e-3, 2e-3])
    signal = np.abs(gain * compute_long_crack(COIL, STEEL, INSTRUMENT.frequency, depths))
    for depth, size in zip(depths, signal, strict=True):
        read = np.max(np.abs(setup.show(visit(3, notch_depth=float(depth)).notch)))
        assert read == pytest.approx(abs(setup.factor) * size, rel=0.05)


@pytest.mark.parametrize(
    ("db", "deg", "reason"),
    [(2.0, 0.0, "% FSH"), (-2.0, 0.0, "% FSH"), (0.0, 8.0, "turned by"), (0.0, 8.0, "lift-off")],
)
def test_a_drift_fails_the_check(db: float, deg: float, reason: str) -> None:
    """An instrument that drifts by `db` and `deg` an hour, checked after an hour."""
    setup = set_up(visit())
    later = check_setup(setup, visit(2, gain=compute_true_gain(0, 0, db, deg, 3600.0)))
    assert not later.holds and any(reason in r for r in later.reasons)
    soon = check_setup(setup, visit(2, gain=compute_true_gain(0, 0, db, deg, 360.0)))
    assert soon.holds  # a tenth of it is within the limits


def draw_visit(notch_deg: float, lift_deg: float = 0.0) -> BlockScan:
    """Return a visit without noise; `notch_deg` and `lift_deg` are the directions (deg)."""
    notch, lift = np.exp(1j * np.radians([notch_deg, lift_deg]))
    return BlockScan(
        np.zeros(50, complex), 5.0 * lift * np.linspace(0.0, 1.0, 50), np.full(50, notch), 1e-3
    )


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("angle", [30.0, 70.0, 110.0])
def test_a_notch_mirrored_about_the_vertical_has_turned(angle: float, side: float) -> None:
    """Lift-off and height stay; `side` -1: the display is rotated with the lift-off to the left."""
    setup = set_up(draw_visit(side * angle))
    assert check_setup(setup, draw_visit(side * angle)).reasons == ()
    later = check_setup(setup, draw_visit(side * (180.0 - angle)))
    assert later.height == pytest.approx(TARGET) and later.lift_angle == pytest.approx(0.0)
    assert later.phase_change == pytest.approx(abs(180.0 - 2.0 * angle))
    assert [f"turned by {abs(180 - 2 * angle):.1f} deg" in x for x in later.reasons] == [True]
    over = check_setup(setup, draw_visit(side * angle + 180.0, 180.0))
    assert over.phase_change == pytest.approx(180.0)


@settings(max_examples=40, deadline=None)
@given(st.floats(-3, 3), st.floats(-20, 20))
def test_the_check_tells_the_drift(db: float, deg: float) -> None:
    setup = set_up(visit())
    later = check_setup(setup, visit(2, gain=compute_true_gain(0, 0, db, deg, 3600.0)))
    assert later.phase_change == pytest.approx(abs(deg), abs=1.5)
    if abs(deg) < 0.5 and abs(abs(10 ** (db / 20) - 1.0) - GAIN_CHANGE / 100) > 0.03:
        assert later.holds == (abs(10 ** (db / 20) - 1.0) < GAIN_CHANGE / 100)


def test_what_cannot_be_set_up_is_told() -> None:
    with pytest.raises(InputError, match="relative_permeability 60 is not that of the part, 100"):
        check_block(Metal(5e6, 60.0), STEEL)
    check_block(STEEL, STEEL)
    scan = visit()
    with pytest.raises(InputError, match="notch of 1 mm reads"):
        set_up(scan._replace(notch=scan.sound))
    with pytest.raises(InputError, match="deg from the lift-off"):
        set_up(scan._replace(notch=scan.lift))
    with pytest.raises(InputError, match="0 samples of the sound metal"):
        set_up(scan._replace(sound=np.zeros(0, complex)))
    with pytest.raises(InputError, match="5 or more finite ones"):
        set_up(scan._replace(lift=np.full(50, np.nan + 0j)))
    with pytest.raises(InputError, match="valid: the same notch"):
        check_setup(set_up(scan), visit(notch_depth=2e-3))


def test_coating_from_lift_off() -> None:
    """Shims calibrate; paint between them is read to 10 um, 2 % of permeability costs 4 to 6."""
    setup = set_up(visit())
    gain = compute_display_gain(COIL, STEEL, INSTRUMENT)

    def read(gap, mu: float = 100.0):
        height = compute_coil_height(COIL, np.atleast_1d(gap), 0.0)
        z = compute_impedance_change(COIL, height, INSTRUMENT.frequency, 5e6, mu)
        return gain * z

    shims = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0]) * 1e-3
    paint = np.array([0.05, 0.25, 0.4, 0.6, 0.9]) * 1e-3
    found = estimate_coating(setup, read(paint), shims, read(shims))
    assert np.max(np.abs(found - paint)) < 1.5e-5
    off = estimate_coating(setup, read(paint, 102.0), shims, read(shims)) - found
    assert 2e-6 < np.max(np.abs(off)) < 9e-6
    assert np.isnan(estimate_coating(setup, read([2e-3]), shims, read(shims))[0])
    with pytest.raises(InputError, match="both growing"):
        estimate_coating(setup, read(paint), shims[::-1], read(shims))


def test_a_coating_thinner_than_the_thinnest_shim_is_read() -> None:
    """Signals of 20 units per mm; the display was nulled on bare metal."""
    setup = set_up(draw_visit(70.0))
    shims = np.array([0.1, 0.2]) * 1e-3
    found = estimate_coating(setup, 2e4 * np.array([0.0, 2e-5, 5e-5, 1.5e-4]), shims, 2e4 * shims)
    assert found == pytest.approx([0.0, 2e-5, 5e-5, 1.5e-4], abs=1e-12)
    with pytest.raises(InputError, match="both growing"):
        estimate_coating(setup, np.zeros(1), np.array([0.0, 1e-4]), np.zeros(2))


def test_the_script_of_the_page_prints_what_the_page_states(
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = Path(__file__).parent.parent / "docs/sensors/eddy-array.md"
    (code,) = re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)
    exec(code, {})
    assert f"# {capsys.readouterr().out}" in code
