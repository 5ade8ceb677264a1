"""Signal of an absolute eddy-current probe above steel: Dodd and Deeds' integral, tabulated.

A cylindrical air-cored coil sits behind the rounded nose of a pen probe. Its impedance change over
a conducting, permeable half-space is (Dodd and Deeds, "Analytical solutions to eddy-current
probe-coil problems", J. Appl. Phys. 39, 2829 (1968); tilted coil by the reciprocity form of Burke,
J. Phys. D 18, 1745 (1985))

    dZ = j w mu0 / (4 pi) * int_0^inf  Gamma(a) W(a) exp(-2 a h) da,
    Gamma(a) = (a mu_r - sqrt(a^2 + j w mu0 mu_r sigma)) / (a mu_r + sqrt(a^2 + ...)),

with a the spatial frequency (rad/m), h the height of the coil's face centre and W the angular
average of |S|^2, where S is the coil as a stack of magnetic sheets. Because the source potential is
harmonic, S is closed-form for any tilt: with K = -a cos(tilt) - j a cos(phi) sin(tilt), S = 2 pi n
[int r J1(K r) dr] [int exp(K z) dz] over the winding of turn density n. At tilt 0 this is exactly
Dodd and Deeds' expression.

The surface is assumed flat: over a coil of 2.5 mm radius a pipe of 0.2 m radius deviates by 0.016
mm. The weld is a smooth local change of sigma and mu_r that the coil averages over its footprint;
the texture of the steel is a random field of mu_r over the unrolled surface.

Units: SI; signals are in instrument units (the display's divisions after gain and rotation).
Surface coordinates: s along the pipe's axis, c = R phi around it (description/world/spec.py).
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import jv

from skywright.core.compiled import helper
from skywright.description.world.spec import Pipe, Weld
from skywright.description.world.surface import build_weld_curve, weld_distance
from skywright.errors import InputError

MU0 = 4e-7 * math.pi
"""H/m, permeability of vacuum."""

_GAP_SCALE = 0.002  # m; gaps are tabulated uniformly in gap / (gap + scale), air is the last row
_N_GAP = 161
_N_BLEND = 9
_TILT_MAX = math.radians(25.0)
_N_TILT = 10


class Coil(NamedTuple):
    """The winding and its nose. All values are assumed, because data sheets of pen probes omit the
    coil.

    The paper names no probe. These sizes give a lift-off sensitivity of 4 dB at the first 0.5 mm,
    between a pencil probe and a weld probe.
    """

    inner_radius: float = 0.0010  # m
    outer_radius: float = 0.0025  # m
    length: float = 0.0030  # m, of the winding along its axis
    turns: float = 120.0
    recess: float = 0.0005  # m, from the nose's apex to the winding's face (wear plate)
    nose_radius: float = 0.0080  # m, of the rounded nose; the coil must fit inside it


class Instrument(NamedTuple):
    """The eddy-current instrument: excitation, gain and rotation of the display.

    The gain scales the excursion from contact to air to `excursion` units, the scale of the
    thresholds 15 (lift-off) and 1.4 (weld) of Tognon 2018; the rotation sets its direction to
    `phase`. The null is at contact on base metal. All values are assumed.
    """

    frequency: float = 100e3  # Hz (EN 1711's usual value for ferritic welds)
    excursion: float = 60.0  # units
    phase: float = math.radians(160.0)  # rad, direction contact -> air on the display
    noise: float = 0.05  # units rms, each component


class Texture(NamedTuple):
    """Grain and rolling texture of steel: a stationary random field of ln(mu_r). Assumed."""

    rms: float = 0.02  # of ln(mu_r)
    correlation_length: float = 0.03  # m, of the Gaussian correlation exp(-d^2 / 2 l^2)
    modes: int = 24


class ProbeSignal(NamedTuple):
    """Data of `ec_signal`, as arrays and floats that compiled code accepts."""

    # complex (tilt * gap, welds * blend), instrument units, zero at contact on base
    table: np.ndarray
    d_log_mu: np.ndarray  # complex (tilt * gap,), derivative by ln(mu_r) at the base metal
    nose: float  # m, distance from the nose's centre to the coil's face
    welds: np.ndarray  # (welds, 4): offset m, slope, around rad as in WeldCurve; half width m
    radius: float  # m, of the pipe
    footprint: float  # m, standard deviation of the coil's averaging
    texture_ks: np.ndarray  # rad/m (modes,)
    texture_kc: np.ndarray  # rad/m (modes,)
    texture_phase: np.ndarray  # rad (modes,)
    texture_amplitude: float  # of ln(mu_r), per mode
    noise: float  # units rms


@lru_cache(maxsize=64)
def compute_coil_spectrum(coil: Coil, tilt: float) -> tuple[np.ndarray, np.ndarray]:
    """Spatial frequencies of the coil and the weight W(a) da of each at a tilt.

    Parameters: `tilt` (rad) of the coil's axis from the surface normal.
    Returns `alpha` (n,) in rad/m and `weight` (n,) in A^2-turns^2 m^2 rad/m for 1 A, quadrature
    included, referred to the centre of the coil's face.
    """
    radius = coil.outer_radius
    # panels of doubling width: the scale is 1/radius, a tilted coil's edge has high frequencies
    edges = np.concatenate([[0.0], 2.0 ** np.arange(-2, 9)]) / radius
    node, node_weight = np.polynomial.legendre.leggauss(20)
    half = np.diff(edges) / 2
    alpha = (edges[:-1, None] + half[:, None] * (node + 1)).ravel()
    alpha_weight = (half[:, None] * node_weight).ravel()

    n_radial = 24
    node, node_weight = np.polynomial.legendre.leggauss(n_radial)
    half_r = (coil.outer_radius - coil.inner_radius) / 2
    r = coil.inner_radius + half_r * (node + 1)
    r_weight = half_r * node_weight

    # a quarter of the directions: by symmetry |S|^2 is equal in the others
    n_angle = 8 if tilt else 1
    phi = (np.arange(n_angle) + 0.5) * 0.5 * math.pi / n_angle
    k = -alpha[:, None] * (math.cos(tilt) + 1j * math.sin(tilt) * np.cos(phi))
    radial = np.zeros_like(k)
    for r_i, w_i in zip(r, r_weight, strict=True):
        radial += (w_i * r_i) * (jv(1, k * r_i) if tilt else jv(1, k.real * r_i))
    axial = np.expm1(k * coil.length) / k
    density = coil.turns / (coil.length * (coil.outer_radius - coil.inner_radius))
    spectrum = 2 * math.pi * density * radial * axial
    weight = (np.abs(spectrum) ** 2).mean(axis=1) * alpha_weight
    alpha.setflags(write=False)  # cached: shared by every caller
    weight.setflags(write=False)
    return alpha, weight


def compute_reflection(
    alpha: np.ndarray, frequency: float, conductivity: float, relative_permeability: float
) -> np.ndarray:
    """Reflection factor Gamma(alpha) of a half-space, complex (n,) (Dodd and Deeds, eq. 1).

    -1 for a perfect conductor, (mu_r - 1) / (mu_r + 1) for an insulating magnet.
    """
    w = 2 * math.pi * frequency
    alpha_1 = np.sqrt(alpha**2 + 1j * w * MU0 * relative_permeability * conductivity)
    a_mu = alpha * relative_permeability
    return (a_mu - alpha_1) / (a_mu + alpha_1)


def compute_impedance_change(
    coil: Coil,
    height: np.ndarray,
    frequency: float,
    conductivity: float,
    relative_permeability: float,
    tilt: float = 0.0,
) -> np.ndarray:
    """Return the impedance change (ohm, complex, shape of `height`) due to the half-space.

    `height` (m) is that of the coil's face centre above the surface.
    """
    alpha, weight = compute_coil_spectrum(coil, tilt)
    gamma = compute_reflection(alpha, frequency, conductivity, relative_permeability)
    decay = np.exp(-2 * np.multiply.outer(np.asarray(height, float), alpha))
    return 1j * MU0 * frequency / 2 * (decay @ (gamma * weight))


def compute_air_inductance(coil: Coil) -> float:
    """Inductance (H) of the coil in air (Dodd and Deeds' isolated-coil integral)."""
    alpha, weight = compute_coil_spectrum(coil, 0.0)
    a_l = alpha * coil.length
    # |S|^2 holds (1 - exp(-a l))^2; the self-term needs 2 (a l - 1 + exp(-a l)) in its place
    ratio = 2 * (a_l + np.expm1(-a_l)) / np.expm1(-a_l) ** 2
    # the panels end at 256 / r; the remaining integrand falls as a^-5 and is below 1e-6
    return float(MU0 / (4 * math.pi) * np.sum(weight * ratio))


def compute_coil_height(coil: Coil, gap: np.ndarray, tilt: float) -> np.ndarray:
    """Height (m) of the coil's face centre for a nose `gap` (m) above the surface at `tilt`."""
    arm = coil.nose_radius - coil.recess
    return np.maximum(gap, 0.0) + coil.recess + arm * (1 - math.cos(tilt))


def _check_coil(coil: Coil) -> None:
    if not all(math.isfinite(v) and v >= 0 for v in coil) or not (
        coil.inner_radius < coil.outer_radius and coil.length > 0 and coil.turns > 0
    ):
        raise InputError(
            f"coil: {coil} is not a winding; valid: 0 <= inner_radius < outer_radius, length > 0"
        )
    arm = coil.nose_radius - coil.recess
    if coil.recess <= 0 or arm < 0 or math.hypot(coil.outer_radius, arm) > coil.nose_radius:
        raise InputError(
            f"coil: a winding of outer_radius {coil.outer_radius} m at recess {coil.recess} m does "
            f"not fit inside a nose of radius {coil.nose_radius} m; valid: "
            "outer_radius^2 + (nose_radius - recess)^2 <= nose_radius^2"
        )


def _build_tables(
    pipe: Pipe, weld: Weld | None, coil: Coil, instrument: Instrument
) -> tuple[np.ndarray, np.ndarray]:
    q = np.linspace(0.0, 1.0, _N_GAP)[:-1]  # the last row, q = 1, is air: exactly zero
    gap = _GAP_SCALE * q / (1 - q)
    sigma, mu = pipe.conductivity_s_per_m, pipe.relative_permeability
    log_sigma = math.log1p(weld.conductivity_change) if weld else 0.0
    log_mu = math.log1p(weld.permeability_change) if weld else 0.0
    blend = np.linspace(0.0, 1.0, _N_BLEND)
    table = np.zeros((_N_TILT, _N_GAP, _N_BLEND), complex)
    d_log_mu = np.zeros((_N_TILT, _N_GAP), complex)
    step = 0.01
    for i, versine in enumerate(np.linspace(0.0, 1 - math.cos(_TILT_MAX), _N_TILT)):
        tilt = math.acos(1 - versine)
        alpha, weight = compute_coil_spectrum(coil, tilt)
        height = compute_coil_height(coil, gap, tilt)
        decay = np.exp(-2 * np.multiply.outer(height, alpha)) * weight
        metals = [(sigma * math.exp(b * log_sigma), mu * math.exp(b * log_mu)) for b in blend]
        metals += [(sigma, mu * math.exp(step)), (sigma, mu * math.exp(-step))]
        gamma = np.stack(
            [compute_reflection(alpha, instrument.frequency, *m) for m in metals], axis=1
        )
        z = 1j * MU0 * instrument.frequency / 2 * (decay @ gamma)
        table[i, :-1] = z[:, :_N_BLEND]
        d_log_mu[i, :-1] = (z[:, -2] - z[:, -1]) / (2 * step)
    null = table[0, 0, 0]
    if not np.all(np.isfinite(table)) or abs(null) == 0:
        raise InputError(
            f"eddy current: conductivity {sigma} S/m, permeability {mu}, frequency "
            f"{instrument.frequency} Hz give no impedance change; check these values"
        )
    gain = instrument.excursion * np.exp(1j * instrument.phase) / (0.0 - null)
    return gain * (table - null), gain * d_log_mu


def build_probe_signal(
    pipe: Pipe,
    welds: Sequence[Weld],
    rng: np.random.Generator,
    coil: Coil | None = None,
    instrument: Instrument | None = None,
    texture: Texture | None = None,
) -> ProbeSignal:
    """Tabulate the probe's signal for a pipe and its welds, and draw the steel's texture.

    Raises InputError if the coil does not fit its nose or the metal produces no signal.
    """
    coil, instrument = coil or Coil(), instrument or Instrument()
    texture = texture or Texture()
    _check_coil(coil)
    tables = [_build_tables(pipe, weld, coil, instrument) for weld in welds or (None,)]
    radius = pipe.diameter_m / 2
    lines = [(*build_weld_curve(w, radius)[:3], w.half_width_m) for w in welds]
    # Gaussian spectrum of wave numbers <=> Gaussian correlation of the field; integer wave counts
    # around the pipe make the field periodic
    k = rng.standard_normal((2, texture.modes)) / texture.correlation_length
    k[1] = np.round(k[1] * radius) / radius
    return ProbeSignal(
        table=np.concatenate([table for table, _ in tables], axis=2).reshape(_N_TILT * _N_GAP, -1),
        d_log_mu=tables[0][1].ravel(),
        nose=coil.nose_radius - coil.recess,
        welds=np.array(lines).reshape(-1, 4),
        radius=radius,
        footprint=(coil.inner_radius + coil.outer_radius) / 2,
        texture_ks=k[0].copy(),
        texture_kc=k[1].copy(),
        texture_phase=rng.uniform(0.0, 2 * math.pi, texture.modes),
        texture_amplitude=texture.rms * math.sqrt(2.0 / max(texture.modes, 1)),
        noise=instrument.noise,
    )


def compute_weld_signal(pipe: Pipe, weld: Weld) -> complex:
    """Return the signal (instrument units) on a weld's middle, in contact and upright, from base
    metal.

    It excludes tilt and texture; the coil averages over a narrow weld.
    """
    coil = Coil()
    row = _build_tables(pipe, weld, coil, Instrument())[0][0, 0]
    footprint = (coil.inner_radius + coil.outer_radius) / 2
    share = math.erf(weld.half_width_m / (math.sqrt(2.0) * footprint))
    return complex(np.interp(share, np.linspace(0.0, 1.0, _N_BLEND), row))


@helper
def weld_blend(ps: ProbeSignal, s: float, c: float) -> tuple[float, int]:
    """Return the share of weld metal under the coil, 0..1, at (s, c) on the unrolled surface (m),
    and its weld.

    Where welds overlap, the one with the larger share counts.
    """
    scale = 1.0 / (math.sqrt(2.0) * ps.footprint)
    most, which = 0.0, 0
    for i in range(ps.welds.shape[0]):
        d = weld_distance(ps.welds[i, 0], ps.welds[i, 1], ps.welds[i, 2], ps.radius, s, c)
        half = ps.welds[i, 3]
        share = 0.5 * (math.erf((d + half) * scale) - math.erf((d - half) * scale))
        if not share <= most:  # NaN propagates
            most, which = share, i
    return most, which


@helper
def ec_signal(
    ps: ProbeSignal, s: float, c: float, gap: float, tilt: float, n1: float, n2: float
) -> tuple[float, float]:
    """One reading (re, im) in instrument units.

    `s`, `c` (m) on the unrolled surface, `gap` (m) from the nose to the surface (negative is
    penetration of the soft contact model and reads as contact), `tilt` (rad, 0..pi) of the probe
    from the inward normal, `n1`, `n2` standard-normal draws. A NaN input gives NaN.
    """
    cos_tilt = math.cos(tilt)
    cos_max = math.cos(_TILT_MAX)
    g = gap if not gap < 0.0 else 0.0
    u = (1.0 - cos_tilt) / (1.0 - cos_max) * (_N_TILT - 1)
    if u > _N_TILT - 1:
        # beyond the table: the coil continues to rise on the rounded nose
        g += ps.nose * (cos_max - cos_tilt)
        u = float(_N_TILT - 1)
    # an infinite gap is air; NaN fails every comparison and reaches the check below
    v = float(_N_GAP - 1) if g > 1e6 else g / (g + _GAP_SCALE) * (_N_GAP - 1)
    share, weld = weld_blend(ps, s, c)
    w = share * (_N_BLEND - 1)
    if not (u >= 0.0 and v >= 0.0 and w >= 0.0):
        return math.nan, math.nan
    i = min(int(u), _N_TILT - 2)
    j = min(int(v), _N_GAP - 2)
    k = min(int(w), _N_BLEND - 2)
    u -= i
    v -= j
    w -= k
    k += weld * _N_BLEND
    field = 0.0
    for m in range(ps.texture_ks.size):
        field += math.cos(ps.texture_ks[m] * s + ps.texture_kc[m] * c + ps.texture_phase[m])
    field *= ps.texture_amplitude
    z = 0.0 + 0.0j
    for a in range(2):
        wa = u if a else 1.0 - u
        for b in range(2):
            wb = wa * (v if b else 1.0 - v)
            at = (i + a) * _N_GAP + j + b
            t0 = ps.table[at, k]
            t1 = ps.table[at, k + 1]
            z += wb * (t0 + w * (t1 - t0) + field * ps.d_log_mu[at])
    return z.real + ps.noise * n1, z.imag + ps.noise * n2
