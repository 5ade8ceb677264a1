"""An eddy-current flaw instrument with one coil, a pair or an array: `kind = "eddy_array"`."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from skywright.core.record import Array, Integers, Mat3, Record
from skywright.core.spec import Fraction, NonNegative, Spec
from skywright.description.world.surface import weld_distance
from skywright.errors import InputError
from skywright.models.cap_gap import STEP, compute_cap_gap
from skywright.models.crack_signal import CELL, GAPS, Metal, build_crack_table
from skywright.models.eddy_current import Coil, Instrument, build_probe_signal, ec_signal
from skywright.models.things.crack import Crack
from skywright.models.things.wall import Wall, build_wall_field
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import (
    Normal,
    Out,
    Output,
    Recorded,
    Sensor,
    helper,
    table,
    words,
)
from skywright.vehicle.instruments.eddy_current import open_signal
from skywright.vehicle.plant import SAMPLE_RATE, Surface

MAX_COILS = 16


class EddyArray(Sensor):
    """Measures the pipe under each coil, once a sample, including flaws, paint and weld caps.

    The position of a coil is that of the tip plus its offset along the array. The array's axis is
    at `axis_deg` from the tip's x axis, about the probe. A differential coil subtracts the reading
    of a second coil, `spacing_m` away across the array.
    """

    slot = "derive"

    class Table(Spec):
        """Coil and instrument; the defaults are those of the pen probe, all assumed."""

        layout: Literal["absolute", "differential"] = "absolute"
        coils: int = Field(default=1, ge=1, le=MAX_COILS)
        width_m: float = Field(default=0.04, ge=0.001, le=0.2)  # from the first coil to the last
        axis_deg: float = Field(default=0.0, ge=-180, le=180)  # of the array, from the tip's x
        spacing_m: float = Field(default=0.003, ge=0.0005, le=0.02)  # of a differential pair
        rigid: Fraction = 0.0  # 0: the array conforms to the surface; 1: a flat plate
        frequency_khz: float = Field(default=100.0, ge=1.0, le=10000.0)
        inner_radius_m: float = Field(default=0.001, ge=0, le=0.02)  # of the winding
        outer_radius_m: float = Field(default=0.0025, ge=0.0002, le=0.03)
        winding_m: float = Field(default=0.003, ge=0.0001, le=0.03)  # length
        recess_m: float = Field(default=0.0005, ge=0.00001, le=0.01)  # wear plate
        nose_radius_m: float = Field(default=0.008, ge=0.0005, le=1.0)
        gain_db: float = Field(default=0.0, ge=-80, le=80)  # as set on the reference block
        phase_deg: float = Field(default=0.0, ge=-360, le=360)  # likewise; rotates the display
        noise: float = Field(default=0.05, ge=0, le=10)  # units rms, at 0 dB
        low_pass_hz: NonNegative = 0.0  # 0: none
        high_pass_hz: NonNegative = 0.0  # 0: none
        gain_drift_db: float = Field(default=0.0, ge=-20, le=20)  # per hour, of the true instrument
        phase_drift_deg: float = Field(default=0.0, ge=-90, le=90)  # per hour, likewise

        def build_coil(self) -> Coil:
            """Return the winding."""
            return Coil(self.inner_radius_m, self.outer_radius_m, self.winding_m,
                        recess=self.recess_m, nose_radius=self.nose_radius_m)  # fmt: skip

        def build_instrument(self) -> Instrument:
            """Return the excitation; gain and rotation of the display are applied later."""
            return Instrument(frequency=1e3 * self.frequency_khz, noise=self.noise)

    class Me(Record):
        tables: int  # address of complex (tilt * gap, welds * blend), as for the pen probe
        d_log_mu: int
        texture: int
        welds: int
        n: Annotated[Integers, 4]
        numbers: Annotated[Array, 5]
        R_WP: Mat3
        count: int  # coils
        offset: Annotated[Array, MAX_COILS]  # m, along the array
        axis: Annotated[Array, 2]  # of the array in x, y of the tip
        spacing: float  # m, 0: absolute
        rigid: float
        cracks: int  # address of (cracks, 4): s, c, cos, sin of the mouth's angle
        signals: int  # address of complex, the cracks' tables one after the other
        shapes: int  # address of (cracks, 3): start, cells in x and in y
        n_cracks: int
        gaps: int  # address of GAPS
        n_gaps: int
        cap: int  # address of the gap by distance from a weld
        n_cap: int
        paint: float  # m
        patches: int  # address of (patches, 6)
        n_patches: int
        gain: Annotated[Array, 2]  # complex, before drift
        drift_db: float  # per second
        drift_rad: float  # per second
        low: float  # weight of a new sample in the low-pass, 1: no low-pass
        high: float  # weight in the slow mean that the high-pass subtracts, 0: no high-pass
        state: Annotated[Array, 64]  # low-pass and slow mean of each coil, re and im
        started: int

    class Noise(Normal):
        z: Annotated[Array, 2 * MAX_COILS]

    class Reading(Output):
        fresh: float
        z: Annotated[Array, 2 * MAX_COILS]  # display units, re and im of each coil

    columns = (Recorded("eddy_array", Reading, "z", "", "display units, re and im of each coil"),)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Tabulate the signals of metal, welds and cracks.

        Raises InputError for a world without a pipe, a robot without a probe, a coil that does not
        fit, or filters without a pass band.
        """
        world = context.world
        if world.pipe is None or context.robot.probe is None:
            lacks = "world has no pipe" if world.pipe is None else "robot has no probe"
            raise InputError(
                f"sensor {self.name!r}: an eddy-current array requires pipe and probe; the {lacks}"
            )
        if 0.0 < table.low_pass_hz <= table.high_pass_hz:
            raise InputError(
                f"sensor {self.name!r}: low_pass_hz {table.low_pass_hz:g} must be above "
                f"high_pass_hz {table.high_pass_hz:g}"
            )
        coil, instrument = table.build_coil(), table.build_instrument()
        signal = build_probe_signal(
            world.pipe, world.list_welds(), context.stream("texture"), coil, instrument
        )
        me.tables = context.keep(np.ascontiguousarray(signal.table, np.complex128))
        me.d_log_mu = context.keep(np.ascontiguousarray(signal.d_log_mu, np.complex128))
        waves = np.stack([signal.texture_ks, signal.texture_kc, signal.texture_phase])
        me.texture = context.keep(np.ascontiguousarray(waves))
        me.welds = context.keep(np.ascontiguousarray(signal.welds))
        me.n[:] = [*signal.table.shape, waves.shape[1], len(signal.welds)]
        me.numbers[:] = [
            signal.nose, signal.radius, signal.footprint, signal.texture_amplitude, 0.0,
        ]  # fmt: skip
        me.R_WP[:] = context.true.cylinder.R_WP
        me.count = table.coils
        me.offset[: table.coils] = (
            np.linspace(-0.5, 0.5, table.coils) * table.width_m if table.coils > 1 else 0.0
        )
        turn = math.radians(table.axis_deg)
        me.axis[:] = [math.cos(turn), math.sin(turn)]
        me.spacing = table.spacing_m if table.layout == "differential" else 0.0
        me.rigid = table.rigid
        self._keep_cracks(me, context, coil, instrument)
        walls = [t for t in world.things.values() if isinstance(t, Wall)]
        wall = walls[0] if walls else Wall()
        field = build_wall_field(wall)
        half = max((w.half_width_m for w in world.list_welds()), default=0.005)
        cap = compute_cap_gap(wall.cap_m, half, coil.nose_radius)
        me.cap, me.n_cap = context.keep(cap), len(cap)
        me.paint, me.n_patches = field.paint, len(field.patches)
        me.patches = context.keep(np.ascontiguousarray(field.patches))
        gain = 10 ** (table.gain_db / 20) * np.exp(1j * math.radians(table.phase_deg))
        me.gain[:] = [gain.real, gain.imag]
        me.drift_db = table.gain_drift_db / 3600.0
        me.drift_rad = math.radians(table.phase_drift_deg) / 3600.0
        me.low = share(table.low_pass_hz) if table.low_pass_hz else 1.0
        me.high = share(table.high_pass_hz) if table.high_pass_hz else 0.0
        self._sigma = table.noise

    def draw(self, what: Any, rng: np.random.Generator, n: int) -> Any:
        """Draw white noise with the instrument's standard deviation."""
        return self._sigma * super().draw(what, rng, n)

    def _keep_cracks(self, me: Any, context: Any, coil: Coil, instrument: Instrument) -> None:
        pipe, radius = context.world.pipe, context.true.cylinder.radius
        metal = Metal(pipe.conductivity_s_per_m, pipe.relative_permeability)
        cracks = [t for t in context.world.things.values() if isinstance(t, Crack)]
        places, shapes, tables, start = [], [], [np.zeros(1, complex)], 1
        for crack in cracks:
            found = build_crack_table(
                crack.length_m, crack.depth_m, metal, coil, instrument, crack.shape
            ).signal
            turn = math.radians(crack.angle_deg)
            places.append((crack.s_m, radius * math.radians(crack.around_deg),
                           math.cos(turn), math.sin(turn)))  # fmt: skip
            shapes.append((start, found.shape[1], found.shape[2]))
            tables.append(found.ravel())
            start += found.size
        me.n_cracks = len(cracks)
        me.cracks = context.keep(np.array(places, float).reshape(-1, 4))
        me.shapes = context.keep(np.array(shapes, float).reshape(-1, 3))
        me.signals = context.keep(np.ascontiguousarray(np.concatenate(tables)))
        me.gaps, me.n_gaps = context.keep(np.ascontiguousarray(GAPS)), len(GAPS)

    def get_period(self, step: str, context: Any) -> float:
        """Return the sample period (s)."""
        return 1.0 / SAMPLE_RATE

    @staticmethod
    def step(
        me: Me, clock: Clock, truth: Truth, surface: Surface, noise: Noise, out: Out[Reading]
    ) -> None:
        out.fresh = 1.0
        db, turn = me.drift_db * clock.t, me.drift_rad * clock.t
        size = 10.0 ** (db / 20.0)
        re, im = size * math.cos(turn), size * math.sin(turn)
        g_re = me.gain[0] * re - me.gain[1] * im
        g_im = me.gain[0] * im + me.gain[1] * re
        # components of the array's axis (a) and of the axis across it (b) along s, c and outward
        sa = ca = na = sb = cb = 0.0
        for i in range(3):
            along = me.axis[0] * truth.R_WT[i, 0] + me.axis[1] * truth.R_WT[i, 1]
            across = -me.axis[1] * truth.R_WT[i, 0] + me.axis[0] * truth.R_WT[i, 1]
            around = math.sin(surface.phi) * me.R_WP[i, 0] + math.cos(surface.phi) * me.R_WP[i, 2]
            sa += along * me.R_WP[i, 1]
            ca += along * around
            na += along * surface.normal[i]
            sb += across * me.R_WP[i, 1]
            cb += across * around
        reach = abs(me.offset[me.count - 1] * na)
        for k in range(me.count):
            u = me.offset[k]
            gap = max(surface.gap, 0.0)
            gap += me.rigid * (reach + u * na + (u * ca) ** 2 / (2.0 * me.numbers[1]))
            s, c = surface.s + u * sa, surface.c + u * ca
            half = 0.5 * me.spacing
            z_re, z_im = read_coil(me, s + half * sb, c + half * cb, gap, surface.tilt)
            if me.spacing > 0.0:
                other = read_coil(me, s - half * sb, c - half * cb, gap, surface.tilt)
                z_re, z_im = z_re - other[0], z_im - other[1]
            z_re, z_im = z_re + noise.z[2 * k], z_im + noise.z[2 * k + 1]
            out.z[2 * k] = filter_sample(me, 4 * k, g_re * z_re - g_im * z_im)
            out.z[2 * k + 1] = filter_sample(me, 4 * k + 2, g_re * z_im + g_im * z_re)
        me.started = 1


