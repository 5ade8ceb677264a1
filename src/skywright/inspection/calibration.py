"""Calibrate an eddy-current instrument from one approach, air to contact, away from the weld.

Tognon 2018 extracts two magnitudes from the complex signal w by principal component analysis and
a change of basis: w_l along the lift-off direction and w_w along the weld direction. The probe is
in contact if w_l < 15 and on a weld if w_w > 1.4 (instrument units, from a preliminary
calibration).

The lift-off trajectory is not straight. In the impedance plane it bends by several per cent of
its length, which is as much as a weld's signal. The axis e_l is therefore the first principal
component and the bend a cubic p(l) about it, both computed from the approach:

    (w - w_contact) conj(e_l) = l + j p(l) + m e_w

with l the lift-off and m the weld component. e_w is the weld's direction in that frame.
"""

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.core.bounded import LARGEST_TOML, parse_json, parse_toml, read_text
from skywright.errors import InputError, neighbours
from skywright.inspection.spikes import find_spikes

ComplexArray = NDArray[np.complex128]

LIFT_OFF_FRACTION = 0.25
"""Lift-off threshold as a share of the excursion contact -> air (the paper's 15 of about 60)."""
WELD_FRACTION = 0.02
"""Least weld threshold as a share of the excursion; a probe at rest senses little texture."""
WELD_SIGMAS = 5.0
GAP_LIMIT = 1e-3
"""m; the paper's largest air gap. It limits the derived lift-off threshold if gaps are known."""
MIN_SAMPLES = 20


class Calibration(NamedTuple):
    """Parameters that convert a complex signal to lift-off and weld components.

    Units are instrument units.
    """

    contact: complex  # signal in contact, on base metal
    lift_off_axis: complex  # unit, contact -> air
    excursion: float  # contact -> air along the axis
    curve: tuple[float, float, float]  # p(l) = c1 l + c2 l^2 + c3 l^3, the bend of the lift-off
    noise: float  # robust standard deviation across the lift-off curve, in contact
    lift_off_threshold: float
    weld_threshold: float
    weld_axis: complex | None = None  # unit, on the display; None: unknown, perpendicular is used


def to_complex(ec: NDArray[Any]) -> ComplexArray:
    """Return a (n, 2) real or (n,) complex signal as (n,) complex."""
    ec = np.asarray(ec)
    if ec.ndim == 2 and ec.shape[1] == 2:
        return np.asarray(ec[:, 0] + 1j * ec[:, 1], dtype=np.complex128)
    return np.asarray(ec, dtype=np.complex128).ravel()


def robust_std(x: Array) -> float:
    """Return the standard deviation from the median absolute deviation (0 for no samples)."""
    if x.size == 0:
        return 0.0
    return float(1.4826 * np.median(np.abs(x - np.median(x))))


def _curve_at(curve: tuple[float, float, float], lift_off: Array, excursion: float) -> Array:
    x = np.clip(lift_off, -0.1 * excursion, excursion)
    return np.asarray(x * (curve[0] + x * (curve[1] + x * curve[2])))


def _fit_curve(along: Array, across: Array, excursion: float) -> tuple[float, float, float]:
    """Return the coefficients (c1, c2, c3) of a cubic through the origin.

    The cubic is fitted to medians in bins, because a long dwell would otherwise dominate.
    """
    edges = np.linspace(-0.05, 1.02, 41) * excursion
    index = np.digitize(along, edges)
    bins = [index == i for i in range(1, edges.size) if np.any(index == i)]
    x = np.array([np.median(along[b]) for b in bins])
    y = np.array([np.median(across[b]) for b in bins])
    if np.count_nonzero((x > 0.05 * excursion) & (x < 0.8 * excursion)) < 4:
        return (0.0, 0.0, 0.0)  # the approach is too fast to show a curve: straight axis
    # the fit must be best near contact, because the threshold is there
    weight = 1.0 / (0.2 + np.abs(x) / excursion)
    a = np.stack([x, x**2 / excursion, x**3 / excursion**2], axis=1)
    c, *_ = np.linalg.lstsq(a * weight[:, None], y * weight, rcond=None)
    return (float(c[0]), float(c[1] / excursion), float(c[2] / excursion**2))


