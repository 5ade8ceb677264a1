"""Every measure by name: (records by role) -> what was measured, and the figure that shows it."""

from __future__ import annotations

from collections.abc import Callable

from skywright.studies.reproduce import measures_arm, measures_f550, measures_locate, measures_scan
from skywright.studies.reproduce.measured import Measured, Records

MEASURES: dict[str, Callable[[Records], Measured]] = {
    "contact": measures_scan.measure_contact,
    "air_gap": measures_scan.measure_air_gap,
    "probe_tilt": measures_scan.measure_probe_tilt,
    "platform_offset": measures_scan.measure_platform_offset,
    "touch_down": measures_scan.measure_touch_down,
    "weld_crossings": measures_scan.measure_weld,
    "weld_line": measures_scan.measure_weld,
    "degraded": measures_scan.measure_degraded,
    "planning": measures_scan.measure_planning,
    "normal_error": measures_scan.measure_normal_error,
    "joint_space": measures_arm.measure_joint_space,
    "vibration": measures_arm.measure_vibration,
    "reduced_tip_only": measures_arm.measure_reduced_tip_only,
    "reduced_displaced": measures_arm.measure_reduced_displaced,
    "stability_map": measures_arm.measure_stability_map,
    "spared_arm": measures_arm.measure_spared_arm,
    "lateral_force": measures_f550.measure_lateral_force,
    "hover_tilt": measures_f550.measure_hover_tilt,
    "payload": measures_f550.measure_payload,
    "mixer": measures_f550.measure_mixer,
    "model": measures_f550.measure_model,
    "camera_alignment": measures_locate.measure_alignment,
    "station_outage": measures_locate.measure_outage,
    "station_rejoin": measures_locate.measure_rejoin,
    "nominal_localisation": measures_locate.measure_nominal,
    "climb": measures_locate.measure_climb,
    "revisit": measures_locate.measure_revisit,
}