def share(frequency: float) -> float:
    """Return the weight of a new sample in a first-order low-pass (Hz) at the sample rate."""
    return 1.0 - math.exp(-2.0 * math.pi * frequency / SAMPLE_RATE)


@helper
def filter_sample(me: Any, at: int, x: float) -> float:
    """Return one component after low-pass and high-pass; their state starts at the first sample."""
    if not me.started:
        me.state[at] = me.state[at + 1] = x
    me.state[at] += me.low * (x - me.state[at])
    me.state[at + 1] += me.high * (me.state[at] - me.state[at + 1])
    return float(me.state[at] - (me.state[at + 1] if me.high > 0.0 else 0.0))


@helper
def read_coil(me: Any, s: float, c: float, gap: float, tilt: float) -> tuple[float, float]:
    """Return one coil's reading at (s, c) m: metal, welds, texture and cracks, under paint."""
    paint = me.paint
    for i in range(me.n_patches):
        row = words(me.patches + 48 * i, 6)
        if abs(s - row[0]) <= row[2] and abs(c - row[1]) <= row[3] and row[5] >= 0.0:
            paint = row[5]
    gap += paint
    welds = table(me.welds, me.n[3], 4)
    cap = words(me.cap, me.n_cap)
    for i in range(me.n[3]):
        d = abs(weld_distance(welds[i, 0], welds[i, 1], welds[i, 2], me.numbers[1], s, c)) / STEP
        j = int(min(d, 1e6))
        if j < me.n_cap - 1:
            gap += cap[j] + (d - j) * (cap[j + 1] - cap[j])
    re, im = ec_signal(open_signal(me), s, c, gap, tilt, 0.0, 0.0)
    for i in range(me.n_cracks):
        place, shape = words(me.cracks + 32 * i, 4), words(me.shapes + 24 * i, 3)
        turn = 2.0 * math.pi * me.numbers[1]
        ds, dc = s - place[0], c - place[1]
        dc -= turn * math.floor(dc / turn + 0.5)
        y = abs(ds * place[3] + dc * place[2]) / CELL
        x = abs(ds * place[2] - dc * place[3]) / CELL
        nx, ny = int(shape[1]), int(shape[2])
        if x < nx - 1 and y < ny - 1:
            z = interpolate(me, int(shape[0]), nx, ny, gap, x, y)
            re, im = re + z.real, im + z.imag
    return re, im


@helper
def interpolate(me: Any, start: int, nx: int, ny: int, gap: float, x: float, y: float) -> complex:
    """Return a crack's signal, interpolated trilinearly in its table."""
    gaps = words(me.gaps, me.n_gaps)
    if not gap < gaps[me.n_gaps - 1]:
        return 0.0j
    g = 0
    while gap >= gaps[g + 1]:
        g += 1
    data = words(me.signals, 2 * (start + me.n_gaps * nx * ny)).view(np.complex128)
    w, i, j = (gap - gaps[g]) / (gaps[g + 1] - gaps[g]), int(x), int(y)
    z = 0.0j
    for a in range(2):
        for b in range(2):
            for d in range(2):
                weight = (w if a else 1.0 - w) * (x - i if b else 1.0 - x + i)
                weight *= y - j if d else 1.0 - y + j
                z += weight * data[start + ((g + a) * nx + i + b) * ny + j + d]
    return z
