"""The pre-flight checklist: what is looked at before the motors turn, and with the spin check."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.description.mission.safety import Checklist, Fence
from skywright.errors import InputError
from skywright.vehicle.interface import Backend
from skywright.vehicle.readings import Telemetry


class Checked(NamedTuple):
    """One check of the list and its result."""

    name: str
    value: float  # NaN: nothing measures it
    limit: float
    unit: str
    passed: bool
    says: str  # for a message, as `battery 0.15, at least 0.3 required`

    def to_json(self) -> dict[str, Any]:
        """Return plain JSON: a value that is not measured or not finite is null."""
        value = self.value if math.isfinite(self.value) else None
        return {**self._asdict(), "value": value}


def list_checks(checklist: Checklist) -> list[str]:
    """Return the names of the checks, in order."""
    names = ["localisation", "battery", "tilt", "speed", "outside the geofence"]
    return [*names, "spin"] if checklist.spin else names


def run_checklist(checklist: Checklist, b: Backend, fence: Fence | None) -> list[Checked]:
    """Run all checks that do not need the motors; the spin check is `check_rotors`."""
    est = b.estimate
    tilt = math.degrees(math.acos(min(max(float(est["R_WB"][2, 2]), -1.0), 1.0)))
    speed, age = float(np.linalg.norm(est["v_WB"])), b.fix_age if b.localised else math.inf
    outside = -math.inf if fence is None else fence.compute_excess(est["p_WB"].tolist())
    return [
        _at_most("localisation", age, checklist.fix_age_max_s, "s"),
        _at_least("battery", read_charge(b), checklist.battery_min_fraction, ""),
        _at_most("tilt", tilt, checklist.tilt_max_deg, "deg"),
        _at_most("speed", speed, checklist.speed_max_mps, "m/s"),
        _at_most("outside the geofence", outside, 0.0, "m"),
    ]


def check_rotors(checklist: Checklist, b: Backend) -> Checked:
    """Compare the rotors' measured speeds while they turn on the ground."""
    n = len(b.rotors.axis)
    try:
        speed = np.array(b.look(Telemetry).speed)[:n]
    except InputError:
        speed = np.full(n, math.nan)
    if np.all(np.isnan(speed)):
        return Checked(
            "spin", math.nan, checklist.spin_spread_fraction, "", True, "spin not measured"
        )
    middle = float(np.median(speed))
    off = np.abs(speed / middle - 1.0) if middle > 1.0 else np.full(n, math.inf)
    worst = int(np.argmax(off))
    says = (
        f"spin check: rotor {worst + 1} turns at {speed[worst]:.0f} rad/s, the median is "
        f"{middle:.0f} rad/s; limit {checklist.spin_spread_fraction:.0%} from it"
    )
    passed = bool(off[worst] <= checklist.spin_spread_fraction)
    return Checked("spin", float(off[worst]), checklist.spin_spread_fraction, "", passed, says)


def read_charge(b: Backend) -> float:
    """Return the share of the battery's energy that is left, by its gauge; NaN without one."""
    try:
        return float(b.look(Telemetry).charge)
    except InputError:
        return math.nan


def _at_most(name: str, value: float, limit: float, unit: str) -> Checked:
    says = f"{name} {value:.3g} {unit}, at most {limit:g} {unit} allowed".replace(" ,", ",")
    if value == -math.inf:
        says = "the mission sets no geofence"
    return Checked(name, value, limit, unit, value <= limit, says)


def _at_least(name: str, value: float, limit: float, unit: str) -> Checked:
    passed = math.isnan(value) or value >= limit
    says = f"{name} {value:.3g}, at least {limit:g}"
    if math.isnan(value):
        says = f"{name} not measured"
    return Checked(name, value, limit, unit, passed, says)
