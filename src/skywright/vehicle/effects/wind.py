"""Air velocity around the robot: steady wind, the jet of a fan, Dryden turbulence.

Gusts are linear filters of unit white noise in exact discretisation, so their variance does not
depend on the control rate. The forces of the air on the robot are in drag.py and limb_drag.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Mat3, Record, Vec3
from skywright.core.rotations import mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_ROTORS
from skywright.description.world.spec import Wind as WindTable
from skywright.description.world.wind import (
    compute_direction,
    compute_dryden_scales,
    compute_mean_wind,
    compute_speed,
    jet_velocity,
)
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import Component, Draws, Effect, Normal, Out, helper
from skywright.vehicle.plant import Wind

STILL, STEADY, FAN, DRYDEN = 0, 1, 2, 3
KINDS = {"none": STILL, "steady": STEADY, "fan": FAN, "dryden": DRYDEN}
POINTS = MAX_ROTORS + 1  # the body and all rotors
NOISE = 3 * POINTS  # normal numbers per control tick at most
SLOWEST = 0.1  # least speed over that of the fan, for the time in which eddies pass


class WindField(Effect):
    """Fills Wind for the next tick."""

    Table = WindTable

    class Me(Record):
        kind: int
        still_W: Vec3  # m/s, uniform mean wind
        R_WG: Mat3  # gust axes: along the mean wind, horizontally across it, and normal to both
        n: int  # rotors
        rotor_p: Annotated[Array, MAX_ROTORS, 3]  # m
        # fan
        place: Vec3
        diameter: float
        speed: float  # m/s at the outlet
        turbulence: float
        eddy_length: float  # m
        sweep: float  # rad
        sweep_rate: float  # rad/s of the phase
        sweep_phase: float  # rad at t = 0
        mix: Annotated[Array, POINTS, POINTS]  # lower Cholesky factor of the points' correlation
        eddy: Annotated[Array, POINTS, 3]  # unit variance
        # Dryden, one filter per axis: x+ = phi x + noise w, gust = out x
        phi: Annotated[Array, 3, 2, 2]
        noise: Annotated[Array, 3, 2, 2]  # lower triangle
        out: Annotated[Array, 3, 2]
        gust: Annotated[Array, 3, 2]

    class Gusts(Normal):
        stream = "wind"
        w: Annotated[Array, NOISE]

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Draw the stationary initial turbulence, and the initial phase of the fan's sweep."""
        rng, rotor_p = context.stream("wind_start"), context.rotors.position
        me.kind, me.n = KINDS[table.kind], len(rotor_p)
        me.rotor_p[: me.n], self._n_rotors = rotor_p, me.n
        along, speed = compute_direction(table), compute_speed(table)
        level = np.array([-along[1], along[0], 0.0])
        size = float(np.linalg.norm(level))
        across = level / size if size > 1e-9 else np.array([0.0, 1.0, 0.0])
        me.R_WG[:] = np.column_stack([along, across, np.cross(along, across)])
        if me.kind == FAN:
            self._build_fan(me, table.fan, speed, rng)
            return
        me.still_W[:] = compute_mean_wind(table, np.zeros((1, 3)))[0]
        wind = context.records.get((Wind, ""))
        if wind is not None:
            wind[0]["body_W"] = me.still_W
        if me.kind == DRYDEN:
            scales = compute_dryden_scales(table)
            lags = scales.length / max(speed, 1e-9)  # almost frozen turbulence without wind
            for axis in range(3):
                me.phi[axis], me.noise[axis], me.out[axis] = build_dryden_filter(
                    float(scales.sigma[axis]), float(lags[axis]), context.dt, axis == 0
                )
            start = np.where(
                [[True, False], [True, True], [True, True]], [[1.0], [0.5], [0.5]], 0.0
            )
            me.gust[:] = start * rng.standard_normal((3, 2))  # stationary standard deviations

    def _build_fan(self, me: Any, fan: Any, speed: float, rng: np.random.Generator) -> None:
        me.place[:] = [fan.x_m, fan.y_m, fan.z_m]
        me.diameter, me.speed = fan.diameter_m, speed
        me.turbulence, me.eddy_length = fan.turbulence, fan.turbulence_length_m
        me.sweep = math.radians(fan.sweep_deg)
        me.sweep_rate = 2.0 * math.pi / fan.sweep_period_s
        me.sweep_phase = rng.uniform(0.0, 2.0 * math.pi)
        points = np.vstack([np.zeros(3), me.rotor_p[: me.n]])
        n = len(points)
        apart = np.linalg.norm(points[:, None] - points[None], axis=2)
        mix = np.linalg.cholesky(np.exp(-apart / fan.turbulence_length_m) + 1e-12 * np.eye(n))
        me.mix[:n, :n] = mix
        me.eddy[:n] = mix @ rng.standard_normal((n, 3))

    def draw(self, what: type[Draws], rng: np.random.Generator, n: int) -> Array:
        """Draw the random numbers that this kind of wind uses; the others are zero."""
        used = {"fan": 3 * (self._n_rotors + 1), "dryden": 6}.get(self.table.kind, 0)
        out = np.zeros((n, NOISE))
        out[:, :used] = rng.standard_normal((n, used))
        return out

    @staticmethod
    def step(me: Me, clock: Clock, truth: Truth, gusts: Gusts, wind: Out[Wind]) -> None:
        if me.kind == FAN:
            wind.varies = 1
            blow_jet(me, wind, gusts.w, clock.t, clock.dt, truth.p_WB, truth.R_WB)
        elif me.kind == DRYDEN:
            blow_gusts(me, wind, gusts.w)
        else:
            for i in range(3):
                wind.body_W[i] = me.still_W[i]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has this effect."""
        yield cls("wind", context.world.wind)


def build_dryden_filter(
    sigma: float, lag: float, dt: float, longitudinal: bool
) -> tuple[Array, Array, Array]:
    """Return (phi (2, 2), noise (2, 2), out (2,)) of one exactly discretised Dryden filter.

    `lag` is T = L / V (s). The filters of MIL-F-8785C, driven by unit white noise, are
    H_u = sigma sqrt(2 T) / (1 + T s) and H_v = H_w = sigma sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2.
    The second with the states z1' = z2 / T, z2' = -(z1 + 2 z2) / T + w / sqrt(T) and the output
    sigma (z1 + sqrt(3) z2) has the stationary variance 1/4 of each state, and thus the rms sigma.
    """
    h = dt / lag
    if longitudinal:
        a = math.exp(-h)
        return (
            np.diag([a, 0.0]),
            np.diag([math.sqrt(-math.expm1(-2.0 * h)), 0.0]),
            np.array([sigma, 0.0]),
        )
    phi = math.exp(-h) * np.array([[1.0 + h, h], [-h, 1.0 - h]])
    # covariance of the noise over one tick, by quadrature; the closed form suffers cancellation
    x, weight = np.polynomial.legendre.leggauss(16)
    s, weight = 0.5 * h * (x + 1.0), 0.5 * h * weight
    g = np.exp(-s) * np.stack([s, 1.0 - s])
    covariance = (g * weight) @ g.T
    return phi, np.linalg.cholesky(covariance), sigma * np.array([1.0, math.sqrt(3.0)])


@helper
def blow_gusts(me: Any, wind: Any, w: Any) -> None:
    """Advance the Dryden gusts (frozen turbulence), uniform over the robot because L is metres."""
    gust, gust_W = local(3), local(3)
    for a in range(3):
        x0, x1 = me.gust[a, 0], me.gust[a, 1]
        n0, n1 = w[2 * a], w[2 * a + 1]
        me.gust[a, 0] = me.phi[a, 0, 0] * x0 + me.phi[a, 0, 1] * x1 + me.noise[a, 0, 0] * n0
        me.gust[a, 1] = (
            me.phi[a, 1, 0] * x0 + me.phi[a, 1, 1] * x1 + me.noise[a, 1, 0] * n0
            + me.noise[a, 1, 1] * n1
        )  # fmt: skip
        gust[a] = me.out[a, 0] * me.gust[a, 0] + me.out[a, 1] * me.gust[a, 1]
    mat_vec(me.R_WG, gust, gust_W)
    for i in range(3):
        wind.body_W[i] = me.still_W[i] + gust_W[i]


@helper
def blow_jet(me: Any, wind: Any, w: Any, t: float, dt: float, p_WB: Any, R_WB: Any) -> None:
    """Fill the velocity of the jet and its eddies at the body and at every rotor.

    The eddies are an Ornstein-Uhlenbeck process with the time L / U in which they pass, correlated
    over the robot as exp(-distance / L), and scaled with the local mean speed.
    """
    angle = me.sweep * math.sin(me.sweep_rate * t + me.sweep_phase)
    c, s = math.cos(angle), math.sin(angle)
    axis, p, v = local(3), local(3), local(3)
    axis[0] = c * me.R_WG[0, 0] - s * me.R_WG[1, 0]
    axis[1] = s * me.R_WG[0, 0] + c * me.R_WG[1, 0]
    axis[2] = me.R_WG[2, 0]
    decay = grow = 0.0
    for k in range(me.n + 1):
        for i in range(3):
            p[i] = p_WB[i]
            if k > 0:
                for j in range(3):
                    p[i] += R_WB[i, j] * me.rotor_p[k - 1, j]
        jet_velocity(me.place, axis, me.diameter, me.speed, p, v)
        speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if k == 0:
            passing = max(speed, SLOWEST * me.speed) / me.eddy_length
            decay = math.exp(-passing * dt)
            grow = math.sqrt(1.0 - decay * decay)
        for i in range(3):
            mixed = 0.0
            for m in range(k + 1):
                mixed += me.mix[k, m] * w[3 * m + i]
            me.eddy[k, i] = decay * me.eddy[k, i] + grow * mixed
            gusty = v[i] + me.turbulence * speed * me.eddy[k, i]
            if k == 0:
                wind.body_W[i] = gusty
            else:
                wind.rotor_W[k - 1, i] = gusty
