"""Ultrasonic thickness measurement by contact: simulation of the received A-scan.

A longitudinal wave travels through couplant and paint into the wall and back. Echo n of a wall d
has travelled 2 n d; its pressure is (Krautkraemer, Ultrasonic Testing of Materials, 4th ed.)

    A_n = A0 C W R^(n-1) exp(-2 n alpha d) D_n G_tilt G_front G_curve G_back^n

with C the coupled share of the face, W the transmission of the film (twice), R the reflection back
into the wall at its front, D diffraction (Rogers and Van Buren, J. Acoust. Soc. Am. 55, 724, 1974),
and G the loss of tilt, roughness and curvature in a coherent sum over the face. Tilt acts through
the couplant wedge: the wave number along the surface is that in the couplant. Pits and steps are a
sum over elements of the face.

A dual probe transmits with one half and receives with the other at a distance of `separation`: the
path is 2 sqrt((n d)^2 + (s/2)^2), and the dead zone is short. Units: SI; amplitudes in full screen
heights (FSH).
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import j0, j1

from skywright.core.arrays import Array
from skywright.errors import InputError

SAMPLE_RATE = 100e6
"""Hz, of an A-scan."""
V_COUPLANT, Z_COUPLANT = 1620.0, 1.7e6
"""m/s and Rayl, of gel."""
V_PAINT, Z_PAINT = 2350.0, 2.8e6
"""Of epoxy: a layer of paint reads as 2.5 times its thickness of steel."""
Z_STEEL, Z_FACE, Z_AIR, V_AIR = 46.4e6, 3.2e6, 412.0, 343.0
PAINT_DB = 8000.0
"""dB/m, one way, of paint at 5 MHz, proportional to the frequency. Assumed."""
N_ECHOES = 6
CLIP = 1.25
"""Full screen heights at which the converter saturates; it has 12 bits."""


class Transducer(NamedTuple):
    """A probe with its instrument. All values are assumed, typical of commercial ones."""

    frequency: float = 5e6  # Hz
    radius: float = 0.003  # m, of the face
    separation: float = 0.0  # m, between the halves of a dual probe; 0: single element
    bandwidth: float = 0.6  # -6 dB, over the frequency
    zero: float = 0.4e-6  # s, of cables and wear plate
    dead: float = 0.12e-6  # s, time constant of the transmitter's ring-down
    gain: float = 1.3  # FSH, of a perfect first echo
    noise: float = 0.004  # FSH rms, white
    grass: float = 0.006  # FSH rms, scattering in the wall, constant at each location

    @property
    def width(self) -> float:
        """Standard deviation (s) of the pulse's envelope."""
        return compute_pulse_width(self.frequency, self.bandwidth)

    @property
    def ready(self) -> float:
        """Time (s) after which the transmitter's ring-down is below 3 % FSH; gates begin here."""
        return self.zero + self.dead * math.log(2.0 / 0.03)


def compute_pulse_width(frequency: float, bandwidth: float) -> float:
    """Return the standard deviation (s) of a Gaussian envelope of `frequency` (Hz).

    `bandwidth` is the pulse's at -6 dB, over the frequency.
    """
    return 2.355 / (2 * math.pi * bandwidth * frequency)


class Coupling(NamedTuple):
    """Layers between probe and wall, and the local state of the wall."""

    film: float = 20e-6  # m, of couplant
    share: float = 1.0  # coupled share of the face
    air: bool = False
    tilt: float = 0.0  # rad, of the face from the surface
    paint: float = 0.0  # m
    roughness_front: float = 5e-6  # m rms
    roughness_back: float = 10e-6  # m rms
    curvature_radius: float = math.inf  # m, of the surface, in one direction
    velocity: float = 5920.0  # m/s, in the wall
    attenuation: float = 11.5  # Np/m: 0.1 dB/mm at 5 MHz


def compute_film_factor(
    film: float, frequency: float, *, velocity: float = V_COUPLANT, impedance: float = Z_COUPLANT,
    front: float = Z_FACE, back: float = Z_STEEL,
) -> float:  # fmt: skip
    """Return W = T / T(0) of a layer (m) between probe and wall, for both passes."""
    kl = 2 * math.pi * frequency * film / velocity
    matched = (front + back) ** 2
    layered = (impedance + front * back / impedance) ** 2
    return matched / (matched * math.cos(kl) ** 2 + layered * math.sin(kl) ** 2)


