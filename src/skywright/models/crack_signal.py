"""Impedance change of an eddy-current coil due to a surface-breaking crack, by reciprocity.

With the surface impedance Zs = (1 + j) / (sigma delta) of the metal, the coil's own tangential
field H on the surface (1 A) gives dZ = int dZs H^2 dS (the square, not its modulus). In a closed
crack that is deep compared with the skin depth delta, the current runs down one face and up the
other. Along the mouth (y), with H_par = H_r y / r parallel to it (Auld and Moulder, J. Nondestr.
Eval. 18, 3 (1999); Harfield and Bowler, J. Appl. Phys. 82, 4590 (1997)),

    dZ = 2 Zs int H_par(y) [g * H_par](y) dy,   g~(k) = tanh(k d) / k,

which is 2 Zs d int H_par^2 dy for a shallow crack and saturates once d reaches the coil's radius.
For a short crack, d is the profile d(y): the effective depth at each y is the one with which the
law of the shallow crack gives the result of the long crack of depth d(y). Below five skin depths
delta G(d / delta) replaces 2 d (two-dimensional finite differences). Flux that leaves the mouth is
neglected; a set-up on a notch scales it (inspection/notch_setup.py).

Coordinates of a crack: x across its mouth, y along it, in m on the unrolled surface.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy  # loads scipy.signal and scipy.stats (0.5 s) at its first use
from numpy.typing import NDArray
from scipy.special import j1

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.eddy_current import (
    MU0,
    Coil,
    Instrument,
    compute_coil_height,
    compute_impedance_change,
)

Complex = NDArray[np.complex128]

GAPS = np.array([0.0, 1e-4, 2e-4, 3e-4, 5e-4, 8e-4, 1.2e-3, 2e-3, 4e-3])
"""m, gaps of the nose above the surface at which a crack's signal is tabulated; 0 beyond the last.
"""
REACH = 0.008
"""m, half width of the tabulated region beside a crack: three coil radii."""
CELL = 0.00025
"""m, spacing of the tables."""
_SHALLOW = np.array([0.0, 0.5, 1.0, 2.0, 5.0])
_SHALLOW_G = np.array([0j, 0.336 + 0.201j, 1.11 + 0.47j, 3.12 + 0.76j, 9.22 + 0.77j])


class Metal(NamedTuple):
    """A conductor."""

    conductivity: float  # S/m
    relative_permeability: float


def compute_skin_depth(metal: Metal, frequency: float) -> float:
    """Return the skin depth (m) at a frequency (Hz)."""
    w = 2 * math.pi * frequency
    return math.sqrt(2 / (w * MU0 * metal.relative_permeability * metal.conductivity))


def compute_surface_impedance(metal: Metal, frequency: float) -> complex:
    """Return Zs (ohm) of a thick conductor, time factor exp(+j w t)."""
    return (1 + 1j) / (metal.conductivity * compute_skin_depth(metal, frequency))


def compute_surface_field(
    coil: Coil, height: float, metal: Metal, frequency: float, r: Array
) -> Complex:
    """Return the tangential (radial) field H_r (A/m per A), the shape of `r` (m).

    `height` (m) is that of the coil's face above the surface. The normal component of the field
    drives no current. The coil is upright.
    """
    edges = np.concatenate([[0.0], 2.0 ** np.arange(-2, 9)]) / coil.outer_radius
    node, node_weight = np.polynomial.legendre.leggauss(24)
    half = np.diff(edges) / 2
    a = (edges[:-1, None] + half[:, None] * (node + 1)).ravel()
    weight = (half[:, None] * node_weight).ravel()
    width = (coil.outer_radius - coil.inner_radius) / 2
    radial = np.zeros_like(a)  # int x J1(a x) dx over the winding, which is I_J / a^2
    for x, w in zip(coil.inner_radius + width * (node + 1), width * node_weight, strict=True):
        radial += w * x * j1(a * x)
    density = coil.turns / (coil.length * (coil.outer_radius - coil.inner_radius))
    mu = metal.relative_permeability
    a_1 = np.sqrt(a**2 + 2j * math.pi * frequency * MU0 * mu * metal.conductivity)
    share = 2 * a_1 / (a * mu + a_1) * radial * np.exp(-a * height) * -np.expm1(-a * coil.length)
    flat = np.asarray(r, float).ravel()
    out = -density / 2 * (j1(np.multiply.outer(flat, a)) @ (share * weight))
    return np.asarray(out.reshape(np.shape(r)))


def compute_depth_factor(depth: Array, skin_depth: float) -> Complex:
    """Return delta G(d / delta) / (2 d): correction of 2 d for a shallow crack of `depth` (m)."""
    ratio = np.maximum(np.asarray(depth, float) / skin_depth, 1e-6)
    g = np.interp(ratio, _SHALLOW, _SHALLOW_G.real) + 1j * np.interp(
        ratio, _SHALLOW, _SHALLOW_G.imag
    )
    deep = 2 * ratio - 0.78 + 0.77j
    return np.where(ratio < 5.0, g, deep) / (2 * ratio)


def compute_display_gain(coil: Coil, metal: Metal, instrument: Instrument) -> complex:
    """Return the factor (units/ohm) from an impedance change to the instrument's display."""
    height = compute_coil_height(coil, np.zeros(1), 0.0)
    null = compute_impedance_change(coil, height, instrument.frequency, *metal)[0]
    return complex(instrument.excursion * np.exp(1j * instrument.phase) / (0.0 - null))


