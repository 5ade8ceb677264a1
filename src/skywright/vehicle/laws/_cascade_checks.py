"""Limits of the cascade: take-off along a link's arc, and the delay of a control link."""

from __future__ import annotations

import math

import numpy as np

from skywright.description.robot.spec import Control
from skywright.models.floating import compute_free_inertia
from skywright.models.link_age import compute_mean_age
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_body, posture
from skywright.vehicle.component import Context
from skywright.vehicle.laws._cascade_gains import CascadeGains, compute_bodies
from skywright.vehicle.link_arc import compute_link_arc
from skywright.vehicle.loops import DELAY_TICKS

FREE_SPARE = math.radians(12.0)
"""rad: 35 deg less the 22 deg that an attitude loop 2.5 times slower costs."""


def compute_borne_delay(g: CascadeGains, c: Control, nominal: Nominal, spare: float) -> float:
    """Return the delay (s) each way with which attitude and rate loop keep `spare` (rad) of phase.

    L(s) = k_rate (1 + k_attitude / s) / (s (1 + lead s)), about roll and pitch. Above the swing
    frequency of a hanging part only the platform turns. The gain is larger there, and the margin is
    at most FREE_SPARE, because FREE_MARGIN of _cascade_gains.py is that of the rate loop alone.
    """
    robot, world = nominal.robot, nominal.world
    free = compute_free_inertia(robot, world, posture(robot, "working"))
    heavier = np.diag(compute_bodies(robot, nominal.model[0])[1]["I_eff"]) / free
    s, both = 1j * np.geomspace(1.0, 1000.0, 4000), math.inf
    for axis in (0, 1):
        for more in (1.0, max(float(heavier[axis]), 1.0)):
            k = more * float(g.k_rate[axis])
            keeps = spare if more == 1.0 else min(spare, FREE_SPARE)
            L = k * (1.0 + float(g.k_attitude[axis]) / s) / (s * (1.0 + g.lead * s))
            at = int(np.argmax(np.abs(L) < 1.0))
            both = min(both, (math.pi + float(np.angle(L[at])) - keeps) / abs(s[at]))
    return max(0.5 * (both - DELAY_TICKS / c.rate_hz), 0.0)


def find_imbalance(gains: CascadeGains, nominal: Context | Nominal) -> str | None:
    """Return a message if the roll loop is too slow for the take-off along a link's arc, or None.

    A robot that stands on the end of its link is an inverted pendulum sideways with an unstable
    pole at sqrt(g / h); the bandwidth of the attitude loop must exceed it.
    """
    robot, world, model = nominal.robot, nominal.world, nominal.model.reshape(1)
    arc = compute_link_arc(robot, model)
    if arc is None:
        return None
    _, com, _ = compute_body(model, posture(robot, "working"))
    falls = math.sqrt(world.gravity_mps2 / (arc.top + com[2]))
    found, rate = float(gains.k_attitude[0]), robot.control.rate_hz
    if found >= falls:
        return None
    age = compute_mean_age(world.link, 1.0 / rate)
    return (
        f"robot.control: at rate_hz = {rate:g} and a mean age of {1000.0 * age:.1f} ms of the "
        f"packets of world.link, the roll loop reaches {found:.2f} rad/s; to take off from the end "
        f"of its link {robot.name!r} requires {falls:.2f} rad/s: raise rate_hz, or lower the "
        "delay, jitter or loss of world.link"
    )
