"""Age of what a link has delivered: vehicle/link.py keeps packets in order and loses some."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from skywright.description.world.spec import Link

FARTHEST = 8.0  # standard deviations of the jitter after which a packet has arrived


def compute_mean_age(link: Link, tick: float) -> float:
    """Return the mean age (s) of the newest packet that a link has delivered.

    A packet is sent each `tick` (s), arrives not before those sent earlier, or is lost. Its age is
    at least k ticks if one that was sent k ticks ago or earlier is in transit; lost ones in a row
    before it add their ticks.
    """
    n = math.ceil((link.delay_s + FARTHEST * link.jitter_s) / tick) + 1
    ages = tick * np.arange(n + 1) + 1e-9
    delay, jitter, p = link.delay_s, link.jitter_s, link.loss_fraction
    arrived = ndtr((ages - delay) / jitter) if jitter else (ages >= delay).astype(float)
    settled = p + (1.0 - p) * arrived  # not in transit, by its age in ticks
    clear = np.cumprod(settled[::-1])[::-1]  # none of this age or older is in transit
    first = clear.copy()
    first[1:] *= 1.0 - settled[:-1]  # and the next younger one is
    mean, lost = float(np.sum(1.0 - clear)), p / (1.0 - p)
    for k in range(n, -1, -1):
        lost = p / settled[k] * (1.0 + lost) if settled[k] > 0.0 else 0.0  # in a row from age k
        mean += float(first[k]) * lost
    return tick * mean


def compute_age_by_loss(link: Link, tick: float) -> float:
    """Return by how much (s) the lost packets of a link raise the mean age."""
    whole = link.model_copy(update={"loss_fraction": 0.0})
    return compute_mean_age(link, tick) - compute_mean_age(whole, tick)
