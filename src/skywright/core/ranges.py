"""Plausible range of each number in a description, by the unit in its key.

A key's own bounds (`Field(gt=..., le=...)`) are the limits of its model; these ranges exclude
values that no aerial manipulator has. They apply to the magnitude. Zero is valid if the key's own
bounds permit it, as it means "none". Keys without a unit are in BARE by their name.
"""

from functools import cache

UNITS: dict[str, tuple[float, float]] = {
    **dict.fromkeys(("_n_per_rad2s2", "_n_per_rads_mps"), (1e-9, 1.0)),  # 3 cm to 3 m
    "_nms_per_rad": (1e-7, 1e4),
    "_nm_per_rad": (1e-3, 1e6),  # below: no spring; above: steel of the links
    "_ns_per_m": (1e-4, 1e6),
    "_n_per_m": (0.1, 1e8),  # a rubber band; a steel bar of 2 cm and 1 m
    "_n_per_count": (1e-9, 1e3),
    **dict.fromkeys(("_m_per_sqrt_m", "_m_per_sqrt_s"), (1e-9, 1.0)),
    "_s_per_m": (1e-3, 1e9),  # conductivity
    "_kg_m3": (1e-4, 1e4),  # air on Mars; water
    "_sqrthz": (1e-12, 10.0),
    "_kgm2": (1e-10, 1e3),
    "_rad_s": (1e-9, 1e4),
    "_mps2": (1e-9, 100.0),
    "_mps": (1e-6, 150.0),
    "_rad": (1e-9, 7.0),
    "_deg": (1e-9, 360.0),
    "_nm": (1e-6, 1e4),
    "_m2": (1e-6, 100.0),
    "_kg": (1e-6, 1000.0),
    "_wh": (1e-3, 1e5),
    "_kbps": (1e-3, 1e9),
    **dict.fromkeys(("_hz", "_ms", "_w"), (1e-3, 1e5)),
    "_mm": (1e-6, 1e6),
    "_n": (1e-6, 1e5),
    "_m": (1e-9, 1e4),
    "_s": (1e-6, 1e5),
}
"""Unit at the end of a key, the longest first -> least and largest magnitude."""

BARE: dict[str, tuple[float, float]] = {
    "friction": (1e-6, 5.0),  # of Coulomb; rubber on concrete has 1, sticky rubber 3
    "relative_permeability": (0.1, 1e6),
    **dict.fromkeys(("seed", "scenario_seed"), (0, 2**64)),
    **dict.fromkeys(("limit_count", "noise_count"), (1e-6, 1e6)),
    **dict.fromkeys(("position_damping", "attitude_damping", "force_damping"), (0.01, 100.0)),
    **dict.fromkeys(
        ("flex_damping_ratio", "lateral_damping_ratio", "spring_damping_ratio"), (1e-6, 100.0)
    ),
    **dict.fromkeys(
        ("friction_feed_forward", "range_noise_fraction", "rotor_gain_spread"), (1e-9, 10.0)
    ),
    **dict.fromkeys(("actuators", "conductivity_change", "permeability_change"), (1e-9, 1e6)),
    **dict.fromkeys(("flex_hardening", "loop_separation", "force_gain"), (1e-6, 1e4)),
    **dict.fromkeys(("joint", "rotor"), (1, 100)),
    **dict.fromkeys(("limit", "jump"), (1e-12, 1e9)),  # in the unit of what they limit
    **dict.fromkeys(("p1", "p2", "belt"), (1e-9, 1e4)),  # positions (m), ratios of a belt
}
NAMED: dict[str, tuple[float, float]] = {
    "tilt_max_deg": (1e-3, 89.0),  # beyond, thrust does not carry
    "stall_torque_nm": (1e-3, 1e4),  # the smallest hobby servo has 0.05
    "time_constant_s": (1e-4, 60.0),
    "rate_hz": (0.01, 1e5),
    "dead_s": (1e-9, 1e-3),  # of a pulser's ring-down
}
"""Ends of names that are more specific than the unit."""
PLACES = ("_m", "_mm", "_deg", "_rad", "_xy_kgm2", "_xz_kgm2", "_yz_kgm2")  # products of inertia
OTHERS = (1e-12, 1e9)
"""For keys of users' own tables whose name has no unit."""


@cache
def find_range(key: str) -> tuple[float, float]:
    """Return the least and the largest magnitude of a key's number, by the end of its name.

    For example, `payload_max_kg` has the range of `mass_kg`.
    """
    for ends in (NAMED, UNITS):
        for end, span in ends.items():
            if key.endswith(end):
                return span
    return BARE.get(key, OTHERS)


def check_range(key: str, value: object, may_vanish: bool = False) -> None:
    """Raise ValueError if a number, or one in a list, is outside the key's range.

    If it `may_vanish`, a position, angle or product has no lower bound: cos(pi / 2) gives 6e-17.
    """
    for number in value if isinstance(value, list) else [value]:
        if isinstance(number, float | int) and not isinstance(number, bool) and number:
            low, high = find_range(key)
            if may_vanish and key.endswith(PLACES):
                low = 0.0
            if not low <= abs(number) <= high:
                shown = "a number beyond 1e308" if abs(number) > 1e308 else f"{number:g}"
                raise ValueError(f"{shown} is implausible; valid: {low:g} to {high:g}")
