"""Largest press of a docked robot against slope, wind and contact point: tables and pictures."""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.docked import (
    DockedPress,
    DockedRobot,
    Stance,
    compute_docked_press,
    find_stance,
)
from skywright.models.wind import FASTEST

DIRECTIONS = np.radians(np.arange(0.0, 360.0, 45.0))
SLOPES_DEG = (0.0, 5.0, 10.0)
WINDS = (0.0, 3.0, 6.0)  # m/s
STEP = 0.02  # m, between contact points
REACH = 1.0  # m, range of the search for contact points


class Condition(NamedTuple):
    """A condition of a docked robot; for a direction of None, the worst of eight is used."""

    slope: float = 0.0  # rad
    slope_toward: float | None = None  # rad, where the surface rises
    wind: float = 0.0  # m/s
    wind_toward: float | None = None  # rad
    contact: tuple[float, float] | None = None  # m in B; None: the working posture's tip


def parse_condition(
    slope: float = 0.0,
    slope_toward: float | None = None,
    wind: float = 0.0,
    wind_toward: float | None = None,
    contact: str | None = None,
    *,
    named: str = "contact",
) -> Condition:
    """Build a condition from degrees, m/s and "X,Y"; raises InputError for values out of range."""
    for flag, value in (("slope-toward", slope_toward), ("wind-toward", wind_toward)):
        if value is not None and not math.isfinite(value):
            raise InputError(f"--{flag} {value}: give a finite angle in deg")
    if not 0.0 <= slope < 90.0:
        raise InputError(f"--slope {slope:g}; valid: 0 to below 90 deg")
    if not 0.0 <= wind <= FASTEST:
        raise InputError(f"--wind {wind:g}; valid: 0 to {FASTEST:g} m/s")
    point = None
    if contact is not None:
        try:
            x, y = (float(part) for part in contact.split(","))
        except ValueError:
            x = y = math.nan
        if not (math.isfinite(x) and math.isfinite(y)):
            raise InputError(f"--{named} {contact!r}: give two numbers X,Y in m, e.g. 0.2,0")
        point = (x, y)
    return Condition(
        math.radians(slope),
        None if slope_toward is None else math.radians(slope_toward),
        wind,
        None if wind_toward is None else math.radians(wind_toward),
        point,
    )


class DockedMap(NamedTuple):
    """Largest press against the conditions. s slopes, w winds, d directions, k contact points."""

    robot: str
    mass: float  # kg
    thrust_fraction: float
    stance: Stance
    condition: Condition  # the requested condition
    asked: DockedPress  # its result
    slopes: Array  # (s,) rad
    winds: Array  # (w,) m/s
    force: Array  # (w, s) N, the least over all directions of slope and wind
    directions: Array  # (d,) rad
    force_toward: Array  # (s, d) N, calm air, against the direction in which the slope rises
    contacts: Array  # (k,) m, x of contact points that the arm reaches ahead
    force_at: Array  # (s, k) N, calm air, worst direction of the slope
    feet: Array  # (n, 3) m

    def to_json(self) -> dict[str, Any]:
        """Return the command line's `--json` object; NaN (cannot stay docked) is null."""
        a, s, c = self.asked, self.stance, self.condition
        return {
            "robot": self.robot,
            "mass_kg": self.mass,
            "thrust_fraction": self.thrust_fraction,
            "condition": {
                "slope_deg": math.degrees(c.slope),
                "slope_toward_deg": _degrees(c.slope_toward),
                "wind_mps": c.wind,
                "wind_toward_deg": _degrees(c.wind_toward),
                "contact_m": s.tip[:2].tolist(),
            },
            "force_n": _number(a.force),
            "limit": a.limit,
            "thrust_n": _numbers(a.thrust),
            "foot_load_n": _numbers(a.foot_load),
            "foot_friction": _numbers(a.foot_friction),
            "posture_deg": np.degrees(s.q).tolist(),
            "slider_lean_deg": math.degrees(s.lean),
            "slopes_deg": np.degrees(self.slopes).round(9).tolist(),
            "winds_mps": self.winds.tolist(),
            "worst_force_n": [_numbers(row) for row in self.force],
            "directions_deg": np.degrees(self.directions).round(9).tolist(),
            "force_toward_n": [_numbers(row) for row in self.force_toward],
            "contacts_m": self.contacts.round(9).tolist(),
            "force_at_n": [_numbers(row) for row in self.force_at],
        }


def _number(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def _numbers(values: Array) -> list[float | None]:
    return [_number(v) for v in values]


def _degrees(angle: float | None) -> float | str:
    return "worst" if angle is None else math.degrees(angle)


def compute_worst_press(docked: DockedRobot, stance: Stance, c: Condition) -> DockedPress:
    """Return the least of `compute_docked_press` over the directions that are None.

    A condition in which the robot cannot stay docked is the worst. `c.contact` is not used.
    """
    slopes = DIRECTIONS if c.slope_toward is None and c.slope > 0.0 else [c.slope_toward or 0.0]
    winds = DIRECTIONS if c.wind_toward is None and c.wind > 0.0 else [c.wind_toward or 0.0]
    worst: DockedPress | None = None
    for a in slopes:
        for b in winds:
            found = compute_docked_press(
                docked, stance, slope=c.slope, slope_toward=float(a), wind=c.wind,
                wind_toward=float(b),
            )  # fmt: skip
            if math.isnan(found.force):
                return found
            if worst is None or found.force < worst.force:
                worst = found
    assert worst is not None
    return worst


def compute_docked_map(docked: DockedRobot, condition: Condition) -> DockedMap:
    """Compute the requested condition and the maps around it.

    Raises InputError like `find_stance` and `compute_docked_press`.
    """
    stance = find_stance(docked, condition.contact)
    stances = _list_stances(docked, float(stance.tip[1]))
    slopes, winds = np.radians(SLOPES_DEG), np.array(WINDS)

    def worst(at: Stance, slope: float, wind: float = 0.0) -> float:
        return compute_worst_press(docked, at, Condition(slope=slope, wind=wind)).force

    def toward(slope: float, direction: float) -> float:
        return compute_docked_press(docked, stance, slope=slope, slope_toward=direction).force

    return DockedMap(
        robot=docked.robot.name,
        mass=stance.mass,
        thrust_fraction=float(docked.layout.t_max[0] / docked.layout.rotors.thrust_max[0]),
        stance=stance,
        condition=condition,
        asked=compute_worst_press(docked, stance, condition),
        slopes=slopes,
        winds=winds,
        force=np.array([[worst(stance, s, w) for s in slopes] for w in winds]),
        directions=DIRECTIONS,
        force_toward=np.array([[toward(s, d) for d in DIRECTIONS] for s in slopes]),
        contacts=np.array([k.tip[0] for k in stances]),
        force_at=np.array([[worst(k, s) for k in stances] for s in slopes]),
        feet=docked.feet,
    )


def _list_stances(docked: DockedRobot, y: float) -> list[Stance]:
    """Return the reachable contact points on a line ahead, from the centre outwards."""
    found = []
    for x in np.arange(0.0, REACH, STEP):
        try:
            found.append(find_stance(docked, (float(x), y)))
        except InputError:
            if found:
                break  # beyond the arm's reach
    return found
