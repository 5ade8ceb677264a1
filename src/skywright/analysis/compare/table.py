"""Rows of a comparison, and their verdicts on the trade-offs that the paper states."""

import math
from collections.abc import Sequence

from skywright.analysis.compare.comparison import Row, Side, Statement

ENTRIES: dict[str, tuple[tuple[str, str, str, str], ...]] = {
    "Sensor under a pipe": (
        ("clearance.propellers_m", "propellers and hub to the pipe, least on the way", "m", "high"),
        ("clearance.gear_m", "landing gear to the pipe, least on the way", "m", "high"),
    ),
    "Sensor under a pipe (flown)": (
        ("install.propellers_m", "propellers and hub to the pipe, least", "m", "high"),
        ("install.gear_m", "landing gear to the pipe, least", "m", "high"),
        ("install.force_error_n", "error of 2 N over 5 s, rms", "N", "low"),
        ("install.tip_mm", "tip from a fixed point over 50 s, rms", "mm", "low"),
        ("install.excursion_m", "platform gives way under the push", "m", "low"),
        ("install.swing_decay_s", "swing of 10 deg decays to 1 deg", "s", "low"),
    ),
    "Reach": (
        ("reach.surface_share", "part of the pipe's circumference in reach", "", "high"),
        ("reach.below_share", "part of its lower half", "", "high"),
        ("reach.area_below_m2", "area below the pipe's axis that a hand reaches", "m2", "high"),
        ("access.depth_m", "depth of a hand in a shaft 0.5 m wide", "m", "high"),
        ("access.rotor_diameters", "rotors above the hand, in propeller diameters", "", "high"),
    ),
    "Force on a hand": (
        ("reaction.pitch_m", "torque about pitch for a newton, worst direction", "N m/N", "low"),
        ("reaction.roll_m", "torque about roll, likewise", "N m/N", "low"),
        ("reaction.yaw_m", "torque about yaw, likewise", "N m/N", "low"),
        ("recoil.swing_deg", "passive link turns under 2 N, worst direction", "deg", ""),
        ("recoil.deflection_deg", "largest turn of a sprung joint under 2 N", "deg", "low"),
        ("recoil.tip_mm", "hand gives way under 2 N, worst direction", "mm", "low"),
    ),
    "Collision at 0.5 m/s (flown)": (
        ("impact.peak_torque_nm", "a hand hits: torque on the platform", "N m", "low"),
        ("impact.peak_force_n", "a hand hits: force on the platform", "N", "low"),
        ("impact.contact_force_n", "a hand hits: force on the pad", "N", "low"),
        ("impact.recoil_deg", "a hand hits: platform tilts afterwards", "deg", "low"),
        (
            "impact.stiff_torque_nm",
            "a hand hits, stiff joints: torque on the platform",
            "N m",
            "low",
        ),
        ("impact.link_torque_nm", "the passive link hits: torque on the platform", "N m", ""),
        ("impact.link_force_n", "the passive link hits: force on the platform", "N", ""),
    ),
    "Accuracy in hover (flown)": (
        ("accuracy.tip_calm_mm", "tip from its place in calm air, rms", "mm", "low"),
        ("accuracy.tip_wind_mm", "tip from its place in gusts, mean wind 3 m/s, rms", "mm", "low"),
        ("accuracy.platform_wind_mm", "platform from its place in the same wind, rms", "mm", "low"),
    ),
    "Control": (
        ("control.roll_radps2", "angular acceleration in roll at hover", "rad/s2", "high"),
        ("control.pitch_radps2", "angular acceleration in pitch at hover", "rad/s2", "high"),
        ("control.swing_period_s", "period of the passive link, which nothing drives", "s", ""),
    ),
    "Mass and endurance": (
        ("mass_kg", "flying mass", "kg", "low"),
        ("power.hover_w", "power in hover", "W", "low"),
        ("power.endurance_min", "endurance in hover", "min", "high"),
        ("power.payload_kg", "payload left", "kg", "high"),
    ),
    "Take-off and landing": (
        ("ground.height_m", "rotors above the lowest part, arms at work", "m", "low"),
        ("ground.offset_m", "centre of mass off the rotors' centre on the ground", "m", "low"),
        ("ground.thrust_share", "most loaded rotor at lift-off, share of its limit", "", "low"),
    ),
}
"""All rows by group, in the order of the table: name, title, unit, which value is better."""

