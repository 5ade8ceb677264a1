"""Terminal output of the command line: tables on standard output."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from skywright.errors import InputError

if TYPE_CHECKING:
    from skywright.models.capability import Capability
    from skywright.reports.summary import Summary
    from skywright.run.planning import MissionPlan
    from skywright.run.verdict import Verdict


def new_console(*, stderr: bool = False, width: int = 110) -> Console:
    """Return a console without markup; it wraps no lines but those of stderr on a terminal.

    Without a terminal it is `width` characters wide.
    """
    console = Console(stderr=stderr, highlight=False, markup=False, emoji=False)
    console.soft_wrap = not stderr or not console.is_terminal  # a bar on a terminal is cropped
    if not console.is_terminal:
        console.width = width
    return console


def new_table(title: str, *columns: str, right: tuple[str, ...] = ()) -> Table:
    """Return an empty table; the columns in `right` are right-aligned."""
    table = Table(title=title, title_justify="left", title_style="bold", header_style="bold")
    for name in columns:
        table.add_column(name, justify="right" if name in right else "left", overflow="fold")
    table.columns[0].no_wrap = True  # a name with a line break cannot be searched for
    return table


def format_number(value: float | None, unit: str = "") -> str:
    """Format a number with three significant digits and its unit; a missing one is a dash."""
    if value is None or not math.isfinite(value):
        return "-"
    text = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{text} {unit}".rstrip()


def print_result(result: Any) -> None:
    """Print the table of requirements of a run and the paths of its files."""
    from skywright.run.directory import UNFINISHED
    from skywright.run.requirements import NOT_MET

    console = new_console()
    table = new_table(
        "Requirements", "requirement", "value", "limit", "measured in", "", right=("value",)
    )
    for r in result.requirements:
        mark = Text("met", "green") if r.passed else Text("FAILED", "bold red")
        limit = f"{r.sense} {format_number(r.limit, r.unit)}"
        table.add_row(r.name, format_number(r.value, r.unit), limit, r.where, mark)
    for name in result.waived:
        table.add_row(name, "-", "-", "-", Text("not judged", "dim"))
    console.print(table)
    for why in dict.fromkeys(result.waived.values()):
        console.print(f"not judged: {why}")
    failed = sum(not r.passed for r in result.requirements)
    verdict = "all requirements met" if not failed else f"{failed} not met"
    said = not result.reason or result.reason.startswith(NOT_MET)  # already in the table
    reason = "" if said else f" ({result.reason})"
    console.print(f"{result.outcome}{reason}: {verdict}")
    directory = Path(result.directory)
    for name in ("report.html", "replay.html"):
        if (directory / name).is_file():
            console.print(str(directory / name))
    if result.outcome in UNFINISHED:
        console.print(_describe_kept(result))


def _describe_kept(result: Any) -> str:
    """Return how much of an unfinished run its directory holds, as text."""
    from skywright.run.directory import load_run

    flown = float(result.samples["t"][-1]) if len(result.samples) else 0.0
    try:
        kept = load_run(Path(result.directory)).samples["t"]
    except InputError as error:
        return f"the recording cannot be read: {error}"
    end = float(kept[-1]) if len(kept) else 0.0
    rest = f"; the rest of {flown:.2f} s was not written" if end < flown - 0.015 else ""
    return f"{result.directory} holds the recording up to t = {end:.2f} s{rest}"


def print_plan(plan: MissionPlan) -> None:
    """Print the quality of a plan, or what blocks it."""
    console = new_console()
    if not plan.feasible:
        console.print(f"no plan: {plan.blocked_by}", style="bold red")
        return
    table = new_table("Plan", "quantity", "value", right=("value",))
    table.add_row("planned motion", format_number(plan.duration_s, "s"))
    table.add_row("smallest clearance", format_number(plan.min_clearance_m, "m"))
    table.add_row("smallest rotor margin", format_number(plan.min_rotor_margin))
    table.add_row("whole flight (estimate)", format_number(plan.flight_s, "s"))
    if plan.need is not None:
        table.add_row("energy (estimate for hover)", format_number(plan.need.energy_wh, "Wh"))
        table.add_row("batteries needed", format_number(plan.need.batteries))
    for name, what, unit in (
        ("plan.cost", "cost of the path", "m"),
        ("plan.lower_bound", "lower bound of the cost", "m"),
        ("plan.first_solution_s", "first path after", "s"),
    ):  # fmt: skip
        if name in plan.metrics:
            table.add_row(what, format_number(plan.metrics[name], unit))
    table.add_row("planning time", format_number(plan.plan_s, "s"))
    console.print(table)


def print_campaign(verdict: Verdict, folder: Path) -> None:
    """Print the answer of a campaign, its requirements and the paths of the results."""
    console = new_console()
    table = new_table(
        "Requirements", "requirement", "median", "worst", "limit", "failed",
        right=("median", "worst", "failed"),
    )  # fmt: skip
    for h in verdict.headroom:
        failed = Text(f"{h.failures} of {verdict.runs}", "bold red" if h.failures else "green")
        limit = f"{h.sense} {format_number(h.limit, h.unit)}"
        table.add_row(h.name, format_number(h.median), format_number(h.worst), limit, failed)
    console.print(table)
    others = {k: n for k, n in verdict.outcomes.items() if k not in ("succeeded", "failed")}
    if others:
        console.print("not completed: " + ", ".join(f"{n} {k}" for k, n in others.items()))
    if 0 < verdict.flown < verdict.runs:
        rate = verdict.succeeded / verdict.flown
        console.print(f"of the {verdict.flown} runs that took off {rate:.1%} succeeded")
    colour = {"GO": "bold green", "NO-GO": "bold red"}.get(verdict.answer, "bold yellow")
    console.print(Text(f"{verdict.answer}: ", colour) + Text(verdict.headline))
    console.print(verdict.limited_by)
    for name in ("campaign.html", "results.csv"):
        console.print(str(folder / name))


def print_capability(
    capability: Capability, picture: Path, windy: tuple[float, float] | None = None
) -> None:
    """Print the limits of a robot; `windy`: a wind (m/s) and the remaining hover tilt (rad)."""
    console = new_console()
    k = capability
    table = new_table(f"Capability of {k.robot}", "quantity", "value")
    table.add_row("mass", f"{k.body.mass:.3g} kg")
    table.add_row("arm posture", k.posture)
    table.add_row("usable thrust", f"{k.thrust_fraction:.0%} of the largest")
    force = np.asarray(k.lateral_force)
    level = bool(np.nanmax(force) > 1e-6)
    if level:
        worst, best = int(np.nanargmin(force)), int(np.nanargmax(force))
        deg = np.degrees(k.directions)
        table.add_row("sideways force, level", f"{force[worst]:.2f} N toward {deg[worst]:.0f} deg")
        table.add_row("", f"to {force[best]:.2f} N toward {deg[best]:.0f} deg")
        roll, pitch = (math.degrees(t) for t in k.hover_tilt)
        table.add_row("hover tilt limit", f"roll {roll:.1f} deg, pitch {pitch:.1f} deg")
        if windy is not None:
            speed, tilt = windy
            said = (
                "none: it cannot hold its position level"
                if math.isnan(tilt)
                else f"{math.degrees(tilt):.1f} deg"
            )
            table.add_row(f"in {speed:g} m/s of wind", said)
    else:
        table.add_row("sideways force, level", "none: moves by tilting")
    wind = np.asarray(k.wind_limit)
    table.add_row("wind held", f"{np.nanmin(wind):.1f} to {np.nanmax(wind):.1f} m/s")
    table.add_row("hover power", f"{k.hover_power:.0f} W")
    table.add_row("endurance", f"{k.endurance / 60:.1f} min")
    table.add_row("payload", f"{k.payload:.2f} kg")
    console.print(table)
    console.print("hover thrusts: " + ", ".join(f"{t:.2f}" for t in k.hover_thrust) + " N")
    console.print(f"picture: {picture}")


def print_summary(summary: Summary) -> None:
    """Print a summary of `skywright show`."""
    console = new_console()
    console.print(f"{summary.kind} {summary.name}", style="bold")
    console.print(summary.description)
    for section in summary.sections:
        if not section.rows:
            continue
        console.print(f"\n{section.title}", style="bold")
        width = max(len(name) for name, _ in section.rows)
        for name, value in section.rows:
            console.print(f"  {name:{width}}  {value}")
    if summary.assumed:
        count = sum(line.startswith("assumed ") for line in summary.assumed)
        console.print(f"\nAssumed values ({count})", style="bold")
        for line in summary.assumed:
            console.print(f"  {line.removeprefix('assumed ')}")
    if summary.picture:
        console.print(f"\npicture: {summary.picture}")
    if summary.urdf:
        console.print(f"\nURDF: {summary.urdf}")


def print_weld(report: Any, picture: Path) -> None:
    """Print the results of processing an instrument's file."""
    console = new_console()
    found = report.to_json()
    table = new_table("Weld scan", "quantity", "value")
    table.add_row("time in contact", f"{found['contact_fraction']:.0%}")
    table.add_row("crossings", str(len(found["crossings"])))
    line = found["line"]
    if line is None:
        table.add_row("weld line", "none found")
    else:
        point = ", ".join(f"{x:.4f}" for x in line["point_m"])
        table.add_row("line through", f"({point}) m, +- {line['std_offset_m'] * 1000:.1f} mm")
        std = math.hypot(line["std_angle_deg"], found["surface"]["std"]["axis_deg"])
        angle = f"{line['angle_deg']:.2f} deg +- {std:.2f} deg"
        table.add_row("angle from the circumference", angle)
    table.add_row("radius of the surface", f"{found['surface']['radius_m']:.4f} m")
    contrasts = [x for x in found["contrasts"] if x is not None]
    if contrasts:
        times = ", ".join(f"{x:.1f}" for x in contrasts)
        table.add_row("signal over the detection threshold", times)
    for name, value in found["thresholds"].items():
        table.add_row(f"threshold {name}", format_number(value))
    console.print(table)
    for note in found.get("notes", []):
        console.print(f"note: {note}")
    console.print(f"map: {picture}")
