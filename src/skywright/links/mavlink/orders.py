"""Requests of a companion to its vehicle; each is confirmed by the vehicle's heartbeat.

A request returns the reason why it failed, or "".
"""

from __future__ import annotations

from skywright.links.mavlink import modes
from skywright.links.mavlink.link import VehicleLink

SET_MODE, ARM_DISARM = 176, 400
MODE_S, SPIN_S = 2.0, 8.0  # s, time limits for a change of mode and for arming
FRESH_S, DOWN_S = 3.0, 10.0
"""s, time limits for a heartbeat, and for a landing from a few decimetres."""
UNKNOWN = "its heartbeat is missing; it may still be armed: use its own controls"


def choose_mode(link: VehicleLink, mode: modes.Mode) -> str:
    """Change the mode."""
    if link.heard.mode == mode:
        return ""
    says = link.command(SET_MODE, float(modes.CUSTOM), float(mode.main), float(mode.sub))
    if says:
        return f"the vehicle refused {mode}: {says}"
    if not link.wait(lambda h: h.mode == mode, MODE_S):
        return f"the vehicle did not change to {mode}"
    return ""


def arm(link: VehicleLink) -> str:
    """Start the motors."""
    says = link.command(ARM_DISARM, 1.0)
    if not says and not link.wait(lambda h: h.armed, SPIN_S):
        says = f"the vehicle did not arm within {SPIN_S:g} s"
    return says


def land_and_disarm(link: VehicleLink) -> str:
    """Stop the motors of a vehicle that a mission leaves on the ground or just above it.

    A vehicle that a pilot's stick flies is left to the pilot. In a mode other than Offboard it
    keeps its mode and is disarmed, which an autopilot refuses in the air. Returns what was done,
    for the reason of the mission's end, or "" if the motors were off.
    """
    asked = link.clock.now()
    fresh = link.wait(lambda h: h.beat > asked, FRESH_S)
    h = link.heard
    if fresh and not h.armed:
        return ""
    if h.mode in modes.BY_STICK:
        known = f"it is armed, and its mode is {h.mode}: land it with its own controls"
        return known if fresh else UNKNOWN
    says = choose_mode(link, modes.LAND) if h.mode == modes.OFFBOARD else ""
    lands = h.mode == modes.LAND
    if not lands or not link.wait(lambda h: h.beat > asked and not h.armed, DOWN_S):
        says = link.command(ARM_DISARM, 0.0) or says
        link.wait(lambda h: h.beat > asked and not h.armed, MODE_S)
    if h.beat <= asked:
        return UNKNOWN
    if h.armed:
        return f"it is still armed ({says or 'no reason given'}): use its own controls"
    return "its motors were stopped"
