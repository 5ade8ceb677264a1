"""Every metric's name, unit and meaning: for requirements, reports and docs.

This module defines the metrics that kinds share; each kind defines its own.
"""

from __future__ import annotations

from skywright.core.find import list_kinds
from skywright.run.kind import Measures, load_kind

COMMON: Measures = {
    "flight.duration_s": (
        "s",
        "duration of the recording: it begins before the motors start and ends after they stop",
    ),
    "flight.energy_wh": ("Wh", "electrical energy used"),
    "flight.saturated_s": (
        "s",
        "time in which the allocation could not realise the commanded wrench; not while a robot "
        "with arms below its gear stands on them",
    ),
    "flight.saturated_max_s": ("s", "longest uninterrupted part of flight.saturated_s"),
    "arm.saturated_s": ("s", "time in which a servo of the arm is at its stall torque"),
    "arm.saturated_max_s": ("s", "longest uninterrupted part of arm.saturated_s"),
    "estimate.position_rms_mm": ("mm", "rms distance of the estimated from the true position"),
    "estimate.position_max_mm": (
        "mm",
        "largest distance of the estimated from the true position",
    ),
    "estimate.outage_s": (
        "s",
        "time without a fix of the localisation; only gaps longer than 0.6 s count",
    ),
    "estimate.outage_max_mm": ("mm", "estimate.position_max_mm during these outages"),
    "estimate.sigmas": (
        "",
        "rms ratio of the position error of an axis to the standard deviation stated by the filter",
    ),
    "estimate.outage_sigmas": ("", "estimate.sigmas during outages"),
    "contact.lost_s": (
        "s",
        "time without contact during the scan, from the instrument's signal; excludes "
        "hops in gusty wind",
    ),
    "contact.collisions": ("", "contacts of any part except the probe's tip"),
    "force.mean_n": ("N", "mean contact force of the probe during the scan"),
    "force.min_n": ("N", "smallest contact force during the scan"),
    "force.max_n": ("N", "largest contact force during the scan"),
    "force.mean_error_n": (
        "N",
        "difference between mean and requested force while the force is held",
    ),
    "force.rms_error_n": (
        "N",
        "rms force error while the force is held; worst hold",
    ),
    "force.sensor_error_n": ("N", "rms error of the force sensor"),
    "tip.hover_rms_mm": (
        "mm",
        "rms distance of a hand from its target point while hovering; the worse hand",
    ),
    "tip.hover_max_mm": ("mm", "largest distance of a hand from its target point while hovering"),
    "platform.hover_rms_mm": (
        "mm",
        "rms distance of the platform from its reference while hovering",
    ),
    "platform.tilt_max_deg": ("deg", "largest tilt of the platform"),
    "plan.cost": ("", "cost of the planned path, equation (6) of Caballero 2018"),
    "plan.lower_bound": ("", "lower bound of the cost of every path"),
    "plan.first_solution_s": ("s", "time until the planner found its first path"),
    "plan.clearance_min_m": (
        "m",
        "smallest planned distance of robot and bar to anything but the robot, on the planner's "
        "path; transports only",
    ),
    "plan.swing_max_deg": ("deg", "largest planned swing about the equilibrium"),
    "plan.duration_s": ("s", "planned duration of the transport"),
    "plan.wall_s": ("s", "duration of planning, including collision checks"),
    "plan.min_clearance_m": (
        "m",
        "smallest planned distance to the world, except the contact of the tip; transports and "
        "plan files: over the motion that is flown, with 0 if parts of the robot touch",
    ),
    "plan.min_rotor_margin": (
        "",
        "smallest distance of a rotor's thrust to its limits, as a fraction of its range",
    ),
    "position.rms_m": ("m", "rms distance of the platform from its planned path"),
    "position.max_m": ("m", "largest distance of the platform from its planned path"),
    "position.hold_error_m": (
        "m",
        "mean distance from a held way-point, or smallest distance from a passed one; "
        "worst way-point",
    ),
    "heading.hold_error_deg": (
        "deg",
        "mean heading error while a way-point is held; worst way-point",
    ),
    "position.final_error_m": ("m", "mean distance from the last way-point that is held"),
    "response.landed": (
        "",
        "1 if the robot came down with running motors after a fault rule acted, 0 if it fell",
    ),
    "response.deviation_max_m": (
        "m",
        "largest distance of the platform from its reference after a fault rule acted; only the "
        "horizontal distance where the platform is above it",
    ),
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
