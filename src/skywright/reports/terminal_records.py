"""What `skywright records` prints for people."""

from collections.abc import Sequence
from pathlib import Path

from skywright.reports.terminal import new_console, new_table
from skywright.run.records import Record


def print_records(records: Sequence[Record], path: Path) -> None:
    """Print the records as a table, and how the force at them changed over the flights."""
    console = new_console()
    flights = list(dict.fromkeys(r.flight for r in records))
    console.print(
        f"{len(records)} measurements of {len(flights)} flights in {path}",
        style="bold", markup=False,
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
