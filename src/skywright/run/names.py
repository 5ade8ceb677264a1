"""Every metric's name, unit and meaning: for requirements, reports and docs.

Here stand the metrics that kinds share; each kind has its own beside what computes them.
"""

from __future__ import annotations

from skywright.core.find import list_kinds
from skywright.run.kind import Measures, load_kind

COMMON: Measures = {
    "flight.duration_s": ("s", "from the start to the motors' stop"),
    "flight.energy_wh": ("Wh", "electrical energy used"),
    "flight.saturated_s": ("s", "time in which the allocation had to cut the command"),
    "estimate.position_rms_mm": ("mm", "rms distance of the estimated from the true position"),
    "estimate.position_max_mm": ("mm", "largest such distance"),
    "estimate.outage_s": ("s", "time without a fix of the localisation, beyond 0.6 s each time"),
    "estimate.outage_max_mm": ("mm", "estimate.position_max_mm meanwhile"),
    "estimate.sigmas": ("", "rms of the error of an axis over what the filter states"),
    "estimate.outage_sigmas": ("", "the same in outages"),
    "contact.lost_s": (
        "s",
        "time without contact while scanning, as the instrument says; in gusts without hops",
    ),
    "contact.collisions": ("", "contacts of anything but the probe's tip"),
    "force.mean_n": ("N", "mean force of the probe on the surface while scanning"),
    "force.min_n": ("N", "smallest force while scanning"),
    "force.max_n": ("N", "largest force while scanning"),
    "force.mean_error_n": ("N", "distance of the mean force from the desired one while it is held"),
    "force.rms_error_n": (
        "N",
        "rms distance of the force from the desired one while it is held; the worst hold",
    ),
    "force.sensor_error_n": ("N", "rms distance of the force sensor from the true force"),
    "tip.hover_rms_mm": (
        "mm",
        "rms distance of the (worse) hand from the point that it tracks while hovering",
    ),
    "tip.hover_max_mm": ("mm", "largest such distance"),
    "platform.hover_rms_mm": ("mm", "rms distance of the platform from its place meanwhile"),
    "platform.tilt_max_deg": ("deg", "largest tilt from level"),
    "plan.cost": ("", "cost (6) of Caballero 2018 of the flown path"),
    "plan.lower_bound": ("", "below which no path's cost can be"),
    "plan.first_solution_s": ("s", "time until the planner had its first path"),
    "plan.clearance_min_m": ("m", "smallest planned distance to anything"),
    "plan.swing_max_deg": ("deg", "largest swing about the equilibrium, as planned"),
    "plan.duration_s": ("s", "planned time of the carrying"),
    "plan.wall_s": ("s", "time that planning took, collision checks included"),
    "plan.min_clearance_m": ("m", "smallest planned distance to anything but the tip's contact"),
    "plan.min_rotor_margin": ("", "smallest share of the thrust range that the plan leaves free"),
    "position.rms_m": ("m", "rms distance of the platform from its planned path"),
    "position.max_m": ("m", "largest such distance"),
    "position.hold_error_m": (
        "m",
        "mean distance from a way-point while it is held, least one where it is passed; the worst",
    ),
    "heading.hold_error_deg": ("deg", "likewise the mean error of the heading"),
    "position.final_error_m": ("m", "mean distance while holding the last way-point"),
}
"""Metric -> unit and meaning."""


def list_measures(kind: str) -> Measures:
    """Return the metrics that missions of a kind may have: metric -> unit and meaning."""
    return {**COMMON, **load_kind(kind).measures}


def list_all_measures() -> Measures:
    """Return the metrics of all kinds; every kind is imported."""
    found = dict(COMMON)
    for kind in list_kinds("kind"):
        found |= load_kind(kind).measures
    return found
