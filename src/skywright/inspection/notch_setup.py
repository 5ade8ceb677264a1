"""Set up an eddy-current inspection on a notch block, and check later that the set-up is valid.

The procedure follows weld inspection (EN 1711, ISO 17643; cited from memory): null on sound metal,
rotate the lift-off to the horizontal, and set the gain such that the 1 mm notch reaches 80 % of
full screen height, upwards. The check after the inspection measures the same quantities. Readings
between two checks are valid only if both checks pass.
"""

import cmath
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.inspection.calibration import robust_std, to_complex
from skywright.models.block_scan import BlockScan
from skywright.models.crack_signal import Metal

TARGET = 80.0
"""% of full screen height that the reference notch reaches."""
LIFT_ANGLE = 5.0
"""deg, largest angle of the lift-off from the horizontal (one firm's procedure)."""
PHASE_CHANGE = 5.0
"""deg, largest rotation of the notch signal between two checks (the same firm's procedure)."""
GAIN_CHANGE = 10.0
"""% of TARGET, largest change of the notch signal between two checks (own rule)."""
LEAST_SNR = 10.0
"""Least ratio of notch signal to noise for a set-up."""
LEAST_ANGLE = 20.0
"""deg, least angle between lift-off and notch; below it, no rotation separates them."""
SAME_MATERIAL = 0.02
"""Largest relative difference in conductivity and permeability between block and part."""


class NotchSetup(NamedTuple):
    """Null, rotation and gain of a display; `show` converts a signal to % of full screen height."""

    null: complex  # display units, on sound metal
    factor: complex  # % FSH per unit, rotation included
    noise: float  # % FSH, standard deviation across the lift-off, at rest
    notch_depth: float  # m, of the reference notch
    notch_angle: float  # deg, of the notch on the display from the right, 0 to 180
    lift_off: float  # % FSH along the horizontal, at the end of the lift

    def show(self, z: NDArray[Any]) -> NDArray[np.complex128]:
        """Return a signal (n,) or (n, k) in % FSH: lift-off horizontal, notches upwards."""
        return np.asarray((np.asarray(z, np.complex128) - self.null) * self.factor)


class SetupCheck(NamedTuple):
    """Result of a second visit to the block; `reasons` is empty if the set-up is still valid."""

    height: float  # % FSH of the reference notch
    phase_change: float  # deg, of the notch
    lift_angle: float  # deg, of the lift-off from the horizontal
    reasons: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """Whether no quantity drifted beyond its limit."""
        return not self.reasons


def check_block(block: Metal, part: Metal) -> None:
    """Raise InputError if block and part are of different material."""
    names = ("conductivity_s_per_m", "relative_permeability")
    for name, a, b in zip(names, block, part, strict=True):
        if abs(a - b) > SAME_MATERIAL * abs(b):
            raise InputError(
                f"reference block: {name} {a:g} is not that of the part, {b:g}; valid: within "
                f"{SAME_MATERIAL:.0%}; use a block of the part's material"
            )


def set_up(scan: BlockScan) -> NotchSetup:
    """Null, rotate and scale the display from a visit to the block.

    Raises InputError if the notch signal is below LEAST_SNR times the noise, or if it is within
    LEAST_ANGLE of the line of the lift-off.
    """
    sound = _check(scan.sound, "sound metal")
    null = complex(np.median(sound.real), np.median(sound.imag))
    lift = _find_direction(_check(scan.lift, "lift-off") - null)
    notch = _find_peak(_check(scan.notch, "notch") - null)
    noise = math.hypot(robust_std(sound.real), robust_std(sound.imag)) / math.sqrt(2.0)
    if abs(notch) < LEAST_SNR * noise or not abs(notch) > 0:
        raise InputError(
            f"set-up: the notch of {1e3 * scan.notch_depth:g} mm reads {abs(notch):.3g} units over "
            f"{noise:.3g} of noise; valid: {LEAST_SNR:g} times; slide over the notch, raise the "
            "gain or lower the noise"
        )
    angle = math.degrees(cmath.phase(notch / lift))
    if not LEAST_ANGLE < abs(angle) < 180.0 - LEAST_ANGLE:
        raise InputError(
            f"set-up: the notch lies {abs(angle):.0f} deg from the lift-off; valid: "
            f"{LEAST_ANGLE:g} to {180 - LEAST_ANGLE:g}; choose another frequency"
        )
    # the notch points upwards: if it would point down, the display is turned by 180 deg and the
    # lift-off points left
    turn = lift.conjugate() / abs(lift) * (1.0 if angle > 0 else -1.0)
    factor = turn * TARGET / (notch * turn).imag
    end = complex(np.median((scan.lift[-5:] - null).real), np.median((scan.lift[-5:] - null).imag))
    across = robust_std(((sound - null) * factor).imag)
    shown = math.degrees(cmath.phase(notch * factor))
    return NotchSetup(null, factor, across, scan.notch_depth, shown, abs((end * factor).real))