@lru_cache(maxsize=256)
def compute_tilt_factor(transducer: Transducer, tilt: float) -> float:
    """Return G of a face tilted by `tilt` (rad): -6 dB at x = 2.2, zero at 3.8 and beyond it."""
    k = 2 * math.pi * transducer.frequency / V_COUPLANT
    x = 2 * k * transducer.radius * math.sin(abs(tilt))
    return 1.0 if x < 1e-9 else abs(2 * float(j1(x)) / x)


def find_tilt_null(transducer: Transducer) -> float:
    """Return the tilt (rad) at which the echo vanishes."""
    k = 2 * math.pi * transducer.frequency / V_COUPLANT
    return math.asin(min(3.8317 / (2 * k * transducer.radius), 1.0))


@lru_cache(maxsize=256)
def compute_diffraction(transducer: Transducer, path: float, velocity: float) -> float:
    """Return D of an echo with the path length `path` (m): Rogers and Van Buren's closed form."""
    s = path * velocity / transducer.frequency / transducer.radius**2
    if s <= 0:
        return 1.0
    q = 2 * math.pi / s
    return abs(1 - complex(math.cos(q), -math.sin(q)) * complex(float(j0(q)), float(j1(q))))


def compute_roughness(transducer: Transducer, coupling: Coupling) -> tuple[float, float]:
    """Return (front, back) factors of rough surfaces, per echo (Gaussian heights)."""
    w = 2 * math.pi * transducer.frequency
    k_s, k_c = w / coupling.velocity, w / V_COUPLANT
    # both passes cross the same points: four times one pass in dB
    front = math.exp(-2 * (k_c - k_s) ** 2 * coupling.roughness_front**2)
    return front, math.exp(-2 * k_s**2 * coupling.roughness_back**2)


@lru_cache(maxsize=256)
def compute_curvature(transducer: Transducer, radius: float) -> float:
    """Return |mean exp(j k x^2 / R)| over the face on a cylinder of `radius` (m)."""
    if math.isinf(radius):
        return 1.0
    u = (np.arange(200) + 0.5) / 200 * 2 - 1
    weight = np.sqrt(1 - u**2)
    k = 2 * math.pi * transducer.frequency / V_COUPLANT
    phase = k * (u * transducer.radius) ** 2 / radius
    return float(abs(np.sum(weight * np.exp(1j * phase)) / np.sum(weight)))


@lru_cache(maxsize=8)
def build_face(radius: float) -> Array:
    """Return the middles (n, 2) m of equal elements of a round face."""
    at = (np.arange(9) - 4) / 4.5 * radius
    u, v = (x.ravel() for x in np.meshgrid(at, at))
    keep = np.hypot(u, v) <= radius
    out = np.column_stack([u[keep], v[keep]])
    out.setflags(write=False)
    return out


class Echoes(NamedTuple):
    """Back-wall echoes: one row per element of the face, one column per echo."""

    times: Array  # (k, n) s
    amplitudes: Array  # (k, n) FSH