STANDARD, LONG = "standard", "long reach"
_ACCURACY = ("accuracy.tip_calm_mm", "accuracy.tip_wind_mm", "recoil.tip_mm")
_CONTROL = ("control.roll_radps2", "control.pitch_radps2", "control.swing_period_s")
_REACH = ("reach.surface_share", "reach.below_share", "reach.area_below_m2")
_CLEAR = ("clearance.propellers_m", "clearance.gear_m")
_SAFE = ("clearance.propellers_m", "impact.peak_torque_nm", "reaction.pitch_m", "reaction.roll_m")
_GROUND = ("ground.height_m", "ground.offset_m", "ground.thrust_share")
TRADE_OFFS = (
    (STANDARD, "more accurate", STANDARD, _ACCURACY),
    (STANDARD, "more controllable", STANDARD, _CONTROL),
    (STANDARD, "smaller workspace", LONG, _REACH),
    (STANDARD, "propellers and landing gear may collide", LONG, _CLEAR),
    (STANDARD, "ground and airflow effects near surfaces", LONG, ()),
    (LONG, "safer", LONG, _SAFE),
    (LONG, "larger workspace", LONG, _REACH),
    (LONG, "access to narrow places", LONG, ("access.depth_m",)),
    (LONG, "less accurate", STANDARD, _ACCURACY),
    (LONG, "heavier", STANDARD, ("mass_kg", "power.endurance_min")),
    (LONG, "harder take-off and landing", STANDARD, _GROUND),
)
"""Suarez 2020, table 3: subject, statement, robot with the better values if it holds, rows.

`skywright reproduce` takes its verdicts on table 3 from here.
"""
UNJUDGED = "rotors near surfaces are not simulated, and a distance alone says nothing of the effect"
HOLDS = {"holds": 1.0, "partly": 0.5, "does not hold": 0.0}


def build_rows(a: Side, b: Side) -> list[Row]:
    """Return the rows in which at least one robot has a value or a note."""
    out = []
    for group, entries in ENTRIES.items():
        for name, title, unit, better in entries:
            values = (a.values.get(name, math.nan), b.values.get(name, math.nan))
            notes = (a.notes.get(name, ""), b.notes.get(name, ""))
            if any(map(math.isfinite, values)) or any(notes):
                out.append(Row(name, title, unit, values, notes, better, group))
    return out


def judge_statements(sides: tuple[Side, Side], rows: Sequence[Row]) -> list[Statement]:
    """Compare the values with the paper's table 3; exactly one robot must have a passive link."""
    hanging = [s.robot.pendulum is not None for s in sides]
    if sum(hanging) != 1:
        which = "both have" if all(hanging) else "neither has"
        why = f"{which} a passive link: table 3 compares a robot without one and a robot with one"
        return [Statement(who, text, "does not apply", why, n) for who, text, _, n in TRADE_OFFS]
    place = {LONG: hanging.index(True), STANDARD: hanging.index(False)}
    by_name = {r.name: r for r in rows}
    return [
        _judge(who, text, place[winner], [by_name[n] for n in names if n in by_name], sides)
        for who, text, winner, names in TRADE_OFFS
    ]


def _judge(
    who: str, text: str, winner: int, rows: Sequence[Row], sides: tuple[Side, Side]
) -> Statement:
    """Compare the robot that the statement favours with the better values of its rows."""
    names = tuple(r.name for r in rows)
    told = [r for r in rows if r.winner is not None]
    for_it = [r for r in told if r.winner == winner]
    if not told:
        reasons = "; ".join(n for r in rows for n in r.notes if n) or "not flown"
        reasons = reasons if names else UNJUDGED
        return Statement(who, text, "not measured", reasons, names)
    verdict = "holds" if len(for_it) == len(told) else "partly" if for_it else "does not hold"
    parts = [
        f"{r.title} {r.write(0)} and {r.write(1)} {r.unit}".rstrip()
        + ("" if r in for_it else " (against it)" if r in told else "")
        for r in rows if any(math.isfinite(v) for v in r.values)
    ]  # fmt: skip
    return Statement(who, text, verdict, "; ".join(parts), names)
