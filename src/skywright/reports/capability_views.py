"""The views of `skywright capability`: each can be drawn, printed, and converted to JSON."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.capability import Capability, check_can_fly, compute_capability
from skywright.models.docked import build_docked
from skywright.models.docked_map import Condition, DockedMap, compute_docked_map
from skywright.models.force_resolution import ForceResolution, compute_force_resolution
from skywright.models.hover_tilt import compute_hover_tilt
from skywright.models.sweep import TiltSweep, compute_tilt_sweep
from skywright.reports.terminal import new_console, new_table, print_capability


class View(NamedTuple):
    """One view."""

    name: str  # name of the figure's file
    to_json: Callable[[], dict[str, Any]]
    write_figure: Callable[[Path], Any]
    print: Callable[[Path], None]


def view_limits(robot: Robot, posture: str, condition: Condition) -> View:
    """Build the view of static limits in free flight; with wind also the remaining hover tilt."""
    check_can_fly(robot)
    found = compute_capability(robot, posture=posture)
    speed, tilt = condition.wind, math.nan
    if speed:
        tilt = _compute_tilt_in_wind(robot, found, condition)

    def write(path: Path) -> None:
        from skywright.reports.capability import write_capability_figure

        write_capability_figure(found, path)

    def to_json() -> dict[str, Any]:
        if not speed:
            return found.to_json()
        toward = condition.wind_toward
        return found.to_json() | {
            "wind_mps": speed,
            "wind_toward_deg": None if toward is None else math.degrees(toward),
            "hover_tilt_in_wind_deg": None if math.isnan(tilt) else math.degrees(tilt),
        }

    def tell(path: Path) -> None:
        print_capability(found, path, (speed, tilt) if speed else None)

    return View(robot.name, to_json, write, tell)


def _compute_tilt_in_wind(robot: Robot, found: Capability, condition: Condition) -> float:
    """Return the smallest hover tilt (rad) in the wind; over all directions if it has none."""
    toward = found.directions if condition.wind_toward is None else [condition.wind_toward]
    winds = [condition.wind * np.array([math.cos(a), math.sin(a), 0.0]) for a in toward]
    return compute_hover_tilt(
        robot, found.q, found.body.gravity, air_density=found.body.air_density,
        wind=np.array(winds),
    )  # fmt: skip


def view_sweep(robot: Robot, posture: str) -> View:
    """Build the view of the limits over the rotors' tilt."""
    if posture == "worst":
        raise InputError("--sweep tilt with --posture worst; valid: extended, folded")
    check_can_fly(robot)
    found = compute_tilt_sweep(robot, posture_name=posture)

    def write(path: Path) -> None:
        from skywright.reports.sweep import write_sweep_figure

        write_sweep_figure(found, path)

    return View(f"{robot.name}-tilt", found.to_json, write, lambda path: _print_sweep(found, path))


def view_docked(robot: Robot, condition: Condition) -> View:
    """Build the view of the arm's press force while the robot is docked."""
    docked = build_docked(robot)
    check_can_fly(robot)
    found = compute_docked_map(docked, condition)
    fine = compute_force_resolution(robot, found.stance.q)

    def write(path: Path) -> None:
        from skywright.reports.docked import write_docked_figure

        write_docked_figure(found, path)

    def to_json() -> dict[str, Any]:
        return {
            **found.to_json(),
            "resolution": None if fine is None else describe_resolution(fine),
        }

    return View(
        f"{robot.name}-docked", to_json, write, lambda path: _print_docked(found, fine, path)
    )


def describe_resolution(fine: ForceResolution) -> dict[str, Any]:
    """Return the force resolution as JSON."""
    return {
        "servo_count_deg": dict(zip(fine.servos, np.degrees(fine.angles).tolist(), strict=True)),
        "force_step_n": dict(zip(fine.servos, fine.steps.tolist(), strict=True)),
        "smallest_force_n": fine.smallest,
        "held_force_rms_n": fine.rms,
        "sensor_step_n": None if math.isnan(fine.sensor_step) else fine.sensor_step,
    }


def _print_sweep(found: TiltSweep, picture: Path) -> None:
    console = new_console()
    table = new_table(
        f"{found.robot} against the tilt of its rotors ({found.mass:.3g} kg)",
        "tilt", "+x", "+y", "-x", "-y", "roll", "pitch", "power", "payload",
    )  # fmt: skip
    own = round(math.degrees(found.own))
    for i, tilt in enumerate(np.degrees(found.tilts).round().astype(int)):
        if tilt % 5 == 0 or tilt == own:
            cells = [f"{f:.2f} N" for f in found.lateral_force[i]]
            cells += [f"{a:.1f} deg" for a in np.degrees(found.hover_tilt[i])]
            cells += [f"{found.hover_power[i]:.0f} W", f"{found.payload[i]:.2f} kg"]
            cells = ["-" if "nan" in cell else cell for cell in cells]
            table.add_row(f"{tilt} deg{' (own)' if tilt == own else ''}", *cells)
    console.print(table)
    console.print(f"picture: {picture}")


def _print_docked(found: DockedMap, fine: ForceResolution | None, picture: Path) -> None:
    from skywright.reports.docked import describe_press

    console = new_console()
    console.print(describe_press(found), style="bold")
    columns = [f"wind {w:g} m/s" for w in found.winds]
    table = new_table(
        f"Largest press of {found.robot}, worst directions ({found.mass:.3g} kg)", "slope", *columns
    )
    for i, slope in enumerate(np.degrees(found.slopes)):
        cells = [f"{f:.1f} N" if math.isfinite(f) else "not docked" for f in found.force[:, i]]
        table.add_row(f"{slope:g} deg", *cells)
    console.print(table)
    x = found.contacts
    if len(x):
        console.print(f"the arm reaches contact points {x[0]:.2f} to {x[-1]:.2f} m ahead")
    if fine is not None:
        console.print(
            f"smallest controllable force {fine.smallest:.2f} N (one servo count), "
            f"{fine.rms:.2f} N rms of a held one"
        )
    console.print(f"picture: {picture}")
