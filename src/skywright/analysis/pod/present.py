"""Terminal output of `skywright pod`."""

from __future__ import annotations

from pathlib import Path

from skywright.analysis.pod.groups import Compared
from skywright.analysis.pod.links import CONFIDENCE
from skywright.analysis.pod.pod import Curve, Pod
from skywright.reports.terminal import format_number, new_console, new_table

BOUND_NAMES = {"wald": "Wald", "likelihood": "likelihood ratio"}


def describe_curve(curve: Curve) -> str:
    """Return the model of a curve in words."""
    axes = curve.size_axis + (f"-{curve.signal_axis}" if curve.signal_axis else "")
    link = curve.link if curve.model == "hit-miss" else "censored line"
    return f"{curve.model}, {link}, {axes} axes, bound: {BOUND_NAMES[curve.bounds]}"


def print_pod(pod: Pod, compared: Compared | None, picture: Path | None) -> None:
    """Print sizes, false calls, groups and warnings."""
    console, c, unit = new_console(), pod.curve, pod.unit
    console.print(f"{describe_curve(c)}", style="bold")
    n = pod.counted
    merged = f", {n.passes_merged} further passes merged" if n.passes_merged else ""
    console.print(f"{n.found} of {n.flaws} flaws found{merged}")
    table = new_table("", "", "POD 50 %", "POD 90 %", f"90 % with {CONFIDENCE:.0%} confidence")
    whole = "all flaws" if c.ceiling is None else "total"
    table.add_row(whole, *(_write(v, unit) for v in (c.a50, c.a90, c.a90_95)))
    if c.conditional is not None:
        table.add_row("where contact was held", *(_write(v, unit) for v in c.conditional.values()))
    if compared is not None:
        for name, one in compared.groups.items():
            if isinstance(one, Pod):
                g = one.curve
                cells = (_write(v, unit) for v in (g.a50, g.a90, g.a90_95))
                table.add_row(f"{compared.column} {name} ({one.counted.flaws} flaws)", *cells)
    console.print(table)
    if compared is not None:
        console.print(
            f"one curve for all groups has p = {compared.p_same:.2g} (likelihood-ratio test)",
        )
        for name, one in compared.groups.items():
            if isinstance(one, str):
                console.print(f"{compared.column} {name}: no curve: {one}")
    if c.ceiling is not None:
        console.print(
            f"ceiling {c.ceiling.value:.3f}, at least {c.ceiling.lower:.3f} with "
            f"{CONFIDENCE:.0%} confidence ({c.ceiling.source})",
        )
    if pod.false_calls is not None:
        f = pod.false_calls
        console.print(
            f"false calls: {f.calls} at {f.sites} sites without a flaw, {f.rate:.3f}; at most "
            f"{f.upper_95:.4f} with {CONFIDENCE:.0%} confidence",
        )
    for warning in pod.warnings:
        console.print(f"warning: {warning}")
    if picture is not None:
        console.print(f"picture: {picture}")


def _write(size: float | None, unit: str) -> str:
    return "none" if size is None else format_number(size, unit)
