"""Every metric's name, unit and meaning: one list for requirements, reports and docs."""

from __future__ import annotations

MEANINGS: dict[str, tuple[str, str]] = {
    "flight.duration_s": ("s", "from the start to the motors' stop"),
    "flight.energy_wh": ("Wh", "electrical energy used"),
    "flight.saturated_s": ("s", "time in which the allocation had to cut the command"),
    "estimate.position_rms_mm": ("mm", "rms distance of the estimated from the true position"),
    "contact.gap_max_mm": (
        "mm",
        "worst air gap between probe and surface while scanning; in gusts without hops",
    ),
    "contact.lost_s": (
        "s",
        "time without contact while scanning, as the instrument says; in gusts without hops",
    ),
    "contact.hops": ("", "times off the surface (gap above 0.1 mm) shorter than 0.05 s"),
    "contact.hop_max_mm": ("mm", "worst air gap of those hops"),
    "contact.off_max_s": ("s", "longest time off the surface, hop or not, rounded up to 0.01 s"),
    "contact.no_force_s": ("s", "time without contact force while scanning (truth)"),
    "contact.tilt_max_deg": ("deg", "worst angle between probe and surface normal while scanning"),
    "contact.duration_s": ("s", "time of the scan"),
    "contact.collisions": ("", "contacts of anything but the probe's tip"),
    "contact.retries": ("", "touches or scans that had to be repeated"),
    "force.mean_n": ("N", "mean force of the probe on the surface while scanning"),
    "force.min_n": ("N", "smallest force while scanning"),
    "force.max_n": ("N", "largest force while scanning"),
    "tip.tangential_rms_mm": ("mm", "rms distance of the tip from its path, along the surface"),
    "tip.tangential_max_mm": ("mm", "largest such distance"),
    "platform.attitude_error_max_deg": ("deg", "largest attitude error while scanning"),
    "platform.offset_rms_mm": (
        "mm",
        "rms distance of the platform from its nominal pose",
    ),
    "platform.tilt_max_deg": ("deg", "largest tilt from level"),
    "touch.attitude_error_max_deg": ("deg", "largest attitude error while touching"),
    "rotors.thrust_max_fraction": ("", "largest rotor thrust over the rotor's limit, scanning"),
    "weld.contact_fraction": ("", "share of the scan in contact, as the instrument says"),
    "weld.crossings": ("", "crossings of the path with the weld at which it was found"),
    "weld.offset_error_mm": (
        "mm",
        "distance between the estimated and the true weld line, at the middle of its crossings",
    ),
    "weld.angle_error_deg": ("deg", "angle between estimated and true weld line"),
    "weld.offset_std_mm": ("mm", "uncertainty of the weld line's offset that the fit states"),
    "weld.angle_std_deg": ("deg", "uncertainty of the weld line's angle that the fit states"),
    "coverage.fraction": ("", "share of the planned path inspected within 1 mm and 10 deg"),
    "plan.wall_s": ("s", "time that planning took, collision checks included"),
    "plan.min_clearance_m": ("m", "smallest planned distance to anything but the tip's contact"),
    "plan.min_rotor_margin": ("", "smallest share of the thrust range that the plan leaves free"),
    "position.rms_m": ("m", "rms distance of the platform from its planned path"),
    "position.max_m": ("m", "largest such distance"),
    "position.final_error_m": ("m", "mean distance while holding the last way-point"),
}
"""Metric -> unit and meaning."""
