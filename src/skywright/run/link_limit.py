"""The delay of a control link that a mission may ask the attitude loop to bear."""

from __future__ import annotations

import math
from typing import Any

from skywright.models.rotors import build_rotors
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.loops import compute_delay_margin

JITTERS = 1.5
"""Standard deviations by which packets that keep their order are later than the mean."""


def find_exceeded_delay(setup: Setup[Any]) -> str | None:
    """Say by how much the link's delay exceeds what the attitude loop bears, or return None.

    Laws whose gains account for the delay say nothing here.
    """
    d, link = setup.description, setup.description.world.link
    asked = link.delay_s + JITTERS * link.jitter_s
    if asked == 0.0:
        return None
    loop = build_law(d, setup).get_attitude_loop(d.robot)
    if loop is None:
        return None
    rotor_tau = build_rotors(d.robot.rotors).time_constant
    period = 1.0 / d.robot.control.rate_hz
    # half a period of sampling and one of computing go off, the rest is shared by both ways
    # with less phase at the crossover the loop rings and saturates the rotors
    spare = d.mission.link_phase_deg
    both = compute_delay_margin(loop, rotor_tau, math.radians(spare)) - 1.5 * period
    most = max(0.5 * both, 0.0)
    if asked <= most:
        return None
    return (
        f"world.link has a delay of {1000.0 * asked:.1f} ms each way (delay_s + {JITTERS:g} "
        f"jitter_s), more than the {1000.0 * most:.1f} ms at which the attitude loop of "
        f"{d.robot.name!r} has a phase margin of {spare:g} deg (mission.link_phase_deg; "
        f"robot.control.attitude_bandwidth_rad_s = {loop.bandwidth:g})"
    )