def build_calibration(
    ec: NDArray[Any],
    *,
    gap: Array | None = None,
    lift_off_threshold: float | None = None,
    weld_threshold: float | None = None,
    weld_axis: complex | None = None,
) -> Calibration:
    """Calibrate from an approach that starts in air and reaches contact, away from the weld.

    Parameters: `ec` (n, 2) or complex (n,), instrument units, in time order; `gap` (n,) m, or None
    if the surface is not known; thresholds in instrument units. A threshold of None is derived.
    Lift-off: 25 % of the excursion, at most the lift-off at a gap of 1 mm, and at least 5 robust
    standard deviations in contact. Weld: the larger of 5 robust standard deviations in contact and
    2 % of the excursion.
    Raises InputError if the samples show no approach.
    """
    w = to_complex(ec)
    ok = np.isfinite(w)
    if gap is not None:
        gap = np.asarray(gap, float)[ok]
    w = w[ok]
    sound = ~find_spikes(w)
    w, gap = w[sound], gap if gap is None else gap[sound]
    if w.size < MIN_SAMPLES:
        raise InputError(
            f"calibration: {w.size} valid samples; an approach from air to contact "
            f"requires at least {MIN_SAMPLES}"
        )
    scale = float(np.max(np.abs(w - w.mean())))
    if not (0 < scale < 1e100):
        raise InputError("calibration: the signal does not change; record an approach from air")
    plane = np.stack([w.real, w.imag], axis=1) / scale
    _, _, vt = np.linalg.svd(plane - plane.mean(axis=0), full_matrices=False)
    axis = complex(vt[0, 0], vt[0, 1])
    air = np.median(plane[: max(3, w.size // 20)], axis=0) * scale
    along = ((w - complex(air[0], air[1])) * np.conj(axis)).real
    if abs(along.min()) > along.max():
        axis, along = -axis, -along
    # `along` now increases from air to contact; contact is the cluster at its upper end
    far = float(np.quantile(along, 0.995))
    in_contact = along > 0.85 * far
    start = np.median(along[: max(3, w.size // 20)])
    if far <= 0 or abs(start) > 0.3 * far or in_contact.sum() < 5:
        raise InputError(
            "calibration: the samples do not go from air to contact (5 samples in contact at "
            "least); choose a time span that starts in air and ends in contact away from the weld"
        )
    contact = complex(np.median(w[in_contact].real), np.median(w[in_contact].imag))
    axis = -axis
    local = (w - contact) * np.conj(axis)
    excursion = float(np.quantile(local.real, 0.995))
    if not excursion > 0:
        raise InputError("calibration: the signal shows no excursion from contact to air")
    curve = _fit_curve(local.real, local.imag, excursion)
    across = local.imag - _curve_at(curve, local.real, excursion)
    noise = robust_std(across[in_contact])
    if noise > 0.1 * excursion:
        raise InputError(
            f"calibration: noise {noise:.3g} against an excursion of {excursion:.3g} units: no "
            "approach is visible; choose a time span from air to contact away from the weld"
        )
    if lift_off_threshold is None:
        lift_off_threshold = LIFT_OFF_FRACTION * excursion
        if gap is not None:
            near = (gap > 0) & (gap < 3 * GAP_LIMIT)
            if gap[near].size >= 3 and gap[near].max() > GAP_LIMIT:
                order = np.argsort(gap[near])
                limit = float(np.interp(GAP_LIMIT, gap[near][order], local.real[near][order]))
                if limit > 0:
                    lift_off_threshold = min(lift_off_threshold, limit)
        lift_off_threshold = max(lift_off_threshold, 5 * robust_std(local.real[in_contact]))
    if weld_threshold is None:
        weld_threshold = max(WELD_SIGMAS * noise, WELD_FRACTION * excursion)
    return check_calibration(
        Calibration(
            contact,
            axis,
            excursion,
            curve,
            noise,
            float(lift_off_threshold),
            float(weld_threshold),
            weld_axis,
        ),
        "calibration",
    )


def compute_components(ec: NDArray[Any], calibration: Calibration) -> tuple[Array, Array]:
    """Return the lift-off and weld components (n,), (n,) of a signal, in instrument units.

    The lift-off is zero in contact and positive in air. With a known weld axis, the basis is
    oblique (the change of basis [e_l, e_w]^-1) and the weld component is signed. Without one, the
    weld component is the magnitude across the lift-off curve. NaN stays NaN.
    """
    cal = calibration
    local = (to_complex(ec) - cal.contact) * np.conj(cal.lift_off_axis)
    direction = 1j if cal.weld_axis is None else cal.weld_axis * cal.lift_off_axis.conjugate()
    lift_off = local.real.copy()
    weld = local.imag.copy()
    for _ in range(8):  # the iteration contracts: the curve's slope is a few per cent
        weld = (local.imag - _curve_at(cal.curve, lift_off, cal.excursion)) / direction.imag
        lift_off = local.real - weld * direction.real
    return lift_off, np.abs(weld) if cal.weld_axis is None else weld


def compute_local(ec: NDArray[Any], calibration: Calibration) -> tuple[ComplexArray, Array]:
    """Return (local, across), each (n,), in instrument units.

    `local` is the complex signal relative to contact, with the lift-off axis as the real axis.
    `across` is its signed distance from the lift-off curve.
    """
    cal = calibration
    local = (to_complex(ec) - cal.contact) * np.conj(cal.lift_off_axis)
    return local, np.asarray(local.imag - _curve_at(cal.curve, local.real, cal.excursion))


def is_lifted(ec: NDArray[Any], calibration: Calibration) -> Mask:
    """Flag (n,) the samples on the lift-off curve: a distance from the surface explains them."""
    local, across = compute_local(ec, calibration)
    between = (local.real > 0) & (local.real < 1.1 * calibration.excursion)
    return np.asarray(between & (np.abs(across) < calibration.weld_threshold))


def measure_lift_off(ec: NDArray[Any], calibration: Calibration) -> Array:
    """Return the magnitude (n,) of the lift-off component in instrument units.

    It is 0 in spikes off the lift-off curve, because they contain no information.
    """
    w = to_complex(ec)
    return np.where(
        find_spikes(w) & ~is_lifted(w, calibration),
        0.0,
        np.abs(compute_components(w, calibration)[0]),
    )


def estimate_weld_axis(ec: NDArray[Any], calibration: Calibration) -> complex | None:
    """Return the unit direction of the weld on the display from a scan; None if no weld is visible.

    The samples whose residual from the lift-off curve exceeds the weld threshold have one sign.
    The regression of their lift-off component on the residual gives the direction. Tilt and gap
    vary independently of the weld and average out.
    """
    cal = calibration
    local, across = compute_local(ec, cal)
    ok = np.isfinite(across) & (np.abs(local.real) < cal.lift_off_threshold)
    strong = ok & (np.abs(across) > cal.weld_threshold)
    if strong.sum() < 5:
        return None
    sign = 1.0 if across[strong].sum() > 0 else -1.0
    one_side = ok & (sign * across > cal.weld_threshold)
    quiet = ok & (np.abs(across) < 0.5 * cal.weld_threshold)
    if one_side.sum() < 5 or quiet.sum() < 5:
        return None
    rest = complex(np.median(local.real[quiet]), np.median(across[quiet]))
    x = sign * (across[one_side] - rest.imag)
    y = local.real[one_side] - rest.real
    slope = float(np.sum(x * y) / np.sum(x * x))
    slope = min(max(slope, -2.0), 2.0)  # a weld axis is within 63 deg of the perpendicular
    direction = complex(slope, sign)
    return direction / abs(direction) * cal.lift_off_axis


def check_calibration(cal: Calibration, where: str) -> Calibration:
    """Return `cal` if its values are valid; raises InputError that names the invalid value."""
    values: dict[str, Any] = cal._asdict()
    for key in ("excursion", "lift_off_threshold", "weld_threshold"):
        if not (math.isfinite(values[key]) and values[key] > 0):
            raise InputError(f"{where}: {key} = {values[key]}; valid: a number above 0")
    if not (math.isfinite(cal.noise) and cal.noise >= 0 and np.all(np.isfinite(cal.curve))):
        raise InputError(f"{where}: noise and curve must be finite numbers")
    for key in ("contact", "lift_off_axis", "weld_axis"):
        value = values[key]
        if value is not None and not np.isfinite(value):
            raise InputError(f"{where}: {key} = {value}; valid: two finite numbers")
        if key != "contact" and value is not None and abs(abs(value) - 1) > 1e-3:
            raise InputError(f"{where}: {key} has length {abs(value):.4g}; valid: 1")
    if cal.weld_axis is not None:
        sine = abs((cal.weld_axis * cal.lift_off_axis.conjugate()).imag)
        if sine < 0.1:
            raise InputError(
                f"{where}: weld_axis is within {math.degrees(math.asin(sine)):.1f} deg of "
                "lift_off_axis; valid: 6 deg or more"
            )
    return cal


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write a calibration as TOML (or JSON, by the suffix); raises InputError if this fails."""
    data: dict[str, Any] = {}
    for key, value in calibration._asdict().items():
        if isinstance(value, complex):
            data[key] = [float(value.real), float(value.imag)]
        elif value is not None:
            data[key] = list(value) if isinstance(value, tuple) else float(value)
    text = json.dumps(data, indent=2) if path.suffix == ".json" else tomli_w.dumps(data)
    try:
        path.write_text(text)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None


def read_table(path: Path) -> dict[str, Any]:
    """Read a TOML or JSON file (by the suffix); raises InputError if its top level is no table."""
    raw = read_text(path, LARGEST_TOML)
    data = (parse_json if path.suffix == ".json" else parse_toml)(raw, str(path))
    if not isinstance(data, dict):
        raise InputError(f"{path}: the top level must be a table of keys")
    return data


def read_numbers(data: dict[str, Any], key: str, count: int, path: Path) -> list[float]:
    """Return the `count` finite numbers under `key`; raises InputError otherwise."""
    if key not in data:
        raise InputError(f"{path}: key {key} is missing; found: {', '.join(data) or 'no keys'}")
    value = data[key] if isinstance(data[key], list) else [data[key]]
    good = [isinstance(v, int | float) and not isinstance(v, bool) for v in value]
    if len(value) != count or not all(good):
        what = "a number" if count == 1 else f"{count} numbers"
        raise InputError(f"{path}: {key} = {str(data[key])[:60]}; valid: {what}")
    try:
        numbers = [float(v) for v in value]
    except OverflowError:
        numbers = [math.inf]
    if not all(math.isfinite(v) for v in numbers):
        raise InputError(f"{path}: {key} = {str(data[key])[:60]}; valid: finite numbers")
    return numbers


def load_calibration(path: Path) -> Calibration:
    """Read a file of `save_calibration`; raises InputError that names an invalid key."""
    data = read_table(path)
    for key in data:
        if key not in Calibration._fields:
            valid = neighbours(key, Calibration._fields, count=len(Calibration._fields))
            raise InputError(f"{path}: unknown key {key}; valid: {valid}")

    def pair(key: str) -> complex:
        return complex(*read_numbers(data, key, 2, path))

    c1, c2, c3 = read_numbers(data, "curve", 3, path)
    cal = Calibration(
        contact=pair("contact"),
        lift_off_axis=pair("lift_off_axis"),
        excursion=read_numbers(data, "excursion", 1, path)[0],
        curve=(c1, c2, c3),
        noise=read_numbers(data, "noise", 1, path)[0],
        lift_off_threshold=read_numbers(data, "lift_off_threshold", 1, path)[0],
        weld_threshold=read_numbers(data, "weld_threshold", 1, path)[0],
        weld_axis=pair("weld_axis") if "weld_axis" in data else None,
    )
    return check_calibration(cal, str(path))