def compute_echoes(transducer: Transducer, coupling: Coupling, walls: Array) -> Echoes:
    """Return the echoes of a wall whose thickness under the face's elements is `walls` (k,) m.

    Equal elements are computed once. Raises InputError for a wall that is not above 0.
    """
    walls, counts = np.unique(np.asarray(walls, float), return_counts=True)
    if not (walls.size and np.all(np.isfinite(walls)) and walls[0] > 0):
        raise InputError(f"wall: {walls.tolist()} m; valid: above 0")
    t, c, f = transducer, coupling, transducer.frequency
    n = np.arange(1, N_ECHOES + 1)
    if c.air:
        film = compute_film_factor(1e-6, f, velocity=V_AIR, impedance=Z_AIR)
    else:
        film = compute_film_factor(c.film, f)
    paint_db = 2 * PAINT_DB * c.paint * f / 5e6
    front, back = compute_roughness(t, c)
    base = t.gain * c.share * film * 10 ** (-paint_db / 20) * front
    base *= compute_tilt_factor(t, c.tilt) * compute_curvature(t, c.curvature_radius)
    face = Z_PAINT if c.paint > 0 else Z_COUPLANT if c.film > 50e-6 else Z_FACE
    back_in = (Z_STEEL - face) / (Z_STEEL + face)
    # a tilted face rests on its edge: the film under its middle is thicker
    layers = 2 * ((c.film + t.radius * math.sin(abs(c.tilt))) / V_COUPLANT + c.paint / V_PAINT)
    slant = min(c.velocity / V_COUPLANT * math.sin(abs(c.tilt)), 0.99)
    depth = np.multiply.outer(walls, n) * math.sqrt(1 - slant**2)
    way = 2 * np.sqrt(depth**2 + (t.separation / 2) ** 2)
    spread = np.array([
        [compute_diffraction(t, 2 * m * d, c.velocity) for m in n.tolist()] for d in walls.tolist()
    ])  # fmt: skip
    loss = np.exp(-2 * c.attenuation * f / 5e6 * np.multiply.outer(walls, n))
    amplitudes = base * back_in ** (n - 1) * back**n * spread * loss
    share = counts / counts.sum()
    return Echoes(t.zero + layers + way / c.velocity, amplitudes * share[:, None])


def compute_squeeze(viscosity: float, radius: float) -> float:
    """Return the growth of 1 / h^2 of a film per impulse F t, in 1 / (m^2 N s): Stefan.

    1/h^2 = 1/h0^2 + 4 F t / (3 pi eta a^4), with the viscosity eta (Pa s) and the face's radius a.
    """
    return 4.0 / (3.0 * math.pi * viscosity * radius**4)


def build_pulse(transducer: Transducer, times: Array) -> Array:
    """Return the pulse at `times` (s) from its middle: a cosine in a Gaussian."""
    return np.asarray(
        np.exp(-0.5 * (times / transducer.width) ** 2)
        * np.cos(2 * math.pi * transducer.frequency * times)
    )


@lru_cache(maxsize=8)
def _build_start(transducer: Transducer, samples: int) -> tuple[Array, Array]:
    """Return the times (samples,) s and the transmitter's ring-down in FSH."""
    t = np.arange(samples) / SAMPLE_RATE
    start = 2.0 * np.exp(-t / transducer.dead) * np.cos(2 * math.pi * transducer.frequency * t)
    for array in (t, start):
        array.setflags(write=False)
    return t, start


@lru_cache(maxsize=64)
def _build_grass(transducer: Transducer, place_seed: int, samples: int) -> Array:
    """Return the scatter (samples,) FSH of a location; repeated readings there repeat it."""
    scatter = np.random.default_rng(place_seed).standard_normal(samples)
    kernel = build_pulse(transducer, np.arange(-60, 61) / SAMPLE_RATE)
    kernel /= math.sqrt(float(np.sum(kernel**2)))
    out = np.asarray(transducer.grass * np.convolve(scatter, kernel, "same"))
    out.setflags(write=False)
    return out


def compute_ascan(
    transducer: Transducer, echoes: Echoes, rng: np.random.Generator, *, place_seed: int = 0,
    samples: int = 1024,
) -> Array:  # fmt: skip
    """Return an A-scan (samples,) in FSH at SAMPLE_RATE, starting at the transmitter's pulse.

    `rng` draws the white noise, `place_seed` the grass: the same location has the same grass, which
    averaging does not remove. 12 bits; clipped at CLIP.
    """
    t, start = _build_start(transducer, samples)
    out = start.copy()
    sigma = transducer.width
    for time, size in zip(echoes.times.ravel(), echoes.amplitudes.ravel(), strict=True):
        a = max(int((time - 5 * sigma) * SAMPLE_RATE), 0)
        b = min(int((time + 5 * sigma) * SAMPLE_RATE) + 1, samples)
        if a < b and size > 1e-9:
            out[a:b] += size * build_pulse(transducer, t[a:b] - time)
    if transducer.grass > 0:
        out += _build_grass(transducer, place_seed, samples)
    out += transducer.noise * rng.standard_normal(samples)
    step = CLIP / 2048
    return np.asarray(np.clip(np.round(out / step) * step, -CLIP, CLIP - step))
