"""An ultrasonic thickness probe at the tip, in a gimbal holder: `kind = "ultrasonic"`."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from skywright.core.arrays import Array as Numbers
from skywright.core.arrays import Samples
from skywright.core.record import Array, Record, Vec3
from skywright.core.spec import Fraction, NonNegative, Positive, Spec
from skywright.description.world.structure import build_surface, find_place
from skywright.description.world.surface import build_cylinder, unroll_points
from skywright.errors import InputError
from skywright.models.things.wall import Wall, WallField, build_wall_field, compute_wall
from skywright.models.ultrasonic import (
    Coupling,
    Transducer,
    build_face,
    compute_ascan,
    compute_echoes,
    compute_squeeze,
)
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import Normal, Out, Output, Recorded, Sensor, Streamed, Uniform
from skywright.vehicle.plant import SAMPLE_RATE, Surface

SAMPLES = 1024
"""Samples of an A-scan at 100 MHz: 30 mm of steel, both ways."""
NEAR = 0.002
"""m, gap of the tip below which A-scans are taken."""
GRASS_CELL = 0.001
"""m, size of a surface patch with the same grass."""


class Ultrasonic(Sensor):
    """Takes A-scans while the tip is at the wall.

    The couplant is squeezed from `film_start_m` at each touch (Stefan). The gimbal lays the face
    flat while force times radius exceeds its friction, within its range.
    """

    class Table(Spec):
        """The defaults are of the class of commercial contact probes; all assumed."""

        rate_hz: float = Field(default=20.0, ge=1.0, le=50.0)
        frequency_mhz: float = Field(default=5.0, ge=0.5, le=20.0)
        face_radius_m: float = Field(default=0.003, ge=0.001, le=0.02)
        separation_m: float = Field(default=0.0, ge=0, le=0.02)  # of a dual probe's halves
        dead_s: float = Field(default=1.2e-7, ge=1e-8, le=1e-5)  # decay of the transmitter
        gain: float = Field(default=1.3, ge=0.001, le=100)  # full screens of a perfect first echo
        noise: float = Field(default=0.004, ge=0, le=1)  # full screens rms
        grass: float = Field(default=0.006, ge=0, le=1)  # full screens rms, fixed at each place
        viscosity_pa_s: float = Field(default=1.0, ge=0.001, le=1000)  # of the couplant
        film_start_m: float = Field(default=0.0005, ge=1e-6, le=0.005)
        film_end_m: float = Field(default=8e-6, ge=1e-7, le=0.001)  # what roughness keeps
        air_fraction: Fraction = 0.02  # of touches that trap air
        share_spread: float = Field(default=0.05, ge=0, le=0.5)  # of the coupled share, a touch
        gimbal_deg: float = Field(default=25.0, ge=0, le=45)  # range; 0: no gimbal
        gimbal_friction_nm: NonNegative = 0.002
        seat_deg: float = Field(default=0.3, ge=0, le=10)  # 1 sigma, of a face that lies flat
        touch_m: Positive = 0.0001  # gap from which the couplant tears

        def build_transducer(self) -> Transducer:
            """Return the probe for its model."""
            return Transducer(
                1e6 * self.frequency_mhz, self.face_radius_m, self.separation_m, dead=self.dead_s,
                gain=self.gain, noise=self.noise, grass=self.grass,
            )  # fmt: skip

    class Me(Record):
        rate: float  # A-scans a sample
        phase: float  # progress towards the next sample
        squeeze: float  # 4 / (3 pi eta a^4) times the time of a sample
        start: float  # 1 / h^2 of a new film
        end: float  # 1 / h^2 at which the roughness is in contact
        touch: float  # m
        air_fraction: float
        share_spread: float
        range: float  # rad, of the gimbal
        friction: float  # N, force that overcomes it
        seat_std: float  # rad
        touching: int
        inverse_square: float  # 1/m^2, of the film
        share: float  # coupled, of this touch
        seat: float  # rad, likewise
        due: int  # 1: an A-scan must be computed
        ready: int  # 1: it is computed
        at: Vec3  # m in W, position of the tip at that time
        when: float  # s
        u: float
        v: float
        film: float
        coupled: float
        tilt: float
        ascan: Annotated[Array, SAMPLES]

    class Touched(Normal):
        share: float
        seat: float

    class Trapped(Uniform):
        air: float

    class Reading(Output):
        fresh: float
        t: float  # s, of the A-scan
        scan: float  # number of A-scans taken
        film: float  # m, true
        share: float  # of the face that is coupled, true; 0: air
        tilt: float  # rad, of the face, true
        u: float  # m, position on the true surface: s, or x of S
        v: float  # m, c, or y of S
        ascan: Annotated[Array, SAMPLES]  # full screen heights at 100 MHz

    columns = (
        Recorded("ut_t", Reading, "t", "s", "time of the last A-scan"),
        Recorded("ut_scan", Reading, "scan", "", "number of A-scans taken"),
        Recorded("ut_film", Reading, "film", "m", "couplant under the probe (true)"),
        Recorded("ut_share", Reading, "share", "", "coupled share of the face (true); 0: air"),
        Recorded("ut_tilt", Reading, "tilt", "rad", "face from the surface (true)"),
        Recorded("ut_u", Reading, "u", "m", "place of the probe: s, or x of S (true)"),
        Recorded("ut_v", Reading, "v", "m", "place of the probe: c, or y of S (true)"),
    )
    streams = (Streamed((Recorded("ascan", Reading, "ascan", "", "full screen heights"),)),)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read wall and couplant.

        Raises InputError for a robot without a probe and for a world without a wall.
        """
        if context.robot.probe is None:
            raise InputError(f"sensor {self.name!r}: robot {context.robot.name!r} has no probe")
        self._wall, self._field = find_wall(context.world, self.name)
        self._transducer, self._world = table.build_transducer(), context.world
        self._seed, self._me = context.seed, me
        me.rate = table.rate_hz / SAMPLE_RATE
        a = table.face_radius_m
        me.squeeze = compute_squeeze(table.viscosity_pa_s, a) / SAMPLE_RATE
        me.start, me.end = table.film_start_m**-2, table.film_end_m**-2
        me.touch, me.air_fraction = table.touch_m, table.air_fraction
        me.share_spread = table.share_spread
        me.range, me.seat_std = math.radians(table.gimbal_deg), math.radians(table.seat_deg)
        me.friction = table.gimbal_friction_nm / a
        me.inverse_square = me.start

    def get_period(self, step: str, context: Any) -> float:
        """Every sample."""
        return 1.0 / SAMPLE_RATE

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Compute the A-scan that is due."""
        me = self._me
        if not me.due:
            return
        me.due, me.ready = 0, 1
        me.u, me.v = find_uv(self._world, np.array(me.at))
        me.ascan[:] = build_ascan(
            self._transducer, self._wall, self._field, self._world, self._seed,
            (me.when, me.film, me.coupled, me.tilt, me.u, me.v),
        )  # fmt: skip

    def save(self) -> Any:
        """Return the seed of the noise of A-scans."""
        return self._seed

    def restore(self, saved: Any) -> None:
        """Restore what `save` returned."""
        self._seed = saved

    def reseed(self, seed: int) -> None:
        """Compute the following A-scans with the noise of another seed."""
        self._seed = seed

    @staticmethod
    def step(
        me: Me, clock: Clock, truth: Truth, surface: Surface, drawn: Touched, trapped: Trapped,
        out: Out[Reading],
    ) -> None:  # fmt: skip
        force = 0.0
        for i in range(3):
            force += truth.f_contact[i] * surface.normal[i]
        if surface.gap > me.touch:
            me.touching, me.inverse_square = 0, me.start
        else:
            if not me.touching:
                me.touching = 1
                me.share = max(1.0 - me.share_spread * abs(drawn.share), 0.0)
                if trapped.air < me.air_fraction:
                    me.share = 0.0
                me.seat = me.seat_std * abs(drawn.seat)
            me.inverse_square = min(me.inverse_square + max(force, 0.0) * me.squeeze, me.end)
        if me.ready:
            me.ready, out.fresh = 0, 1.0
            out.t, out.scan = me.when, out.scan + 1.0
            out.film, out.share, out.tilt = me.film, me.coupled, me.tilt
            out.u, out.v = me.u, me.v
            for i in range(SAMPLES):
                out.ascan[i] = me.ascan[i]
        me.phase += me.rate
        if me.phase < 1.0 - 1e-9 or surface.gap > NEAR:
            return
        me.phase = me.phase - 1.0 if me.phase < 2.0 else 0.0
        me.due, me.when = 1, clock.t
        me.film = 1.0 / math.sqrt(me.inverse_square)
        me.coupled = me.share if me.touching else 0.0
        if me.range > 0.0 and force > me.friction:
            me.tilt = max(surface.tilt - me.range, 0.0) + me.seat
        else:
            me.tilt = surface.tilt
        for i in range(3):
            me.at[i] = truth.p_WT[i]


def find_wall(world: Any, name: str) -> tuple[Wall, WallField]:
    """Return the wall of a world; raises InputError if there is none."""
    walls = [t for t in world.things.values() if isinstance(t, Wall)]
    if not walls:
        raise InputError(
            f"sensor {name!r}: world {world.name!r} has no wall to measure: add "
            '[world.things.NAME] kind = "wall"'
        )
    return walls[0], build_wall_field(walls[0])


def find_uv(world: Any, p_W: Numbers) -> tuple[float, float]:
    """Return the position of a point (3,) m on the pipe (s, c) or structure (x, y of S)."""
    if world.pipe is not None:
        s, c, _ = unroll_points(build_cylinder(world.pipe), p_W[None])
        return float(s[0]), float(c[0])
    x, y, _ = find_place(build_surface(world.structure), p_W).tolist()
    return x, y


def build_ascan(
    transducer: Transducer, wall: Wall, field: WallField, world: Any, seed: int,
    state: tuple[float, float, float, float, float, float],
) -> Numbers:  # fmt: skip
    """Return the A-scan of a state (t, film, share, tilt, u, v); it is deterministic."""
    t, film, share, tilt, u, v = (float(x) for x in state)
    face = build_face(transducer.radius)
    walls, paint = compute_wall(field, u + face[:, 0], v + face[:, 1])
    radius = math.inf
    if world.pipe is not None:
        radius = 0.5 * world.pipe.diameter_m
    elif world.structure is not None and world.structure.radius_m:
        radius = world.structure.radius_m
    coupling = Coupling(
        film, max(share, 1e-3), share == 0.0, tilt, float(np.mean(paint)), wall.roughness_front_m,
        wall.roughness_back_m, radius, wall.velocity_m_per_s,
    )  # fmt: skip
    echoes = compute_echoes(transducer, coupling, walls)
    place = (round(u / GRASS_CELL) * 1000003 + round(v / GRASS_CELL)) % 2**32
    rng = np.random.default_rng([seed, round(1e6 * t)])
    return compute_ascan(transducer, echoes, rng, place_seed=place, samples=SAMPLES)


def rebuild_ascans(
    samples: Samples, table: Ultrasonic.Table, world: Any, seed: int
) -> tuple[Numbers, Numbers, Numbers]:
    """Return the times (k,) s, the A-scans (k, SAMPLES) and the true state of each (k, 6).

    From the recorded columns of a run, in the world that was flown in: they are those of its stream
    (`/sensors/NAME`), without reading it. A state is (t, film, share, tilt, u, v).
    """
    wall, field = find_wall(world, "ultrasonic")
    taken = np.flatnonzero(np.diff(samples["ut_scan"], prepend=0.0) > 0)
    names = ("ut_t", "ut_film", "ut_share", "ut_tilt", "ut_u", "ut_v")
    states = np.stack([np.asarray(samples[n][taken], float) for n in names], axis=1)
    transducer = table.build_transducer()
    scans = [build_ascan(transducer, wall, field, world, seed, tuple(s)) for s in states.tolist()]
    return states[:, 0], np.array(scans).reshape(-1, SAMPLES), states
