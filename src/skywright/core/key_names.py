"""Names of keys and their units: messages about unknown keys."""

from __future__ import annotations

import re

from skywright.errors import neighbours

UNITS = {
    "m": "metres",
    "m2": "square metres",
    "kg": "kilograms",
    "kgm2": "kg m^2",
    "s": "seconds",
    "n": "newtons",
    "nm": "newton metres",
    "deg": "degrees",
    "rad": "radians",
    "hz": "hertz",
    "w": "watts",
    "wh": "watt hours",
    "mps": "metres per second",
    "mps2": "m/s^2",
    "rad_s": "radians per second",
    "n_per_m": "newtons per metre",
    "ns_per_m": "newton seconds per metre",
    "n_per_count": "newtons per count",
    "kg_m3": "kg/m^3",
    "s_per_m": "siemens per metre",
    "nm_per_rad": "newton metres per radian",
}
"""Unit suffixes of keys, and their names in messages."""

_FOREIGN_UNIT = re.compile(
    "mm|cm|km|in|ft|um|nm|g|t|lb|gf|kgf|kn|mn|ms|us|min|h|hr|khz|rpm|rps|mwh|kwh|mah|kw|mw|v|"
    "kmh|km_h|kph|mph|knots|kts|m_s|ms2|rads|degs|degrees|grad|percent|pct|n_m|n_mm|nmm|g_cm2|"
    "n_per_mm|deg_s|cm2|mm2|meters|metres|seconds|newtons|hertz"
)


def describe_unknown(name: str, at: str, valid: list[str]) -> str:
    """Return a message about an unknown key: the key with the right unit if any, and neighbours."""
    where = f"{at}.{name}" if at else name
    twin = _find_unit_twin(name, valid)
    if twin is not None:
        field, unit = twin
        return f"unknown key {where}; the key is {field} (in {unit})"
    if not valid:
        return f"unknown key {where}; {at or 'this table'} has no keys"
    return f"unknown key {where}; valid: {neighbours(name, valid)}"


def _find_unit_twin(name: str, valid: list[str]) -> tuple[str, str] | None:
    """Find the key with the same stem and another unit: (key, name of its unit)."""
    for field in sorted(valid, key=len):
        for suffix in sorted(UNITS, key=len, reverse=True):
            if not field.endswith("_" + suffix):
                continue
            stem = field[: -len(suffix) - 1]
            tail = name.removeprefix(stem)
            if tail != name and (
                tail == ""
                or (
                    tail[0] == "_"
                    and (tail[1:] in UNITS or _FOREIGN_UNIT.fullmatch(tail[1:].lower()))
                )
            ):
                return field, UNITS[suffix]
            break
    return None