def compute_long_crack(
    coil: Coil, metal: Metal, frequency: float, depth: Array, x: float = 0.0, gap: float = 0.0
) -> Complex:
    """Return dZ (ohm) for each `depth` (n,) m of a crack that is long compared with the coil.

    `x` (m) is the distance of the coil's axis from the crack, `gap` (m) that of its nose from the
    surface. Raises InputError for a depth that is not above 0.
    """
    depth = np.atleast_1d(np.asarray(depth, float))
    if not np.all(np.isfinite(depth) & (depth > 0)):
        raise InputError(f"crack: depth {depth.tolist()} m; valid: above 0")
    y = np.linspace(-2048 * 2e-5, 2047 * 2e-5, 4096)
    field = _field_along(coil, metal, frequency, x, y, gap)
    spectrum = np.fft.fft(field) * 2e-5
    k = 2 * math.pi * np.fft.fftfreq(y.size, 2e-5)
    kd = np.abs(np.multiply.outer(depth, k))
    kernel = np.where(kd > 1e-9, np.tanh(kd) / np.maximum(np.abs(k), 1e-12), depth[:, None])
    # H is odd in y, so H~(-k) = -H~(k) up to the grid's shift, which the square takes out
    product = spectrum * spectrum[-np.arange(k.size) % k.size]
    total = (kernel @ product) / (y.size * 2e-5)
    factor = compute_depth_factor(depth, compute_skin_depth(metal, frequency))
    return np.asarray(2 * compute_surface_impedance(metal, frequency) * total * factor)


@lru_cache(maxsize=32)
def _tabulate_field(
    coil: Coil, metal: Metal, frequency: float, gap: float
) -> tuple[Array, Complex]:
    """Return H_r on a grid of distances (m); it falls by six orders of magnitude over the grid."""
    height = float(compute_coil_height(coil, np.array([gap]), 0.0)[0])
    grid = np.concatenate([np.linspace(0.0, 0.02, 800), np.geomspace(0.0205, 2.0, 60)])
    return grid, compute_surface_field(coil, height, metal, frequency, grid)


def _field_along(
    coil: Coil, metal: Metal, frequency: float, x: float, y: Array, gap: float
) -> Complex:
    """Return H parallel to the crack (n,) along its mouth `y` (n,), at `x` (m) from the coil."""
    r = np.hypot(x, y)
    grid, radial = _tabulate_field(coil, metal, frequency, gap)
    h = np.interp(r, grid, radial.real) + 1j * np.interp(r, grid, radial.imag)
    return np.asarray(h * y / np.maximum(r, 1e-12))


class CrackTable(NamedTuple):
    """Signal of one crack on the display, for compiled code."""

    signal: Complex  # (gap, x, y) units, at |x| and |y| in steps of CELL


def build_crack_table(
    length: float, depth: float, metal: Metal, coil: Coil, instrument: Instrument,
    shape: str = "semi-ellipse",
) -> CrackTable:  # fmt: skip
    """Tabulate a crack or a notch of `length` and greatest `depth` (m).

    `shape` "semi-ellipse" is a fatigue crack, "rectangle" a notch of an eroding tool. Raises
    InputError for a size that is not above 0.
    """
    if not (0 < length < 1.0 and 0 < depth < 0.1):
        raise InputError(
            f"crack: length {length:g} m, depth {depth:g} m; valid: above 0, up to 1 and 0.1"
        )
    frequency, half, step = instrument.frequency, length / 2, 0.5 * CELL
    skin = compute_skin_depth(metal, frequency)
    x = np.arange(0.0, REACH + CELL, CELL)
    y = np.arange(0.0, half + REACH + CELL, CELL)
    n = int(y[-1] / step) + 1
    mouth = np.arange(-n, n + 1) * step
    inside = np.clip((half - np.abs(mouth)) / step + 0.5, 0.0, 1.0)  # share of the cell
    profile = depth * inside
    if shape == "semi-ellipse":
        profile = profile * np.sqrt(np.maximum(1 - (mouth / half) ** 2, 0.0))
    depths = np.linspace(0.0, depth, 9)[1:]
    factor = compute_depth_factor(depths, skin)
    scale = compute_display_gain(coil, metal, instrument)
    scale *= 2 * compute_surface_impedance(metal, frequency) * step
    away = np.linspace(-2 * n * step, 2 * n * step, 4 * n + 1)
    out = np.zeros((GAPS.size, x.size, y.size), complex)
    for g, gap in enumerate(GAPS[:-1].tolist()):
        # effective depth from the long crack under the coil, where the signal is largest
        long = np.abs(compute_long_crack(coil, metal, frequency, depths, 0.0, gap) / factor)
        under = _field_along(coil, metal, frequency, 0.0, np.linspace(-0.02, 0.02, 801), gap)
        unit = abs(2 * compute_surface_impedance(metal, frequency) * np.sum(under**2) * 5e-5)
        counts = np.interp(profile, [0.0, *depths], [0.0, *np.maximum.accumulate(long) / unit])
        counts = counts * compute_depth_factor(profile, skin)
        field = np.stack([_field_along(coil, metal, frequency, a, away, gap) for a in x.tolist()])
        whole = scipy.signal.fftconvolve(field**2, counts[None], mode="valid", axes=1)
        out[g] = scale * whole[:, n :: round(CELL / step)][:, : y.size]
    return CrackTable(out)
