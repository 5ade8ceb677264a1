"""Measures of Suarez 2020, table 3: benefits and drawbacks of both configurations."""

import numpy as np

from skywright.description.robot.loader import load_robot
from skywright.evidence.reproduce.figures import Bars, ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.evidence.reproduce.measures_bimanual import SHORT, judge_statement, load_sides
from skywright.models.capability import compute_capability
from skywright.models.sweep import strip_robot

PAYLOAD = 3.0  # kg, table 1


def compute_table() -> dict[str, float]:
    """Return the rows of `skywright compare` that concern table 3."""
    near, far = (s.values for s in load_sides())
    diameters = (near["access.rotor_diameters"], far["access.rotor_diameters"])
    values = {
        "roll_ratio": near["control.roll_radps2"] / far["control.roll_radps2"],
        "pitch_ratio": near["control.pitch_radps2"] / far["control.pitch_radps2"],
        "period_s": far["control.swing_period_s"],
        "near_depth_m": near["access.depth_m"], "far_depth_m": far["access.depth_m"],
        "depth_gain_m": far["access.depth_m"] - near["access.depth_m"],
        "near_ground": gain_near_surface(diameters[0]),
        "far_ground": gain_near_surface(diameters[1]),
        "near_diameters": diameters[0], "far_diameters": diameters[1],
        "added_kg": far["mass_kg"] - near["mass_kg"],
        "near_min": near["power.endurance_min"], "far_min": far["power.endurance_min"],
        "near_share": near["ground.thrust_share"], "far_share": far["ground.thrust_share"],
        "near_offset_m": near["ground.offset_m"], "far_offset_m": far["ground.offset_m"],
    }  # fmt: skip
    for side, row in (("near", near), ("far", far)):
        values |= {f"{side}_kg": row["mass_kg"], f"{side}_roll": row["control.roll_radps2"],
                   f"{side}_pitch": row["control.pitch_radps2"]}  # fmt: skip
    return values


def gain_near_surface(diameters: float) -> float:
    """Return the relative thrust gain above a surface (Cheeseman and Bennett 1955)."""
    return 1.0 / (1.0 - (0.125 / diameters) ** 2) - 1.0


def _show(
    title: str, unit: str, groups: dict[str, str], statement: str, limit: str = ""
) -> Measured:
    """Draw near_KEY and far_KEY of both configurations for each KEY in `groups`, and add the
    verdict of `skywright compare` on the statement.
    """
    v = {**compute_table(), "holds": judge_statement(statement)}
    table = np.array([[v[f"near_{key}"], v[f"far_{key}"]] for key in groups])
    bars = Bars(title, unit, list(groups.values()), SHORT, table, [(1.0, limit)] if limit else ())
    return Measured(v, ClaimFigure([bars], "Rows of skywright compare."))


def measure_controllability(records: Records) -> Measured:
    """Angular acceleration from the rotors at hover."""
    groups = {"roll": "roll", "pitch": "pitch"}
    return _show(
        "Angular acceleration that the rotors can give", "rad/s²", groups, "more controllable"
    )


def measure_narrow_access(records: Records) -> Measured:
    """Depth of a hand in a shaft 0.5 m wide."""
    groups = {"depth_m": ""}
    return _show("Depth of a hand in a shaft 0.5 m wide", "m", groups, "access to narrow places")


def measure_weight(records: Records) -> Measured:
    """Flying mass and endurance."""
    groups = {"kg": "mass (kg)", "min": "endurance (min)"}
    return _show("Mass and endurance", "", groups, "heavier")


def measure_take_off(records: Records) -> Measured:
    """Load of the rotors when they carry the whole weight in the posture on the ground."""
    title, groups = "Most loaded rotor at lift-off", {"share": ""}
    return _show(title, "of its limit", groups, "harder take-off and landing", "limit")


def measure_platform(records: Records) -> Measured:
    """Table 1: endurance in hover without arms, with arms and with 3 kg, and the payload."""
    whole, _ = load_robot("bimanual")
    bare = strip_robot(whole)
    mass = bare.platform.mass_kg
    loaded = bare.platform.model_copy(update={"mass_kg": mass + PAYLOAD})
    empty, arms = compute_capability(bare), compute_capability(whole, posture="folded")
    full = compute_capability(bare.model_copy(update={"platform": loaded}))
    most = 6.0 * float(np.max(whole.rotors.thrust_max_n))
    values = {
        "empty_min": empty.endurance / 60.0, "arms_min": arms.endurance / 60.0,
        "loaded_min": full.endurance / 60.0, "payload_kg": empty.payload,
        "empty_kg": empty.body.mass, "arms_kg": arms.body.mass,
        "arms_load_kg": arms.body.mass - empty.body.mass,
        "thrust_share": 9.81 * full.body.mass / most,
    }  # fmt: skip
    bars = Bars(
        "Flight time in hover", "min", ["without arms", "with arms", "with 3 kg"], [""],
        np.array([values["empty_min"], values["arms_min"], values["loaded_min"]])[:, None],
        [(30.0, "Table 1: no load"), (15.0, "nominal load")],
    )  # fmt: skip
    return Measured(values, ClaimFigure([bars], "From the rotors' power and the batteries."))


def measure_ground_effect(records: Records) -> Measured:
    """Thrust gain above the surface that a hand touches."""
    v = compute_table()
    z = np.linspace(0.4, 3.2, 60)
    panel = Panel(
        "Thrust gained over a surface, Cheeseman and Bennett", "height (propeller diameters)", "%",
        [
            Curve("", z, 100.0 * np.array([gain_near_surface(d) for d in z])),
            *(Curve(n, np.array([v[f"{k}_diameters"]]), np.array([100.0 * v[f"{k}_ground"]]),
                    "line+points") for n, k in zip(SHORT, ("near", "far"), strict=True)),
        ], low=0.0,
    )  # fmt: skip
    return Measured(v, ClaimFigure([panel], "A single rotor above level ground.", across=1))
