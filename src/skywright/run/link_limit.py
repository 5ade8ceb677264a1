"""The delay of a control link that a mission may ask the attitude loop to bear."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.models.rotor_reaction import compute_reaction_times
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.loops import compute_delay_margin


def find_exceeded_delay(setup: Setup[Any]) -> str | None:
    """Say by how much the link's delay exceeds what the attitude loop bears, or return None.

    Laws whose gains account for the delay say nothing here.
    """
    d, link = setup.description, setup.description.world.link
    if link.delay_s + link.jitter_s == 0.0:
        return None
    loop = build_law(d, setup).get_attitude_loop(d.robot)
    if loop is None:
        return None
    rotors, period = setup.rotors, 1.0 / d.robot.control.rate_hz
    weight = float(setup.model["mass0"][0] + setup.model["mass"][0].sum()) * d.world.gravity_mps2
    reaction = float(np.min(compute_reaction_times(rotors, setup.allocator, weight)[:2]))
    # a period of sampling and computing goes off, the rest is shared by both ways
    spare = math.radians(d.mission.link_phase_deg)
    both = compute_delay_margin(loop, rotors.time_constant, spare, reaction) - period
    most, asked = max(0.5 * both, 0.0), compute_arrival(link.delay_s, link.jitter_s, period)
    if asked <= most:
        return None
    return (
        f"world.link has a delay of {1000.0 * asked:.1f} ms each way (delay_s, jitter_s and the "
        f"wait for the next control tick), more than the {1000.0 * most:.1f} ms at which the "
        f"attitude loop of {d.robot.name!r} has a phase margin of {d.mission.link_phase_deg:g} deg "
        "(mission.link_phase_deg); robot.control.attitude_bandwidth_rad_s = "
        f"{loop.bandwidth:g} sets that loop, and a lower one bears more"
    )


def compute_arrival(delay: float, jitter: float, period: float) -> float:
    """Return the mean time (s) from the sending of a packet to the control tick that reads it.

    E[ceil(x / h)] h of x normal: h times the sum of P(x > k h) over k from 0.
    """
    ticks = np.arange(math.ceil((delay + 6.0 * jitter) / period) + 1) * period
    if jitter == 0.0:
        return float(period * np.count_nonzero(ticks < delay - 1e-9))
    late = [0.5 * math.erfc((t - delay) / (math.sqrt(2.0) * jitter)) for t in ticks]
    return period * sum(late)
