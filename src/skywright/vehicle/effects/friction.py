"""Friction that varies over a pipe: a stationary random field, evaluated at the tip."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Record
from skywright.description.world.spec import Pipe
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Effect, helper, table
from skywright.vehicle.plant import Surface

MODES = 32
NEAR = 0.005  # m, gap up to which the coefficient is updated


class Friction(Effect):
    """Writes the coefficient under the tip into MuJoCo's contact pair `touch`.

    Log-normal: the logarithm is a sum of MODES random Fourier modes of the Gaussian covariance
    exp(-d^2 / (2 l^2)) on the unrolled surface (Rahimi and Recht 2007).
    """

    Table = Pipe

    class Me(Record):
        pair: int  # its place among MuJoCo's contact pairs, which are sorted by bodies
        middle: float
        sigma: float  # of the logarithm
        ks: Annotated[Array, MODES]  # rad/m along the axis
        kc: Annotated[Array, MODES]  # rad/m around it
        phase: Annotated[Array, MODES]

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Draw the field, with the mean and relative deviation of the pipe."""
        rng = context.stream("friction")
        me.pair = context.scene.model.pair("touch").id
        me.middle = table.friction
        me.sigma = math.sqrt(math.log1p(table.friction_variation**2))
        me.ks[:], around = rng.standard_normal((2, MODES)) / table.friction_length_m
        radius = table.diameter_m / 2
        me.kc[:] = np.round(around * radius) / radius  # whole waves: continuous around the pipe
        me.phase[:] = rng.uniform(0.0, 2.0 * math.pi, MODES)

    @staticmethod
    def step(me: Me, surface: Surface, mj: MuJoCo) -> None:
        if surface.gap < NEAR and mj.npair > 0:
            pairs = table(mj.pair_friction, mj.npair, 5)
            mu = max(compute_friction(me, surface.s, surface.c), 1e-4)
            pairs[me.pair, 0] = mu
            pairs[me.pair, 1] = mu

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with a probe in a world with a pipe of varying friction."""
        pipe = context.world.pipe
        if pipe is not None and pipe.friction_variation > 0.0 and context.robot.probe is not None:
            yield cls("friction", pipe)


@helper
def compute_friction(f: Any, s: float, c: float) -> float:
    """Return the friction coefficient at (s, c) m of the unrolled surface."""
    g = 0.0
    for m in range(MODES):
        g += math.cos(f.ks[m] * s + f.kc[m] * c + f.phase[m])
    g *= math.sqrt(2.0 / MODES)
    return float(f.middle * math.exp(f.sigma * g - 0.5 * f.sigma * f.sigma))
