"""Terminal output of `skywright records`."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from skywright.inspection.history.corrosion import MERGE_DAYS, Location, Rate
from skywright.inspection.history.entries import StoredIndication, StoredReading
from skywright.inspection.history.registration import Registration
from skywright.reports.terminal import format_number, new_console, new_table
from skywright.run.records import Record


def print_records(records: Sequence[Record], path: Path) -> None:
    """Print the records as a table."""
    console = new_console()
    flights = list(dict.fromkeys(r.flight for r in records))
    console.print(
        f"{len(records)} measurements of {len(flights)} flights in {path}",
        style="bold",
    )  # fmt: skip
    if not records:
        return
    table = new_table(
        "", "UTC", "flight", "structure", "spot", "how", "x, y (m)", "asked (N)", "force (N)",
        "± mm",
    )  # fmt: skip
    for r in records:
        known = "-" if r.pose_std_m is None else f"{1e3 * r.pose_std_m:.1f}"
        table.add_row(
            r.time_utc[5:19].replace("T", " "), r.flight, r.structure, r.spot, r.how,
            f"{r.x_m:.3f}, {r.y_m:.3f}", f"{r.force_des_n:g}",
            f"{r.force_n:.2f} ± {r.force_std_n:.2f}", known,
        )  # fmt: skip
    console.print(table)


def print_history(places: Sequence[Location], path: Path) -> None:
    """Print thickness, rates and remaining life of each location, a table for each structure.

    The notes of the locations follow. A location without a valid reading has dashes.
    """
    console = new_console()
    console.print(f"{len(places)} locations in {path}", style="bold")
    if not places:
        return
    for asset in dict.fromkeys(p.asset for p in places):
        console.print(_build_history_table(asset, [p for p in places if p.asset == asset]))
    console.print("± is one standard deviation; “at least” takes the rate's upper 95 % bound")
    console.print(f"readings of a location within {MERGE_DAYS:g} days are one inspection")
    for p in places:
        for note in p.notes:
            console.print(f"{p.asset} {p.component} {p.name}: {note}")


def _build_history_table(asset: str, places: Sequence[Location]) -> Table:
    simulated = any(one.simulated for p in places for one in p.inspections)
    table = new_table(
        f"{asset}, SIMULATED" if simulated else asset, "location", "times", "thickness (mm)",
        "long term (mm/a)", "short term (mm/a)", "life (a)", "at least", "interval",
    )  # fmt: skip
    for p in places:
        last = p.inspections[-1] if p.inspections else None
        lows = [r.life_low_years for r in (p.long_term, p.short_term) if r is not None]
        low = min((v for v in lows if v is not None), default=None)
        table.add_row(
            f"{p.component} {p.name}".strip(), str(len(p.inspections)),
            f"{last.thickness_mm:.2f} ± {last.std_mm:.2f}" if last else "-",
            _write_rate(p.long_term), _write_rate(p.short_term), format_number(p.life_years),
            format_number(low), format_number(p.interval_years),
        )  # fmt: skip
    return table


def _write_rate(rate: Rate | None) -> str:
    return "-" if rate is None else f"{rate.mm_per_year:.3f} ± {rate.std_mm_per_year:.3f}"


def print_indications(found: Sequence[StoredIndication], path: Path) -> None:
    """Print the indications with size, position and disposition."""
    console = new_console()
    console.print(f"{len(found)} indications in {path}", style="bold")
    if not found:
        return
    table = new_table(
        "SIMULATED" if any(i.simulated for i in found) else "", "id", "kind", "x, y, z (m)",
        "± mm", "length (mm)", "depth (mm)", "disposition",
    )  # fmt: skip
    for i in found:
        one = i.indication
        place = "-" if one.place_u95_m is None else f"{1e3 * one.place_u95_m:.1f}"
        depth = format_number(one.depth_mm)
        if one.depth_mm is not None and one.depth_u95_mm is not None:
            depth += f" ± {one.depth_u95_mm:.2f}"
        table.add_row(
            str(i.id), f"{i.component or ''} {one.kind}".strip(),
            f"{one.x_m:.3f}, {one.y_m:.3f}, {one.z_m:.3f}", place, format_number(one.length_mm),
            depth, i.disposition,
        )  # fmt: skip
    console.print(table)
    for i in found:
        decided = f"; {i.disposition}: {i.decided}" if i.decided else ""
        console.print(f"{i.id}: flight {i.flight}, {i.time_utc}{decided}")


def print_readings(found: Sequence[StoredReading], path: Path) -> None:
    """Print the readings with uncertainty, position and acceptance."""
    console = new_console()
    accepted = sum(r.reading.accepted for r in found)
    console.print(f"{len(found)} readings in {path}, {accepted} accepted", style="bold")
    if not found:
        return
    table = new_table(
        "SIMULATED" if any(r.simulated for r in found) else "", "UTC", "component", "spot",
        "reading", "u95", "x, y, z (m)", "accepted",
    )  # fmt: skip
    for r in found:
        one = r.reading
        table.add_row(
            r.time_utc[:19].replace("T", " "), r.component or "-", one.spot or "-",
            f"{one.quantity} {format_number(one.value, one.unit)}", format_number(one.u95),
            f"{one.x_m:.3f}, {one.y_m:.3f}, {one.z_m:.3f}",
            "yes" if one.accepted else f"no: {one.reason}",
        )  # fmt: skip
    console.print(table)


def print_registrations(found: Mapping[str, Registration | None], asset: str, points: int) -> None:
    """Print the registration of each flight in the frame of its asset, and its notes."""
    console = new_console()
    console.print(f"{points} datum points of {asset}", style="bold")
    table = new_table("", "flight", "common", "shift (mm)", "turn (deg)", "residual (mm)")
    for flight, one in found.items():
        if one is None:
            table.add_row(flight, "0", "-", "-", "-")
            continue
        shift, turn = (1e3 * one.shift).tolist(), np.degrees(one.turn).tolist()
        table.add_row(
            flight, str(one.points), ", ".join(f"{v:.1f}" for v in shift),
            ", ".join(f"{v:.2f}" for v in turn), f"{1e3 * one.residual_m:.2f}",
        )  # fmt: skip
    console.print(table)
    for flight, one in found.items():
        for note in one.notes if one else ():
            console.print(f"{flight}: {note}")