def check_setup(setup: NotchSetup, scan: BlockScan) -> SetupCheck:
    """Compare a later visit to the block with the set-up.

    The probe is nulled again, as inspectors do, because a shift of the null is not a drift of the
    sensitivity. Raises InputError if the visit is to another notch, or if a part of it has fewer
    than 5 samples or samples that are not finite.
    """
    if abs(scan.notch_depth - setup.notch_depth) > 1e-9:
        raise InputError(
            f"check: the notch has {1e3 * scan.notch_depth:g} mm, that of the set-up "
            f"{1e3 * setup.notch_depth:g} mm; valid: the same notch"
        )
    sound = _check(scan.sound, "sound metal")
    null = complex(np.median(sound.real), np.median(sound.imag))
    notch = _find_peak(_check(scan.notch, "notch") - null) * setup.factor
    lift = _find_direction(_check(scan.lift, "lift-off") - null) * setup.factor
    lift_angle = math.degrees(math.atan(lift.imag / lift.real)) if lift.real else 90.0
    now = math.degrees(cmath.phase(notch))
    change = abs(math.remainder(now - setup.notch_angle, 360.0))
    height = notch.imag
    reasons = []
    if abs(height - TARGET) > GAIN_CHANGE / 100.0 * TARGET:
        reasons.append(
            f"the reference notch reads {height:.1f} % FSH; valid: {TARGET:g} within "
            f"{GAIN_CHANGE:g} % of it"
        )
    if change > PHASE_CHANGE:
        reasons.append(f"the notch turned by {change:.1f} deg; valid: {PHASE_CHANGE:g}")
    if abs(lift_angle) > LIFT_ANGLE:
        reasons.append(f"the lift-off lies {lift_angle:.1f} deg off the horizontal; valid: "
                       f"{LIFT_ANGLE:g}")  # fmt: skip
    return SetupCheck(height, change, lift_angle, tuple(reasons))


def estimate_coating(setup: NotchSetup, z: NDArray[Any], shims: Array, lifted: Array) -> Array:
    """Return the thickness (n,) m of the coating under the probe from its lift-off.

    `shims` (k,) m and the signals `lifted` (k,) on them calibrate |signal - null|, which grows with
    the distance and is 0 on bare metal. Signals beyond the thickest shim give NaN. An error of 2 %
    in the permeability changes the result by 4 to 6 um. Raises InputError if there are fewer than
    two shims, or if shims or signals do not increase.
    """
    size = np.abs(np.asarray(lifted, np.complex128) - setup.null)
    if len(shims) < 2 or np.any(np.diff(shims) <= 0) or np.any(np.diff(size) <= 0):
        raise InputError(
            f"coating: shims of {np.round(1e3 * np.asarray(shims), 3).tolist()} mm with signals of "
            f"{np.round(size, 2).tolist()} units; valid: two or more, both growing"
        )
    # from the null, because a coating may be thinner than the thinnest shim
    read = np.abs(np.asarray(z) - setup.null)
    return np.interp(read, [0.0, *size], [0.0, *shims], right=np.nan)


def _find_direction(lift: NDArray[np.complex128]) -> complex:
    """Return the direction of the lift-off near contact, as a complex number of any length.

    It is computed from the samples of the first half below half of the largest signal, because the
    lift-off bends after that, or from all samples if these are fewer than 3.
    """
    size = np.abs(lift)
    near = lift[(size < 0.5 * np.max(size)) & (np.arange(lift.size) < lift.size // 2)]
    near = near if near.size >= 3 else lift
    return complex(np.sum(near * np.abs(near)))


def _find_peak(notch: NDArray[np.complex128]) -> complex:
    """Return the peak signal of the notch, the mean of the five largest samples."""
    order = np.argsort(np.abs(notch))[-5:]
    return complex(np.mean(notch[order]))


def _check(z: NDArray[Any], what: str) -> NDArray[np.complex128]:
    w = to_complex(z)
    if w.size < 5 or not np.all(np.isfinite(w)):
        raise InputError(f"set-up: {w.size} samples of the {what}; valid: 5 or more finite ones")
    return w
